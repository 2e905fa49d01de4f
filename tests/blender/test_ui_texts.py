# SPDX-License-Identifier: GPL-3.0-or-later
"""What the interface says follows Blender's guidelines, and the guide lists every operator and property.

https://developer.blender.org/docs/features/interface/human_interface_guidelines/: labels in Title Case, tooltips of
everything that can be set, without a period at their end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "scripting.md"
SMALL_WORDS = {"a", "an", "and", "as", "at", "by", "for", "from", "in", "of", "on", "or", "per", "the", "to", "with"}
STANDARD = {"filepath", "filter_glob", "directory", "files", "check_existing", "name", "rna_type"}
SPLAT_MODULES = ("stipple", "import_scene", "export_scene", "object")


def own(cls: type) -> bool:
    return cls.__module__.startswith("stipple.")


def own_classes(base: type) -> list[Any]:
    return [cls for cls in base.__subclasses__() if own(cls)]


def operators() -> Iterator[tuple[str, Any]]:
    """Name in bpy.ops and RNA of each, but for those that only serve the interface."""
    for module in SPLAT_MODULES:
        for name in dir(getattr(bpy.ops, module)):
            operator = getattr(getattr(bpy.ops, module), name)
            if (module == "stipple" or "splat" in name or "stipple" in name) and "INTERNAL" not in operator.bl_options:
                yield f"{module}.{name}", operator.get_rna_type()


def groups() -> list[Any]:
    return [cls.bl_rna for cls in own_classes(bpy.types.PropertyGroup)]


def settable(rna: Any) -> Iterator[Any]:
    for b_property in rna.properties:
        if b_property.identifier not in STANDARD and not b_property.is_hidden and b_property.type != "POINTER":
            yield b_property


def test_labels_are_in_title_case() -> None:
    labels = [rna.name for _, rna in operators()]
    labels += [p.name for rna in (*groups(), *(rna for _, rna in operators())) for p in settable(rna)]
    labels += [cls.bl_label for base in (bpy.types.Panel, bpy.types.Menu) for cls in own_classes(base)]
    labels = [label for label in labels if label not in ("location", "radius")]  # of a dab, never shown
    assert not [
        label
        for label in labels
        if any(word.islower() and word not in SMALL_WORDS for word in re.findall(r"(?<!\))\b[A-Za-z']+", label))
    ]


def test_tooltips_say_something_and_end_without_a_period() -> None:
    texts = {name: rna.description for name, rna in operators()}
    for name, rna in (*((rna.identifier, rna) for rna in groups()), *operators()):
        texts |= {f"{name}.{p.identifier}": p.description for p in settable(rna)}
        for b_property in settable(rna):
            if b_property.type == "ENUM":
                texts |= {
                    f"{name}.{b_property.identifier}={i.name}": i.description or "-" for i in b_property.enum_items
                }
    internal = ("StippleDab.", "StippleLinkedCapture.", "StippleEditSettings.has_clone_source", "STIPPLE_OT_")
    texts = {name: text for name, text in texts.items() if not name.startswith(internal)}
    assert not [name for name, text in texts.items() if not text or text.endswith(".") or text[0].islower()]


def test_every_operator_and_property_is_in_the_guide() -> None:
    guide = GUIDE.read_text(encoding="utf-8")
    wanted = [f"bpy.ops.{name}" for name, _ in operators()]
    for rna in (*groups(), *(rna for _, rna in operators())):
        wanted += [f"`{p.identifier}`" for p in settable(rna)]
    assert not [text for text in wanted if text not in guide]
