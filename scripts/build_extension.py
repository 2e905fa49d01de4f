# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: one zip per platform, with the wheels of that platform; `scripts/build` runs it.

A zip holds blender_manifest.toml, __init__.py, addon/, engine/, wheels/ and LICENSE. The version is the manifest's. The
wheels are the versions in constraints.txt, downloaded once into .wheels/. Blender's own tool packs and validates the
zip; it comes with the module bpy, which has to be installed. A zip appears in dist/ only when it is valid.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CONTENTS = ("__init__.py", "addon", "engine", "LICENSE")
WHEELS = ("warp-lang", "plyfile")  # NumPy comes with Blender
# Platform -> tags of wheels that run there, the newest first.
PLATFORMS = {
    "linux_x64": ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64"),
    "windows_x64": ("win_amd64",),
    "macos_arm64": ("macosx_11_0_arm64",),
}


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="scripts/build", description="Build the Blender extension.")
    parser.add_argument("--platform", action="append", choices=PLATFORMS, help="only this one; may be repeated")
    parser.add_argument("--output", type=Path, default=ROOT / "dist", metavar="FOLDER", help="default: dist/")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    for platform in options.platform or PLATFORMS:
        path = build(platform, options.output)
        print(f"{path} ({path.stat().st_size / 2**20:.0f} MiB)")


def build(platform: str, output: Path) -> Path:
    """Make and validate the zip of one platform; returns its path."""
    manifest = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    wheels = download_wheels(platform)
    with tempfile.TemporaryDirectory(prefix="stipple-build-", dir=output) as folder:
        stage = Path(folder) / "stipple"
        stage.mkdir()
        for name in CONTENTS:
            copy_source(ROOT / name, stage / name)
        (stage / "wheels").mkdir()
        for wheel in wheels:
            link_or_copy(wheel, stage / "wheels" / wheel.name)
        (stage / "blender_manifest.toml").write_text(manifest_for(manifest, platform, wheels), encoding="utf-8")
        version = tomllib.loads(manifest)["version"]
        packed = Path(folder) / f"stipple-{version}-{platform}.zip"
        run_blender_tool("build", "--source-dir", str(stage), "--output-filepath", str(packed))
        run_blender_tool("validate", str(packed))
        return packed.replace(output / packed.name)


def manifest_for(manifest: str, platform: str, wheels: list[Path]) -> str:
    """The manifest with `platforms` and `wheels`, which have to stand before its first table."""
    lines = [f"platforms = [{toml_string(platform.replace('_', '-'))}]", "wheels = ["]
    lines += [f"    {toml_string(f'./wheels/{wheel.name}')}," for wheel in wheels] + ["]", "", ""]
    table = re.search(r"^\[", manifest, re.MULTILINE)
    start = table.start() if table else len(manifest)
    return f"{manifest[:start].rstrip()}\n\n" + "\n".join(lines) + manifest[start:]


def toml_string(text: str) -> str:
    return f'"{text}"'


def copy_source(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "*.pyc", ".*", "*.tmp"))
    else:
        shutil.copyfile(source, target)


def link_or_copy(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        shutil.copyfile(source, target)


def pinned_version(package: str) -> str:
    """The version of `package` in constraints.txt, which has to be one for every Python."""
    pattern = rf"^{re.escape(package)}==([^\s;]+)$"
    found = re.findall(pattern, (ROOT / "constraints.txt").read_text(encoding="utf-8"), re.MULTILINE)
    if len(found) != 1:
        sys.exit(f"build: constraints.txt must pin {package} once, without a marker: the zip serves every Blender.")
    return str(found[0])


def download_wheels(platform: str) -> list[Path]:
    """The platform's wheels, from .wheels/ or else from the package index."""
    cache = ROOT / ".wheels" / platform
    wheels = []
    for package in WHEELS:
        version = pinned_version(package)
        pattern = f"{package.replace('-', '_')}-{version}-*.whl"
        if not list(cache.glob(pattern)):
            pip_download(f"{package}=={version}", platform, cache)
        wheels.append(next(cache.glob(pattern)))
    return wheels


def pip_download(requirement: str, platform: str, cache: Path) -> None:
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=cache) as folder:  # an interrupted download leaves no half of a wheel
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "--quiet"]
        only = ["--no-deps", "--only-binary=:all:", "--python-version=3.11"]
        tags = [f"--platform={tag}" for tag in PLATFORMS[platform]]
        if subprocess.run([*pip, *only, *tags, "--dest", folder, requirement], check=False).returncode:
            sys.exit(f"build: pip could not download {requirement} for {platform} (its message is above).")
        for wheel in Path(folder).glob("*.whl"):
            wheel.replace(cache / wheel.name)


def run_blender_tool(*arguments: str) -> None:
    """Run Blender's extension tool; ends the program with the tool's message where it fails."""
    result = subprocess.run([sys.executable, blender_tool(), *arguments], check=False, capture_output=True, text=True)
    if result.returncode:
        sys.exit(f"build: Blender's tool could not {arguments[0]}: {result.stdout.strip()} {result.stderr.strip()}")


def blender_tool() -> Path:
    """The extension tool inside the module bpy, which is found but not imported (that takes seconds)."""
    bpy = importlib.util.find_spec("bpy")
    if bpy and bpy.origin:
        for tool in Path(bpy.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"):
            return tool
    sys.exit("build: the module bpy with Blender's extension tool is missing; run scripts/setup.")


if __name__ == "__main__":
    main(sys.argv[1:])
