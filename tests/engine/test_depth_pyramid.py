# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth pyramid against brute force: it may say visible of what is hidden, never hidden of what is visible."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

from stipple.engine.buffers import Buffers
from stipple.engine.depth_pyramid import DepthPyramid, build_depth_pyramid, is_hidden
from stipple.engine.device import choose_device

wp.set_module_options({"enable_backward": False})

NOTHING = (1 << 28) - 1


@wp.kernel
def ask_kernel(
    pyramid: DepthPyramid,
    corners: wp.array(dtype=wp.vec4),
    keys: wp.array(dtype=wp.uint32),
    hidden: wp.array(dtype=wp.int32),
) -> None:
    i = wp.tid()
    c = corners[i]
    hidden[i] = wp.where(is_hidden(pyramid, wp.vec2(c[0], c[1]), wp.vec2(c[2], c[3]), keys[i]), 1, 0)


def ask(pyramid: DepthPyramid, corners: np.ndarray, keys: np.ndarray, device: Any) -> np.ndarray:
    hidden = wp.zeros(len(keys), dtype=wp.int32, device=device)
    given = [
        wp.array(corners.astype(np.float32), dtype=wp.vec4, device=device),
        wp.array(keys.astype(np.uint32), dtype=wp.uint32, device=device),
    ]
    wp.launch(ask_kernel, dim=len(keys), inputs=[pyramid, *given, hidden], device=device)
    return hidden.numpy() != 0


@pytest.mark.parametrize(
    ("width", "height", "subpixels"), [(64, 48, 1), (37, 53, 2), (1, 1, 1), (1, 200, 1), (130, 3, 3)]
)
def test_nothing_visible_is_called_hidden(device: str, width: int, height: int, subpixels: int) -> None:
    rng = np.random.default_rng(width)
    buffers = Buffers(choose_device(device))
    # Nearly flat, so that much is hidden; a few subpixels saw nothing.
    depth = rng.integers(1000, 2000, (height * subpixels, width * subpixels)).astype(np.uint64)
    depth[rng.uniform(size=depth.shape) < 0.002] = NOTHING
    words = wp.array(((depth << 36) | 12345).ravel(), dtype=wp.uint64, device=buffers.device)
    pyramid = build_depth_pyramid(words, width, height, subpixels, "pyramid", buffers)

    count = 4000
    middle = rng.uniform((-5, -5), (width + 5, height + 5), (count, 2))
    half = np.exp(rng.uniform(np.log(0.1), np.log(max(width, height)), (count, 2)))
    corners = np.hstack([middle - half, middle + half])
    keys = rng.integers(900, 2300, count)
    hidden = ask(pyramid, corners, keys, buffers.device)

    pixels = depth.reshape(height, subpixels, width, subpixels).max(axis=(1, 3))
    clipped = np.floor(np.clip(corners, 0, [width - 1, height - 1] * 2)).astype(int)
    farthest = np.array([pixels[y0 : y1 + 1, x0 : x1 + 1].max() for x0, y0, x1, y1 in clipped])
    assert not (hidden & (farthest >= keys)).any()
    if width * height > 1000:
        assert hidden.sum() > 0.2 * (farthest < keys).sum() > 0


def test_without_levels_nothing_is_hidden(device: str) -> None:
    assert not ask(DepthPyramid(), np.array([[0.0, 0, 5, 5]]), np.array([5]), choose_device(device)).any()
