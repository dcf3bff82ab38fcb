"""The formats written on request, by the names of `--formats`.

Each writer is fetched when it is asked for: most runs want none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

from eaves import formats
from eaves.formats.vectors.geopackage import Row, write_polygons
from eaves.model import BuildingModel, CoordinateSystem, Failure
from eaves.model.provenance import Provenance

Writer = Callable[..., object]


def citygml3_writer() -> Writer:
    """The writer of CityGML 3.0, which has no name among the public ones."""
    from eaves.formats.models.citygml import write_citygml3

    return write_citygml3


FOOTPRINT_FILES: dict[str, tuple[Callable[[], Writer], str]] = {
    "geojson": (lambda: write_polygons, "footprints.geojson"),
    "fgb": (lambda: write_polygons, "footprints.fgb"),
    "parquet": (lambda: formats.write_geoparquet, "footprints.parquet"),
}
ROOF_FILES: dict[str, tuple[Callable[[], Writer], str]] = {
    "fgb": (lambda: partial(write_polygons, layer="roof_planes"), "roof_planes.fgb"),
    "parquet": (lambda: formats.write_geoparquet, "roof_planes.parquet"),
}
MODEL_FILES: dict[str, tuple[Callable[[], Writer], str]] = {
    "cityjson": (lambda: formats.write_cityjson, "buildings.city.json"),
    "obj": (lambda: formats.write_obj, "buildings.obj"),
    "obj-wireframe": (lambda: formats.write_obj_wireframe, "wireframe.obj"),
    "dxf": (lambda: formats.write_dxf, "roofs.dxf"),
    "glb": (lambda: formats.write_glb, "buildings.glb"),
    "gpkg": (lambda: formats.write_lod_layers, "buildings.gpkg"),
    "citygml": (lambda: formats.write_citygml, "buildings.gml"),
    "citygml3": (citygml3_writer, "buildings3.gml"),
    "3dtiles": (lambda: formats.write_3dtiles, "3dtiles"),
}


def check_formats(names: Sequence[str], outputs: Sequence[str] = ("footprints", "models")) -> None:
    """Check that every name is one of a format that can be written here, beside the `outputs` of the run.

    Raises
    ------
    ValueError
        For an unknown name, a format whose library is missing, or one of what is not among the outputs.
    """
    choices = [*MODEL_FILES, *FOOTPRINT_FILES]
    for name in names:
        if name not in choices:
            raise ValueError(f"--formats {name}: unknown format; choose among: {', '.join(choices)}")
        needed = "models" if name in MODEL_FILES else "footprints"
        if needed not in outputs:
            raise ValueError(f"--formats {name}: it is written with the {needed}; add {needed} to --outputs")
    if "parquet" in names:
        from eaves.formats.vectors.parquet import require_pyarrow

        require_pyarrow()


def export_footprints(
    folder: Path,
    rows: Iterable[Row],
    roofs: Iterable[Row],
    system: CoordinateSystem,
    names: Sequence[str],
    provenance: Provenance,
) -> list[Path]:
    """Write the footprints, and the roof planes, in the formats named; the files written."""
    written = []
    for files, which in ((FOOTPRINT_FILES, rows), (ROOF_FILES, roofs)):
        for name, (writer, file) in files.items():
            if name in names:
                writer()(folder / file, list(which), system, provenance=provenance)
                written.append(folder / file)
    return written


def export_models(
    folder: Path,
    models: Callable[[], Iterator[BuildingModel | Failure]],
    system: CoordinateSystem,
    names: Sequence[str],
    provenance: Provenance,
) -> list[Path]:
    """Write the models, streamed anew for every format named; the files written, for 3D Tiles the tileset."""
    written = []
    for name, (writer, file) in MODEL_FILES.items():
        if name in names:
            writer()(folder / file, models(), system, provenance=provenance)
            written.append(folder / file / "tileset.json" if name == "3dtiles" else folder / file)
            written += [folder / "buildings.mtl"] if name == "obj" else []
    return written
