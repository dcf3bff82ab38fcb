from .consensus.groups import VehicleRules as VehicleRules
from .consensus.groups import find_vehicles as find_vehicles
from .stage import MIN_HEIGHT_M as MIN_HEIGHT_M
from .stage import Detector as Detector
from .stage import detect_buildings as detect_buildings
from .toolkit.cells import Cells as Cells
