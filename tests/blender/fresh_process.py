# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs in a Python process of their own, next to Blender's."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def fresh_python(root: Path, program: str, *arguments: Path, **variables: str) -> str:
    """What a program prints in a process of its own."""
    # bpy puts its own scripts on sys.path; a fresh process must find the module first.
    paths = [str(root), *(path for path in sys.path if "scripts" not in Path(path).parts)]
    environment = dict(os.environ) | {"PYTHONPATH": os.pathsep.join(paths)} | variables
    command = [sys.executable, "-c", program, *map(str, arguments)]
    result = subprocess.run(command, check=False, env=environment, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    return result.stdout
