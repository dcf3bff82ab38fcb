"""Pictures of a run for print: which there are, and saving them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from eaves.formats.errors import require_plots

if TYPE_CHECKING:
    pass

PICTURES = ("plan", "errors", "section", "models")
SUFFIXES = (".png", ".svg", ".pdf")
CENTIMETRES = 2.54


def plot_run(
    folder: str | Path,
    path: str | Path | None = None,
    what: str = "plan",
    *,
    reference: str | Path | None = None,
    building: str | None = None,
    size_cm: float = 18.0,
    dpi: int = 300,
) -> Path:
    """Save a picture of a run; its path.

    Parameters
    ----------
    folder
        Folder of `eaves build`.
    path
        PNG, SVG or PDF by its extension; `<what>.png` in the folder for None.
    what
        `plan` (faces by direction over the shaded surface), `errors` (found, missed, false areas), `section`
        (across a building, with its points), `models` (all of them, seen obliquely).
    reference
        For `errors`: polygons, or the `detection.tif` of `eaves evaluate`.
    building
        For `section`: the id; the largest building with a model for None.
    size_cm
        Width of the picture.
    dpi
        Dots an inch, of PNG and of images inside SVG and PDF.

    Raises
    ------
    ValueError
        For another picture, another extension, or what it needs and has not.
    InputError
        When matplotlib is not installed.
    """
    require_plots()
    if what not in PICTURES:
        raise ValueError(f"'{what}' is no picture; choose one of: {', '.join(PICTURES)}")
    target = Path(path) if path else Path(folder) / f"{what}.png"
    if target.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{target}: '{target.suffix}' cannot be drawn; use {', '.join(SUFFIXES)}")
    from eaves.report.plots.drawings import errors_figure, models_figure, plan_figure, section_figure

    size = size_cm / CENTIMETRES
    if what == "errors" and reference is None:
        raise ValueError("errors need a reference; give --reference polygons, or evaluate's detection.tif")
    draw = {
        "plan": partial(plan_figure, folder, size),
        "errors": partial(errors_figure, folder, reference or "", size),
        "section": partial(section_figure, folder, building, size),
        "models": partial(models_figure, folder, size),
    }
    draw[what]().savefig(target, dpi=dpi)
    return target
