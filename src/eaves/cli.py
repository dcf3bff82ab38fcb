"""The command line. Imports are late: `eaves --help` must answer at once."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from eaves.command_options import (
    BlockSide,
    BoundsText,
    Clip,
    Config,
    Crs,
    Footprints,
    Formats,
    IdField,
    Inputs,
    Jobs,
    MethodName,
    Out,
    PartyWalls,
    PerTile,
    Published,
    Quiet,
    Resume,
    Scheduler,
    Snap,
    Strict,
    Units,
    UseClasses,
    Verbose,
)
from eaves.invocation import (
    COMPLETE,
    INCOMPLETE,
    INTERRUPTED,
    describe_methods,
    finish,
    heard_interrupts,
    options_from,
    progress,
    read_config,
    recipe_from,
    run_build,
    start_log,
    tell_error,
)

app = typer.Typer(
    name="eaves",
    help="From raw airborne LiDAR to building footprints and valid 3D buildings.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.command()
def build(
    inputs: Inputs,
    out: Out,
    footprints: Footprints = None,
    id_field: IdField = None,
    snap_footprints: Snap = False,
    party_walls: PartyWalls = None,
    use_classes: UseClasses = False,
    lod: Annotated[str, typer.Option(help="Finest level of detail: 0, 1.2, 1.3, 2.0 or 2.2.")] = "2.2",
    crs: Crs = None,
    bounds: BoundsText = None,
    clip: Clip = None,
    ground_method: MethodName = None,
    detect_method: MethodName = None,
    outline_method: MethodName = None,
    units: Units = None,
    roof_method: MethodName = None,
    reconstruct_method: MethodName = None,
    formats: Formats = "",
    as_published: Published = False,
    block: BlockSide = 240.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    resume: Resume = False,
    per_tile: PerTile = False,
    strict: Strict = False,
    config: Config = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Points in; footprints, 3D buildings and a report out. Also rasters and the classified points."""
    names = {"ground": ground_method, "detect": detect_method, "outline": outline_method}
    names |= {"units": units, "roof": roof_method, "reconstruct": reconstruct_method}
    recipe = recipe_from(
        names, read_config(config), as_published=as_published, use_classes=use_classes, lod=lod
    )
    options = options_from(
        crs=crs,
        bounds=bounds,
        clip=clip,
        footprints=footprints,
        id_field=id_field,
        snap_footprints=snap_footprints,
        party_walls=party_walls,
        formats=tuple(name.strip() for name in formats.split(",") if name.strip()),
        jobs=jobs,
        scheduler=scheduler,
        resume=resume,
        per_tile=per_tile,
        block=block,
    )
    finish(run_build(inputs, out, recipe, options, quiet, verbose), quiet, strict)


