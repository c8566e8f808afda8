"""What a law is shown: sensors, observers, cameras, images."""

# Written by python -m phcontrol._groups.

from .sensors.camera_sensor import CameraSensor
from .sensors.force_sensor import ForceSensor
from .sensors.joint_sensor import JointSensor
from .sensors.measured import NOTHING, Measured
from .sensors.momentum_observer import MomentumObserver
from .sensors.wrist_sensor import Tool, WristSensor
from .vision.calibration_file import read_camera
from .vision.extraction import ColourDetector, extract_features
from .vision.feature_flow import FeatureFlow
from .vision.goal_posture import goal_posture
from .vision.hand_eye import HandEyeCalibration, calibrate_hand_eye
from .vision.interaction import interaction_matrix
from .vision.marker_detector import MarkerDetector
from .vision.marker_print import MarkerPrint
from .vision.observed_object import ObservedObject
from .vision.pinhole_camera import PinholeCamera
from .vision.rendered_view import RenderedView
from .vision.rendering import Renderer

__all__ = [
    "NOTHING",
    "CameraSensor",
    "ColourDetector",
    "FeatureFlow",
    "ForceSensor",
    "HandEyeCalibration",
    "JointSensor",
    "MarkerDetector",
    "MarkerPrint",
    "Measured",
    "MomentumObserver",
    "ObservedObject",
    "PinholeCamera",
    "RenderedView",
    "Renderer",
    "Tool",
    "WristSensor",
    "calibrate_hand_eye",
    "extract_features",
    "goal_posture",
    "interaction_matrix",
    "read_camera",
]
