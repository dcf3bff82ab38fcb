from .stage import GroundMethod as GroundMethod
from .stage import classify_ground as classify_ground
