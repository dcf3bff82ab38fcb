"""The steps whose results are kept, each declared once: unit, inputs with their reach, parameters, functions.

Nothing else knows these. `eaves.flow.step` computes them; `eaves.pipeline` names them in their order.
"""

from __future__ import annotations

from eaves.blocks.block import find_regions, find_signs, inputs_of_regions, inputs_of_signs
from eaves.blocks.block_file import BlockFile, inputs_of_shown, show_block
from eaves.blocks.ground import (
    classify_block,
    find_floor,
    find_large,
    find_square_decks,
    inputs_of_decks,
    inputs_of_floors,
    inputs_of_ground,
    inputs_of_large,
)
from eaves.blocks.sharpened import find_sharpened, inputs_of_sharpened
from eaves.blocks.superseded import find_superseded, inputs_of_superseded
from eaves.blocks.thinned import find_thinned, inputs_of_thinned
from eaves.buildings.building_file import load_buildings, load_found
from eaves.buildings.edited import inputs_of_edited, model_orders
from eaves.buildings.owned import inputs_of_buildings, model_buildings
from eaves.flow.step import Input, Step
from eaves.run import keys
from eaves.run.partition import SliceWriter, inputs_of_points, read_slice
from eaves.run.points import load_chosen, load_files, load_points, load_scans
from eaves.run.world_squares import WIDE_SQUARE

POINTS = Step(
    name=keys.POINTS,
    code=keys.READING,
    takes=(),
    inputs_of=inputs_of_points,
    run=read_slice,
    reads=("side", "window", "fields"),
    writes=SliceWriter,
    booked="read",
    shown="read",
)
"""Its units are the parts of the inputs, whose points it puts into their blocks."""
SUPERSEDED = Step(
    name=keys.SUPERSEDED,
    code=(*keys.BASE, "blocks/superseded.py"),
    takes=(Input(load=load_scans, rings=1),),
    inputs_of=inputs_of_superseded,
    run=find_superseded,
    reads=("generations",),
    booked="read",
)
THINNED = Step(
    name=keys.THINNED,
    code=(*keys.BASE, "blocks/thinned.py"),
    takes=(Input(load=load_files),),
    inputs_of=inputs_of_thinned,
    run=find_thinned,
    booked="read",
)
SHARPENED = Step(
    name=keys.SHARPENED,
    code=(*keys.BASE, "blocks/sharpened.py"),
    takes=(Input(load=load_chosen, rings=1),),
    inputs_of=inputs_of_sharpened,
    run=find_sharpened,
    reads=("blur",),
    booked="read",
)
FLOORS = Step(
    name=keys.FLOORS,
    code=keys.GROUND_CODE,
    takes=(Input(load=load_points),),
    inputs_of=inputs_of_floors,
    run=find_floor,
    booked="wide",
)
LARGE = Step(
    name=keys.LARGE,
    code=keys.GROUND_CODE,
    side=WIDE_SQUARE,
    takes=(FLOORS.within("wide_buffer"),),
    inputs_of=inputs_of_large,
    run=find_large,
    reads=("ground", "wide_buffer"),
    needs="sees_wide",
    booked="wide",
)
DECKS = Step(
    name=keys.DECKS,
    code=keys.GROUND_CODE,
    side=WIDE_SQUARE,
    takes=(FLOORS.within("wide_buffer"), LARGE.around(0)),
    inputs_of=inputs_of_decks,
    run=find_square_decks,
    reads=("wide_buffer",),
    needs="sees_decks",
    booked="wide",
)
GROUND = Step(
    name=keys.GROUND,
    code=keys.GROUND_CODE,
    takes=(Input(reach="ground.buffer", ids=False), LARGE.within("ground.buffer")),
    inputs_of=inputs_of_ground,
    run=classify_block,
    reads=("ground", "use_classes", "ground_classes", "sees_wide"),
    isolated=True,
    shown="ground",
)
SEEN = (
    Input(reach="scene_buffer"),
    GROUND.within("scene_buffer"),
    LARGE.within("scene_buffer"),
    DECKS.within("scene_buffer"),
)
SIGNS = Step(
    name=keys.SIGNS,
    code=keys.SCENES_CODE,
    takes=SEEN,
    inputs_of=inputs_of_signs,
    run=find_signs,
    reads=("detect", "scene_buffer", "sees_wide", "marks_others"),
    needs="coloured",
)
REGIONS = Step(
    name=keys.REGIONS,
    code=keys.SCENES_CODE,
    takes=(*SEEN, SIGNS.within("signs_buffer")),
    inputs_of=inputs_of_regions,
    run=find_regions,
    load=BlockFile,
    reads=(
        "detect",
        "scene_buffer",
        "sees_wide",
        "vegetation",
        "marks_vegetation",
        "marks_others",
        "keeps_low",
        "smallest",
        "classes_only",
    ),
    shown="blocks",
)
BUILDINGS = Step(
    name=keys.BUILDINGS,
    code=keys.BUILDINGS_CODE,
    takes=(REGIONS.around(1), Input(load=load_points, rings=1)),
    inputs_of=inputs_of_buildings,
    run=model_buildings,
    reads=(
        "outline",
        "units",
        "roof",
        "reconstruct",
        "lod",
        "overhangs",
        "keeps_low",
        "snap_footprints",
        "from_raster",
    ),
    earlier=load_buildings,
    booked="buildings",
    shown="buildings",
    persistent=True,
)
EDITED = Step(
    name=keys.EDITED,
    code=keys.BUILDINGS_CODE,
    takes=(REGIONS.around(1), Input(load=load_found)),
    inputs_of=inputs_of_edited,
    run=model_orders,
    reads=("roof", "reconstruct", "lod", "overhangs", "keeps_low", "from_raster"),
    earlier=load_buildings,
    booked="buildings",
    shown="buildings",
    persistent=True,
)
SHOWN = Step(
    name="shown",
    code=(*keys.BASE, "blocks/block_file.py"),
    takes=(REGIONS.around(0), GROUND.around(0)),
    inputs_of=inputs_of_shown,
    run=show_block,
    load=BlockFile,
    persistent=True,
)
"""What the files show of a block, of a run by tiles, which lets go of the other results."""
STEPS = (
    POINTS,
    SUPERSEDED,
    THINNED,
    SHARPENED,
    FLOORS,
    LARGE,
    DECKS,
    GROUND,
    SIGNS,
    REGIONS,
    BUILDINGS,
    EDITED,
    SHOWN,
)
"""In the order in which they run."""