@app.command()
def ground(
    inputs: Inputs,
    out: Out,
    method: MethodName = None,
    crs: Crs = None,
    bounds: BoundsText = None,
    clip: Clip = None,
    use_classes: UseClasses = False,
    as_published: Published = False,
    block: BlockSide = 240.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    resume: Resume = False,
    config: Config = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Which points are ground (class 2) and noise (7, 18). The same points, to OUT.laz or a folder."""
    from dataclasses import replace

    recipe = recipe_from(
        {"ground": method}, read_config(config), as_published=as_published, use_classes=use_classes, lod="0"
    )
    options = options_from(
        crs=crs,
        bounds=bounds,
        clip=clip,
        jobs=jobs,
        scheduler=scheduler,
        resume=resume,
        block=block,
        outputs=("classified",),
    )
    recipe = replace(recipe, detect=None)
    if out.suffix.lower() in (".laz", ".las"):
        options = replace(options, classified=out)
        out = out.parent
    finish(run_build(inputs, out, recipe, options, quiet, verbose), quiet, strict=False)


@app.command()
def detect(
    inputs: Inputs,
    out: Out,
    method: MethodName = None,
    ground_method: MethodName = None,
    outline_method: MethodName = None,
    crs: Crs = None,
    bounds: BoundsText = None,
    clip: Clip = None,
    use_classes: UseClasses = False,
    as_published: Published = False,
    block: BlockSide = 240.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    resume: Resume = False,
    config: Config = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Where buildings are: mask, footprints, classified points. The mask is a GeoTIFF with world file."""
    names = {"detect": method, "ground": ground_method, "outline": outline_method}
    recipe = recipe_from(
        names, read_config(config), as_published=as_published, use_classes=use_classes, lod="0"
    )
    options = options_from(
        crs=crs,
        bounds=bounds,
        clip=clip,
        jobs=jobs,
        scheduler=scheduler,
        resume=resume,
        block=block,
        outputs=("footprints", "mask", "classified"),
    )
    finish(run_build(inputs, out, recipe, options, quiet, verbose), quiet, strict=False)


@app.command()
def reconstruct(
    inputs: Inputs,
    out: Out,
    footprints: Annotated[Path, typer.Option(help="The footprints to model.")],
    id_field: IdField = None,
    snap_footprints: Snap = False,
    use_classes: UseClasses = False,
    lod: Annotated[str, typer.Option(help="Finest level of detail: 1.2, 1.3, 2.0 or 2.2.")] = "2.2",
    roof_method: MethodName = None,
    method: MethodName = None,
    crs: Crs = None,
    bounds: BoundsText = None,
    clip: Clip = None,
    as_published: Published = False,
    block: BlockSide = 240.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    resume: Resume = False,
    strict: Strict = False,
    config: Config = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Models for given footprints. The points may be classified or not."""
    names = {"roof": roof_method, "reconstruct": method}
    recipe = recipe_from(
        names, read_config(config), as_published=as_published, use_classes=use_classes, lod=lod
    )
    options = options_from(
        crs=crs,
        bounds=bounds,
        clip=clip,
        footprints=footprints,
        id_field=id_field,
        snap_footprints=snap_footprints,
        jobs=jobs,
        scheduler=scheduler,
        resume=resume,
        block=block,
    )
    finish(run_build(inputs, out, recipe, options, quiet, verbose), quiet, strict)


@app.command()
def validate(
    file: Annotated[Path, typer.Argument(help="CityJSON or CityJSONSeq.", metavar="FILE")],
    quiet: Quiet = False,
) -> None:
    """Every defect of every solid, by val3dity's codes. Exit status 1 when there is one."""
    from eaves.validate import validate_file

    findings = validate_file(file)
    for finding in findings:
        typer.echo(f"{finding.code} {finding.name}: {finding.building} {finding.where}: {finding.detail}")
    if not quiet:
        typer.echo(f"{file}: {len(findings)} findings" if findings else f"{file}: valid, no findings")
    raise typer.Exit(INCOMPLETE if findings else COMPLETE)


@app.command()
def evaluate(
    what: Annotated[str, typer.Argument(help="ground, detection, footprints, planes or models.")],
    result: Annotated[Path, typer.Argument(help="What is judged: a file that eaves or another wrote.")],
    reference: Annotated[Path, typer.Argument(help="What it is held against.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for JSON, rows and maps.")] = None,
    footprints: Annotated[
        Path | None, typer.Option(help="For models: the polygons whose points count; else the models' own.")
    ] = None,
    lod: Annotated[
        str | None, typer.Option(help="For models: 1.2, 1.3, 2.0 or 2.2; else each building's finest.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """How well a result agrees with a reference. By the measures of docs/evaluation.md."""
    from eaves.evaluate import evaluate_files

    start_log(quiet, verbose=False)
    evaluation = evaluate_files(what, result, reference, out, lod=lod, footprints=footprints)
    if not quiet:
        typer.echo(evaluation.as_text())


@app.command()
def simulate(
    out: Out,
    area: Annotated[float, typer.Option(help="Area of the town (km²).", min=0.001)] = 0.09,
    buildings: Annotated[
        int | None, typer.Option(help="Number of buildings; what the area holds by default.")
    ] = None,
    density: Annotated[float, typer.Option(help="Points a square metre.", min=0.1, max=100)] = 10.0,
    noise: Annotated[float, typer.Option(help="Standard deviation of a range (m).", min=0)] = 0.02,
    pattern: Annotated[str, typer.Option(help="lines, zigzag, ellipse or random (no scan angle).")] = "lines",
    terrain: Annotated[str, typer.Option(help="flat, slope, hilly or terraced.")] = "flat",
    style: Annotated[str, typer.Option(help="mixed, suburb or centre.")] = "mixed",
    trees: Annotated[float, typer.Option(help="Times the trees of an ordinary town.", min=0, max=10)] = 1.0,
    clutter: Annotated[bool, typer.Option(help="Vents, skylights, panels and balconies on roofs.")] = True,
    seed: Annotated[int, typer.Option(help="Same seed, same bytes.", min=0)] = 0,
    model: Annotated[
        Path | None, typer.Option(help="Scan the buildings of this CityJSON file instead.")
    ] = None,
    crs: Crs = None,
    quiet: Quiet = False,
) -> None:
    """A town of which everything is known, and its scan. Every plane, corner and point label."""
    from eaves.simulation import run_simulation

    start_log(quiet, verbose=False)
    town: dict[str, object] = {"area_km2": area, "buildings": buildings, "terrain": terrain, "trees": trees}
    town |= {"style": style, "clutter": clutter, "model": model}
    told = run_simulation(out, town, {"density": density, "noise": noise, "pattern": pattern}, seed, crs)
    if not quiet:
        typer.echo(told)


@app.command()
def view(
    folder: Annotated[Path, typer.Argument(help="What `eaves build` wrote.", metavar="OUT")],
    browser: Annotated[bool, typer.Option(help="Open it, or only make it.")] = True,
    again: Annotated[bool, typer.Option("--again", help="Make the page anew.")] = False,
    around: Annotated[str | None, typer.Option(help="Of a large run, draw what is around this id.")] = None,
    quiet: Quiet = False,
) -> None:
    """Open the 3D page of a run; it is made when it is missing."""
    from eaves.viewer.open import open_report

    start_log(quiet, verbose=False)
    path = open_report(folder, browser, again, around)
    if not quiet:
        typer.echo(f"report: {path}")


@app.command()
def plot(
    folder: Annotated[Path, typer.Argument(help="What `eaves build` wrote.", metavar="OUT")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="PNG, SVG or PDF; OUT/<what>.png.")] = None,
    what: Annotated[str, typer.Option(help="plan, errors, section or models.")] = "plan",
    reference: Annotated[
        Path | None, typer.Option(help="For errors: polygons, or the detection.tif of `eaves evaluate`.")
    ] = None,
    building: Annotated[str | None, typer.Option(help="For section: the building's id.")] = None,
    size: Annotated[float, typer.Option(help="Width (cm).", min=2, max=200)] = 18.0,
    dpi: Annotated[int, typer.Option(help="Dots an inch.", min=30, max=1200)] = 300,
    quiet: Quiet = False,
) -> None:
    """A picture of a run for print. Plan, errors against a reference, cross-section, all models."""
    from eaves.viewer.plot import plot_run

    start_log(quiet, verbose=False)
    path = plot_run(folder, out, what, reference=reference, building=building, size_cm=size, dpi=dpi)
    if not quiet:
        typer.echo(f"picture: {path}")


@app.command()
def methods(stage: Annotated[str | None, typer.Argument(help="One stage only.")] = None) -> None:
    """Every method: name, idea, paper, parameters."""
    for line in describe_methods(stage):
        typer.echo(line)


@app.command()
def demo(out: Out = Path("demo-out"), quiet: Quiet = False) -> None:
    """Build a town whose every plane is known, and compare."""
    from eaves.demo import run_demo

    start_log(quiet, verbose=False)
    raise typer.Exit(run_demo(out, progress(quiet)))


def main() -> None:
    """Entry point: a caller's mistake is one line and status 2, never a traceback."""
    with heard_interrupts() as interrupts:
        try:
            status = app(standalone_mode=False) or COMPLETE
        except SystemExit as end:  # how typer passes Ctrl-C on
            status = end.code
        except (KeyboardInterrupt, typer.Abort):
            status = INTERRUPTED
        except Exception as error:
            status = INTERRUPTED if interrupts else tell_error(error)
    if status == INTERRUPTED or (interrupts and status != COMPLETE):
        typer.echo("interrupted: nothing is half-written; run again with --resume to go on", err=True)
        status = INTERRUPTED
    sys.exit(status)


if __name__ == "__main__":
    main()
