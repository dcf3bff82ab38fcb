from .codes import RULES as RULES
from .files import validate_file as validate_file
from .fit_to_points import Fit as Fit
from .fit_to_points import fit_to_points as fit_to_points
from .models import validate_model as validate_model
from .primitives import Tolerances as Tolerances
