"""The styles of the layers `footprints`, `roof_planes` and `doubts`: what a map of buildings shows first.

A style is a list of XML elements: inside `<qgis>` they are a QML document (`as_qml`), inside `<maplayer>` a
layer of a project. Heights are in metres in the attributes and in the system's unit in the geometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from xml.etree.ElementTree import Element, SubElement, tostring

from eaves.formats.crs import parse_crs, system_of
from eaves.formats.qgis import symbols
from eaves.model import CoordinateSystem
from eaves.model.columns import COLUMNS

VERSION = "3.22.0"
"""The oldest QGIS whose XML this is; newer ones read it."""
VIEW_DIRECTION_DEG = 70.0
"""Where upright edges point to in the oblique map, counter-clockwise from east."""
FORESHORTENING = 0.6
"""Length of an upright metre in the oblique map."""
LOD_COLOURS = {
    "2.3": ("LoD 2.3, roof overhangs", "#2f6f78"),
    "2.2": ("LoD 2.2, detailed roof", "#5b8c85"),
    "2.0": ("LoD 2.0, main roof", "#a7c4a0"),
    "1.3": ("LoD 1.3, several heights", "#f2c14e"),
    "1.2": ("LoD 1.2, one height", "#f08a4b"),
    "0": ("LoD 0, outline only", "#c9c5ba"),
    "none": ("no model", "#c8102e"),
}
DIRECTIONS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
DIRECTION_COLOURS = (
    "#5271a8", "#6d9bb8", "#86bfa4", "#d3c96b", "#f2a541", "#e2743e", "#b5577a", "#7b5aa0",
)  # fmt: skip
FLAT_COLOUR, UNKNOWN_COLOUR, WALL_COLOUR = "#c2bdb3", "#ffffff", "#e6e0d4"
SURFACE_COLOURS = {
    "RoofSurface": ("roof", "#d98c6a"),
    "WallSurface": ("wall", WALL_COLOUR),
    "OuterCeilingSurface": ("underside", "#b08968"),
    "GroundSurface": ("ground", "#8d8677"),
}
ROOF_TYPES = {
    "flat": "#c2bdb3", "shed": "#d3c96b", "gable": "#e2743e", "hip": "#b5577a", "pyramid": "#7b5aa0",
    "complex": "#5271a8",
}  # fmt: skip
DOUBT_COLOURS = {"ground": ("terrain or not", "#8c510a"), "detect": ("a building or not", "#7b1fa2")}
TRUST = {"high": "#5b8c85", "medium": "#f2c14e", "low": "#c8102e"}
RMSE_CLASSES = (
    (0.0, 0.05, "#2c7bb6"), (0.05, 0.1, "#abd9e9"), (0.1, 0.2, "#ffffbf"), (0.2, 0.5, "#fdae61"),
    (0.5, 1000.0, "#d7191c"),
)  # fmt: skip
"""Metres, in steps of the noise of good scans to a roof that is plainly wrong."""
SLOPE_CLASSES = ((0, 2), (2, 10), (10, 25), (25, 40), (40, 60), (60, 90))
MOST = 1e6
"""The upper end of a last class."""
LIGHT_CLASSES = (0.0, 400.0, 700.0, 1000.0, 1300.0, 1600.0, MOST)
SHARE_CLASSES = (0.0, 0.05, 0.1, 0.2, 0.4, 0.6, 1.0)
AREA_CLASSES = (0.0, 3.4, 10.0, 20.0, 50.0, 100.0, MOST)
SLOPE_COLOURS = ("#f7f4ea", "#fee391", "#fec44f", "#fe9929", "#d95f0e", "#993404")


@dataclass(frozen=True, eq=False)
class Style:
    """A named way to draw a layer; the first of a layer is the one it opens with."""

    name: str
    meaning: str
    elements: tuple[Element, ...]

    def as_qml(self) -> str:
        """The style as a QML document."""
        root = Element("qgis", version=VERSION, styleCategories="AllStyleCategories")
        root.extend(self.elements)
        return "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n" + tostring(root, "unicode")


def styles_of(layer: str, columns: Sequence[str], system: CoordinateSystem) -> list[Style]:
    """The styles of a layer with these columns; none for a layer of another name."""
    makers = {"footprints": footprint_styles, "roof_planes": roof_styles, "doubts": doubt_styles}
    makers |= {"roofs": solar_styles}
    if layer.startswith("lod_"):
        made = surface_style()
        return [Style(made.name, made.meaning, (*made.elements, aliases(columns)))]
    if layer not in makers:
        return []
    about = [aliases(columns), map_tip(layer)]
    return [
        Style(one.name, one.meaning, (*one.elements, *about))
        for one in makers[layer](system, frozenset(columns))
    ]


def footprint_styles(system: CoordinateSystem, columns: frozenset[str]) -> list[Style]:
    """By level of detail, oblique, by roof type, by fit; those whose columns there are."""
    levels = [(lod, words, symbols.fill(colour)) for lod, (words, colour) in LOD_COLOURS.items()]
    found = [
        Style(
            "Level of detail",
            "what was reached; red where there is no model",
            (symbols.categorised("coalesce(\"lod\", 'none')", levels),),
        )
    ]
    if "trust" in columns:
        kinds = [(kind, kind, symbols.fill(colour)) for kind, colour in TRUST.items()]
        made = symbols.categorised('"trust"', kinds)
        found.append(Style("Trust", "what to review first: red, then yellow", (made,)))
    if "h_70p" in columns:
        found.append(Style("Oblique", "buildings raised by their height", (oblique(system),)))
    if "roof_type" in columns:
        types = [(kind, kind, symbols.fill(colour)) for kind, colour in ROOF_TYPES.items()]
        types.append(("none", "no model", symbols.fill(LOD_COLOURS["none"][1])))
        made = symbols.categorised("coalesce(\"roof_type\", 'none')", types)
        found.append(Style("Roof type", "shape of the roof", (made,)))
    if "rmse_m" in columns:
        found.append(Style("Fit", "distance of the roof points to the model", (by_fit(),)))
    return found


def roof_styles(system: CoordinateSystem, columns: frozenset[str]) -> list[Style]:
    """By direction, by slope, by fit, all at their heights in 3D; those whose columns there are."""
    raised = symbols.raised_polygons(FLAT_COLOUR, tint=direction_colour())
    if "azimuth_deg" not in columns:
        return [Style("Roof", "all faces alike", (symbols.single([symbols.fill("#e2743e")]), raised))]
    slopes = [
        (low, high, f"{low}° to {high}°", symbols.fill(colour, width=0.08))
        for (low, high), colour in zip(SLOPE_CLASSES, SLOPE_COLOURS, strict=True)
    ]
    found = [
        Style(
            "Direction",
            "where a roof face looks, and flat roofs",
            (by_direction("no_data" in columns), raised),
        ),
        Style("Slope", "degrees from the horizontal", (symbols.graduated('"slope_deg"', slopes), raised)),
    ]
    if "rmse_m" in columns:
        found.append(Style("Fit", "distance of a face's points to it", (by_fit(), raised)))
    return found


def doubt_styles(system: CoordinateSystem, columns: frozenset[str]) -> list[Style]:
    """Hatched squares, by the step that could not decide."""
    kinds = [
        (stage, words, symbols.fill(colour, colour, 0.4, "f_diagonal"))
        for stage, (words, colour) in DOUBT_COLOURS.items()
    ]
    return [Style("Doubts", "where the scan cannot decide", (symbols.categorised('"stage"', kinds),))]


def solar_styles(system: CoordinateSystem, columns: frozenset[str]) -> list[Style]:
    """By light, by the share that shadows take, by what panels can use."""
    found = []
    for name, column, classes, words in (
        ("Sunlight", "light_kwh_m2", LIGHT_CLASSES, "kWh a square metre and year"),
        ("Shadows", "shade_share", SHARE_CLASSES, "share of the light that shadows take"),
        ("Panels", "usable_m2", AREA_CLASSES, "square metres that panels can use"),
    ):
        steps = []
        for (low, high), colour in zip(pairwise(classes), SLOPE_COLOURS, strict=True):
            told = f"{low:g} to {high:g}" if high < MOST else f"over {low:g}"
            steps.append((low, high, told, symbols.fill(colour, width=0.08)))
        found.append(Style(name, words, (symbols.graduated(f'"{column}"', steps),)))
    return found


def surface_style() -> Style:
    """Roofs, walls and ground in colours of their own; walls have no extent on a map."""
    kinds = [
        (name, words, symbols.fill(colour, width=0.08)) for name, (words, colour) in SURFACE_COLOURS.items()
    ]
    tints = " ".join(f"WHEN '{name}' THEN '{colour}'" for name, (_, colour) in SURFACE_COLOURS.items())
    raised = symbols.raised_polygons(WALL_COLOUR, tint=f'CASE "surface" {tints} END')
    return Style("Surfaces", "roofs, walls, ground", (symbols.categorised('"surface"', kinds), raised))


def by_direction(gaps: bool) -> Element:
    """Eight directions, flat, and where `gaps` are marked faces that are filled in."""
    faces = [
        (name, name, symbols.fill(colour, width=0.08))
        for name, colour in zip(DIRECTIONS, DIRECTION_COLOURS, strict=True)
    ]
    faces.append(("flat", "flat", symbols.fill(FLAT_COLOUR, width=0.08)))
    unknown = symbols.fill("#888888", width=0.08, pattern="b_diagonal")
    if gaps:
        faces.append(("no data", "no data: filled in, not measured", unknown))
    names = ", ".join(f"'{name}'" for name in DIRECTIONS)
    first = "WHEN \"no_data\" THEN 'no data' " if gaps else ""
    expression = (
        f"CASE {first}WHEN \"azimuth_deg\" IS NULL THEN 'flat' "
        f'ELSE array_get(array({names}), floor(("azimuth_deg" + 22.5) / 45) % 8) END'
    )
    return symbols.categorised(expression, faces)


def direction_colour() -> str:
    """The expression of a face's colour by direction, for 3D."""
    colours = ", ".join(f"'{colour}'" for colour in DIRECTION_COLOURS)
    turn = 'floor(("azimuth_deg" + 22.5) / 45) % 8'
    return f"if(\"azimuth_deg\" IS NULL, '{FLAT_COLOUR}', array_get(array({colours}), {turn}))"


