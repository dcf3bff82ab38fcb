"""The commands that take results further: validate, evaluate, view, export, solar."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from eaves.cli.options import Basemap, Quiet, Verbose
from eaves.cli.runs import COMPLETE, INCOMPLETE, start_log

MODELS = "buildings.city.jsonl"
"""Of a run."""


def validate(
    file: Annotated[
        Path,
        typer.Argument(help="CityJSON or CityJSONSeq file, or folder of `eaves build`.", metavar="FILE|OUT"),
    ],
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Check every solid and every file of a run. The exit status is 1 if there is a defect.

    Defects of solids have the codes of val3dity. Files of a run that are missing or modified are reported.
    """
    from eaves.formats import InputError
    from eaves.run.manifest import check_folder, files_of_run
    from eaves.validate import validate_file

    start_log(quiet, verbose)
    if not file.exists():
        raise InputError.about(file, "does not exist", "give a CityJSON file, or a folder of `eaves build`")
    changed = check_folder(file) if file.is_dir() else []
    findings = []
    for models in files_of_run(file, MODELS) if file.is_dir() else [file]:
        findings += validate_file(models) if models.exists() else []
    defects = [f"{one.code} {one.name}: {one.building} {one.where}: {one.detail}" for one in findings]
    for line in (*changed, *defects):
        typer.echo(printable(line))
    if not quiet:
        whole = ", whole" if file.is_dir() and not changed else ""
        typer.echo(f"{file}: {len(findings)} findings" if findings else f"{file}: valid{whole}, no findings")
    raise typer.Exit(INCOMPLETE if findings or changed else COMPLETE)


def printable(text: str) -> str:
    """Text with all that could begin a line, move a terminal or not be written as an escape."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode("ascii") for one in text)


def evaluate(
    what: Annotated[
        str,
        typer.Argument(help="What to evaluate: ground, detection, footprints, planes or models."),
    ],
    result: Annotated[
        Path,
        typer.Argument(help="File to evaluate, from eaves or any other program."),
    ],
    reference: Annotated[Path, typer.Argument(help="Reference to compare it with.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the JSON report, tables and maps.")
    ] = None,
    footprints: Annotated[
        Path | None, typer.Option(help="For models: polygons whose points count; default: the models' own.")
    ] = None,
    lod: Annotated[
        str | None,
        typer.Option(help="For models: 1.2, 1.3, 2.0, 2.2 or 2.3; default: each building's finest."),
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Measure how well a result agrees with a reference. docs/evaluation.md explains the measures.

    Example:

      eaves evaluate detection out/mask.tif tile.laz
    """
    from eaves.evaluate import evaluate_files

    start_log(quiet, verbose)
    evaluation = evaluate_files(what, result, reference, out, lod=lod, footprints=footprints)
    if not quiet:
        typer.echo(evaluation.as_text())


