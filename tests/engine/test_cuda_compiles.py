# SPDX-License-Identifier: GPL-3.0-or-later
"""Every kernel compiles for sm_90, with no GPU present."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest
import warp as wp

import stipple.engine
from stipple.scripts import generated_scenes


def modules_with_kernels() -> list[str]:
    """Names of modules that define kernels: the engine's, and those that a benchmark on a GPU runs."""
    names = [info.name for info in pkgutil.walk_packages(stipple.engine.__path__, "stipple.engine.")]
    names += [info.name for info in pkgutil.walk_packages(generated_scenes.__path__, f"{generated_scenes.__name__}.")]
    names += ["stipple.scripts.bench_machine"]
    sources = {name: Path(importlib.util.find_spec(name).origin).read_text() for name in names}  # type: ignore[union-attr, arg-type]
    return sorted(name for name, source in sources.items() if "@wp.kernel" in source)


def test_there_are_kernels_to_compile() -> None:
    assert len(modules_with_kernels()) >= 10


@pytest.mark.parametrize("name", modules_with_kernels())
def test_kernels_compile_for_sm_90(name: str, tmp_path: Path) -> None:
    module = importlib.import_module(name)
    wp.init()
    wp.compile_aot_module(module, arch=90, module_dir=str(tmp_path), use_ptx=False)
    cubins = list(tmp_path.glob("*.sm90.cubin"))
    assert len(cubins) == 1 and cubins[0].stat().st_size > 1000
