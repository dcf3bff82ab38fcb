"""A QGIS project beside the files of a run: a map of the roofs over the relief, and a 3D view."""

from __future__ import annotations

import sqlite3
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import numpy as np
from pyproj.enums import WktVersion

from eaves.formats.crs import epsg_of, horizontal_crs, unit_lengths
from eaves.formats.qgis import symbols
from eaves.formats.qgis.styles import VERSION, Style, styles_of
from eaves.formats.whole_files import atomic
from eaves.model import CoordinateSystem

RELIEF_LIGHT_DEG = (315.0, 45.0)
"""Azimuth and height of the light on the hillshade: from the north-west, as on printed maps."""
WIDEST_VIEW_M = 600.0
"""The 3D view opens on at most this much of a run."""
WALL_GAP_M = 0.1
"""Walls end this far under the roof, or the two would be drawn through each other."""
LAYERS = ("review", "doubts", "roof_planes", "walls", "footprints", "relief", "surface")
IDS = {name: f"eaves_{name}_layer" for name in LAYERS}
"""QGIS gives a layer another id when its own has ten characters or fewer."""
OFF = (IDS["review"], IDS["doubts"], IDS["surface"])
"""Layers that are there and not drawn when the project opens."""
RASTERS = {"dtm": ("relief", "Relief"), "dsm": ("surface", "Relief with buildings and trees")}
"""By the name of their file, a layer and its title."""
WALL_COLOUR = "#e6e0d4"
FIXED_DATE = (1980, 1, 1, 0, 0, 0)
"""Of the file in the archive: the same run gives the same bytes."""


@dataclass(frozen=True, eq=False)
class _ProjectLayer:
    """A layer of the project: where it is read from and how it is drawn."""

    id: str
    name: str
    source: str
    kind: str
    elements: tuple[Element, ...]
    styles: Sequence[Style] = ()


