# SPDX-License-Identifier: GPL-3.0-or-later
"""The check of the layers passes here, and finds each thing it is there to find."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scripts.check_layers import check_file

HEAD = '# SPDX-License-Identifier: GPL-3.0-or-later\n"""A module."""\n'


def messages(path: str, body: str, head: str = HEAD) -> str:
    return "\n".join(message for _, message in check_file(path, head + body))


def test_this_checkout_passes(root: Path) -> None:
    command = [sys.executable, root / "scripts" / "check_layers.py"]
    result = subprocess.run(command, check=False, capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (0, "")


@pytest.mark.parametrize(
    ("path", "statement"),
    [
        ("engine/film.py", "import bpy"),
        ("engine/film.py", "from mathutils import Matrix"),
        ("engine/film.py", "from .. import addon"),
        ("engine/points/scan.py", "from ...addon.sync import read"),
        ("engine/film.py", "def f():\n    import gpu.types\n"),
        ("engine/film.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import bpy\n"),
        ("engine/film.py", "import stipple.engine.camera"),
        ("addon/sync.py", "from stipple.engine import camera"),
        ("engine/film.py", "import moderngl"),
        ("engine/formats/ply.py", "import warp as wp"),
        ("tests/oracle/blend.py", "from stipple.engine.splats import SplatCloud"),
        ("__init__.py", "import bpy"),
    ],
)
def test_forbidden_imports_are_found(path: str, statement: str) -> None:
    assert "import" in messages(path, statement)


@pytest.mark.parametrize(
    ("path", "statement"),
    [
        ("addon/sync.py", "import bpy\nfrom ..engine import camera\n"),
        ("engine/rays/device.py", "import moderngl"),
        ("engine/points/scan.py", "import warp as wp\nfrom ..device import launch\n"),
        ("tests/blender/test_import.py", "import bpy\nfrom stipple.engine import camera\n"),
        ("engine/film.py", "import warpath\nimport bpython\n"),
    ],
)
def test_allowed_imports_pass(path: str, statement: str) -> None:
    assert messages(path, statement) == ""


def function(lines: int, *, decorator: str = "", comment: str = "", name: str = "f") -> str:
    """Source of a function of `lines` lines."""
    body = "    x = 1\n" * (lines - 1)
    return f"{decorator}def {name}():{comment}\n{body}"


def test_long_functions_are_found_and_excused() -> None:
    assert messages("engine/film.py", function(40)) == ""
    assert "f has 41 lines" in messages("engine/film.py", function(41))
    assert messages("engine/film.py", function(41, comment="  # long: one table")) == ""
    assert messages("engine/film.py", function(80, decorator="@wp.kernel\n")) == ""
    assert messages("engine/film.py", function(80, decorator="@wp.kernel(enable_backward=False)\n")) == ""
    assert "f has 81 lines" in messages("engine/film.py", function(81, decorator="@wp.kernel\n"))


def test_docstrings_and_inner_functions_count_for_themselves() -> None:
    inner = "".join(f"    {line}\n" for line in function(30, name="inner").splitlines())
    documented = 'def f():\n    """A.\n' + "\n" * 30 + '    """\n' + "    x = 1\n" * 20
    assert messages("engine/film.py", "def f():\n" + inner + "    x = 1\n" * 20) == ""
    assert messages("engine/film.py", documented) == ""
    assert "inner has 41" in messages("engine/film.py", "def f():\n" + inner + "        x = 1\n" * 11)


def test_long_files_missing_heads_and_vague_names_are_found() -> None:
    assert messages("engine/film.py", "x = 1\n" * 298) == ""
    assert "has 301 lines" in messages("engine/film.py", "x = 1\n" * 299)
    assert "SPDX" in messages("engine/film.py", "", head='"""A module."""\n')
    assert "docstring" in messages("engine/film.py", "", head=HEAD.splitlines()[0] + "\n")
    assert "name" in messages("engine/utils.py", "")
    assert "name" in messages("engine/helpers/one.py", "")
