"""The command `eaves solar`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli import Quiet, Verbose, progress_display, start_log


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
