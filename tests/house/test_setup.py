# SPDX-License-Identifier: GPL-3.0-or-later
"""scripts/setup: when it has nothing to do, what it makes anew, and what it says when Python is missing."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from scripts import make_environment


@pytest.fixture
def environment(tmp_path: Path) -> Path:
    """A folder that looks like an environment of this Python to everything but pip."""
    folder = tmp_path / "venv"
    (folder / "bin").mkdir(parents=True)
    (folder / "bin" / "python").symlink_to(sys.executable)
    (folder / "pyvenv.cfg").touch()
    return folder


def test_a_stamp_holds_for_its_tier_and_those_within(environment: Path) -> None:
    (environment / "stamp-dev").write_text(make_environment.fingerprint("dev"))
    assert make_environment.is_ready(environment, "dev") and make_environment.is_ready(environment, "run")
    (environment / "stamp-dev").rename(environment / "stamp-run")
    (environment / "stamp-run").write_text(make_environment.fingerprint("run"))
    assert make_environment.is_ready(environment, "run") and not make_environment.is_ready(environment, "dev")


def test_changed_requirements_and_interruptions_are_noticed(
    environment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, root: Path
) -> None:
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).write_bytes((root / name).read_bytes())
    monkeypatch.setattr(make_environment, "ROOT", tmp_path)
    (environment / "stamp-run").write_text(make_environment.fingerprint("run"))
    assert make_environment.is_ready(environment, "run")
    (environment / make_environment.BROKEN).touch()
    assert not make_environment.is_ready(environment, "run")
    (environment / make_environment.BROKEN).unlink()
    with (tmp_path / "constraints.txt").open("a") as constraints:
        constraints.write("numpy==2.0.0\n")
    assert not make_environment.is_ready(environment, "run")


def test_a_folder_that_is_no_environment_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(SystemExit, match="no Python environment"):
        make_environment.prepare(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.slow
def test_an_interrupted_environment_is_made_anew(environment: Path) -> None:
    (environment / make_environment.BROKEN).touch()
    (environment / "half-a-package").touch()
    make_environment.prepare(environment)
    assert not (environment / "half-a-package").exists()
    assert make_environment.python_of(environment) == sys.version_info[:2]


def test_two_runs_wait_for_each_other(
    environment: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second finds the first's work done; both would install if the lock did not hold."""
    inside, most_inside, installs = 0, 0, 0

    def install(folder: Path, tier: str) -> None:
        nonlocal inside, most_inside, installs
        inside += 1
        most_inside, installs = max(most_inside, inside), installs + 1
        threading.Event().wait(0.3)
        (folder / f"stamp-{tier}").write_text(make_environment.fingerprint(tier))
        inside -= 1

    monkeypatch.setattr(make_environment, "install", install)
    monkeypatch.setattr(sys, "argv", ["make_environment.py", str(environment), "run"])
    runs = [threading.Thread(target=make_environment.main) for _ in range(3)]
    for run in runs:
        run.start()
    for run in runs:
        run.join()
    assert (most_inside, installs) == (1, 1)
    assert capsys.readouterr().out.count("ready after") == 1


def run_setup(root: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": os.environ["PATH"], "HOME": os.environ.get("HOME", "/"), **variables}
    command = ["bash", str(root / "scripts" / "setup"), *arguments]
    return subprocess.run(command, check=False, capture_output=True, text=True, env=environment)


def test_a_missing_python_is_said_in_one_line(root: Path, tmp_path: Path) -> None:
    for tool in ("bash", "dirname", "ls"):
        found = next(Path(folder) / tool for folder in os.environ["PATH"].split(":") if (Path(folder) / tool).exists())
        (tmp_path / tool).symlink_to(found)
    result = run_setup(root, PATH=str(tmp_path), HOME=str(tmp_path), STIPPLE_VENV=str(tmp_path / "none"))
    assert (result.returncode, len(result.stderr.splitlines())) == (1, 1)
    assert "3.13" in result.stderr and "3.11" in result.stderr
    assert not (tmp_path / "none").exists()


def test_the_named_python_is_taken_or_refused(root: Path) -> None:
    found = run_setup(root, "find", STIPPLE_PYTHON=sys.executable)
    assert (found.returncode, found.stdout.strip()) == (0, sys.executable)
    refused = run_setup(root, "find", STIPPLE_PYTHON="/nowhere/python")
    assert (refused.returncode, len(refused.stderr.splitlines())) == (1, 1)
    unknown = run_setup(root, STIPPLE_BLENDER="3.6")
    assert unknown.returncode == 2
