# SPDX-License-Identifier: GPL-3.0-or-later
"""`stipple apply`: a copy of a capture with the edits that Blender keeps beside a .blend."""

from __future__ import annotations

from pathlib import Path

from .capture_file import CaptureFile
from .cli_notices import Notices
from .edit.edited_copy import write_edited_copy
from .edit.edits_file import read_edits


def run(file: Path, edits_file: Path, out: Path, selected_only: bool, quiet: bool) -> None:
    """Says how many splats the copy has. Raises StippleError as the reading and the writing do."""
    notices = Notices(quiet)
    capture, edits = CaptureFile.open(file), read_edits(edits_file)
    with notices.progress:
        count = write_edited_copy(capture, edits, out, notices.report, selected_only=selected_only)
    if (dropped := capture.splat_count - edits.splat_count) > 0:
        notices.warn([f"{file}: {dropped:,} splats cannot be rendered and were left out."])
    notices.say(f"{out}: {count:,} splats")
