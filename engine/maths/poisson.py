# SPDX-License-Identifier: GPL-3.0-or-later
"""Poisson-distributed counts.

Gaussian Point Splatting (doi 10.1145/3811272) §3.4 draws every count from Giles' asymptotic approximation; below rates
of about ten that is wrong (its mean is 2× too high at λ = 0.1 and 33× at 0.02). Here small rates are inverted exactly
and only large ones approximated: Giles, "Algorithm 955" (doi 10.1145/2699466).
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

EXACT_BELOW = wp.constant(10.0)  # rate from which Giles' expansion is used; its error there is below 1e-3 of a count
LONGEST_INVERSION = wp.constant(64)  # P(N > 64) at rate 10 is below 1e-26


@wp.func
def poisson_exact(rate: wp.float32, tail: wp.float32) -> wp.int32:
    """The n with P(N > n) <= tail < P(N >= n): inversion from the upper tail.

    Starting from P(N > 0) = -expm1(-rate) keeps tiny rates exact, where 1 - exp(-rate) has no bits left.
    """
    term = wp.exp(-rate)
    # -expm1(-rate); Warp has no expm1. The series is exact to 1e-7 below 1/8.
    above = 1.0 - term
    if rate < 0.125:
        above = rate * (1.0 - rate * (0.5 - rate * (0.16666667 - rate * (0.041666668 - rate * 0.008333334))))
    n = int(0)
    while tail < above and n < LONGEST_INVERSION:
        n += 1
        term *= rate / float(n)
        above -= term
    return n


@wp.func
def poisson_giles(rate: wp.float32, normal: wp.float32) -> wp.int32:
    """Giles' Q̃_N3 of a standard normal variate: the Cornish-Fisher expansion of the quantile to 1/rate."""
    root = wp.sqrt(rate)
    w2 = normal * normal
    q = rate + root * normal + (0.33333334 + 0.16666667 * w2)
    q -= normal * (0.027777778 + 0.013888889 * w2) / root
    q += (-0.019753087 + w2 * (0.008641975 + 0.0037037037 * w2)) / rate
    return int(wp.max(wp.floor(q), 0.0))


@wp.func
def poisson(rate: wp.float32, u: wp.vec3) -> wp.int32:
    """A count with mean `rate` from uniform variates in (0, 1]; the third is left to the caller."""
    if rate < EXACT_BELOW:
        return poisson_exact(rate, u[0])
    # Box-Muller gives the normal variate to the last bit; inverting the normal distribution would need a fit.
    normal = wp.sqrt(-2.0 * wp.log(u[0])) * wp.cos(6.2831855 * u[1])
    return poisson_giles(rate, normal)
