# SPDX-License-Identifier: GPL-3.0-or-later
"""What the `stipple` command says on the error stream while it works."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class Notices:
    """Everything that goes to the error stream while a job runs: the progress bar, and each warning once.

    The bar shows on a terminal only.
    """

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=True, highlight=False, emoji=False)
        self._said: set[str] = set()
        self._quiet = quiet
        self.progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f}%"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=self._console,
            disable=quiet or not self._console.is_terminal,
            transient=True,
            redirect_stdout=sys.stdout.isatty(),  # or a summary that is piped to a file would go to the terminal
        )

        self._task = self.progress.add_task("reading", total=1)

    @property
    def total(self) -> int:
        """Of what the bar counts: pictures, once there are any."""
        return int(self.progress.tasks[0].total or 1)

    def start(self, total: int) -> None:
        """From now on the bar counts `total` pictures."""
        self.progress.reset(self._task, total=total, description="starting")

    def report(self, done: float, text: str) -> None:
        """A `Progress` callback: moves the bar."""
        self.progress.update(self._task, completed=done, description=text)

    def say(self, text: str) -> None:
        """A line that --quiet leaves out."""
        if not self._quiet:
            self._console.print(text, markup=False, soft_wrap=True)

    def warn(self, warnings: Sequence[str]) -> None:
        for warning in warnings:
            if warning not in self._said:
                self._said.add(warning)
                self._console.print(f"warning: {warning}", markup=False, soft_wrap=True)
