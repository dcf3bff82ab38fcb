"""Detection: which points belong to which building."""

from eaves.detect.base import Detector, detect_buildings

__all__ = ["Detector", "detect_buildings"]
