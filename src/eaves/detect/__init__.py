"""Detection: which points belong to which building."""

from eaves.detect.stage import Detector, detect_buildings

__all__ = ["Detector", "detect_buildings"]
