"""The command `eaves export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli import Basemap, Quiet, Verbose, start_log


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
        from eaves.exports.run import export_run

        names = [name.strip() for name in formats.split(",") if name.strip()]
        lines += [f"written: {path}" for path in export_run(folder, names)]
    if contours is not None:
        from eaves.exports.run import write_contours

        lines.append(f"written: {write_contours(folder, contours)}")
    if picture is not None:
        from eaves.report import plot_run

        path = plot_run(folder, out, picture, reference=reference, building=building, size_cm=size, dpi=dpi)
        lines.append(f"picture: {path}")
    if site is not None:
        from eaves.report import write_site

        lines.append(f"page: {write_site(folder, site, basemap)}, to be opened from a web server")
    if not lines:
        raise ValueError("export: nothing is asked for; give --formats, --contours, --picture or --site")
    if not quiet:
        typer.echo("\n".join(lines))
