# SPDX-License-Identifier: GPL-3.0-or-later
"""Launches on a CPU's threads, and what is left of one that Ctrl-C ends."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest
import warp as wp

from stipple.engine.device import choose_device, launch

wp.set_module_options({"enable_backward": False})


@wp.kernel
def count_slowly_kernel(first: wp.int32, rounds: wp.int32, counts: wp.array(dtype=wp.int32)) -> None:
    i = first + wp.tid()
    for _ in range(rounds):
        counts[i] = (counts[i] * 3 + 1) % 1000003 + 1


@pytest.mark.skipif(os.name == "nt", reason="no signals")
def test_no_thread_writes_once_a_launch_was_interrupted() -> None:
    """Its arrays may be freed from then on."""
    device = choose_device("cpu")
    counts = wp.zeros(64, dtype=wp.int32, device=device)
    launch(count_slowly_kernel, 64, [1, counts], device, smallest_chunk=1)
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        launch(count_slowly_kernel, 64, [5_000_000, counts], device, smallest_chunk=1)
    timer.join()
    after = counts.numpy().copy()
    time.sleep(0.3)
    assert np.array_equal(counts.numpy(), after)
    assert np.count_nonzero(after == after[-1]) < 64  # it was in the middle
