# SPDX-License-Identifier: GPL-3.0-or-later
"""Front-to-back blending of projected splats by brute force, in float64."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene_like import Float64Array, IntArray


@dataclass(frozen=True, eq=False)
class BlendInput:
    """V splats in any order; equal depths are blended in the order given here.

    `mean_px` (V, 2), `covariance_px2` (V, 2, 2), `depth` (V,), `opacity` (V,), `colour` (V, 3).
    """

    mean_px: Float64Array
    covariance_px2: Float64Array
    depth: Float64Array
    opacity: Float64Array
    colour: Float64Array


@dataclass(frozen=True, eq=False)
class Blended:
    """Sums over the splats, (H, W[, 3]), box-filtered over subpixels: Σ w colour, Σ w, Σ w z, and 1 − Σ w."""

    colour: Float64Array
    weight: Float64Array
    weighted_depth: Float64Array
    transmittance: Float64Array


def support_boxes(
    splats: BlendInput, window: tuple[int, int, int, int], supersampling: int, alpha_min: float
) -> IntArray:
    """(V, 4) int64 x0, x1, y0, y1: half-open ranges of subpixels outside which a splat's alpha is below `alpha_min`.

    Exact, with 1 px to spare: opacity · exp(−d²/2) >= alpha_min bounds d², and √(d² Σ_xx) is the reach along x.
    Without a threshold a splat reaches everywhere.
    """
    left, top, width, height = window
    if alpha_min > 0:
        reach = 2.0 * np.log(splats.opacity / alpha_min)
        half = np.sqrt(np.maximum(reach, 0.0)[:, None] * np.diagonal(splats.covariance_px2, axis1=1, axis2=2)) + 1.0
    else:
        half = np.full((len(splats.opacity), 2), np.inf)
    centre = splats.mean_px - (left, top)
    size = np.array([width, height]) * supersampling
    first = np.clip(np.ceil((centre - half) * supersampling - 0.5), 0, size)
    last = np.clip(np.floor((centre + half) * supersampling - 0.5) + 1, first, size)
    return np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], axis=1).astype(np.int64)


def blend(
    splats: BlendInput,
    window: tuple[int, int, int, int],
    *,
    supersampling: int,
    alpha_min: float,
    alpha_max: float,
) -> Blended:
    """Blend every splat into the window (x, y, width, height) [px] of the frame.

    At each subpixel centre alpha = min(alpha_max, opacity · exp(−½ dᵀ Σ⁻¹ d)), skipped below `alpha_min`; the
    weight is alpha times the transmittance left by nearer splats. No 3-sigma cut and no early stop.
    """
    left, top, width, height = window
    x_px = left + (np.arange(width * supersampling) + 0.5) / supersampling
    y_px = top + (np.arange(height * supersampling) + 0.5) / supersampling
    boxes = support_boxes(splats, window, supersampling, alpha_min)
    conics = np.linalg.inv(splats.covariance_px2)
    payload = np.concatenate([splats.colour, np.ones((len(boxes), 1)), splats.depth[:, None]], axis=1)[:, :, None, None]
    sums = np.zeros((5, len(y_px), len(x_px)))
    transmittance = np.ones((len(y_px), len(x_px)))
    for k in np.argsort(splats.depth, kind="stable"):
        x0, x1, y0, y1 = boxes[k]
        if x0 == x1 or y0 == y1:
            continue
        dx = x_px[x0:x1] - splats.mean_px[k, 0]
        dy = (y_px[y0:y1] - splats.mean_px[k, 1])[:, None]
        (xx, xy), (_, yy) = conics[k]
        alpha = splats.opacity[k] * np.exp(-0.5 * (xx * dx * dx + (2.0 * xy * dx) * dy + yy * dy * dy))
        np.minimum(alpha, alpha_max, out=alpha)
        alpha[alpha < alpha_min] = 0.0
        behind = transmittance[y0:y1, x0:x1]
        sums[:, y0:y1, x0:x1] += payload[k] * (alpha * behind)
        behind *= 1.0 - alpha
    means = box_filter(sums, supersampling)
    return Blended(np.moveaxis(means[:3], 0, -1), means[3], means[4], box_filter(transmittance[None], supersampling)[0])


def box_filter(subpixels: Float64Array, supersampling: int) -> Float64Array:
    """Mean of each s × s block: (C, H s, W s) to (C, H, W)."""
    channels, height, width = subpixels.shape
    blocks = subpixels.reshape(channels, height // supersampling, supersampling, width // supersampling, supersampling)
    return np.asarray(blocks.mean(axis=(2, 4)))
