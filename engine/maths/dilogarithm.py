# SPDX-License-Identifier: GPL-3.0-or-later
"""The dilogarithm Li2(x) = -∫₀ˣ ln(1 - s)/s ds and its inverse on [0, 1].

Gaussian Point Splatting (doi 10.1145/3811272) Eq. 3 takes the expected number of points from Li2, and appendix B takes
a point's radius from the inverse. The coefficients come from scripts/fit_dilogarithm.py. Largest absolute errors in
single precision over the whole range: Li2 below 1e-6 (the paper's fit: 7.27e-5), inverse below 3e-5 (7.07e-5), and
below 5e-6 up to 0.99, where opacities are clamped.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

LI2_ONE = wp.constant(1.6449340668482264)  # π²/6

# Li2(x) / x on [0, ½] and s / t for t = Li2(s) on [0, π²/6], lowest order first.
LI2_LOWER_HALF = (
    1.00000008, 0.249993632, 0.111277638, 0.0603802483, 0.0550821685,
    -0.0357545897, 0.179589649, -0.20837925, 0.157128229,
)  # fmt: skip
LI2_INVERSE = (
    1.00515655, -0.379480367, 1.13353868, -4.74888099, 11.3868757,
    -16.5003056, 14.7325537, -7.92896473, 2.35916312, -0.298168039,
)  # fmt: skip


def _horner(coefficients: tuple[float, ...], x: str) -> str:
    """C++ statements that leave the polynomial in `p`."""
    steps = "".join(f" p = p * {x} + {c!r}f;" for c in reversed(coefficients[:-1]))
    return f"float p = {coefficients[-1]!r}f;{steps}"


# For native kernels: ln(x), x > 0, to 2e-7 (exponent, and Cephes' polynomial on [√½, √2]), and
# log_li2_inverse(t) = ln(s) with Li2(s) = t, which is what a radius is made of.
#
# One Newton step follows the polynomial. Without it, the fit reaches past the opacity itself near a splat's mean, all
# radii there become zero, and one pixel in the middle of every splat is too dense: z = 18 for 4,096 samples of a splat
# of 20 px.
LI2_INVERSE_NATIVE = f"""
    auto ln = [](float x) {{
        union {{ float f; int i; }} v; v.f = x;
        int e = (v.i - 0x3f3504f3) >> 23;
        v.i -= e << 23;
        float f = v.f - 1.0f;
        float p = 7.0376836292e-2f;
        p = p * f - 1.1514610310e-1f; p = p * f + 1.1676998740e-1f; p = p * f - 1.2420140846e-1f;
        p = p * f + 1.4249322787e-1f; p = p * f - 1.6668057665e-1f; p = p * f + 2.0000714765e-1f;
        p = p * f - 2.4999993993e-1f; p = p * f + 3.3333331174e-1f;
        return f + f * f * (p * f - 0.5f) + 0.69314718f * (float)e;
    }};
    auto li2_lower_half = [](float x) {{
        {_horner(LI2_LOWER_HALF, "x")}
        return p * x;
    }};
    auto log_li2_inverse = [&](float t) {{
        {_horner(LI2_INVERSE, "t")}
        float s = p * t;
        s = s < 0.9999999f ? s : 0.9999999f;
        float rest = 1.0f - s, log_s = ln(s), log_rest = ln(rest);
        float half = li2_lower_half(s < rest ? s : rest);
        float value = s < rest ? half : 1.6449340668f - log_s * log_rest - half;
        // Li2'(s) = -ln(1 - s)/s, so this is the step over s; the series is ln(1 + step) to 1e-8.
        float step = (value - t) / log_rest;
        step = s < 1e-3f ? -0.25f * s + (t - s) / s : step;
        return log_s + step * (1.0f - step * (0.5f - step * 0.33333333f));
    }};
"""


@wp.func_native(f"""
    {_horner(LI2_LOWER_HALF, "x")}
    return p * x;""")
def li2_lower_half(x: wp.float32) -> wp.float32:
    """Li2 on [0, ½], to 4e-10 before rounding."""
    ...


@wp.func
def li2(x: wp.float32) -> wp.float32:
    """Li2 on [0, 1]; above ½ by Euler's reflection Li2(x) + Li2(1 - x) = π²/6 - ln x ln(1 - x)."""
    y = 1.0 - x
    if x <= 0.5:
        return li2_lower_half(x)
    if y <= 0.0:
        return LI2_ONE
    return LI2_ONE - wp.log(x) * wp.log(y) - li2_lower_half(y)


@wp.func_native(f"""{LI2_INVERSE_NATIVE}
    return expf(log_li2_inverse(t));""")
def li2_inverse(t: wp.float32) -> wp.float32:
    """x with Li2(x) = t, for t in (0, π²/6] (appendix B)."""
    ...
