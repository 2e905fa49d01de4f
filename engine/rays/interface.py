# SPDX-License-Identifier: GPL-3.0-or-later
"""What the shaders read, hand on and write: declared once, for every host.

`header` writes the declarations for a host that compiles plain GLSL (moderngl); `create_info_calls` lists the same
declarations as the calls that Blender's `GPUShaderCreateInfo` and `GPUStageInterfaceInfo` take. The shader sources
hold no declaration of their own. Only what both hosts have is used: float textures read by `texelFetch`, no storage
buffers, 32-bit constants of at most 128 bytes together (what Vulkan guarantees for push constants).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..device_look import RIM_SHADE, SHADE_SLOPE
from ..edit.state_bits import HIGHLIGHT

GLSL_VERSION = "#version 400 core"  # 400 for per-sample interpolation


@dataclass(frozen=True)
class Texture:
    """An RGBA32F texture; `slot` is its unit on every host."""

    name: str
    slot: int


@dataclass(frozen=True)
class Value:
    """A constant, attribute, varying or output; `location` where the host numbers it."""

    name: str
    glsl_type: str
    location: int = 0


SPLATS = tuple(Texture(f"splats_{page}", page) for page in range(4))
"""Records of all clouds, one after the other, over as many pages as they fill; see `texels.splat_pages`."""
INSTANCES = Texture("instances", len(SPLATS))
"""`INSTANCE_TEXELS` texels per instance; see `texels.pack_instances`."""
ORDER = Texture("draw_order", len(SPLATS) + 1)
"""One texel per drawn splat, farthest first; see `texels.pack_order`."""
TEXTURES = (*SPLATS, INSTANCES, ORDER)

QUADS_PER_BATCH = 64
"""Splats per instance of the draw. One would do, but hardware fills its lanes with the vertices of one instance, and
four do not fill them; llvmpipe spends microseconds on each."""
INSTANCE_TEXELS = 9
DEFINES: dict[str, object] = {
    "QUADS_PER_BATCH": QUADS_PER_BATCH,
    "INSTANCE_TEXELS": INSTANCE_TEXELS,
    "SHADE_SLOPE": SHADE_SLOPE,
    "RIM_SHADE": RIM_SHADE,
    "HIGHLIGHT": ", ".join(str(channel) for channel in HIGHLIGHT),
}

CONSTANTS = (
    Value("lens", "vec4"),  # fx, fy [px], principal point in the window, shifted by the sample's place [px]
    Value("window", "vec4"),  # x, y, width, height [px]
    Value("cut", "vec4"),  # p_min, largest opacity; opacities from which on that is 1, and a splat is shaded
    Value("modes", "ivec4"),  # 1 for an orthographic camera, unused, stream of random numbers, splats drawn
)

ATTRIBUTES = (Value("corner", "vec3", 0),)  # a column of the canonical quad O; which quad of the batch

SMOOTH = (Value("quad_point", "vec3"),)  # Z_ray α; depth of the quad along z [world units]
FLAT = (
    Value("radiance", "vec4"),  # colour in the blend space, prior opacity o
    Value("inverse_c2", "float"),  # c⁻², 0 for an orthographic camera
    Value("random_key", "uvec2"),  # of the splat, of the instance and sample
)

OUTPUTS = (
    Value("out_colour", "vec4", 0),  # premultiplied
    Value("out_depth", "vec4", 1),  # depth times opacity [world units], 0, 0, opacity
)


def source(stage: str) -> str:
    """The GLSL of a stage ("vertex" or "fragment") without declarations, the shared functions first."""
    folder = Path(__file__).parent
    names = {"vertex": ("raygs", "harmonics", "vertex"), "fragment": ("random", "fragment")}[stage]
    return "\n".join((folder / f"{name}.glsl").read_text(encoding="utf-8") for name in names)


@dataclass(frozen=True)
class Variant:
    """What is decided when the shaders are compiled.

    - `stochastic`: fragments are kept by chance and write their depth.
    - `paged`: records fill more than the first of `SPLATS` (choosing takes llvmpipe a fifth of the vertex work).
    """

    stochastic: bool = False
    paged: bool = False

    @property
    def defines(self) -> tuple[str, ...]:
        return ("STOCHASTIC",) * self.stochastic + ("PAGED",) * self.paged


def header(stage: str, variant: Variant, *, per_sample: bool) -> str:
    """Declarations of a stage for a plain GLSL compiler."""
    lines = [GLSL_VERSION, *(f"#define {name}" for name in variant.defines)]
    lines += [f"#define {name} {number}" for name, number in DEFINES.items()]
    lines += [f"uniform {value.glsl_type} {value.name};" for value in CONSTANTS]
    if stage == "vertex":
        lines += [f"uniform sampler2D {texture.name};" for texture in TEXTURES]
        lines += [f"layout(location = {value.location}) in {value.glsl_type} {value.name};" for value in ATTRIBUTES]
    direction = "out" if stage == "vertex" else "in"
    smooth = "sample" if per_sample else "smooth"
    lines += [f"{smooth} {direction} {value.glsl_type} {value.name};" for value in SMOOTH]
    lines += [f"flat {direction} {value.glsl_type} {value.name};" for value in FLAT]
    if stage == "fragment":
        lines += [f"layout(location = {value.location}) out {value.glsl_type} {value.name};" for value in OUTPUTS]
    return "\n".join(lines) + "\n"


def complete_source(stage: str, variant: Variant, *, per_sample: bool) -> str:
    """Header and source of a stage, ready to compile."""
    return header(stage, variant, per_sample=per_sample) + source(stage)


def create_info_calls(variant: Variant) -> tuple[list[tuple], list[tuple]]:
    """(method, arguments …) to call on a GPUShaderCreateInfo and on its GPUStageInterfaceInfo.

    The caller adds `vertex_out(interface)` and both sources, which are `source("vertex")` and `source("fragment")`.
    """
    info: list[tuple] = [("push_constant", value.glsl_type.upper(), value.name) for value in CONSTANTS]
    info += [("sampler", texture.slot, "FLOAT_2D", texture.name) for texture in TEXTURES]
    info += [("vertex_in", value.location, value.glsl_type.upper(), value.name) for value in ATTRIBUTES]
    info += [("fragment_out", value.location, value.glsl_type.upper(), value.name) for value in OUTPUTS]
    info += [("define", name, str(number)) for name, number in DEFINES.items()]
    info += [("define", name) for name in variant.defines]
    if variant.stochastic:
        info.append(("depth_write", "ANY"))
    stage: list[tuple] = [("smooth", value.glsl_type.upper(), value.name) for value in SMOOTH]
    stage += [("flat", value.glsl_type.upper(), value.name) for value in FLAT]
    return info, stage
