# SPDX-License-Identifier: GPL-3.0-or-later
"""Where *rays* finds a splat's record: in the largest captures, across textures, in the shaders' own whole numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stipple.engine.buffers import Buffers
from stipple.engine.device import choose_device
from stipple.engine.device_cloud import DeviceCloud
from stipple.engine.errors import StippleError
from stipple.engine.rays.texels import MOST_TEXELS, splat_pages, texels_per_splat
from stipple.engine.renderer import Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import ARRAY_NAMES, SplatCloud
from tests.render.shader_probe import run_probe
from tests.scenes import front_camera, random_cloud, scene_of

PLAIN = Settings(method="rays", dilation_px2=0.0)

# The vertex shader's own functions, called for numbers that no test could hold textures for.
PROBE = """
in ivec4 asked; // splat in two parts, cloud's first texel in two parts
in ivec2 laid;  // texels per splat, side of a page
out int texel;
out ivec3 place;
void main() {
  int splat = joined(vec2(asked.xy));
  texel = first_texel(vec2(asked.zw), splat, laid.x);
  place = place_of(texel, ivec2(laid.y));
}
"""


def test_the_shader_counts_in_whole_numbers(rays: Renderer) -> None:
    """Splats and texels around 2¹⁶, 2²⁴ and the last one of 2³¹, in pages up to the largest of today's hardware."""
    rng = np.random.default_rng(3)
    edges = np.array([0, (1 << 16) - 1, 1 << 16, (1 << 24) - 1, 1 << 24, (1 << 24) + 1, (1 << 26) + 3], np.int64)
    rows = [
        (splat, start, per_splat, side)
        for side in (64, 4096, 16384, 32768)
        for per_splat in (4, 7, 10, 16, 22)
        for splat in (*edges, *rng.integers(0, 1 << 26, 20))
        for start in (0, (1 << 24) + 1, int(rng.integers(0, 1 << 30)))
        if start + splat * per_splat <= MOST_TEXELS
    ]
    rows += [(0, MOST_TEXELS, 16, 32768), ((MOST_TEXELS - 1) // 16, 1, 16, 32768)]
    splat, start, per_splat, side = np.array(rows, np.int64).T
    asked = np.column_stack([*np.divmod(splat, 1 << 16), *np.divmod(start, 1 << 16), per_splat, side]).astype(np.int32)
    content = ("4i 2i", "asked", "laid")
    found = run_probe(rays, PROBE, content, {"texel": 1, "place": 3}, asked)  # texel; page, column, row
    wanted = start + splat * per_splat
    assert wanted.max() == MOST_TEXELS
    assert (found[:, 0] == wanted).all()
    assert (found[:, 1] == wanted // side**2).all()
    assert (found[:, 2] == wanted % side).all()
    assert (found[:, 3] == wanted % side**2 // side).all()


def test_more_texels_than_the_shaders_can_count_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """However large the textures are."""
    cloud = DeviceCloud()
    cloud.splat_count, cloud.sh_degree = MOST_TEXELS // 16 + 1, 3
    pages = splat_pages([cloud], 32768, 4, Buffers(choose_device("cpu")))
    with pytest.raises(StippleError, match="can be given 2,147,483,647"):
        next(pages)


def test_captures_may_fill_several_textures(monkeypatch: pytest.MonkeyPatch, rays: Renderer) -> None:
    """Records across the ends of pages, clouds across pages, and a page too many."""
    host = rays.raster().host
    scene = scene_of(random_cloud(200, 1, sh_degree=3), random_cloud(70, 2), random_cloud(90, 3, sh_degree=2))
    camera = front_camera()
    whole = rays.render(scene, camera, PLAIN)
    for largest, pages in ((43, 3), (37, 4)):  # 4,380 texels
        monkeypatch.setattr(host, "largest_texture", largest)
        assert -(-4380 // largest**2) == pages
        fresh = Scene(tuple(Instance(replace(instance.cloud)) for instance in scene.instances))
        assert (rays.render(fresh, camera, PLAIN).rgba == whole.rgba).all()
    monkeypatch.setattr(host, "largest_texture", 33)
    with pytest.raises(StippleError, match="4,380 texels and this graphics device can be given 4,356"):
        rays.render(scene, camera, PLAIN)
    monkeypatch.undo()
    assert (rays.render(scene, camera, PLAIN).rgba == whole.rgba).all()


@pytest.mark.slow
def test_splats_beyond_two_to_the_24th_texel_are_found(rays: Renderer) -> None:
    """800,000 degree-4 splats of which only the last 60 can be seen: 17.6 M texels, in floats' odd range."""
    few, many = random_cloud(60, 1, sh_degree=4), 800_000
    arrays = {name: np.zeros((many, *getattr(few, name).shape[1:]), np.float32) for name in ARRAY_NAMES}
    for name, array in arrays.items():
        array[-60:] = getattr(few, name)
    arrays["rotation"][:-60, 0] = 1.0
    seen = rays.render(scene_of(SplatCloud(**arrays)), front_camera(), PLAIN)
    assert many * texels_per_splat(4) > 1 << 24
    assert seen.stats.splats_visible <= 60
    assert (seen.rgba == rays.render(scene_of(few), front_camera(), PLAIN).rgba).all()
