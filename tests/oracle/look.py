# SPDX-License-Identifier: GPL-3.0-or-later
"""What an object's look does to its splats, step by step, in float64.

Colours are graded in linear Rec.709 light, in this order: gain and exposure, saturation about the luminance, tint.
Crops look where a splat's mean lies in the world. Displays other than splats are not modelled.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .scene_like import Float64Array, InstanceLike

LUMINANCE = np.array([0.2126390059, 0.7151686788, 0.0721923154])  # row Y of sRGB to XYZ (W3C, CSS Color 4)


@dataclass(frozen=True, eq=False)
class LookedCloud:
    """A cloud after its look; what is cropped away has opacity -1, so indices stay."""

    position: Float64Array
    scale: Float64Array
    rotation: Float64Array
    opacity: Float64Array
    sh_dc: Float64Array
    sh_rest: Float64Array


@dataclass(frozen=True, eq=False)
class LookedInstance:
    cloud: LookedCloud
    world_from_object: Float64Array


def linear_from_srgb(encoded: Float64Array) -> Float64Array:
    """IEC 61966-2-1, the same power law above 1."""
    return np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)


def srgb_from_linear(light: Float64Array) -> Float64Array:
    light = np.maximum(light, 0.0)
    return np.where(light > 0.0031308, 1.055 * light ** (1 / 2.4) - 0.055, light * 12.92)


def grade(encoded: Float64Array, look: Any) -> Float64Array:
    """Graded colours (N, 3), sRGB-encoded as they come."""
    light = linear_from_srgb(encoded)
    light = light * np.asarray(look.gain) * 2.0**look.exposure
    grey = (light @ LUMINANCE)[:, None]
    light = grey + look.saturation * (light - grey)
    tint = np.asarray(look.tint, np.float64)
    brightness = tint @ LUMINANCE
    coloured = (light @ LUMINANCE)[:, None] * (tint / brightness if brightness > 0 else 0 * tint)
    light = light + look.tint_factor * (coloured - light)
    return srgb_from_linear(light)


def kept(position: Float64Array, world_from_object: Float64Array, crops: Any) -> np.ndarray:
    """(N,) bool: means inside any of the crops that keep the inside, and outside all that keep the outside."""
    world = position @ world_from_object[:, :3].T + world_from_object[:, 3]
    inside, outside = [], [np.ones(len(position), bool)]
    for crop in crops:
        matrix = np.asarray(crop.world_from_crop, np.float64)
        local = np.linalg.solve(matrix[:, :3], (world - matrix[:, 3]).T).T
        within = np.abs(local).max(axis=1) <= 1 if crop.shape == "box" else np.linalg.norm(local, axis=1) <= 1
        (inside if crop.keep == "inside" else outside).append(within if crop.keep == "inside" else ~within)
    return np.logical_and.reduce(outside) & (np.logical_or.reduce(inside) if inside else True)


def looked(instance: InstanceLike) -> InstanceLike:
    """The instance with its look's size, opacity and crops in the cloud; itself where it has no look."""
    look = getattr(instance, "look", None)
    if look is None:
        return instance
    if look.display != "splats":
        raise ValueError(f"the oracle does not display {look.display}")
    cloud, placed = instance.cloud, np.asarray(instance.world_from_object, np.float64)
    position = np.asarray(cloud.position, np.float64)
    opacity = np.asarray(cloud.opacity, np.float64)
    if look.opacity != 1:
        opacity = np.minimum(opacity * look.opacity, 1.0)
    opacity = np.where(kept(position, placed, look.crops), opacity, -1.0)
    scale = np.asarray(cloud.scale, np.float64) * look.size
    dressed = LookedCloud(position, scale, cloud.rotation, opacity, cloud.sh_dc, cloud.sh_rest)  # type: ignore[arg-type]
    return LookedInstance(dressed, placed)


def overridden(instance: InstanceLike, antialiased: bool, sh_degree: int | None) -> tuple[bool, int | None]:
    """The render settings where the look does not say otherwise: its own antialiasing, the lower of both degrees."""
    look = getattr(instance, "look", None)
    if look is None:
        return antialiased, sh_degree
    degrees = [degree for degree in (sh_degree, look.sh_degree) if degree is not None]
    return antialiased if look.antialiased is None else look.antialiased, min(degrees, default=None)


def graded(rgb: Float64Array, instance: InstanceLike) -> Float64Array:
    """Colours (N, 3) of the instance's splats as its look shows them."""
    look = getattr(instance, "look", None)
    return rgb if look is None else grade(rgb, look)
