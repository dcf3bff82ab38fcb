"""Results against references, by the field's measures: ground, detection, footprints, roof planes, models."""

from eaves.evaluate.detection_scores import DetectionScore, evaluate_detection, label_objects
from eaves.evaluate.files import evaluate_files
from eaves.evaluate.footprint_scores import FootprintScore, evaluate_footprints
from eaves.evaluate.ground_scores import GroundScore, evaluate_ground
from eaves.evaluate.models import ModelScore, evaluate_models
from eaves.evaluate.report import Evaluation, write_report
from eaves.evaluate.roof_planes import PlaneScore, evaluate_planes
from eaves.evaluate.scores import Agreement
from eaves.evaluate.values import detection, footprints, ground, roofs

__all__ = [
    "Agreement",
    "DetectionScore",
    "Evaluation",
    "FootprintScore",
    "GroundScore",
    "ModelScore",
    "PlaneScore",
    "detection",
    "evaluate_detection",
    "evaluate_files",
    "evaluate_footprints",
    "evaluate_ground",
    "evaluate_models",
    "evaluate_planes",
    "footprints",
    "ground",
    "label_objects",
    "roofs",
    "write_report",
]
