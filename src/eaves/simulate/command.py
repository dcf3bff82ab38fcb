"""The commands that make scenes: simulate, demo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eaves.cli import Crs, Out, Quiet, Verbose, run_display, start_log


def simulate(
    out: Out,
    area: Annotated[float, typer.Option(help="Area of the town (km²).", min=0.001)] = 0.09,
    buildings: Annotated[
        int | None, typer.Option(help="Number of buildings; default: as many as the area holds.")
    ] = None,
    density: Annotated[float, typer.Option(help="Points per square metre.", min=0.1, max=500)] = 10.0,
    noise: Annotated[float, typer.Option(help="Standard deviation of the ranges (m).", min=0)] = 0.02,
    pattern: Annotated[
        str, typer.Option(help="Scan pattern: lines, zigzag, ellipse or random (no scan angle).")
    ] = "lines",
    terrain: Annotated[str, typer.Option(help="Terrain: flat, slope, steep, hilly or terraced.")] = "flat",
    style: Annotated[
        str, typer.Option(help="Style of the town: mixed, suburb, centre or village.")
    ] = "mixed",
    trees: Annotated[
        float, typer.Option(help="Number of trees, relative to an ordinary town.", min=0, max=10)
    ] = 1.0,
    clutter: Annotated[bool, typer.Option(help="Add vents, skylights, panels and balconies.")] = True,
    colours: Annotated[
        bool, typer.Option("--colours", help="Add intensity, red, green, blue and near infrared.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Random seed; the same seed gives the same bytes.", min=0)] = 0,
    model: Annotated[
        Path | None, typer.Option(help="Scan the buildings of this CityJSON file instead.")
    ] = None,
    epochs: Annotated[
        bool,
        typer.Option("--epochs", help="Write the town at two epochs, from two scanners: OUT/old, OUT/new."),
    ] = False,
    changed: Annotated[
        float, typer.Option(help="With --epochs: fraction of the buildings that change.", min=0, max=1)
    ] = 0.25,
    new_density: Annotated[
        float | None,
        typer.Option(help="With --epochs: points per square metre of the second.", min=0.1, max=500),
    ] = None,
    crs: Crs = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate a town with known truth, and its scan. Every plane, corner and point label is known."""
    from eaves.simulate.run import run_epochs, run_simulation

    start_log(quiet, verbose)
    town: dict[str, object] = {"area_km2": area, "buildings": buildings, "terrain": terrain, "trees": trees}
    town |= {"style": style, "clutter": clutter, "model": model}
    scan = {"density": density, "noise": noise, "pattern": pattern}
    if epochs and colours:
        raise ValueError("--colours: of a town at two times no colours are drawn; leave one of both out")
    if epochs:
        message = run_epochs(out, town, scan, changed, new_density or density, seed, crs)
    else:
        message = run_simulation(out, town, scan, seed, crs, colours)
    if not quiet:
        typer.echo(message)


def demo(
    out: Out = Path("demo-out"),
    real: Annotated[
        bool,
        typer.Option("--real", help="Fetch a small open tile (1 MB) and build it, if there is a network."),
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Build a simulated town and evaluate it against its truth."""
    from eaves.simulate.demo import run_demo, run_real

    start_log(quiet, verbose)
    status = run_real(out) if real else None
    raise typer.Exit(run_demo(out, run_display(quiet)) if status is None else status)
