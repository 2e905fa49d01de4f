# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray-based splats (RayGS) by brute force, in float64: every ray's point of maximum density, no quads.

Rota Bulò et al., "Hardware-Rasterized Ray-Based Gaussian Splatting": Eq. 5 (divergence along a ray), Eq. 2 (opacity),
Eq. 17 (MIP). Two orders: by the means' depth, as Eq. 1 has it, and by each pixel's own depth τ(x).

What the paper leaves open, and what is done here:
- p_min is `alpha_min`; opacity is clamped at `alpha_max` per pixel, as INRIA's trainer does (the paper does not say).
- a primitive with κ <= 0 or c² <= κ is left out (§3.2), and so is one whose mean is outside (near, far) (§4.1).
- Eq. 5 is even in x: a ray also "meets" what lies behind the camera. Only τ(x) > 0 counts.
- σ_x² of §5 is a pixel's area at unit distance, per primitive on the ray through its mean: times τ², it is
  `dilation_px2` · z³ / (‖μ‖ f_x f_y). With `antialiased` the opacity is modulated as in Eq. 17, without it is not.
- a scale below 1e-9 of the mean's distance (orthographic: of a pixel) is raised to it, so that discs have an inverse.
- an orthographic camera is the limit of c → ∞: parallel rays, no primitive around the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .blend import box_filter
from .look import graded, looked, overridden
from .picture import OraclePicture
from .projection import camera_from_object, rotation_matrices, view_directions
from .scene_like import CameraLike, Float64Array, InstanceLike, IntArray, SceneLike
from .sh import colour

LEAST_SCALE = 1e-9


@dataclass(frozen=True, eq=False)
class RaySplats:
    """V primitives in camera space, after the skip rules, in the order instance, splat.

    `mean` (V, 3); `whitening` (V, 3, 3), W with WᵀW = Σ̂⁻¹; `opacity` (V,) after modulation; `kappa` (V,);
    `colour` (V, 3); `radius` (V,) of a sphere around the mean that every ray of the support meets.
    """

    mean: Float64Array
    whitening: Float64Array
    opacity: Float64Array
    kappa: Float64Array
    colour: Float64Array
    radius: Float64Array
    orthographic: bool


