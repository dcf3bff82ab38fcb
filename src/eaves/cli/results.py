"""The commands that take results further: validate, evaluate, view, serve, plot, load."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli.options import Basemap, Quiet
from eaves.cli.runs import COMPLETE, INCOMPLETE, start_log


def validate(
    file: Annotated[Path, typer.Argument(help="CityJSON or CityJSONSeq.", metavar="FILE")],
    extension: Annotated[
        list[Path] | None,
        typer.Option(help="Definition of an extension that the file uses; may be repeated."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Every defect of every solid, by val3dity's codes. Exit status 1 when there is one."""
    from eaves.validate import validate_file

    start_log(quiet)
    findings = validate_file(file, extensions=extension or ())
    for finding in findings:
        told = f"{finding.code} {finding.name}: {finding.building} {finding.where}: {finding.detail}"
        typer.echo(printable(told))
    if not quiet:
        typer.echo(f"{file}: {len(findings)} findings" if findings else f"{file}: valid, no findings")
    raise typer.Exit(INCOMPLETE if findings else COMPLETE)


def check(
    folder: Annotated[Path, typer.Argument(help="What `eaves build` wrote.", metavar="OUT")],
    quiet: Quiet = False,
) -> None:
    """Whether results are whole and unchanged. Exit status 1 when something is not as the run left it."""
    from eaves.run.manifest import check_folder, read_manifest

    wrong = check_folder(folder)
    for line in wrong:
        typer.echo(line)
    if not quiet and not wrong:
        typer.echo(f"{folder}: whole, {len(read_manifest(folder)['files'])} files as the run wrote them")
    raise typer.Exit(INCOMPLETE if wrong else COMPLETE)


def printable(text: str) -> str:
    """Text with all that could begin a line, move a terminal or not be written as an escape."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode("ascii") for one in text)


def evaluate(
    what: Annotated[str, typer.Argument(help="ground, detection, footprints, planes, models or wireframe.")],
    result: Annotated[Path, typer.Argument(help="What is judged: a file that eaves or another wrote.")],
    reference: Annotated[Path, typer.Argument(help="What it is held against.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for JSON, rows and maps.")] = None,
    footprints: Annotated[
        Path | None, typer.Option(help="For models: the polygons whose points count; else the models' own.")
    ] = None,
    lod: Annotated[
        str | None, typer.Option(help="For models: 1.2, 1.3, 2.0, 2.2 or 2.3; else each building's finest.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """How well a result agrees with a reference. By the measures of docs/evaluation.md."""
    from eaves.evaluate import evaluate_files

    start_log(quiet)
    evaluation = evaluate_files(what, result, reference, out, lod=lod, footprints=footprints)
    if not quiet:
        typer.echo(evaluation.as_text())


def view(
    folder: Annotated[Path, typer.Argument(help="What `eaves build` wrote.", metavar="OUT")],
    browser: Annotated[bool, typer.Option(help="Open it, or only make it.")] = True,
    again: Annotated[bool, typer.Option("--again", help="Make the page anew.")] = False,
    around: Annotated[str | None, typer.Option(help="Of a large run, draw what is around this id.")] = None,
    basemap: Basemap = None,
    beside: Annotated[
        Path | None, typer.Option(help="Another run, side by side: both turn together.", metavar="OUT2")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Open the 3D page of a run; it is made when it is missing."""
    from eaves.report.beside import open_beside
    from eaves.report.view import open_report

    start_log(quiet)
    if beside is None:
        path = open_report(folder, browser, again, around, basemap)
    elif around is not None:
        raise ValueError(f"--around {around}: not together with --beside; give one of them")
    else:
        path = open_beside(folder, beside, browser, basemap)
    if not quiet:
        typer.echo(f"report: {path}")


def serve(
    folder: Annotated[Path, typer.Argument(help="What `eaves build` wrote.", metavar="OUT")],
    static: Annotated[
        Path | None, typer.Option(help="Write a folder for any web server instead.", metavar="FOLDER")
    ] = None,
    port: Annotated[int, typer.Option(help="Of this computer; 0: any free one.", min=0, max=65535)] = 8017,
    browser: Annotated[bool, typer.Option(help="Open it, or only serve.")] = True,
    basemap: Basemap = None,
    quiet: Quiet = False,
) -> None:
    """Show the 3D Tiles of a run of any size in a browser. To this computer only, until Ctrl-C."""
    from eaves.report.serve import make_site, serve_run, write_site

    start_log(quiet)
    site = make_site(folder, basemap)
    if static is not None:
        path = write_site(site, static)
        if not quiet:
            typer.echo(f"page: {path}, to be opened from a web server")
        return
    try:
        serve_run(site, port, browser, lambda words: None if quiet else typer.echo(words))
    except KeyboardInterrupt:  # the way to end it
        return


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
    from eaves.report.plot import plot_run

    start_log(quiet)
    path = plot_run(folder, out, what, reference=reference, building=building, size_cm=size, dpi=dpi)
    if not quiet:
        typer.echo(f"picture: {path}")


def solar(
    folder: Annotated[Path, typer.Argument(help="What `eaves build` wrote.", metavar="OUT")],
    weather: Annotated[
        Path | None, typer.Option(help="EPW file of the light of a year by hours; else a clear sky.")
    ] = None,
    turbidity: Annotated[float, typer.Option(help="Of the clear sky (Linke): 2 to 7.", min=1, max=10)] = 3.0,
    reach: Annotated[
        float, typer.Option(help="Distance (m) up to which things cast shadows.", min=1, max=5000)
    ] = 300.0,
    efficiency: Annotated[float, typer.Option(help="Of the modules.", min=0, max=1)] = 0.2,
    latitude: Annotated[
        float | None, typer.Option(help="Degrees, where the data have no system.", min=-90, max=90)
    ] = None,
    longitude: Annotated[float, typer.Option(help="Degrees, with --latitude.", min=-180, max=180)] = 0.0,
    quiet: Quiet = False,
) -> None:
    """Sunlight on every roof face by month. With shadows, and what panels can use, into OUT/solar.gpkg."""
    from eaves.cli.runs import progress_display
    from eaves.solar.folder import measure_solar
    from eaves.solar.roofs import SolarRules
    from eaves.solar.sun import read_epw

    start_log(quiet)
    with progress_display(quiet) as progress:
        summary = measure_solar(
            folder,
            SolarRules(turbidity=turbidity, reach=reach, efficiency=efficiency),
            None if weather is None else read_epw(weather),
            None if latitude is None else (latitude, longitude),
            progress,
        )
    if not quiet:
        typer.echo(summary.as_text())


def load(
    folder: Annotated[Path, typer.Argument(help="What `eaves build` wrote.", metavar="OUT")],
    address: Annotated[str, typer.Argument(help="postgresql://user@host:port/database")],
    schema: Annotated[str, typer.Option(help="Where the tables go.")] = "eaves",
    replace: Annotated[bool, typer.Option("--replace", help="Make tables anew that are there.")] = False,
    quiet: Quiet = False,
) -> None:
    """The results of a run into PostGIS. Tables footprints, roof_planes and surfaces, all or nothing."""
    from eaves.formats import write_postgis

    start_log(quiet)
    counts = write_postgis(folder, address, schema, replace)
    if not quiet:
        typer.echo(", ".join(f"{schema}.{table}: {count:,} rows" for table, count in counts.items()))