def by_fit() -> Element:
    """Classes of the RMSE, with no class for what has none."""
    classes = [
        (low, high, f"{low:g} to {high:g} m" if high < 1000 else f"over {low:g} m", symbols.fill(colour))
        for low, high, colour in RMSE_CLASSES
    ]
    return symbols.graduated('"rmse_m"', classes)


def oblique(system: CoordinateSystem) -> Element:
    """Walls and roof of a block as high as the building, drawn over the map; far ones first."""
    unit = units_of(system)[0]
    height = f'coalesce("h_70p" - "h_ground", 0) * {FORESHORTENING / unit:.9g}'
    across, along = (f"{name}(radians({VIEW_DIRECTION_DEG:g}))" for name in ("cos", "sin"))
    far = f"x(centroid($geometry)) * {across} + y(centroid($geometry)) * {along}"
    lift = f"{across} * {height}, {along} * {height}"
    walls = f"order_parts(extrude(segments_to_lines($geometry), {lift}), '{far}', false)"
    roof = f"translate($geometry, {lift})"
    edge = "geometry_n($geometry, @geometry_part_num)"
    turn = f"azimuth(point_n({edge}, 1), point_n({edge}, 2))"
    bright = f"set_color_part(@symbol_color, 'value', 45 + 15 * abs($pi - {turn}))"
    colour = "if(\"lod\" IS NULL, '#c8102e', if(\"failure_code\" IS NULL, @symbol_color, '#f2c14e'))"
    ground = symbols.fill("#00000030", width=0)
    upright = symbols.fill(WALL_COLOUR, "#6b675f", 0.06, expressions={"fillColor": bright})
    top = symbols.fill("#d98c6a", "#6b3f2c", 0.12, expressions={"fillColor": colour})
    layers = [ground, symbols.generated(walls, upright), symbols.generated(roof, top)]
    return symbols.single(layers, farthest_first=far)


