"""Symbols and renderers as QGIS 3.22 and later write them in XML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
        one = SubElement(properties, "Option", type="Map", name=name)
        SubElement(one, "Option", type="bool", name="active", value="true")
        SubElement(one, "Option", type="QString", name="expression", value=expression)
        SubElement(one, "Option", type="int", name="type", value=FROM_EXPRESSION)
    SubElement(options, "Option", type="QString", name="type", value="collection")


def rgba(colour: str) -> str:
    """`r,g,b,a` of `#rrggbb` or `#rrggbbaa`."""
    digits = colour.lstrip("#").ljust(8, "f")
    return ",".join(str(int(digits[k : k + 2], 16)) for k in range(0, 8, 2))


def fill(
    colour: str,
    edge: str = "#333333",
    width: float = 0.15,
    pattern: str = "solid",
    expressions: Mapping[str, str] | None = None,
) -> Element:
    """A layer of a symbol: an area of one colour with an edge (width in mm)."""
    layer = Element("layer", {"class": "SimpleFill", "enabled": "1", "locked": "0", "pass": "0"})
    values = {
        "color": rgba(colour),
        "style": pattern,
        "outline_color": rgba(edge),
        "outline_style": "solid" if width else "no",
        "outline_width": f"{width:g}",
        "outline_width_unit": "MM",
        "joinstyle": "miter",
    }
    option_map(layer, values)
    if expressions:
        data_defined(layer, "data_defined_properties", expressions)
    return layer


def generated(geometry: str, area: Element) -> Element:
    """A layer of a symbol that draws, instead of the feature, what an expression makes of it."""
    layer = Element("layer", {"class": "GeometryGenerator", "enabled": "1", "locked": "0", "pass": "0"})
    option_map(layer, {"SymbolType": "Fill", "geometryModifier": geometry, "units": "MapUnit"})
    inner = SubElement(
        layer, "symbol", type="fill", name="@0@0", alpha="1", clip_to_extent="1", force_rhr="0"
    )
    inner.append(area)
    return layer


def symbol(name: str, layers: Sequence[Element]) -> Element:
    """A fill symbol of layers drawn in this order."""
    made = Element("symbol", type="fill", name=name, alpha="1", clip_to_extent="1", force_rhr="0")
    made.extend(layers)
    return made


def single(layers: Sequence[Element], farthest_first: str | None = None) -> Element:
    """One symbol for all features, drawn by falling values of an expression where one is given."""
    renderer = Element("renderer-v2", type="singleSymbol", symbollevels="0", forceraster="0")
    SubElement(renderer, "symbols").append(symbol("0", layers))
    renderer.set("enableorderby", "1" if farthest_first else "0")
    if farthest_first:
        clause = SubElement(SubElement(renderer, "orderby"), "orderByClause", asc="0", nullsFirst="0")
        clause.text = farthest_first
    return renderer


def categorised(expression: str, categories: Sequence[tuple[str, str, Element]]) -> Element:
    """A symbol for each value of an expression: value, words of the legend, layer of the symbol."""
    renderer = Element("renderer-v2", type="categorizedSymbol", attr=expression, enableorderby="0")
    renderer.set("forceraster", "0")
    renderer.set("symbollevels", "0")
    listed = SubElement(renderer, "categories")
    symbols = SubElement(renderer, "symbols")
    for number, (value, label, layer) in enumerate(categories):
        SubElement(
            listed, "category", value=value, label=label, symbol=str(number), render="true", type="string"
        )
        symbols.append(symbol(str(number), [layer]))
    return renderer


def graduated(expression: str, classes: Sequence[tuple[float, float, str, Element]]) -> Element:
    """A symbol for each range of values: lower and upper end, words of the legend, layer of the symbol."""
    renderer = Element("renderer-v2", type="graduatedSymbol", attr=expression, enableorderby="0")
    renderer.set("graduatedMethod", "GraduatedColor")
    renderer.set("forceraster", "0")
    renderer.set("symbollevels", "0")
    ranges = SubElement(renderer, "ranges")
    symbols = SubElement(renderer, "symbols")
    for number, (lower, upper, label, layer) in enumerate(classes):
        SubElement(
            ranges,
            "range",
            lower=f"{lower:.6f}",
            upper=f"{upper:.6f}",
            label=label,
            symbol=str(number),
            render="true",
        )
        symbols.append(symbol(str(number), [layer]))
    return renderer


def nothing_flat() -> Element:
    """The renderer of a layer that is seen in 3D only."""
    return Element("renderer-v2", type="nullSymbol")


def raised_polygons(
    colour: str, expressions: Mapping[str, str] | None = None, tint: str | None = None
) -> Element:
    """The 3D renderer of polygons at their own heights; `expressions` may raise (`height`) and extrude
    (`extrusionHeight`) them, `tint` is an expression of their colour."""
    renderer = Element("renderer-3d", type="vector", layer="")
    SubElement(renderer, "vector-layer-3d-tiling", {"zoom-levels-count": "3", "show-bounding-boxes": "0"})
    made = SubElement(renderer, "symbol", type="polygon", material_type="phong")
    SubElement(
        made,
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
    material = SubElement(made, "material", diffuse=rgba(colour), ambient=rgba(shade(colour, 0.35)))
    material.set("specular", rgba("#101010"))
    material.set("shininess", "0")
    if tint:
        dark = f"darker({tint}, 260)"
        data_defined(material, "data-defined-properties", {"diffuse": tint, "ambient": dark})
    data_defined(made, "data-defined-properties", expressions or {})
    SubElement(made, "edges", enabled="0", width="1", color=rgba("#000000"))
    return renderer


def shade(colour: str, share: float) -> str:
    """A colour at a share of its brightness."""
    parts = [int(float(part) * share) for part in rgba(colour).split(",")[:3]]
    return "#" + "".join(f"{part:02x}" for part in parts)
