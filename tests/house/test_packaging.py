# SPDX-License-Identifier: GPL-3.0-or-later
"""pyproject.toml, the manifest, the constraints and the folders agree; imports cost what they should."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


@pytest.fixture(scope="module")
def project(root: Path) -> dict[str, object]:
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def manifest(root: Path) -> dict[str, object]:
    return tomllib.loads((root / "blender_manifest.toml").read_text(encoding="utf-8"))


def test_one_version_and_one_licence(project: dict, manifest: dict, root: Path) -> None:
    assert project["project"]["version"] == manifest["version"]
    assert manifest["license"] == [f"SPDX:{project['project']['license']}"]
    assert manifest["id"] == project["project"]["name"] == "stipple"
    assert manifest["blender_version_min"] == "4.5.0"
    assert f"## {manifest['version']}" in (root / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_package_is_listed(project: dict, root: Path) -> None:
    folders = {file.parent for top in ("engine", "addon") for file in (root / top).rglob("*.py")}
    packages = {"stipple", *(".".join(("stipple", *folder.relative_to(root).parts)) for folder in folders)}
    assert set(project["tool"]["setuptools"]["packages"]) == packages
    assert [folder for folder in folders if not (folder / "__init__.py").exists()] == []


def applies(requirement: Requirement, python: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"python_version": python})


def test_every_requirement_is_pinned_within_its_range(project: dict, root: Path) -> None:
    """In constraints.txt; Blender, of which an environment holds one of several, where it is required."""
    lines = (root / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line) for line in lines if line and not line.startswith("#")]
    extras = project["project"]["optional-dependencies"]
    wanted = [Requirement(text) for text in sum(extras.values(), project["project"]["dependencies"])]
    for python in ("3.11", "3.13"):
        pinned = {canonicalize_name(pin.name): pin for pin in pins if applies(pin, python)}
        for requirement in wanted:
            if applies(requirement, python) and not str(requirement.specifier).startswith("=="):
                version = str(pinned[canonicalize_name(requirement.name)].specifier).removeprefix("==")
                assert requirement.specifier.contains(version), f"{requirement} is pinned to {version} on {python}"


def test_importing_the_package_loads_neither_blender_nor_warp() -> None:
    code = "import sys, stipple, stipple.engine, stipple.engine.splats, stipple.engine.camera, stipple.engine.settings;"
    code += "print(*(name for name in ('bpy', 'warp') if name in sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (result.returncode, result.stdout, result.stderr) == (0, "\n", "")


def test_no_registry_host_or_private_path_is_named(root: Path) -> None:
    """Files name no package index and no place that exists on one machine only."""
    private = re.compile(r"index-url|find-links|/home/\w|/Users/\w|[\"' ]/work/|/tmp/\w")
    found = []
    for pattern in ("*.toml", "*.md", "*.txt", ".pre-commit-config.yaml", "[aestd]*/**/*.py", "scripts/*", ".ci/run"):
        for file in root.glob(pattern):
            if file.is_file() and file != Path(__file__) and private.search(file.read_text(encoding="utf-8")):
                found.append(str(file.relative_to(root)))
    assert found == []
