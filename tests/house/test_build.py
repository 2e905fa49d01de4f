# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension is built, installed and used the way a user does it: the zip, a fresh profile, Blender."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scripts import build_extension
from stipple.engine.formats import write_splats
from stipple.engine.splats import SplatCloud

pytestmark = [pytest.mark.blender, pytest.mark.slow]

# Runs in a Python that has Blender but neither this checkout nor what it depends on: those must come from the zip.
USE_AS_A_USER = """
import sys
import bpy
archive, capture, picture = sys.argv[1:]
installed = bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
assert installed == {"FINISHED"}, installed
assert "bl_ext.user_default.stipple" in bpy.context.preferences.addons
scene = bpy.context.scene
for b_object in list(bpy.data.objects):
    bpy.data.objects.remove(b_object)
assert bpy.ops.import_scene.splats(filepath=capture) == {"FINISHED"}
scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
scene.collection.objects.link(scene.camera)
scene.camera.location, scene.camera.rotation_euler = (0, -4, 0), (1.5707963, 0, 0)
scene.render.engine, scene.stipple.method = "STIPPLE", "SORTED"
scene.render.resolution_x = scene.render.resolution_y = 64
scene.render.film_transparent = True
scene.view_settings.view_transform = "Standard"
scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
scene.render.filepath = picture
assert bpy.ops.render.render(write_still=True) == {"FINISHED"}
import plyfile, warp
engine = sys.modules["bl_ext.user_default.stipple.engine"]
print("LOADED", engine.__file__, warp.__file__, plyfile.__file__, sep="|")
"""


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The zip of the platform the tests run on, freshly built."""
    platforms = {"linux": "linux_x64", "win32": "windows_x64", "darwin": "macos_arm64"}
    return build_extension.build(platforms[sys.platform], tmp_path_factory.mktemp("dist"))


def test_the_zip_holds_what_it_should_and_no_more(archive: Path, root: Path) -> None:
    with zipfile.ZipFile(archive) as packed:
        names = packed.namelist()
        manifest = tomllib.loads(packed.read("blender_manifest.toml").decode())
    source = tomllib.loads((root / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert archive.name.startswith(f"stipple-{source['version']}-")
    assert {name.split("/")[0] for name in names} == {
        "blender_manifest.toml", "__init__.py", "addon", "engine", "wheels", "LICENSE",
    }  # fmt: skip
    modules = {file.relative_to(root).as_posix() for top in ("addon", "engine") for file in (root / top).rglob("*.py")}
    assert modules <= set(names)
    assert {Path(wheel).name.split("-")[0] for wheel in manifest["wheels"]} == {"warp_lang", "plyfile"}
    assert all("-py3-none-" in wheel for wheel in manifest["wheels"]), "a wheel for one Python only serves one Blender"
    assert len(manifest["platforms"]) == 1
    assert {key: manifest[key] for key in source} == source


def test_a_user_installs_the_zip_and_renders(archive: Path, tmp_path: Path) -> None:
    capture, picture = tmp_path / "dot.ply", tmp_path / "dot.png"
    write_splats(capture, one_red_splat())
    profile = {"BLENDER_USER_RESOURCES": str(tmp_path / "profile"), "PYTHONPATH": str(plain_blender(tmp_path / "site"))}
    environment = {**os.environ, **profile}
    command = [sys.executable, "-S", "-c", USE_AS_A_USER, archive, capture, picture]
    result = subprocess.run(command, check=False, capture_output=True, text=True, env=environment, cwd=tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    loaded = next(line for line in result.stdout.splitlines() if line.startswith("LOADED")).split("|")[1:]
    assert all(Path(file).is_relative_to(tmp_path / "profile") for file in loaded), loaded
    rgba = read_picture(picture)
    assert rgba[32, 32, 0] > 0.9 and rgba[32, 32, 3] > 0.95
    assert rgba[32, 32, 1] < 0.1
    assert rgba[2, 2, 3] == 0.0


def plain_blender(folder: Path) -> Path:
    """A folder of installed packages, linked, without Stipple, Warp and plyfile and without what points to them."""
    folder.mkdir()
    spec = find_spec("bpy")
    assert spec and spec.origin
    for entry in Path(spec.origin).parent.parent.iterdir():
        if not entry.name.startswith(("warp", "plyfile", "stipple", "__editable__")) and entry.suffix != ".pth":
            (folder / entry.name).symlink_to(entry)
    return folder


def one_red_splat() -> SplatCloud:
    return SplatCloud(
        position=np.zeros((1, 3), np.float32),
        scale=np.full((1, 3), 0.5, np.float32),
        rotation=np.array([[1, 0, 0, 0]], np.float32),
        opacity=np.full(1, 0.995, np.float32),
        sh_dc=np.array([[1.7, -1.7, -1.7]], np.float32),
        sh_rest=np.zeros((1, 0, 3), np.float32),
    )


def read_picture(path: Path) -> np.ndarray:
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGBA"), dtype=np.float64) / 255
