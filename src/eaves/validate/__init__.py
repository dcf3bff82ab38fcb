"""Validity: rings, polygons, shells and solids, with val3dity's codes."""

from eaves.validate.codes import RULES
from eaves.validate.files import validate_file
from eaves.validate.fit_to_points import Fit, fit_to_points
from eaves.validate.models import validate_model
from eaves.validate.primitives import Tolerances

__all__ = ["RULES", "Fit", "Tolerances", "fit_to_points", "validate_file", "validate_model"]
