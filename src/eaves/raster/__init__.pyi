from .contours import trace_contours as trace_contours
from .grid import UNKNOWN as UNKNOWN
from .grid import agreement_codes as agreement_codes
from .grid import cell_centres as cell_centres
from .grid import empty_raster as empty_raster
from .grid import highest_points as highest_points
from .grid import whole_cells as whole_cells
from .surfaces import scene_of as scene_of
