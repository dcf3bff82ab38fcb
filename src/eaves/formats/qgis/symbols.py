"""Symbols and renderers as QGIS 3.22 and later write them in XML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement

FROM_EXPRESSION = "3"
"""QGIS's number for a property that an expression gives."""


def option_map(parent: Element, values: Mapping[str, str]) -> None:
    """Adds values as the `<Option>` elements that QGIS keeps a symbol's properties in."""
    options = SubElement(parent, "Option", type="Map")
    for name, value in values.items():
        SubElement(options, "Option", type="QString", name=name, value=value)


def data_defined(parent: Element, tag: str, expressions: Mapping[str, str]) -> None:
    """Adds the properties that expressions give."""
    options = SubElement(SubElement(parent, tag), "Option", type="Map")
    SubElement(options, "Option", type="QString", name="name", value="")
    properties = SubElement(options, "Option", type="Map", name="properties")
    for name, expression in expressions.items():
        option = SubElement(properties, "Option", type="Map", name=name)
        SubElement(option, "Option", type="bool", name="active", value="true")
        SubElement(option, "Option", type="QString", name="expression", value=expression)
        SubElement(option, "Option", type="int", name="type", value=FROM_EXPRESSION)
    SubElement(options, "Option", type="QString", name="type", value="collection")


def rgba(colour: str) -> str:
    """`r,g,b,a` of `#rrggbb` or `#rrggbbaa`."""
    digits = colour.lstrip("#").ljust(8, "f")
    return ",".join(str(int(digits[k : k + 2], 16)) for k in range(0, 8, 2))


def symbol_layer(
    fill: str,
    edge: str = "#333333",
    width: float = 0.15,
    pattern: str = "solid",
    shape: str = "",
    tint: str = "",
) -> Element:
    """A layer of a symbol: an area of one colour with an edge (width in mm); `tint` is an expression of its
    colour, `shape` one of what is drawn instead of the feature."""
    area = Element("layer", {"class": "SimpleFill", "enabled": "1", "locked": "0", "pass": "0"})
    values = {
        "color": rgba(fill),
        "style": pattern,
        "outline_color": rgba(edge),
        "outline_style": "solid" if width else "no",
        "outline_width": f"{width:g}",
        "outline_width_unit": "MM",
        "joinstyle": "miter",
    }
    option_map(area, values)
    if tint:
        data_defined(area, "data_defined_properties", {"fillColor": tint})
    if not shape:
        return area
    layer = Element("layer", {"class": "GeometryGenerator", "enabled": "1", "locked": "0", "pass": "0"})
    option_map(layer, {"SymbolType": "Fill", "geometryModifier": shape, "units": "MapUnit"})
    layer.append(symbol("@0@0", [area]))
    return layer


def symbol(name: str, layers: Sequence[Element]) -> Element:
    """A fill symbol of layers drawn in this order."""
    element = Element("symbol", type="fill", name=name, alpha="1", clip_to_extent="1", force_rhr="0")
    element.extend(layers)
    return element


def single(layers: Sequence[Mapping[str, Any]], farthest: str | None = None) -> Element:
    """One symbol for all features, drawn by falling values of an expression where one is given."""
    renderer = Element("renderer-v2", type="singleSymbol", symbollevels="0", forceraster="0")
    SubElement(renderer, "symbols").append(symbol("0", [symbol_layer(**layer) for layer in layers]))
    renderer.set("enableorderby", "1" if farthest else "0")
    if farthest:
        clause = SubElement(SubElement(renderer, "orderby"), "orderByClause", asc="0", nullsFirst="0")
        clause.text = farthest
    return renderer


def classified(by: str, classes: Sequence[Mapping[str, Any]]) -> Element:
    """A symbol for each value, or range from `low` to `high`, of an expression."""
    ranged = "low" in classes[0]
    renderer = Element("renderer-v2", attr=by, enableorderby="0", forceraster="0", symbollevels="0")
    renderer.set("type", "graduatedSymbol" if ranged else "categorizedSymbol")
    if ranged:
        renderer.set("graduatedMethod", "GraduatedColor")
    listed = SubElement(renderer, "ranges" if ranged else "categories")
    symbols = SubElement(renderer, "symbols")
    for number, grade in enumerate(classes):
        if ranged:
            entry = SubElement(listed, "range", lower=f"{grade['low']:.6f}", upper=f"{grade['high']:.6f}")
        else:
            entry = SubElement(listed, "category", value=grade["value"], type="string")
        entry.attrib |= {
            "label": grade.get("label", grade.get("value")),
            "symbol": str(number),
            "render": "true",
        }
        drawn = {name: grade[name] for name in ("fill", "edge", "width", "pattern") if name in grade}
        symbols.append(symbol(str(number), [symbol_layer(**drawn)]))
    return renderer


def raised_polygons(
    colour: str, expressions: Mapping[str, str] | None = None, tint: str | None = None
) -> Element:
    """The 3D renderer of polygons at their own heights; `expressions` may raise (`height`) and extrude
    (`extrusionHeight`) them, `tint` is an expression of their colour."""
    renderer = Element("renderer-3d", type="vector", layer="")
    SubElement(renderer, "vector-layer-3d-tiling", {"zoom-levels-count": "3", "show-bounding-boxes": "0"})
    element = SubElement(renderer, "symbol", type="polygon", material_type="phong")
    SubElement(
        element,
        "data",
        {
            "alt-clamping": "absolute",
            "alt-binding": "vertex",
            "height": "0",
            "extrusion-height": "0",
            "culling-mode": "no-culling",
            "invert-normals": "0",
            "add-back-faces": "0",
            "rendered-facade": "3",
        },
    )
    *parts, opaque = rgba(colour).split(",")
    ambient = ",".join([*(str(int(float(part) * 0.35)) for part in parts), opaque])
    material = SubElement(element, "material", diffuse=rgba(colour), ambient=ambient)
    material.set("specular", rgba("#101010"))
    material.set("shininess", "0")
    if tint:
        dark = f"darker({tint}, 260)"
        data_defined(material, "data-defined-properties", {"diffuse": tint, "ambient": dark})
    data_defined(element, "data-defined-properties", expressions or {})
    SubElement(element, "edges", enabled="0", width="1", color=rgba("#000000"))
    return renderer
