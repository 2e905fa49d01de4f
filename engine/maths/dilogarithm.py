# SPDX-License-Identifier: GPL-3.0-or-later
"""The dilogarithm Li2(x) = -∫₀ˣ ln(1 - s)/s ds and its inverse on [0, 1].

Gaussian Point Splatting (doi 10.1145/3811272) Eq. 3 takes the expected number of points from Li2, and appendix B takes
a point's radius from the inverse. The coefficients come from scripts/fit_dilogarithm.py. Largest absolute errors in
single precision, over the whole range: Li2 below 1e-6 (the paper's fit: 7.27e-5), inverse below 7e-5 (7.07e-5).
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

LI2_ONE = wp.constant(1.6449340668482264)  # π²/6

# s / t for t = Li2(s), lowest order first; also written into the native kernel of points/splat.py.
LI2_INVERSE = (
    1.00515655, -0.379480367, 1.13353868, -4.74888099, 11.3868757,
    -16.5003056, 14.7325537, -7.92896473, 2.35916312, -0.298168039,
)  # fmt: skip

LI2_INVERSE_NATIVE = f"""
    auto li2_inverse = [](float t) {{
        float p = {LI2_INVERSE[-1]!r}f;
        {" ".join(f"p = p * t + {c!r}f;" for c in reversed(LI2_INVERSE[:-1]))}
        return p * t;
    }};
    """


@wp.func
def li2_lower_half(x: wp.float32) -> wp.float32:
    """Li2 on [0, ½], to 4e-10."""
    p = float(0.157128229)
    p = p * x - 0.20837925
    p = p * x + 0.179589649
    p = p * x - 0.0357545897
    p = p * x + 0.0550821685
    p = p * x + 0.0603802483
    p = p * x + 0.111277638
    p = p * x + 0.249993632
    p = p * x + 1.00000008
    return p * x


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
    return li2_inverse(t);""")
def li2_inverse(t: wp.float32) -> wp.float32:
    """x with Li2(x) = t, for t in [0, π²/6]; a polynomial of degree 10 without constant term (appendix B)."""
    ...
