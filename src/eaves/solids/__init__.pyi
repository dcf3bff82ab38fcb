from .coverage import coverage_of as coverage_of
from .extrude import close_cells as close_cells
from .extrude import drop_straight_nodes as drop_straight_nodes
from .extrude import split_crossings as split_crossings
from .soundness import find_defect as find_defect
