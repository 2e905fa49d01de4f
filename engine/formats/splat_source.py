# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture's file, opened: what its header says, and its splats in chunks, for files larger than memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import StippleError
from ..memory import gibibytes, host_free_bytes
from ..progress import Progress
from ..splats import ARRAY_NAMES, SplatChunk, SplatCloud, full_bytes_per_splat
from .splat_format import LoadedSplats

CHUNK_BYTES = 1 << 25  # of a chunk with all its arrays; what is read at one time is far less
REASONS_SHOWN = 5


@dataclass
class Dropped:
    """The splats that a reading has left out: how many, and how many each reason spoils."""

    count: int = 0
    reasons: Counter[str] = field(default_factory=Counter)

    def __str__(self) -> str:
        shown = [f"{reason} in {count:,}" for reason, count in sorted(self.reasons.items(), key=lambda item: -item[1])]
        more = len(shown) - REASONS_SHOWN
        return ", ".join(shown[:REASONS_SHOWN]) + (f" and {more} more" if more > 0 else "")

    def warnings(self, path: Path, splat_count: int) -> tuple[str, ...]:
        """A sentence about what was left out of a file's splats, if anything was."""
        return (f"{path}: {self.count:,} of {splat_count:,} splats were left out: {self}.",) if self.count else ()


class SplatSource(ABC):
    """One file of splats. Opening it has read its header only, and holds nothing open.

    - `splat_count`: of the file, those that cannot be rendered included.
    - `sh_degree`: 0 to 4.
    """

    def __init__(self, path: Path, splat_count: int, sh_degree: int) -> None:
        self.path, self.splat_count, self.sh_degree = path, splat_count, sh_degree

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def nbytes(self) -> int:
        """What `read` takes [bytes]."""
        return self.splat_count * full_bytes_per_splat(self.sh_degree)

    @abstractmethod
    def chunks(
        self,
        arrays: Collection[str] = ARRAY_NAMES,
        *,
        chunk_splats: int | None = None,
        progress: Progress | None = None,
        dropped: Dropped | None = None,
    ) -> Iterator[SplatChunk]:
        """Reads the file once, in order; splats that cannot be rendered are left out, whatever `arrays` asks for.

        The host holds one chunk (of `chunk_splats`, or of about 32 MiB) and what the consumer keeps; each chunk has
        arrays of its own. `progress` is called after each block. What is left out is counted in `dropped`. May be
        called again. Raises StippleError where the file is damaged, has changed since it was opened, or no splat of
        it can be rendered; lets what `progress` raises through.
        """

    def read(self, progress: Progress | None = None) -> LoadedSplats:
        """The whole capture in memory; peak memory is the cloud plus a few MiB where the format can be streamed.

        Raises StippleError as `chunks`, and where memory does not suffice.
        """
        free = host_free_bytes()
        if self.nbytes > free:
            raise StippleError(
                f"{self.path}: {gibibytes(self.nbytes)} are needed for {self.splat_count:,} splats and "
                f"{gibibytes(free)} are free; import it as a linked capture, or free some memory."
            )
        dropped = Dropped()
        (chunk,) = self.chunks(chunk_splats=self.splat_count, progress=progress, dropped=dropped)
        cloud = SplatCloud(**{name: getattr(chunk, name) for name in ARRAY_NAMES}, name=self.name)
        return LoadedSplats(cloud, dropped.count, dropped.warnings(self.path, self.splat_count))


def chunk_splats_of_degree(sh_degree: int) -> int:
    """Splats of a chunk of 32 MiB."""
    return CHUNK_BYTES // full_bytes_per_splat(sh_degree)
