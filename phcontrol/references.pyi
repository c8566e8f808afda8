"""Along what an arm or a frame is led, also while goals change."""

# Written by python -m phcontrol._groups.

from .setpoints.live_frame_path import LiveFramePath
from .setpoints.live_trajectory import LiveTrajectory
from .setpoints.live_value import LiveValue
from .setpoints.setpoint import Setpoint
from .trajectories.figure_of_eight import FigureOfEight
from .trajectories.files import read_frame_path
from .trajectories.fourier_series import FourierSeries
from .trajectories.frame_arc import FrameArc
from .trajectories.frame_line import FrameLine
from .trajectories.frame_path import FramePath, FrameReference
from .trajectories.frame_spline import FrameSpline
from .trajectories.inverse_kinematics import Posture, follow, reach
from .trajectories.limits import LimitReport, check_limits
from .trajectories.minimum_jerk import MinimumJerk
from .trajectories.path_limits import within_limits
from .trajectories.resolved_motion import ResolvedMotion, resolved_motion
from .trajectories.sampled_frame_path import SampledFramePath
from .trajectories.sinusoid import Sinusoid
from .trajectories.slowed_path import SlowedPath
from .trajectories.splines import CubicSpline, QuinticSpline, SampledTrajectory
from .trajectories.tracking_transformation import TrackingTransformation
from .trajectories.trajectory import Reference, Trajectory

__all__ = [
    "CubicSpline",
    "FigureOfEight",
    "FourierSeries",
    "FrameArc",
    "FrameLine",
    "FramePath",
    "FrameReference",
    "FrameSpline",
    "LimitReport",
    "LiveFramePath",
    "LiveTrajectory",
    "LiveValue",
    "MinimumJerk",
    "Posture",
    "QuinticSpline",
    "Reference",
    "ResolvedMotion",
    "SampledFramePath",
    "SampledTrajectory",
    "Setpoint",
    "Sinusoid",
    "SlowedPath",
    "TrackingTransformation",
    "Trajectory",
    "check_limits",
    "follow",
    "reach",
    "read_frame_path",
    "resolved_motion",
    "within_limits",
]
