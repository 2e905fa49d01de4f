# SPDX-License-Identifier: GPL-3.0-or-later
"""The `stipple` command without Blender: runs it and turns every end into an exit status.

| status | means                                                                          |
|--------|--------------------------------------------------------------------------------|
| 0      | done                                                                           |
| 1      | a problem with a file or a setting: one line `error: …` on the error stream    |
| 2      | a wrong command line: usage on the error stream                                |
| 130    | interrupted: `cancelled`; finished pictures stay, nothing half-written is left |
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from .errors import Cancelled, StippleError


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status; `arguments` are those after the program's name."""
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments))
    except StippleError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        sys.stdout = None  # nobody listens any more; closing it again would complain
        return 1
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}; check the path and the space on the disk.", file=sys.stderr)
        return 1
    except MemoryError:
        print("error: not enough memory; render fewer captures or a smaller picture.", file=sys.stderr)
        return 1
    except (Cancelled, KeyboardInterrupt):
        print("cancelled", file=sys.stderr)
        return 130


def _run(arguments: list[str]) -> int:
    try:
        import click
        import rich  # noqa: F401 - needed later; found missing before anything is done

        from .cli_command import command
    except ModuleNotFoundError as error:
        raise StippleError(f"the command line needs the Python package {error.name}; install it with pip.") from error
    try:
        command.main(arguments, "stipple", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort as error:  # what click makes of Ctrl-C
        raise KeyboardInterrupt from error
    return 0


if __name__ == "__main__":
    sys.exit(main())
