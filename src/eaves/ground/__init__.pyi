from .contours import trace_contours as trace_contours
from .stage import GroundMethod as GroundMethod
from .stage import classify_ground as classify_ground
