# SPDX-License-Identifier: GPL-3.0-or-later
"""Loading kernels ahead of a render: which, and when it stops."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from stipple.engine.camera import Camera
from stipple.engine.device import choose_device
from stipple.engine.errors import Cancelled
from stipple.engine.renderer import METHOD_FRAMES, Renderer
from stipple.engine.scene import Instance, Scene
from stipple.engine.settings import Settings
from stipple.engine.splats import SplatCloud
from stipple.engine.warm_up import kernel_modules, load_kernels


def one_splat() -> Scene:
    arrays = {"position": [[0, 0, 2]], "scale": [[0.1] * 3], "rotation": [[1, 0, 0, 0]], "sh_dc": [[1, 0, 0]]}
    cloud = SplatCloud(
        **{name: np.array(value, np.float32) for name, value in arrays.items()},
        opacity=np.array([0.9], np.float32),
        sh_rest=np.empty((1, 0, 3), np.float32),
    )
    return Scene((Instance(cloud),))


@pytest.mark.parametrize("method", METHOD_FRAMES)
def test_a_render_needs_no_module_that_was_not_loaded_before(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if method == "rays":
        pytest.importorskip("moderngl")
    texts: list[str] = []
    load_kernels(choose_device("cpu"), method, lambda fraction, text: texts.append(f"{fraction:.2f} {text}"))
    loaded = {module.__name__ for module in kernel_modules(method, cuda=False)}
    assert len(texts) == len(loaded) and texts[0].startswith("0.00 preparing kernels 1/")
    launched: set[str] = set()
    launch = wp.launch
    monkeypatch.setattr(
        wp, "launch", lambda kernel, *a, **k: (launched.add(kernel.module.name), launch(kernel, *a, **k))
    )
    camera = Camera(np.eye(3, 4), 16, 16, 16.0, 16.0, 8.0, 8.0)
    Renderer("cpu").render(one_splat(), camera, Settings(method=method, samples=1))
    assert {name for name in launched if name.startswith("stipple.")} <= loaded


def test_it_stops_when_the_host_says_so() -> None:
    def stop(fraction: float, text: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        load_kernels(choose_device("cpu"), "sorted", stop)
