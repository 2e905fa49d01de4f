# SPDX-License-Identifier: GPL-3.0-or-later
"""Starts the desktop program with the built extension and a scenario.

STIPPLE_DESKTOP names a command that starts it, with these arguments:
`--extension ZIP --mount FOLDER --seconds N --out FOLDER -- BLENDER ARGUMENTS`; the zip is the newest of dist/.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 240


class NotHere(Exception):
    """No desktop program, or nothing built to run in it."""


class Failed(Exception):
    """The scenario did not end well; the text is its error and Blender's log."""


def run(script: Path, scenario: str, folder: Path, *arguments: str, seconds: int = SECONDS) -> dict[str, Any]:
    """The results of a scenario of a script that ends in time; raises NotHere or Failed."""
    program = os.environ.get("STIPPLE_DESKTOP")
    zips = sorted((ROOT / "dist").glob("stipple-*-linux_x64.zip"), key=lambda path: path.stat().st_mtime)
    if not program or not zips:
        raise NotHere("STIPPLE_DESKTOP is not set, or dist/ has no extension (scripts/build --platform linux_x64)")
    folder.chmod(0o755)
    for name in ("results.json", "error.txt"):
        (folder / name).unlink(missing_ok=True)
    command = [program, "--extension", str(zips[-1]), "--mount", str(ROOT), "--mount", str(folder)]
    command += [part for path in map(Path, arguments) if path.is_file() for part in ("--mount", str(path.parent))]
    command += ["--seconds", str(seconds), "--shots", str(seconds // 4), "--out", str(folder / "screen"), "--"]
    command += ["--python", str(script), "--", scenario, str(folder), *arguments]
    subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=seconds + 120)
    log = (folder / "screen" / "blender.log").read_text()
    if (folder / "error.txt").exists():
        raise Failed((folder / "error.txt").read_text() + log)
    if not (folder / "results.json").exists() or "Traceback" in log:
        raise Failed(log)
    results: dict[str, Any] = json.loads((folder / "results.json").read_text())
    return results
