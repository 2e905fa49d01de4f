# SPDX-License-Identifier: GPL-3.0-or-later
"""PSNR and SSIM against closed forms and scikit-image."""

from __future__ import annotations

import math

import numpy as np
import pytest

from .image_metrics import psnr, ssim

RNG = np.random.default_rng(1)
PICTURE = np.clip(np.add.outer(np.linspace(0, 0.7, 40), np.linspace(0, 0.3, 50))[..., None] * [1.0, 0.8, 0.4], 0, 1)


def test_psnr_in_closed_form() -> None:
    assert psnr(PICTURE, PICTURE) == math.inf
    assert psnr(PICTURE + 0.01, PICTURE) == pytest.approx(40.0)
    assert psnr(255 * PICTURE + 0.255, 255 * PICTURE, peak=255) == pytest.approx(60.0)
    one_bad = PICTURE.copy()
    one_bad[3, 4, 1] += 0.6
    assert psnr(one_bad, PICTURE) == pytest.approx(10 * math.log10(PICTURE.size / 0.36))


def test_psnr_sees_the_noise_it_is_given() -> None:
    noisy = PICTURE + RNG.normal(scale=0.001, size=PICTURE.shape)
    assert psnr(noisy, PICTURE) == pytest.approx(60.0, abs=0.4)


@pytest.mark.parametrize("scale", [0.001, 0.05, 0.3])
def test_ssim_agrees_with_scikit_image(scale: float) -> None:
    metrics = pytest.importorskip("skimage.metrics")
    noisy = PICTURE + RNG.normal(scale=scale, size=PICTURE.shape)
    expected = metrics.structural_similarity(
        noisy, PICTURE, data_range=1.0, channel_axis=2, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert ssim(noisy, PICTURE) == pytest.approx(expected, abs=1e-9)
    grey = noisy[..., 0], PICTURE[..., 0]
    assert ssim(*grey) == pytest.approx(ssim(noisy[..., :1], PICTURE[..., :1]))


def test_ssim_in_closed_form() -> None:
    """Two flat pictures: only the luminance term is left."""
    assert ssim(PICTURE, PICTURE) == pytest.approx(1.0, abs=1e-12)
    flat = np.full((20, 20), 0.25)
    c1 = 0.01**2
    assert ssim(flat, 3 * flat) == pytest.approx((2 * 0.25 * 0.75 + c1) / (0.25**2 + 0.75**2 + c1))


def test_ssim_falls_when_structure_is_lost_at_equal_psnr() -> None:
    noise = RNG.normal(scale=0.05, size=PICTURE.shape)
    noisy, shifted = PICTURE + noise, PICTURE + math.sqrt(float(np.mean(noise**2)))
    assert psnr(noisy, PICTURE) == pytest.approx(psnr(shifted, PICTURE), abs=1e-6)
    assert ssim(noisy, PICTURE) < ssim(shifted, PICTURE) - 0.2


def test_pictures_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="differ in shape"):
        psnr(PICTURE, PICTURE[:-1])
    with pytest.raises(ValueError, match="at least 11"):
        ssim(PICTURE[:10], PICTURE[:10])