def write_project(path: Path, footprints: Path, rasters: Sequence[Path], system: CoordinateSystem) -> None:
    """Write a project (`.qgz`) that opens what lies beside it, by relative paths.

    Parameters
    ----------
    path
        The file, in the folder of the others.
    footprints
        The GeoPackage with the layers `footprints` and `roof_planes`.
    rasters
        The terrain, named `dtm.tif` or `dtm.vrt`, likewise `dsm`; those of other names are left out.
    system
        The reference system that all of them are in.

    Examples
    --------
    >>> import shapely
    >>> from pathlib import Path
    >>> from eaves.formats import write_geopackage
    >>> from eaves.formats.vectors.geopackage import Row
    >>> from eaves.formats.qgis.project import write_project
    >>> from eaves.model.coordinates import LOCAL_METRES
    >>> write_geopackage("shed.gpkg", [Row(shapely.box(0, 0, 10, 10), {"id": "shed"})])
    >>> write_project(Path("shed.qgz"), Path("shed.gpkg"), [], LOCAL_METRES)
    """
    extent, columns, ground = _look(footprints)
    layers = _layers(footprints, rasters, columns, system)
    tree = [
        {
            "id": layer.id,
            "name": layer.name,
            "checked": "Qt::Unchecked" if layer.id in OFF else "Qt::Checked",
            "expanded": "1" if layer.id == IDS["roof_planes"] else "0",
            "source": layer.source,
            "providerKey": layer.kind,
        }
        for layer in layers
    ]
    text = Template(files("eaves.formats.qgis").joinpath("project.xml").read_text("utf-8")).substitute(
        version=VERSION,
        crs=_reference(system),
        tree=_xml_text("layer-tree-layer", tree),
        layers="".join(tostring(_as_element(layer, system), "unicode") for layer in layers),
        order=_xml_text("layer", ({"id": layer.id} for layer in layers)),
        themes=_themes(layers),
        **_view_in_3d(layers, extent, ground, system),
    )
    with atomic(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        entry = zipfile.ZipInfo(path.with_suffix(".qgs").name, FIXED_DATE)
        archive.writestr(entry, text, zipfile.ZIP_DEFLATED)


def _xml_text(tag: str, attributes: Iterable[Mapping[str, str]]) -> str:
    """Elements without content as text."""
    return "".join(tostring(Element(tag, dict(element)), "unicode") for element in attributes)


def _look(footprints: Path) -> tuple[tuple[float, ...], dict[str, list[str]], float]:
    """West, south, east, north of the footprints, the columns by layer, and the mean ground height (m)."""
    with closing(sqlite3.connect(footprints)) as database:
        named = dict(database.execute("SELECT table_name, column_name FROM gpkg_geometry_columns"))
        columns = {
            layer: [row[1] for row in database.execute(f'PRAGMA table_info("{layer}")')] for layer in named
        }
        extent_row = database.execute(
            "SELECT min_x, min_y, max_x, max_y FROM gpkg_contents WHERE table_name = 'footprints'"
        ).fetchone()
        ground = 0.0
        if "h_ground" in columns["footprints"]:
            ground = database.execute("SELECT avg(h_ground) FROM footprints").fetchone()[0] or 0.0
    extent = (
        (0.0, 0.0, 1.0, 1.0) if extent_row is None or None in extent_row else tuple(map(float, extent_row))
    )
    fields = {
        layer: [name for name in names if name not in ("fid", named[layer])]
        for layer, names in columns.items()
    }
    return extent, fields, float(ground)


def _layers(
    footprints: Path, rasters: Sequence[Path], columns: dict[str, list[str]], system: CoordinateSystem
) -> list[_ProjectLayer]:
    """The layers from the top down."""
    roofs = styles_of("roof_planes", columns.get("roof_planes", []), system)
    prints = styles_of("footprints", columns["footprints"], system)
    source = f"./{footprints.name}|layername="
    layers = []
    for name, title in (("review", "To review"), ("doubts", "Doubts")):
        if name in columns:
            styles = styles_of(name, columns[name], system)
            layers.append(_ProjectLayer(IDS[name], title, source + name, "ogr", styles[0].elements, styles))
    if roofs:
        layers.append(
            _ProjectLayer(
                IDS["roof_planes"], "Roof planes", source + "roof_planes", "ogr", roofs[0].elements, roofs
            )
        )
        if "h_high" in columns["roof_planes"]:
            walls = (Element("renderer-v2", type="nullSymbol"), _walls(system))
            layers.append(
                _ProjectLayer(IDS["walls"], "Walls (3D view)", source + "roof_planes", "ogr", walls)
            )
    layers.append(
        _ProjectLayer(
            IDS["footprints"], "Buildings", source + "footprints", "ogr", prints[0].elements, prints
        )
    )
    by_name = {raster.stem: raster for raster in rasters}
    for stem, (name, title) in RASTERS.items():
        if stem in by_name:
            look = (_relief_renderer(system),)
            layers.append(_ProjectLayer(IDS[name], title, f"./{by_name[stem].name}", "gdal", look))
    return layers


def _walls(system: CoordinateSystem) -> Element:
    """Roof planes drawn down to the ground: what shows below the roof are its walls."""
    unit = unit_lengths(system)[1]
    drop = f'("h_high" - "h_ground") / {unit:.9g}'
    return symbols.raised_polygons(
        WALL_COLOUR, {"height": f"-{drop}", "extrusionHeight": f"{drop} - {WALL_GAP_M / unit:.3g}"}
    )


def _relief_renderer(system: CoordinateSystem) -> Element:
    pipe = Element("pipe")
    azimuth, altitude = RELIEF_LIGHT_DEG
    across, upright = unit_lengths(system)
    SubElement(
        pipe,
        "rasterrenderer",
        type="hillshade",
        band="1",
        azimuth=f"{azimuth:g}",
        angle=f"{altitude:g}",
        zfactor=f"{2 * upright / across:.6g}",
        multidirection="0",
        opacity="0.6",
        alphaBand="-1",
    )
    SubElement(pipe, "brightnesscontrast", brightness="30", contrast="-20", gamma="1")
    return pipe


def _reference(system: CoordinateSystem) -> str:
    """The plane part of the reference system as QGIS writes it; empty without one."""
    crs = horizontal_crs(system)
    if crs is None:
        return ""
    place = Element("spatialrefsys", nativeFormat="Wkt")
    SubElement(place, "wkt").text = crs.to_wkt(WktVersion.WKT2_2019)
    code = epsg_of(crs)
    if code is not None:
        SubElement(place, "srid").text = str(code)
        SubElement(place, "authid").text = f"EPSG:{code}"
    SubElement(place, "description").text = crs.name
    return tostring(place, "unicode")


def _as_element(layer: _ProjectLayer, system: CoordinateSystem) -> Element:
    element = Element("maplayer", type="vector" if layer.kind == "ogr" else "raster")
    if layer.kind == "ogr":
        element.set("geometry", "Polygon")
    SubElement(element, "id").text = layer.id
    SubElement(element, "datasource").text = layer.source
    SubElement(element, "layername").text = layer.name
    element.append(fromstring(f"<srs>{_reference(system)}</srs>"))
    SubElement(element, "provider", encoding="UTF-8").text = layer.kind
    manager = SubElement(element, "map-layer-style-manager", current="default")
    SubElement(manager, "map-layer-style", name="default")
    for style in layer.styles[1:]:
        entry = SubElement(manager, "map-layer-style", name=style.name)
        entry.append(style.root())
    element.extend(layer.elements)
    return element


def _themes(layers: Sequence[_ProjectLayer]) -> str:
    """Two themes: the map, and the oblique one without the roof planes."""
    names = {style.name for layer in layers for style in layer.styles}
    themes: list[tuple[str, dict[str, str], tuple[str, ...]]] = [("Map", {}, ())]
    if "Oblique" in names:
        themes.append(("Oblique (2.5D)", {IDS["footprints"]: "Oblique"}, (IDS["roof_planes"],)))
    text = ""
    for title, chosen, hidden in themes:
        preset = Element("visibility-preset", {"name": title, "has-expanded-info": "0"})
        for layer in layers:
            if layer.id not in (*hidden, *OFF):
                style = chosen.get(layer.id, "default")
                SubElement(preset, "layer", id=layer.id, visible="1", style=style)
        text += tostring(preset, "unicode")
    return text


def _view_in_3d(
    layers: Sequence[_ProjectLayer], extent: Sequence[float], ground: float, system: CoordinateSystem
) -> dict[str, str]:
    """The words of the template for a 3D map over the terrain, looking north at the middle of the run."""
    across, upright = unit_lengths(system)
    west, south, east, north = extent
    width = float(np.clip(max(east - west, north - south), 20.0 / across, WIDEST_VIEW_M / across))
    heights = [layer.id for layer in layers if layer.kind == "gdal"]
    relief = {"type": "dem", "layer": heights[0], "resolution": "64", "skirt-height": "2"} if heights else {}
    sides = zip(("west", "south", "east", "north"), extent, strict=True)
    draped = (layer.id for layer in layers if layer.id in (IDS["footprints"], IDS["relief"]))
    return {
        **{name: f"{value:.3f}" for name, value in sides},
        "x": f"{0.5 * (west + east):.3f}",
        "y": f"{0.5 * (south + north):.3f}",
        "draped": _xml_text("layer", ({"id": layer_id} for layer_id in draped)),
        "generator": _xml_text("generator", [relief or {"type": "flat"}]),
        "offset": "0" if heights else f"{ground / upright:.3f}",
        "ground": f"{ground / upright:.3f}",
        "distance": f"{1.1 * width:.3f}",
    }
