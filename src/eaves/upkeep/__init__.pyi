from .trial import Trial as Trial
from .trial import open_trial as open_trial
from .update import update as update
from .versions import NARROWEST_CHANGE_M as NARROWEST_CHANGE_M
from .versions import SAME_SURFACE_M as SAME_SURFACE_M
from .versions import SMALLEST_CHANGE_M2 as SMALLEST_CHANGE_M2