def divergence(
    whitening: Float64Array, mean: Float64Array, origins: Float64Array, directions: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Eq. 5 of one primitive for rays (…, 3): D_ray and τ, both (…).

    τ is the ray parameter of maximum density (Prop. A.1); D_ray the squared Mahalanobis distance there.
    """
    x = directions @ whitening.T
    m = (mean - origins) @ whitening.T
    tau = (x * m).sum(axis=-1) / (x * x).sum(axis=-1)
    miss = tau[..., None] * x - m
    return (miss * miss).sum(axis=-1), tau


def mip_modulation(scale: Float64Array, filtered: Float64Array, towards: Float64Array) -> Float64Array:
    """√(|Σ| c² / (|Σ̂| ĉ²)) of Eq. 17 for principal standard deviations (V, 3) before and after the filter.

    `towards` (V, 3) is the mean in principal axes; its length cancels.
    """
    area = scale.prod(axis=1) ** 2 * ((towards / scale) ** 2).sum(axis=1)
    filtered_area = filtered.prod(axis=1) ** 2 * ((towards / filtered) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(area / filtered_area))


def filter_variance(mean: Float64Array, camera: CameraLike, dilation_px2: float) -> Float64Array:
    """σ_x² τ² of §5 (V,) [world units²]: the area a pixel covers at the mean, across the ray."""
    if camera.projection == "orthographic":
        return np.full(len(mean), dilation_px2 / (camera.fx * camera.fy))
    distance = np.linalg.norm(mean, axis=1)
    return np.asarray(dilation_px2 * np.abs(mean[:, 2]) ** 3 / (distance * camera.fx * camera.fy))


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def gather_instance(
    instance: InstanceLike,
    camera: CameraLike,
    alpha_min: float,
    dilation_px2: float,
    antialiased: bool,
    sh_degree: int | None,
) -> RaySplats:
    """The primitives of one instance that may show."""
    placed, instance = instance, looked(instance)
    antialiased, sh_degree = overridden(placed, antialiased, sh_degree)
    cloud, affine = instance.cloud, camera_from_object(instance, camera)
    mean = np.asarray(cloud.position, np.float64) @ affine[:, :3].T + affine[:, 3]
    factor = affine[:, :3] @ (rotation_matrices(cloud.rotation) * np.asarray(cloud.scale, np.float64)[:, None, :])
    opacity = np.asarray(cloud.opacity, np.float64)
    keep = (mean[:, 2] > camera.near) & (mean[:, 2] < camera.far) & np.isfinite(factor).all(axis=(1, 2))
    index = np.flatnonzero(keep & np.isfinite(mean).all(axis=1) & (opacity > alpha_min))
    mean, factor, opacity = mean[index], factor[index], opacity[index]
    axes, scale, _ = np.linalg.svd(factor)
    orthographic = camera.projection == "orthographic"
    towards = np.tile([0.0, 0.0, 1.0], (len(mean), 1)) if orthographic else mean
    unit = np.full(len(mean), 1.0 / max(camera.fx, camera.fy)) if orthographic else np.linalg.norm(mean, axis=1)
    scale = np.maximum(scale, LEAST_SCALE * unit[:, None])
    filtered = np.sqrt(scale**2 + filter_variance(mean, camera, dilation_px2)[:, None])
    if antialiased:
        opacity = opacity * mip_modulation(scale, filtered, np.einsum("nij,ni->nj", axes, towards))
    whitening = np.swapaxes(axes, 1, 2) / filtered[:, :, None]
    c2 = np.full(len(mean), np.inf) if orthographic else (np.einsum("nij,nj->ni", whitening, mean) ** 2).sum(axis=1)
    kappa = -2.0 * np.log(alpha_min / opacity)
    kept = (kappa > 0) & (c2 > kappa)
    rgb = colour(cloud.sh_dc[index], cloud.sh_rest[index], view_directions(instance, camera, index), sh_degree)
    rgb = graded(rgb, placed)
    kept &= np.isfinite(rgb).all(axis=1)
    radius = np.sqrt(np.maximum(kappa, 0.0)) * filtered.max(axis=1, initial=0.0)
    arrays = (mean, whitening, opacity, kappa, rgb, radius)
    return RaySplats(*(array[kept] for array in arrays), orthographic)


def gather(
    scene: SceneLike,
    camera: CameraLike,
    *,
    alpha_min: float = 1.0 / 255.0,
    dilation_px2: float = 0.0,
    antialiased: bool = False,
    sh_degree: int | None = None,
) -> RaySplats:
    """Every primitive of every instance that may show."""
    parts = [
        gather_instance(instance, camera, alpha_min, dilation_px2, antialiased, sh_degree)
        for instance in scene.instances
    ]
    names = ("mean", "whitening", "opacity", "kappa", "colour", "radius")
    orthographic = camera.projection == "orthographic"
    return RaySplats(*(np.concatenate([getattr(part, name) for part in parts]) for name in names), orthographic)


def pixel_rays(camera: CameraLike, supersampling: int) -> tuple[Float64Array, Float64Array]:
    """Origins and directions (H s, W s, 3) of the rays through subpixel centres; z of a direction is 1, so τ is z."""
    left, top, width, height = camera.window or (0, 0, camera.width, camera.height)
    x = (left + (np.arange(width * supersampling) + 0.5) / supersampling - camera.cx) / camera.fx
    y = (top + (np.arange(height * supersampling) + 0.5) / supersampling - camera.cy) / camera.fy
    grid = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1)
    if camera.projection == "orthographic":
        return grid * [1.0, 1.0, 0.0], np.broadcast_to([0.0, 0.0, 1.0], grid.shape)
    return np.zeros_like(grid), grid


def reach(centre: Float64Array, z: Float64Array, radius: Float64Array, orthographic: bool) -> tuple[Float64Array, ...]:
    """Lowest and highest slope x/z (orthographic: x) at which a ray in front of the camera can meet a sphere."""
    if orthographic:
        return centre - radius, centre + radius
    middle = np.arctan2(centre, z)
    half = np.arcsin(np.minimum(1.0, radius / np.hypot(centre, z)))
    half = np.where(radius >= np.hypot(centre, z), np.pi, half)
    low = np.where(middle - half > -np.pi / 2, np.tan(middle - half), -np.inf)
    return low, np.where(middle + half < np.pi / 2, np.tan(middle + half), np.inf)


def support_boxes(splats: RaySplats, camera: CameraLike, supersampling: int, everywhere: bool = False) -> IntArray:
    """(V, 4) int64 x0, x1, y0, y1: half-open ranges of subpixels outside which no ray meets the support.

    D_ray <= κ puts τ(x)x inside the ellipsoid of √κ standard deviations, which a sphere encloses. `everywhere` gives
    the whole window instead.
    """
    left, top, width, height = camera.window or (0, 0, camera.width, camera.height)
    boxes = []
    for axis, (focal, principal, first, size) in enumerate(
        ((camera.fx, camera.cx, left, width), (camera.fy, camera.cy, top, height))
    ):
        low, high = reach(splats.mean[:, axis], splats.mean[:, 2], splats.radius, splats.orthographic)
        if everywhere:
            low, high = np.full_like(low, -np.inf), np.full_like(high, np.inf)
        count = size * supersampling
        begin = np.clip(np.floor((low * focal + principal - first) * supersampling - 1.0), 0, count)
        end = np.clip(np.ceil((high * focal + principal - first) * supersampling + 1.0), begin, count)
        boxes += [begin, end]
    return np.stack(boxes, axis=1).astype(np.int64)


def opacities(
    splats: RaySplats, k: int, origins: Float64Array, directions: Float64Array, alpha_min: float, alpha_max: float
) -> tuple[Float64Array, Float64Array]:
    """ω of Eq. 2 and the depth τ(x) of primitive `k` on rays (…, 3); 0 outside the support and behind the camera."""
    d, tau = divergence(splats.whitening[k], splats.mean[k], origins, directions)
    omega = splats.opacity[k] * np.exp(-0.5 * d)
    behind = (tau <= 0) & (not splats.orthographic)
    return np.where((omega < alpha_min) | behind, 0.0, np.minimum(omega, alpha_max)), tau


def render(
    scene: SceneLike,
    camera: CameraLike,
    *,
    alpha_min: float = 1.0 / 255.0,
    alpha_max: float = 0.99,
    dilation_px2: float = 0.0,
    antialiased: bool = False,
    supersampling: int = 1,
    sh_degree: int | None = None,
    order: str = "mean",
    everywhere: bool = False,
) -> OraclePicture:
    """The picture, front to back by the depth of the mean (`order` "mean") or of each pixel's τ ("pixel").

    Depth is the mean of τ(x), weighted as the colours. "pixel" holds all primitives of all pixels at once: for
    small scenes only.
    """
    splats = gather(
        scene,
        camera,
        alpha_min=alpha_min,
        dilation_px2=dilation_px2,
        antialiased=antialiased,
        sh_degree=sh_degree,
    )
    origins, directions = pixel_rays(camera, supersampling)
    blend = blend_by_mean if order == "mean" else blend_by_pixel
    boxes = support_boxes(splats, camera, supersampling, everywhere)
    sums, transmittance = blend(splats, boxes, origins, directions, alpha_min, alpha_max)
    means, left = box_filter(sums, supersampling), box_filter(transmittance[None], supersampling)[0]
    rgb, weight, alpha = np.moveaxis(means[:3], 0, -1), means[3], means[3]
    if scene.background is not None:
        rgb = rgb + left[..., None] * np.asarray(scene.background, dtype=np.float64)
        alpha = np.ones_like(weight)
    depth = np.full(weight.shape, np.inf)
    np.divide(means[4], weight, out=depth, where=weight > 0)
    return OraclePicture(np.concatenate([rgb, alpha[..., None]], axis=-1), depth)


def blend_by_mean(
    splats: RaySplats,
    boxes: IntArray,
    origins: Float64Array,
    directions: Float64Array,
    alpha_min: float,
    alpha_max: float,
) -> tuple[Float64Array, Float64Array]:
    """Eq. 1 with ν by the means' depth, ties in the scene's order: (5, H, W) Σ w (r, g, b, 1, τ), (H, W) 1 − Σ w."""
    sums = np.zeros((5, *origins.shape[:2]))
    transmittance = np.ones(origins.shape[:2])
    for k in np.argsort(splats.mean[:, 2], kind="stable"):
        x0, x1, y0, y1 = boxes[k]
        if x0 == x1 or y0 == y1:
            continue
        part = (slice(y0, y1), slice(x0, x1))
        omega, tau = opacities(splats, k, origins[part], directions[part], alpha_min, alpha_max)
        weight = omega * transmittance[part]
        sums[(slice(0, 3), *part)] += splats.colour[k][:, None, None] * weight
        sums[(3, *part)] += weight
        sums[(4, *part)] += weight * tau
        transmittance[part] *= 1.0 - omega
    return sums, transmittance


def blend_by_pixel(
    splats: RaySplats,
    boxes: IntArray,
    origins: Float64Array,
    directions: Float64Array,
    alpha_min: float,
    alpha_max: float,
) -> tuple[Float64Array, Float64Array]:
    """As `blend_by_mean`, with ν by each pixel's τ(x). Every primitive that shows is evaluated everywhere."""
    shown = np.flatnonzero((boxes[:, 0] < boxes[:, 1]) & (boxes[:, 2] < boxes[:, 3]))
    both = [opacities(splats, k, origins, directions, alpha_min, alpha_max) for k in shown]
    omega, tau = (np.stack(arrays) for arrays in zip(*both, strict=True))
    order = np.argsort(tau, axis=0, kind="stable")
    omega, tau = np.take_along_axis(omega, order, axis=0), np.take_along_axis(tau, order, axis=0)
    left = np.cumprod(1.0 - omega, axis=0)
    weight = omega * np.concatenate([np.ones_like(left[:1]), left[:-1]])
    rgb = np.einsum("khw,khwc->chw", weight, splats.colour[shown][order])
    return np.concatenate([rgb, weight.sum(axis=0)[None], (weight * tau).sum(axis=0)[None]]), left[-1]
