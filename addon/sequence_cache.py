# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds of numbered files: read when a frame asks for them, ahead of time by a thread, kept within a limit.

One thread reads ahead (reading uses two cores itself); it starts with the first file and ends with `free`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from ..engine.errors import StippleError
from ..engine.formats import LoadedSplats, read_splats
from ..engine.formats.sequence import NumberedFiles, find_numbered

THREAD_NAME = "stipple-sequence"
FileKey = tuple[Path, int, int]  # path, time of the last change [ns], size [bytes]


class SequenceClouds:
    """The same file gives the same SplatCloud as long as it is kept; a file that was written again is read again.

    May be used from several threads.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._files: dict[FileKey, Future[LoadedSplats]] = {}  # least recently asked for first
        self._asked: dict[FileKey, int] = {}  # in which reading
        self._expected: dict[FileKey, int] = {}
        self._reading = 0
        self._folders: dict[Path, tuple[int, NumberedFiles]] = {}
        self._pool: ThreadPoolExecutor | None = None

    def __len__(self) -> int:
        return len(self._files)

    @property
    def held_bytes(self) -> int:
        """Memory of the clouds that are kept [bytes]; those on their way count as large as their files."""
        with self._lock:
            return sum(_bytes_of(key, future) for key, future in self._files.items())

    @contextmanager
    def reading(self, limit: int, keep: int = 1, hoard: bool = True) -> Iterator[None]:
        """Brackets the reading of one depsgraph and makes room after it.

        What the last `keep` readings asked for stays, and what they expected to need next. Other clouds stay, too, as
        long as all of them take no more than `limit` [bytes]; without `hoard` they go at once.
        """
        with self._lock:
            self._reading += 1
        yield
        with self._lock:
            oldest = self._reading - keep
            for table in (self._asked, self._expected):
                for key in [key for key, reading in table.items() if reading <= oldest]:
                    del table[key]
            self._start_expected(limit)
            room = limit if hoard else 0
            for key in [key for key in self._files if key not in self._asked and key not in self._expected]:
                if self.held_bytes > room:
                    self._files.pop(key).cancel()

    def files_of(self, path: Path) -> NumberedFiles:
        """`find_numbered`, which lists the folder again only after something in it changed."""
        try:
            changed = path.parent.stat().st_mtime_ns
        except OSError:
            return find_numbered(path)  # raises with the reason
        with self._lock:
            known = self._folders.get(path)
            if known is None or known[0] != changed:
                known = self._folders[path] = (changed, find_numbered(path))
            return known[1]

    def cloud_of(
        self, path: Path, patience: float | None = None, arrived: Callable[[], None] | None = None
    ) -> LoadedSplats | None:
        """The file's splats; only inside `reading`.

        None where they are not there within `patience` [s]; then `arrived` is called from another thread when they
        are. Raises StippleError for a file that cannot be read.
        """
        key = _key_of(path)
        with self._lock:
            self._asked[key] = self._reading
            future = self._files.pop(key, None)
            read_here = patience is None and (future is None or future.cancelled() or future.cancel())
            if read_here:  # sooner done than by the thread, which may be busy with another file
                future = Future()
                future.set_running_or_notify_cancel()
            elif future is None or future.cancelled():
                future = self._submit(path, urgent=True)
            assert future is not None
            self._files[key] = future
        if read_here:
            _read_into(future, path)
        try:
            return future.result(patience)
        except (TimeoutError, CancelledError):
            if arrived is not None:
                future.add_done_callback(lambda _: arrived())
            return None
        except BaseException:
            with self._lock:
                self._files.pop(key, None)  # perhaps it can be read the next time
            raise

    def expect(self, path: Path) -> None:
        """Says that the file will be asked for soon; it is read when `reading` ends, if the limit leaves room."""
        with suppress(StippleError):
            key = _key_of(path)
            with self._lock:
                self._expected[key] = self._reading

    def free(self) -> None:
        """Drops every cloud and ends the thread."""
        with self._lock:
            for future in self._files.values():
                future.cancel()
            for table in (self._files, self._asked, self._expected, self._folders):
                table.clear()
            pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)

    def _start_expected(self, limit: int) -> None:
        needed = sum(_bytes_of(key, future) for key, future in self._files.items() if key in self._asked)
        for key in list(self._expected):
            future = self._files.get(key)
            needed += _bytes_of(key, future)
            if needed > limit:
                del self._expected[key]
            elif future is None or future.cancelled():
                self._files[key] = self._submit(key[0])

    def _submit(self, path: Path, urgent: bool = False) -> Future[LoadedSplats]:
        if urgent:
            for key, future in self._files.items():
                if key not in self._asked:
                    future.cancel()  # what waits for its turn; `reading` starts it again
        if self._pool is None:
            self._pool = ThreadPoolExecutor(1, thread_name_prefix=THREAD_NAME)
        return self._pool.submit(read_splats, path)


def _key_of(path: Path) -> FileKey:
    try:
        status = path.stat()
    except OSError as error:
        raise StippleError(f"{path}: it cannot be read ({error.strerror}); restore the file.") from error
    return (path, status.st_mtime_ns, status.st_size)


def _bytes_of(key: FileKey, future: Future[LoadedSplats] | None) -> int:
    if future is not None and future.done() and not future.cancelled() and future.exception() is None:
        return future.result().cloud.nbytes
    return key[2]


def _read_into(future: Future[LoadedSplats], path: Path) -> None:
    try:
        future.set_result(read_splats(path))
    except BaseException as error:
        future.set_exception(error)