def view(
    folder: Annotated[Path, typer.Argument(help="Folder of `eaves build`.", metavar="OUT")],
    browser: Annotated[bool, typer.Option(help="Open the page in a browser, or only write it.")] = True,
    again: Annotated[bool, typer.Option("--again", help="Regenerate the page.")] = False,
    around: Annotated[
        str | None, typer.Option(help="For large runs: draw the surroundings of this building id.")
    ] = None,
    basemap: Basemap = None,
    beside: Annotated[
        Path | None,
        typer.Option(help="Folder of another run, to show side by side with linked views.", metavar="OUT2"),
    ] = None,
    serve: Annotated[
        bool, typer.Option("--serve", help="Serve the page of a run of any size until Ctrl-C.")
    ] = False,
    port: Annotated[
        int, typer.Option(help="With --serve: local port; 0: any free port.", min=0, max=65535)
    ] = 8017,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Open the 3D page of a run. It is generated if missing; --serve shows runs of any size."""
    from eaves.report.serve import serve_run
    from eaves.report.site import open_site
    from eaves.report.view import open_beside, open_report

    start_log(quiet, verbose)
    if sum((around is not None, beside is not None, serve)) > 1:
        raise ValueError("--around, --beside, --serve: not together; give one of them")
    if serve:
        with suppress(KeyboardInterrupt):  # the way to end it
            site = open_site(folder, again, basemap)
            serve_run(site, port, browser, lambda words: None if quiet else typer.echo(words))
        return
    if beside is None:
        path = open_report(folder, browser, again, around, basemap)
    else:
        path = open_beside(folder, beside, browser, basemap)
    if not quiet:
        typer.echo(f"report: {path}")


def export(
    folder: Annotated[Path, typer.Argument(help="Folder of `eaves build`.", metavar="OUT")],
    picture: Annotated[
        str | None, typer.Option(help="Picture for print: plan, errors, section or models.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Path of the picture: PNG, SVG or PDF; default: OUT/<picture>.png."),
    ] = None,
    reference: Annotated[
        Path | None, typer.Option(help="For errors: polygons, or the detection.tif of `eaves evaluate`.")
    ] = None,
    building: Annotated[str | None, typer.Option(help="For section: the building's id.")] = None,
    size: Annotated[float, typer.Option(help="Width of the picture (cm).", min=2, max=200)] = 18.0,
    dpi: Annotated[
        int, typer.Option(help="Resolution of the picture (dots per inch).", min=30, max=1200)
    ] = 300,
    site: Annotated[
        Path | None,
        typer.Option(
            help="Write the page of a run of any size as static files for a web server.", metavar="FOLDER"
        ),
    ] = None,
    basemap: Basemap = None,
    formats: Annotated[
        str | None, typer.Option(help="Formats to write to OUT, as for `eaves build --formats`.")
    ] = None,
    contours: Annotated[
        float | None, typer.Option(help="Write contours of the ground to OUT, at this interval (m).")
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Export the results of a run: other formats, pictures for print, a web site.

    Examples:

      eaves export out --formats citygml,glb,dxf
      eaves export out --contours 0.5
      eaves export out --picture plan
      eaves export out --site web
    """
    start_log(quiet, verbose)
    if picture is None and (out, reference, building) != (None, None, None):
        raise ValueError("export: --out, --reference and --building need a --picture; formats go into OUT")
    lines = []
    if formats is not None:
        from eaves.flow.exports import export_run

        names = [name.strip() for name in formats.split(",") if name.strip()]
        lines += [f"written: {path}" for path in export_run(folder, names)]
    if contours is not None:
        from eaves.flow.exports import write_contours

        lines.append(f"written: {write_contours(folder, contours)}")
    if picture is not None:
        from eaves.report.plots.plot import plot_run

        path = plot_run(folder, out, picture, reference=reference, building=building, size_cm=size, dpi=dpi)
        lines.append(f"picture: {path}")
    if site is not None:
        from eaves.report.site import write_site

        lines.append(f"page: {write_site(folder, site, basemap)}, to be opened from a web server")
    if not lines:
        raise ValueError("export: nothing is asked for; give --formats, --contours, --picture or --site")
    if not quiet:
        typer.echo("\n".join(lines))


def solar(
    folder: Annotated[Path, typer.Argument(help="Folder of `eaves build`.", metavar="OUT")],
    weather: Annotated[
        Path | None,
        typer.Option(help="EPW file with the hourly radiation of a year; default: a clear sky, no yield."),
    ] = None,
    annual: Annotated[
        float | None,
        typer.Option(
            help="Sunlight of a year on the level (kWh/m²), in place of --weather.", min=100, max=3000
        ),
    ] = None,
    turbidity: Annotated[
        float, typer.Option(help="Linke turbidity of the clear sky, usually 2 to 7.", min=1, max=10)
    ] = 3.0,
    reach: Annotated[
        float, typer.Option(help="Distance (m) up to which objects cast shadows.", min=1, max=5000)
    ] = 300.0,
    efficiency: Annotated[float, typer.Option(help="Module efficiency.", min=0, max=1)] = 0.2,
    latitude: Annotated[
        float | None,
        typer.Option(help="Latitude (degrees), if the data have no reference system.", min=-90, max=90),
    ] = None,
    longitude: Annotated[
        float, typer.Option(help="Longitude (degrees), with --latitude.", min=-180, max=180)
    ] = 0.0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compute the solar radiation on every roof face, by month. Writes OUT/solar.gpkg and irradiation.tif."""
    from eaves.cli.runs import progress_display
    from eaves.formats import InputError
    from eaves.solar.folder import measure_solar
    from eaves.solar.roofs import SolarRules
    from eaves.solar.sun import ClearSky, read_epw

    if weather is not None and annual is not None:
        raise InputError("--weather and --annual: each gives the sunlight of a year; give one of them")
    start_log(quiet, verbose)
    with progress_display(quiet) as progress:
        summary = measure_solar(
            folder,
            SolarRules(reach=reach, efficiency=efficiency),
            ClearSky(turbidity, annual) if weather is None else read_epw(weather),
            None if latitude is None else (latitude, longitude),
            progress,
        )
    if not quiet:
        typer.echo(summary.as_text())
