"""Goals, stiffnesses and forces that may be changed while an arm runs."""

from phcontrol.setpoints.live_frame_path import LiveFramePath
from phcontrol.setpoints.live_motion import LiveMotion
from phcontrol.setpoints.live_trajectory import LiveTrajectory
from phcontrol.setpoints.live_value import LiveValue
from phcontrol.setpoints.setpoint import Setpoint

__all__ = ["LiveFramePath", "LiveMotion", "LiveTrajectory", "LiveValue", "Setpoint"]