def units_of(system: CoordinateSystem) -> tuple[float, float]:
    """Metres a unit, along the ground and upright, of the system as it is registered."""
    if system.wkt is None:
        return system.horizontal_unit_m, system.vertical_unit_m
    known = system_of(parse_crs(system.wkt), "", (0.0, 0.0))
    return known.horizontal_unit_m, known.vertical_unit_m


def aliases(columns: Sequence[str]) -> Element:
    """The names that QGIS shows for the columns."""
    made = Element("aliases")
    for number, name in enumerate(columns, 1):  # 0 is the feature's number
        label = COLUMNS[name].label if name in COLUMNS else ""
        SubElement(made, "alias", index=str(number), field=name, name=label)
    return made


def map_tip(layer: str) -> Element:
    """What QGIS shows under the pointer."""
    tip = Element("mapTip")
    if layer == "doubts":
        tip.text = '[% "stage" %], [% round("area_m2") %] m²<br>[% "reason" %]'
        return tip
    tip.text = (
        '<b>[% "id" %]</b><br>LoD [% coalesce("lod", \'none\') %], '
        '[% round("area_m2") %] m²<br>[% coalesce("failure_reason", \'\') %]'
        if layer == "footprints"
        else '[% "building_id" %]: [% round("light_kwh_m2") %] kWh/m², [% round("usable_m2") %] m² for panels'
        if layer == "roofs"
        else '[% "building_id" %]: [% round("area_m2", 1) %] m², slope [% round("slope_deg") %]°, '
        "azimuth [% coalesce(round(\"azimuth_deg\"), 'none') %]"
    )
    return tip
