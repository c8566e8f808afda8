"""A law on an arm: loops, drivers, limits, torque filter."""

# Written by python -m phcontrol._groups.

from .runtime.arm_driver import ArmDriver, Reading, drive
from .runtime.camera_thread import CameraThread
from .runtime.control_box import ControlBox
from .runtime.control_loop import ControlLoop
from .runtime.franka_arm import FrankaArm
from .runtime.loop_camera import LoopCamera, SeenFrame
from .runtime.loop_log import LoopLog, LoopRecord, read_loop_log
from .runtime.loop_mode import LoopMode
from .runtime.mujoco_arm import MujocoArm
from .runtime.observed_arm import ObservedArm
from .runtime.packet_faults import PacketFaults
from .runtime.preflight import Preflight, preflight
from .runtime.real_time import RealTime
from .runtime.sensed_arm import SensedArm
from .runtime.simulated_arm import SimulatedArm
from .runtime.simulated_camera import SimulatedCamera
from .runtime.udp_arm import UdpArm
from .runtime.ur_arm import URArm
from .safety.filter_status import FilterStatus
from .safety.limits import Limits
from .safety.storage_condition import StorageCondition
from .safety.torque_filter import FilteredTorque, TorqueFilter

__all__ = [
    "ArmDriver",
    "CameraThread",
    "ControlBox",
    "ControlLoop",
    "FilterStatus",
    "FilteredTorque",
    "FrankaArm",
    "Limits",
    "LoopCamera",
    "LoopLog",
    "LoopMode",
    "LoopRecord",
    "MujocoArm",
    "ObservedArm",
    "PacketFaults",
    "Preflight",
    "Reading",
    "RealTime",
    "SeenFrame",
    "SensedArm",
    "SimulatedArm",
    "SimulatedCamera",
    "StorageCondition",
    "TorqueFilter",
    "URArm",
    "UdpArm",
    "drive",
    "preflight",
    "read_loop_log",
]
