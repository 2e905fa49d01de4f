# SPDX-License-Identifier: GPL-3.0-or-later
"""An equirectangular picture around the scene: what every pixel sees where no splat covers it.

The picture is scene-linear light; splats blend in display (sRGB-encoded) space. So each pixel looks its light up and
filters it linearly, encodes it, and the film then blends splats over it as over a plain colour. Encoding has no upper
end (light of 1000 encodes to 18.7) and is undone when the film is linearised: an uncovered pixel is the picture's
light again, to float32 rounding. Under a splat of opacity α a bright sun is dimmed as display values are, more than
light would be: that is what α was trained to mean, and it keeps the rim of a capture in front of a sun of 65,504 from
burning out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from .buffers import Buffers, shortage
from .camera import Camera
from .device import free_bytes, launch
from .errors import DeviceError
from .scene import Environment, EnvironmentImage

wp.set_module_options({"enable_backward": False})

BYTES_PER_PIXEL = {"film_behind": 16}
PI = wp.constant(3.14159265358979)


@wp.struct
class Sky:
    """An environment seen by one camera, as the kernel reads it."""

    texels: wp.array(dtype=wp.vec3)  # scene-linear Rec.709, rows from the top
    columns: wp.int32
    rows: wp.int32
    strength: wp.float32
    world_from_camera: wp.mat33
    environment_from_world: wp.mat33
    shift: wp.vec3
    focal_px: wp.vec2
    centre_px: wp.vec2
    corner_px: wp.vec2  # of the window in the frame
    orthographic: wp.int32
    subpixels: wp.int32


@wp.func
def encoded(linear: wp.float32) -> wp.float32:
    """sRGB's transfer function (IEC 61966-2-1), extended above 1 and mirrored below 0 as in `colour`."""
    size = wp.abs(linear)
    curve = 1.055 * wp.pow(size, 1.0 / 2.4) - 0.055
    return wp.sign(linear) * wp.where(size <= 0.0031308, size * 12.92, curve)


@wp.func
def texel(sky: Sky, column: wp.int32, row: wp.int32) -> wp.vec3:
    """Around the horizon the picture closes; above the zenith and below the nadir its last rows go on."""
    x = column % sky.columns
    if x < 0:
        x += sky.columns
    return sky.texels[wp.clamp(row, 0, sky.rows - 1) * sky.columns + x]


@wp.func
def light_along(sky: Sky, direction: wp.vec3) -> wp.vec3:
    """Bilinear light along a vector in the environment's space, of any length (0: along its +x)."""
    across = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    u = 0.5 - wp.atan2(direction[1], direction[0]) / (2.0 * PI)
    v = 0.5 - wp.atan2(direction[2], across) / PI
    x = u * float(sky.columns) - 0.5
    y = v * float(sky.rows) - 0.5
    left, top = wp.floor(x), wp.floor(y)
    right_weight, bottom_weight = x - left, y - top
    i, j = int(left), int(top)
    upper = texel(sky, i, j) * (1.0 - right_weight) + texel(sky, i + 1, j) * right_weight
    lower = texel(sky, i, j + 1) * (1.0 - right_weight) + texel(sky, i + 1, j + 1) * right_weight
    return (upper * (1.0 - bottom_weight) + lower * bottom_weight) * sky.strength


@wp.kernel
def look_around_kernel(first: wp.int32, sky: Sky, width: wp.int32, behind: wp.array(dtype=wp.vec4)) -> None:
    pixel = first + wp.tid()
    y = pixel / width
    x = pixel - y * width
    light = wp.vec3(0.0, 0.0, 0.0)
    for sub_y in range(sky.subpixels):
        for sub_x in range(sky.subpixels):
            place_x = sky.corner_px[0] + float(x) + (float(sub_x) + 0.5) / float(sky.subpixels)
            place_y = sky.corner_px[1] + float(y) + (float(sub_y) + 0.5) / float(sky.subpixels)
            ray = wp.vec3(
                (place_x - sky.centre_px[0]) / sky.focal_px[0], (place_y - sky.centre_px[1]) / sky.focal_px[1], 1.0
            )
            if sky.orthographic != 0:
                ray = wp.vec3(0.0, 0.0, 1.0)
            direction = wp.normalize(sky.world_from_camera * ray)
            light += light_along(sky, sky.environment_from_world * direction + sky.shift)
    light = light / float(sky.subpixels * sky.subpixels)
    behind[pixel] = wp.vec4(encoded(light[0]), encoded(light[1]), encoded(light[2]), 1.0)


@dataclass(frozen=True, eq=False)
class DeviceEnvironment:
    """The texels of an `EnvironmentImage` on the device; on a CPU a view of the host's."""

    texels: wp.array


def upload_environment(image: EnvironmentImage, device: wp.Device) -> DeviceEnvironment:
    """Copies the image to the device; on a CPU nothing is copied and it must outlive the result.

    Raises DeviceError where memory does not suffice.
    """
    flat = image.pixels.reshape(-1, 3)
    if not device.is_cuda:
        view = wp.array(ptr=flat.ctypes.data, dtype=wp.vec3, shape=(len(flat),), device=device, capacity=flat.nbytes)
        return DeviceEnvironment(view)
    if flat.nbytes > free_bytes(device):
        raise DeviceError(shortage(device, flat.nbytes, image.name, free_bytes(device)))
    return DeviceEnvironment(wp.from_numpy(flat, dtype=wp.vec3, device=device))


def look_around(
    environment: Environment, uploaded: DeviceEnvironment, camera: Camera, subpixels: int, buffers: Buffers
) -> wp.array:
    """What every pixel of the camera's window sees behind the splats: sRGB-encoded, alpha 1, rows from the top.

    The mean light of `subpixels`² rays a pixel, or of the ray through its centre. All rays of an orthographic camera
    are parallel, so it sees one colour, as with Blender's own engines. A window changes no bit.
    """
    x, y, width, height = camera.rendered_window
    rows, columns, _ = environment.image.pixels.shape
    affine = np.array(environment.environment_from_world, np.float64)
    sky = Sky()
    sky.texels, sky.columns, sky.rows = uploaded.texels, columns, rows
    sky.strength = environment.strength
    sky.world_from_camera = wp.mat33(*np.linalg.inv(camera.camera_from_world[:, :3]).ravel())
    sky.environment_from_world, sky.shift = wp.mat33(*affine[:, :3].ravel()), wp.vec3(*affine[:, 3])
    sky.focal_px, sky.centre_px = wp.vec2(camera.fx, camera.fy), wp.vec2(camera.cx, camera.cy)
    sky.corner_px = wp.vec2(float(x), float(y))
    sky.orthographic, sky.subpixels = int(camera.projection == "orthographic"), subpixels
    behind = buffers.array("film_behind", wp.vec4, width * height)
    launch(look_around_kernel, width * height, [sky, width, behind], buffers.device)
    return behind
