"""docs/develop/steps.md: the steps whose results are kept, from their declarations."""

from __future__ import annotations

from eaves.flow.corrected import EDITED
from eaves.flow.step import STEPS, Input, Step
from eaves.run.keys import BASE

BASE_NAMES = ", ".join(f"`{name}`" for name in BASE)
INTRODUCTION = f"""# The steps of a run

Made from the table in `flow/step.py` by `make docs`. The code of each is also that of {BASE_NAMES} and
of the methods it is given. After `regions` buildings are joined across blocks, after `buildings` an update
names them as the earlier run did (`upkeep/versions.py`): these two are not kept by a key.

| step | unit | takes, within | parameters | functions | code beside the base |
|---|---|---|---|---|---|
"""


def steps_page() -> str:
    """The whole page."""
    return INTRODUCTION + "".join(map(row, (*STEPS, EDITED)))


def row(step: Step) -> str:
    """The line of one step."""
    unit = "block" if step.side is None else f"square of {step.side:g} m"
    unit = unit if step.writes is None else "part of a file"
    unit += f", where `{step.needs}`" if step.needs else ""
    takes = "; ".join(map(taken, step.takes)) or "files"
    parameters = ", ".join(f"`{name}`" for name in step.reads) or "–"
    functions = f"`{step.inputs_of.__name__}`, `{step.run.__name__}`"
    code = ", ".join(f"`{name}`" for name in step.code if name not in BASE)
    return f"| {step.name} | {unit} | {takes} | {parameters} | {functions} | {code} |\n"


def taken(entry: Input) -> str:
    """An input, and how far it reaches."""
    name = "points" if entry.source is None else entry.source.name
    if entry.reach is not None:
        return f"{name}, `{entry.reach}`"
    return name if not entry.rings else f"{name}, {entry.rings} ring{'s' * (entry.rings > 1)} of blocks"
