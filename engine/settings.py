# SPDX-License-Identifier: GPL-3.0-or-later
"""How to render: one frozen value that hosts fill in and every stage reads."""

from __future__ import annotations

from dataclasses import dataclass

from .errors import StippleError

METHODS = ("points", "sorted", "rays")
RAY_ORDERS = ("sorted", "stochastic")
MULTISAMPLES = (1, 2, 4, 8, 16)
CULLING = ("occlusion", "frustum", "none")
STORAGE = ("full", "quantised")


@dataclass(frozen=True)
class Settings:
    """Render settings; the defaults give the picture a capture was trained for.

    - `method`: "points" (stochastic, accumulates), "sorted" (noise-free reference) or "rays" (exact per ray, drawn by
      the graphics hardware).
    - `samples`: frames accumulated by points and by rays in stochastic order; the others need one and take one.
    - `supersampling`: s, for s × s subpixels per pixel, box-filtered.
    - `seed`: of the random numbers; equal seeds give equal bits on one device.
    - `device`: "auto" (CUDA where there is one), "cpu" or "cuda:N".
    - `sh_degree`: highest band evaluated, None for all the capture has.
    - `antialiased`: opacity compensation of Mip-Splatting for the dilation, for captures trained with it.
    - `points_per_thread`: K of Gaussian point splatting; above 1 rounds counts to multiples of K (faster on a
      GPU, slightly biased).
    - `max_points`: T, most points in flight at once; more are rendered in several passes, none are lost.
    - `dilation_px2`: added to the screen-space covariance [px²]; 3DGS trains with 0.3.
    - `alpha_min`, `alpha_max`: a splat is skipped at a pixel below the first and clamped at the second; INRIA's
      trainer uses 1/255 and 0.99, gsplat 1/255 and 0.999.
    - `ray_order`: of rays, "sorted" (blended by mean depth) or "stochastic" (per pixel, by where each ray meets a
      splat; accumulates).
    - `multisamples`: of rays in sorted order, rays per pixel in one draw (MSAA); not inside Blender.
    - `culling`: what *points* leaves out: "occlusion" (hidden or outside the frustum), "frustum" or "none"; *sorted*
      leaves out what is outside the frustum unless "none". Never changes a picture.
    - `storage`: of captures on the device, "full" (float32) or "quantised" (21 bytes a splat, 81 with harmonics of
      degree 3); captures that are too large for the host's memory are always quantised.
    - `reprojection`: mix the last frame of the same renderer in, carried over to where the camera now sees it; for a
      moving camera in interactive use, never for final frames.
    - `point_scale`: factor on sizes that looks give in pixels, for a picture whose pixels are shown larger or smaller.
    - `small_splat_px`: sorted skips splats whose larger radius is below this [px]; 0 skips none.

    Raises StippleError for a value outside its range.
    """

    method: str = "points"
    samples: int = 64
    supersampling: int = 1
    seed: int = 0
    device: str = "auto"
    sh_degree: int | None = None
    antialiased: bool = False
    points_per_thread: int = 1
    max_points: int = 1 << 24
    dilation_px2: float = 0.3
    alpha_min: float = 1.0 / 255.0
    alpha_max: float = 0.99
    small_splat_px: float = 0.0
    ray_order: str = "sorted"
    multisamples: int = 1
    culling: str = "occlusion"
    storage: str = "full"
    reprojection: bool = False
    point_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise StippleError(f"method is {self.method!r}; choose one of {', '.join(METHODS)}.")
        if self.ray_order not in RAY_ORDERS:
            raise StippleError(f"ray_order is {self.ray_order!r}; choose one of {', '.join(RAY_ORDERS)}.")
        if self.culling not in CULLING:
            raise StippleError(f"culling is {self.culling!r}; choose one of {', '.join(CULLING)}.")
        if self.storage not in STORAGE:
            raise StippleError(f"storage is {self.storage!r}; choose one of {', '.join(STORAGE)}.")
        if self.multisamples not in MULTISAMPLES:
            raise StippleError(f"multisamples is {self.multisamples}; choose one of {MULTISAMPLES}.")
        if self.multisamples > 1 and self.ray_order == "stochastic":
            raise StippleError(
                "multisamples do not go with stochastic ray_order; use samples or supersampling instead."
            )
        ranges = {
            "samples": (1, 1 << 24),
            "supersampling": (1, 16),
            "seed": (0, (1 << 31) - 1),
            "points_per_thread": (1, 64),
            "max_points": (1 << 10, 1 << 30),
            "dilation_px2": (0.0, 100.0),
            "alpha_min": (0.0, 1.0),
            "alpha_max": (0.0, 1.0),
            "small_splat_px": (0.0, 1e6),
            "point_scale": (1e-3, 1e3),
        }
        for name, (low, high) in ranges.items():
            if not low <= getattr(self, name) <= high:
                raise StippleError(f"{name} is {getattr(self, name)}; give a value from {low} to {high}.")
        if self.sh_degree is not None and not 0 <= self.sh_degree <= 4:
            raise StippleError(f"sh_degree is {self.sh_degree}; give 0 to 4.")
