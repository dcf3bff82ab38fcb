"""The whole flow with the report: tiles in, results and the page that people open first out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Unpack

from eaves.pipeline import build as build_files
from eaves.report.contents import BUILDINGS_SHOWN, POINTS_SHOWN, import_libraries
from eaves.report.notebook import Results
from eaves.report.page_file import write_report
from eaves.report.sample import PointSample
from eaves.run.recipe import Recipe
from eaves.run.run import EVERYTHING, Progress, RunOptions, list_options, no_progress


@list_options
def build(
    inputs: str | Path | Sequence[str | Path],
    out: str | Path,
    recipe: Recipe | None = None,
    progress: Progress = no_progress,
    **options: Unpack[RunOptions],
) -> Results:
    """Footprints, models, rasters, classified points and report.html, in the folder `out`.

    Parameters
    ----------
    inputs : str, Path or sequence of them
        LAS, LAZ, COPC or text files, folders or globs.
    out : str or Path
        Folder; made when missing.
    recipe : Recipe or None
        The methods, instead of the options that name them.
    progress : callable
        Called with the step, how much of it is done, and how much there is.
    ground, detect, outline, units, roof, reconstruct : Method, str, mapping or None
        The method of the stage, its name, or a table of its parameters; None is the default.
    source : str or None
        One of the published systems, whole: chen_sun, xiao2014, ren_fcs, roof_attributes or maas_vosselman.
    use_classes : bool
        Use the classes of the files: 2 is ground, 6 building, 7 and 18 noise.
    building_classes, ground_classes : sequence of int or None
        What the files' classes of buildings and ground are, with `use_classes`; None is 6 and 67, and 2.
    classes : sequence of int or None
        The classes to write: None is `2, 3, 4, 5, 6, 9, 14, 15, 17`; `2, 3, 4, 5, 6` leaves water,
        wires and bridges what they would be otherwise, `2, 6` vegetation, too.
    as_published : bool
        Methods given by name take the numbers that their papers print.
    lod : str or None
        The finest level of detail: `0`, `1.2`, `1.3`, `2.0`, `2.2` or `2.3`; None is what the source
        delivers, or 2.2.
    crs : str or None
        EPSG code, compound code, or a file with WKT or PROJJSON; it overrides the files' own.
    crs_force : bool
        Use `crs` even where a file states another system, or its numbers do not fit it.
    salvage : bool
        Of files that are cut off, use what is whole.
    bounds : Bounds, four numbers or None
        West, south, east, north in the unit of the files' reference system; points outside are not used.
    clip : str, Path or None
        File of polygons; points outside are not used.
    footprints : str, Path or None
        File of polygons to use as footprints instead of detected ones.
    id_field : str or None
        Field of the footprints that holds their id; by default that of a known map, or they are numbered.
    footprint_source : str or None
        The map that footprints or party walls are from: bag, bgt, bdtopo, usa-structures, overture, osm,
        microsoft; None is told by its columns, `none` takes polygons as they are.
    snap_footprints : bool
        Move given footprints to the eaves in the points.
    party_walls : str, Path or None
        File of polygons of addresses; detected blocks are split along their borders.
    formats : sequence of str
        Further formats: `obj`, `glb`, `3dtiles`, `cityjson`, `dxf`, `geojson`, `fgb`, `parquet`.
    outputs : sequence of str
        Outputs to write, of `footprints`, `models`, `mask`, `rasters`, `classified`, `report`; all for none.
    block : float
        Side (m, ≥ 6) of the area whose points are loaded at once to find its ground, at least that of a
        block, 240 m. The result is the same.
    jobs : int
        Processes (≥ 1).
    scheduler : str or None
        Address of a Dask scheduler: `tcp://host:port`.
    memory : str or None
        Bound of the processes' memory together: `4G`, `1500M`.
    resume : bool
        Keep the parts of an earlier run that are done and match.
    keep : bool
        Keep the parts of the run in `out`, about 100 bytes a point, for `eaves update`.
    per_tile : bool
        Compute and write by tiles, each on its own, also where there are few points.
    classified : Path or None
        File for the classified points of the one input, instead of those in `out`.

    Returns
    -------
    Results
        What was found and written; a notebook shows it as HTML. A run by tiles has no report.

    Raises
    ------
    InputError
        When an input cannot be used; nothing is written then.
    TypeError, ValueError
        When an option, a method or a value does not exist.
    DiskFullError
        When the disk is full; what is done stays for a run with `resume`.

    Examples
    --------
    >>> import eaves
    >>> from eaves.simulate import nine_roofs_on_a_slope
    >>> truth = nine_roofs_on_a_slope(density=4.0)
    >>> from eaves.simulate import write_simulation
    >>> files = write_simulation(truth, "nine")
    >>> results = eaves.build(files["points"], "out", jobs=1)
    >>> results.found == results.modelled + sum(results.failures.values())
    True
    >>> (results.folder / "report.html").exists()
    True
    """
    if "report" not in (options.get("outputs") or EVERYTHING):
        return Results.of(build_files(inputs, out, recipe, progress, **options))
    sample = PointSample(POINTS_SHOWN, BUILDINGS_SHOWN)
    several = options.get("jobs", 1) != 1 or options.get("scheduler") is not None

    def show(step: str, done: int, total: int) -> None:
        progress(step, done, total)
        if several and step == "buildings" and done == 1:  # the others compute meanwhile
            import_libraries()

    report = partial(write_report, received=sample)
    return Results.of(build_files(inputs, out, recipe, show, sample, report, **options))
