"""The styles of the layers that a run writes, as `styles.toml` lists them, in QGIS's XML.

A style is a list of XML elements: inside `<qgis>` they are a QML document (`as_qml`), inside `<maplayer>` a
layer of a project. Heights are in metres in the attributes and in the system's unit in the geometry.
"""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

from eaves.formats.columns import COLUMNS
from eaves.formats.crs import unit_lengths
from eaves.formats.qgis.symbols import classified, raised_polygons, single
from eaves.model import CoordinateSystem

VERSION = "3.22.0"
"""The oldest QGIS whose XML this is; newer ones read it."""


@dataclass(frozen=True, eq=False)
class Style:
    """A named way to draw a layer; the first of a layer is the one it opens with."""

    name: str
    meaning: str
    elements: tuple[Element, ...]

    def root(self) -> Element:
        """The style as the element that a document has, and a project that keeps it."""
        element = Element("qgis", version=VERSION, styleCategories="AllStyleCategories")
        element.extend(self.elements)
        return element

    def as_qml(self) -> str:
        """The style as a QML document."""
        head = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
        return head + tostring(self.root(), "unicode")


@functools.cache
def listed_styles() -> dict[str, dict[str, Any]]:
    """The styles by layer, as `styles.toml` has them."""
    return tomllib.loads(files("eaves.formats.qgis").joinpath("styles.toml").read_text("utf-8"))


def styles_of(layer: str, columns: Sequence[str], system: CoordinateSystem, note: str = "") -> list[Style]:
    """The styles of a layer with these columns, `note` in their legends; none for a layer of another name."""
    about = listed_styles().get("lod" if layer.startswith("lod_") else layer)
    if about is None:
        return []
    beside = [raised_polygons(**about["raised"])] if "raised" in about else []
    beside.append(aliases(columns))
    if "tip" in about:
        beside.append(Element("mapTip"))
        beside[-1].text = about["tip"]
    return [
        Style(
            style["name"],
            style["meaning"].replace("{note}", note),
            (renderer_of(style, system, note), *beside),
        )
        for style in about["styles"]
        if style.get("needs") in (None, *columns) and style.get("unless") not in columns
    ]


def renderer_of(style: dict[str, Any], system: CoordinateSystem, note: str) -> Element:
    """The renderer of a style: by classes, or one symbol for all features."""
    if "by" in style:
        labels = [
            grade.get("label", grade.get("value")).replace("{note}", note) for grade in style["classes"]
        ]
        classes = [{**grade, "label": label} for grade, label in zip(style["classes"], labels, strict=True)]
        return classified(style["by"], classes)
    unit = f"{unit_lengths(system)[0]:.9g}"
    layers = [{**layer, "shape": layer.get("shape", "").replace("{unit}", unit)} for layer in style["layers"]]
    return single(layers, style.get("farthest"))


def aliases(columns: Sequence[str]) -> Element:
    """The names that QGIS shows for the columns."""
    element = Element("aliases")
    for number, name in enumerate(columns, 1):  # 0 is the feature's number
        label = COLUMNS[name].label if name in COLUMNS else ""
        SubElement(element, "alias", index=str(number), field=name, name=label)
    return element
