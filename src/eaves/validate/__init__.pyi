from .files import Fit as Fit
from .files import fit_to_points as fit_to_points
from .files import validate_file as validate_file
from .models import RULES as RULES
from .models import Tolerances as Tolerances
from .models import validate_model as validate_model
