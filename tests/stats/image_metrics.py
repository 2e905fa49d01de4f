# SPDX-License-Identifier: GPL-3.0-or-later
"""PSNR and SSIM, for the tables and the agreement of renderers; not tests of bias.

Known power: none is claimed. A PSNR says how large the error is, not whether it is noise: 40 dB is a root mean squared
error of 1 % of the peak, 60 dB of 0.1 %, and a bias in one tile of a few hundred can hide below either.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]

SSIM_RADIUS_PX = 5  # an 11 × 11 window
SSIM_SIGMA_PX = 1.5
SSIM_K1, SSIM_K2 = 0.01, 0.03


def psnr(image: npt.ArrayLike, reference: npt.ArrayLike, peak: float = 1.0) -> float:
    """Peak signal-to-noise ratio over all values [dB]; +inf for equal pictures. Raises ValueError if shapes differ."""
    a, b = matching(image, reference)
    mse = float(np.mean((a - b) ** 2))
    return 10.0 * math.log10(peak**2 / mse) if mse > 0 else math.inf


def ssim(image: npt.ArrayLike, reference: npt.ArrayLike, peak: float = 1.0) -> float:
    """Structural similarity of (H, W) or (H, W, C) pictures, the mean over pixels and channels; 1 for equal ones.

    Gaussian window of 1.5 px in 11 × 11 px, population statistics, windows that leave the picture left out
    (Wang et al., "Image Quality Assessment: From Error Visibility to Structural Similarity", 2004). Raises ValueError
    if shapes differ or the picture is smaller than the window.
    """
    a, b = matching(image, reference)
    if min(a.shape[:2]) < 2 * SSIM_RADIUS_PX + 1:
        raise ValueError(f"SSIM needs at least {2 * SSIM_RADIUS_PX + 1} px in each direction, not {a.shape[:2]}")
    mean_a, mean_b = windowed(a), windowed(b)
    variance_a, variance_b = windowed(a * a) - mean_a**2, windowed(b * b) - mean_b**2
    covariance = windowed(a * b) - mean_a * mean_b
    c1, c2 = (SSIM_K1 * peak) ** 2, (SSIM_K2 * peak) ** 2
    luminance = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    structure = (2 * covariance + c2) / (variance_a + variance_b + c2)
    return float(np.mean(luminance * structure))


def windowed(picture: Float64Array) -> Float64Array:
    """Gaussian mean around every pixel whose window lies in the picture."""
    offsets = np.arange(-SSIM_RADIUS_PX, SSIM_RADIUS_PX + 1)
    weights = np.exp(-0.5 * (offsets / SSIM_SIGMA_PX) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        length = picture.shape[axis] - 2 * SSIM_RADIUS_PX
        shifted = (weights[k] * np.take(picture, np.arange(k, k + length), axis=axis) for k in range(len(weights)))
        picture = np.asarray(sum(shifted))
    return picture


def matching(image: npt.ArrayLike, reference: npt.ArrayLike) -> tuple[Float64Array, Float64Array]:
    a, b = np.asarray(image, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if a.shape != b.shape:
        raise ValueError(f"the pictures differ in shape: {a.shape} and {b.shape}")
    return a, b
