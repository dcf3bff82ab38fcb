"""Results against references, by the field's measures: ground, detection, footprints, roof planes, models."""

from eaves.evaluate.detection import DetectionScore, evaluate_detection, label_objects
from eaves.evaluate.files import evaluate_files
from eaves.evaluate.footprints import FootprintScore, evaluate_footprints
from eaves.evaluate.ground import GroundScore, evaluate_ground
from eaves.evaluate.models import ModelScore, evaluate_models
from eaves.evaluate.report import Evaluation, write_report
from eaves.evaluate.roof_planes import PlaneScore, evaluate_planes
from eaves.evaluate.scores import Agreement

__all__ = [
    "Agreement",
    "DetectionScore",
    "Evaluation",
    "FootprintScore",
    "GroundScore",
    "ModelScore",
    "PlaneScore",
    "evaluate_detection",
    "evaluate_files",
    "evaluate_footprints",
    "evaluate_ground",
    "evaluate_models",
    "evaluate_planes",
    "label_objects",
    "write_report",
]
