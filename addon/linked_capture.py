# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures that stay in their file: `data.stipple_capture` of a PointCloud or Mesh that holds a proxy of one.

The path is that of a CacheFile datablock, Blender's own kind for geometry in external files, because Blender then looks
after it: *Find Missing Files*, *Make Paths Relative*, *Report Missing Files*, the remapping when a file is saved
elsewhere, appended or linked. Blender opens cache files of Alembic and USD only, packs none and saves to none. (Paths
in properties of add-ons get none of this; those of images and volumes would be packed, a text's written over.)

The proxy has the usual attributes (`splat_data`), so that it shows, is selected and framed like any capture. Nothing
else of the capture is in the .blend.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import FloatVectorProperty, IntProperty, PointerProperty, StringProperty

from ..engine.capture_file import CaptureFile, Survey
from ..engine.errors import StippleError
from ..engine.splats import SplatCloud
from .splat_data import datablock_from_cloud, resize_points, splat_count_of, write_cloud

ID_TYPES = (bpy.types.PointCloud, bpy.types.Mesh)


class StippleLinkedCapture(bpy.types.PropertyGroup):
    """What a datablock keeps of the file it stands for; `fingerprint` is empty where it stands for none."""

    file: PointerProperty(type=bpy.types.CacheFile, name="File")  # type: ignore[valid-type]
    fingerprint: StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    splat_count: IntProperty(name="Splats", min=0)  # type: ignore[valid-type]
    sh_degree: IntProperty(name="SH Degree", min=0, max=4)  # type: ignore[valid-type]
    bounds_low: FloatVectorProperty(name="Smallest", size=3, subtype="XYZ")  # type: ignore[valid-type]
    bounds_high: FloatVectorProperty(name="Largest", size=3, subtype="XYZ")  # type: ignore[valid-type]
    proxy_step: IntProperty(options={"HIDDEN"})  # type: ignore[valid-type]  # splats of the file per point
    edits: StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]  # see `linked_edits`
    edits_file: StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]  # beside the .blend
    edits_folder: StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]  # that it was written to


def is_linked(b_data: Any) -> bool:
    """Whether a datablock, original or evaluated, stands for a file.

    Geometry Nodes keep this where they instance or pass on the geometry, and lose it where they make a new one: with
    *Delete*, *Join Geometry* and *Realize Instances*. Then only points of the proxy are left, see `lost_notice`.
    """
    return isinstance(b_data, ID_TYPES) and bool(b_data.stipple_capture.fingerprint)


def lost_notice(b_object: Any) -> str:
    """A sentence where the modifiers of an evaluated object left points of the proxy in place of the file; mostly "".

    They might be one part of it or ten copies: the file is no substitute, and the points must not pass for it.
    """
    b_data, b_source = b_object.data, b_object.original.data
    if is_linked(b_data) or not is_linked(b_source):
        return ""
    return (
        f"{b_object.name}: its modifiers leave {splat_count_of(b_data):,} points of the proxy in place of the linked "
        f"file's {b_source.stipple_capture.splat_count:,} splats; let them instance it, or import it without Link."
    )


def path_of(b_data: Any) -> Path | None:
    """The absolute path of the linked file; None where its datablock was deleted."""
    b_file = b_data.stipple_capture.file
    if b_file is None:
        return None
    b_file = b_file.original
    return Path(os.path.normpath(bpy.path.abspath(b_file.filepath, library=b_file.library)))


def problem_of(b_data: Any, name: str) -> str:
    """What keeps a linked file from being read as far as a look at the disk tells; "" where nothing does."""
    path = path_of(b_data)
    if path is not None and path.is_file():
        return ""
    missing = f"the linked file {path} is missing" if path else "the link to its file was deleted"
    return f"{name}: {missing}; choose the file in Object Data properties > Linked Capture > Relink."


def fingerprint_text(capture: CaptureFile) -> str:
    state = capture.fingerprint
    return f"{state.file_bytes} {state.modified_ns} {state.samples}"


def new_linked_data(capture: CaptureFile, survey: Survey, name: str) -> Any:
    """A new datablock that stands for the file; leaves nothing behind if it fails."""
    b_data = datablock_from_cloud(proxy_of(survey), name)
    try:
        _note(b_data, capture, survey)
        b_data.stipple_capture.file = _cache_file_of(capture.path)
    except BaseException:
        bpy.data.batch_remove([b_data])
        raise
    return b_data


def relink(b_data: Any, capture: CaptureFile, survey: Survey) -> None:
    """Makes a linked datablock stand for this file, which may be another one; all that use its CacheFile follow."""
    b_capture = b_data.stipple_capture
    if b_capture.file is None:
        b_capture.file = _cache_file_of(capture.path)
    elif path_of(b_data) != capture.path:
        b_capture.file.filepath = _path_for_blend(capture.path)
    proxy = proxy_of(survey)
    resize_points(b_data, proxy.splat_count)
    write_cloud(b_data, proxy)
    _note(b_data, capture, survey)
    b_data.update_tag()


def link_anew(b_data: Any, capture: CaptureFile, survey: Survey) -> None:
    """As `relink`, but what else stands for the file that this datablock stood for goes on doing so."""
    b_data.stipple_capture.file = None
    relink(b_data, capture, survey)


def proxy_of(survey: Survey) -> SplatCloud:
    """The survey's sample without harmonics, its splats so much larger that they cover what all of them do."""
    sample = survey.sample
    growth = np.float32(np.sqrt(survey.splat_count / sample.splat_count))
    no_harmonics = np.empty((sample.splat_count, 0, 3), np.float32)
    return replace(sample, scale=sample.scale * growth, sh_rest=no_harmonics)


def _note(b_data: Any, capture: CaptureFile, survey: Survey) -> None:
    b_capture = b_data.stipple_capture
    b_capture.fingerprint = fingerprint_text(capture)
    b_capture.splat_count, b_capture.sh_degree = min(survey.splat_count, (1 << 31) - 1), capture.sh_degree
    b_capture.bounds_low, b_capture.bounds_high = survey.bounds
    b_capture.proxy_step = survey.step


def _path_for_blend(path: Path) -> str:
    """Relative to the .blend file where that is saved, on the same drive, and the user's preferences say so."""
    if not bpy.data.filepath or not bpy.context.preferences.filepaths.use_relative_paths:
        return str(path)
    try:
        return str(bpy.path.relpath(str(path)))
    except ValueError:  # another drive
        return str(path)


def _cache_file_of(path: Path) -> Any:
    """The CacheFile of this path, a new one where there is none."""
    for b_file in bpy.data.cache_files:
        if b_file.library is None and Path(os.path.normpath(bpy.path.abspath(b_file.filepath))) == path:
            return b_file
    before = set(bpy.data.cache_files)
    if bpy.ops.cachefile.open(filepath=str(path), relative_path=False) != {"FINISHED"}:
        raise StippleError(f"{path}: Blender could not link the file.")
    (b_file,) = set(bpy.data.cache_files) - before
    b_file.filepath = _path_for_blend(path)
    return b_file


def register() -> None:
    bpy.utils.register_class(StippleLinkedCapture)
    for id_type in ID_TYPES:
        id_type.stipple_capture = PointerProperty(type=StippleLinkedCapture)


def unregister() -> None:
    for id_type in ID_TYPES:
        del id_type.stipple_capture
    bpy.utils.unregister_class(StippleLinkedCapture)
