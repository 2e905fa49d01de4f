# SPDX-License-Identifier: GPL-3.0-or-later
"""Make or complete a virtual environment for this checkout; `scripts/setup` runs it with the Python to build on.

    make_environment.py FOLDER run|dev

A stamp in the environment says what it was made from (pyproject.toml, constraints.txt, the Python, the place of the
checkout), so a second run does nothing. A lock lets one run at a time change it, and an environment whose installation
was interrupted is made anew. Needs nothing but the standard library.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLENDER = "blender-5-3" if os.environ.get("STIPPLE_BLENDER") == "5.3" else "blender"  # else the LTS of this Python
EXTRAS = {"run": BLENDER, "dev": f"{BLENDER},cli,dev"}
BROKEN = "installing"  # a file in the environment while packages are being installed


def fingerprint(tier: str) -> str:
    """Of everything that decides what the environment holds."""
    digest = hashlib.sha256(f"{sys.version_info[:3]} {ROOT} {EXTRAS[tier]}".encode())
    for name in ("pyproject.toml", "constraints.txt"):
        digest.update((ROOT / name).read_bytes())
    return digest.hexdigest()


def is_ready(folder: Path, tier: str) -> bool:
    """True where a stamp of this tier, or of one that holds more, fits the checkout as it is now."""
    if (folder / BROKEN).exists() or not (folder / "bin" / "python").exists():
        return False
    for candidate in ("run", "dev")[("run", "dev").index(tier) :]:
        stamp = folder / f"stamp-{candidate}"
        if stamp.exists() and stamp.read_text() == fingerprint(candidate):
            return True
    return False


def python_of(folder: Path) -> tuple[int, ...]:
    """Version of the environment's Python, () where it does not start."""
    program = [folder / "bin" / "python", "-c", "import sys; print(*sys.version_info[:2])"]
    answer = subprocess.run(program, check=False, capture_output=True, text=True)
    return tuple(int(part) for part in answer.stdout.split())


def prepare(folder: Path) -> None:
    """Leave a working, empty or earlier environment of this Python's version in `folder`."""
    usable = (folder / "bin" / "python").exists() and not (folder / BROKEN).exists()
    if usable and python_of(folder) == sys.version_info[:2]:
        return
    if folder.exists() and not (folder / "pyvenv.cfg").exists() and any(folder.iterdir()):
        sys.exit(f"setup: {folder} exists and is no Python environment; move it away or set STIPPLE_VENV.")
    shutil.rmtree(folder, ignore_errors=True)
    venv.create(folder, with_pip=True, symlinks=True)


def install(folder: Path, tier: str) -> None:
    """Install the checkout, editable, and the tier's packages at the tested versions."""
    for stamp in folder.glob("stamp-*"):
        stamp.unlink()
    (folder / BROKEN).touch()
    # Python compiles what is imported when it is: compiling all of Blender's scripts here would take ten seconds more.
    pip = [folder / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "--quiet"]
    what = ["--constraint", ROOT / "constraints.txt", "--editable", f"{ROOT}[{EXTRAS[tier]}]"]
    if subprocess.run([*pip, "install", "--no-compile", *what], check=False).returncode:
        sys.exit("setup: pip could not install the packages (its message is above); is the network there?")
    (folder / f"stamp-{tier}").write_text(fingerprint(tier))
    (folder / BROKEN).unlink()


def main() -> None:
    folder, tier = Path(sys.argv[1]).absolute(), sys.argv[2]
    if is_ready(folder, tier) and python_of(folder) == sys.version_info[:2]:
        return
    if (folder / BROKEN).exists() and Path(sys.prefix).resolve() == folder.resolve():
        base = str(sys._base_executable)  # type: ignore[attr-defined]
        os.execv(base, [base, *sys.argv])  # an environment cannot be made anew by its own Python
    folder.parent.mkdir(parents=True, exist_ok=True)
    with open(folder.parent / f"{folder.name}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # the system frees it when this process ends, however it ends
        if is_ready(folder, tier):
            return
        start = time.monotonic()
        version = ".".join(map(str, sys.version_info[:2]))
        print(f"setup: installing into {folder.name} (Python {version}, {tier}); about a minute, once …", flush=True)
        prepare(folder)
        install(folder, tier)
        print(f"setup: ready after {time.monotonic() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
