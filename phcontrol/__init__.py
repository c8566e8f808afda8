"""Energy-based control of robot arms, with a certificate for every controller."""

from phcontrol._version import __version__
from phcontrol.analysis.casimirs import CasimirCheck, casimirs
from phcontrol.analysis.certificate import Certificate
from phcontrol.analysis.certify import certify
from phcontrol.analysis.detectability import InvariantSet, invariant_set
from phcontrol.analysis.equilibrium import Equilibrium, equilibrium
from phcontrol.analysis.force_conditions import ForceConditions, force_control_conditions
from phcontrol.analysis.l2_gain import GainBound, damping_for_gain, l2_gain, measured_l2_gain
from phcontrol.analysis.model_comparison import ModelComparison, compare_models
from phcontrol.compilation.compiled_law import compile_law
from phcontrol.compilation.errors import CompilationError, CompilationWarning, NotTraceableError
from phcontrol.controllers.adaptive_payload import AdaptivePayload
from phcontrol.controllers.cartesian_impedance import CartesianImpedance
from phcontrol.controllers.cartesian_tracking import CartesianTracking
from phcontrol.controllers.classical_force import ClassicalForceControl
from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.event_schedule import EventSchedule, HandOver, Phase, Switch
from phcontrol.controllers.events import After, Event, Lost, Moment, Seen, Settled, Touched, When
from phcontrol.controllers.force_control import ForceControl
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.force_regulation import ForceRegulation
from phcontrol.controllers.hamiltonian_servo import HamiltonianServo
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping, RestLengthPort
from phcontrol.controllers.integral_action import IntegralAction
from phcontrol.controllers.law_error import LawError
from phcontrol.controllers.parameters import (
    Flag,
    Gain,
    Matrix,
    NonNegative,
    Parameter,
    Positive,
    PositiveVector,
    Vector,
)
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.reduction_servo import ReductionServo
from phcontrol.controllers.registry import CONTROLLERS, make_controller, register
from phcontrol.controllers.schedule import Schedule
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.tanked_law import TankedLaw, with_tank
from phcontrol.controllers.target import Target
from phcontrol.controllers.total_force_rejection import TotalForceRejection
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.controllers.virtual_position import VirtualPosition, virtual_position
from phcontrol.environments.body import Body
from phcontrol.environments.compliant_body import CompliantBody
from phcontrol.environments.contact_geometry import JointContact, SphereContact
from phcontrol.environments.disturbances import Disturbance, Pulse, Sampled, Sine, Step, Wrench
from phcontrol.environments.grasp_contact import GraspContact
from phcontrol.environments.rigid_body import RigidBody
from phcontrol.exceptions import (
    DataFileError,
    InvalidArgumentError,
    MissingMeasurementError,
    NonFiniteTorqueError,
    ObjectLostError,
    PHControlError,
    RobotDescriptionError,
    RobotDescriptionWarning,
    UnknownNameError,
)
from phcontrol.identification.excitation import ExcitingTrajectory, exciting_trajectory
from phcontrol.identification.identified import Identification
from phcontrol.identification.identify import identify
from phcontrol.identification.motion import Motion
from phcontrol.mechanics.friction import DeclaredFriction, StribeckFriction
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.matrix_damping import MatrixDamping
from phcontrol.mechanics.payload import Payload
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.potentials import ConstantTorque, GripperSpring
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.mechanics.transformations import (
    CanonicalCheck,
    PassivityCheck,
    check_canonical_transformation,
    check_transformed_passivity,
)
from phcontrol.mechanics.transformed_system import TransformedSystem, transformed_system
from phcontrol.potentials.frame_spring import FrameSpring
from phcontrol.potentials.frame_wrench import FrameWrench
from phcontrol.potentials.holding import Holding
from phcontrol.potentials.joint_force import JointForce
from phcontrol.potentials.joint_spring import JointSpring
from phcontrol.potentials.point_force import PointForce
from phcontrol.potentials.position_potential import PositionPotential
from phcontrol.potentials.potential import Potential
from phcontrol.potentials.single_joint_spring import SingleJointSpring
from phcontrol.runtime.arm_driver import ArmDriver, Reading, drive
from phcontrol.runtime.camera_thread import CameraThread
from phcontrol.runtime.control_box import ControlBox
from phcontrol.runtime.control_loop import ControlLoop
from phcontrol.runtime.loop_camera import LoopCamera, SeenFrame
from phcontrol.runtime.loop_mode import LoopMode
from phcontrol.runtime.packet_faults import PacketFaults
from phcontrol.runtime.simulated_arm import SimulatedArm
from phcontrol.runtime.simulated_camera import SimulatedCamera
from phcontrol.runtime.udp_arm import UdpArm
from phcontrol.safety.filter_status import FilterStatus
from phcontrol.safety.limits import Limits
from phcontrol.safety.storage_condition import StorageCondition
from phcontrol.safety.torque_filter import FilteredTorque, TorqueFilter
from phcontrol.sensors.camera_sensor import CameraSensor
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.sensors.momentum_observer import MomentumObserver
from phcontrol.setpoints.live_frame_path import LiveFramePath
from phcontrol.setpoints.live_trajectory import LiveTrajectory
from phcontrol.setpoints.live_value import LiveValue
from phcontrol.setpoints.setpoint import Setpoint
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log
from phcontrol.simulation.power_balance import PowerBalance
from phcontrol.simulation.simulation_error import SimulationError, SimulationInterrupted
from phcontrol.tanks.action import Action
from phcontrol.tanks.energy_tank import EnergyTank
from phcontrol.tanks.external_action import ExternalAction
from phcontrol.tanks.posture_action import PostureAction
from phcontrol.tanks.stiffness import Stiffness
from phcontrol.trajectories.figure_of_eight import FigureOfEight
from phcontrol.trajectories.files import read_frame_path
from phcontrol.trajectories.fourier_series import FourierSeries
from phcontrol.trajectories.frame_arc import FrameArc
from phcontrol.trajectories.frame_line import FrameLine
from phcontrol.trajectories.frame_path import FramePath, FrameReference
from phcontrol.trajectories.frame_spline import FrameSpline
from phcontrol.trajectories.inverse_kinematics import Posture, UnreachableTargetError, follow, reach
from phcontrol.trajectories.limits import LimitReport, check_limits
from phcontrol.trajectories.minimum_jerk import MinimumJerk
from phcontrol.trajectories.path_limits import within_limits
from phcontrol.trajectories.resolved_motion import ResolvedMotion, resolved_motion
from phcontrol.trajectories.sampled_frame_path import SampledFramePath
from phcontrol.trajectories.sinusoid import Sinusoid
from phcontrol.trajectories.slowed_path import SlowedPath
from phcontrol.trajectories.splines import CubicSpline, QuinticSpline, SampledTrajectory
from phcontrol.trajectories.tracking_transformation import TrackingTransformation
from phcontrol.trajectories.trajectory import Reference, Trajectory
from phcontrol.vision.calibration_file import read_camera
from phcontrol.vision.extraction import ColourDetector, extract_features
from phcontrol.vision.feature_flow import FeatureFlow
from phcontrol.vision.goal_posture import goal_posture
from phcontrol.vision.hand_eye import HandEyeCalibration, calibrate_hand_eye
from phcontrol.vision.interaction import interaction_matrix
from phcontrol.vision.marker_detector import MarkerDetector
from phcontrol.vision.marker_print import MarkerPrint
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.rendered_view import RenderedView
from phcontrol.vision.rendering import Renderer
from phcontrol.visualization.live import LiveView
from phcontrol.visualization.recording import record

__all__ = [
    "CONTROLLERS",
    "INTEGRATORS",
    "NOTHING",
    "Action",
    "AdaptivePayload",
    "After",
    "ArmDriver",
    "Body",
    "CameraSensor",
    "CameraThread",
    "CanonicalCheck",
    "CartesianImpedance",
    "CartesianTracking",
    "CasimirCheck",
    "Certificate",
    "ClassicalForceControl",
    "ClassicalImpedance",
    "ColourDetector",
    "Command",
    "CompilationError",
    "CompilationWarning",
    "CompliantBody",
    "ConstantTorque",
    "ControlBox",
    "ControlLoop",
    "Controller",
    "CubicSpline",
    "DataFileError",
    "DeclaredFriction",
    "Disturbance",
    "EnergyShaping",
    "EnergyTank",
    "Equilibrium",
    "Event",
    "EventSchedule",
    "ExcitingTrajectory",
    "ExternalAction",
    "FeatureFlow",
    "FigureOfEight",
    "FilterStatus",
    "FilteredTorque",
    "Flag",
    "ForceConditions",
    "ForceControl",
    "ForceFeedback",
    "ForceRegulation",
    "ForceSensor",
    "FourierSeries",
    "FrameArc",
    "FrameLine",
    "FramePath",
    "FrameReference",
    "FrameSpline",
    "FrameSpring",
    "FrameWrench",
    "Gain",
    "GainBound",
    "GraspContact",
    "GripperSpring",
    "HamiltonianServo",
    "HandEyeCalibration",
    "HandOver",
    "Holding",
    "Identification",
    "ImpedanceGrasping",
    "IntegralAction",
    "InvalidArgumentError",
    "InvariantSet",
    "JointContact",
    "JointForce",
    "JointSpring",
    "LawError",
    "LimitReport",
    "Limits",
    "LiveFramePath",
    "LiveTrajectory",
    "LiveValue",
    "LiveView",
    "Log",
    "LoopCamera",
    "LoopMode",
    "Lost",
    "MarkerDetector",
    "MarkerPrint",
    "Matrix",
    "MatrixDamping",
    "Measured",
    "MechanicalState",
    "MechanicalSystem",
    "MinimumJerk",
    "MissingMeasurementError",
    "ModelComparison",
    "Moment",
    "MomentumObserver",
    "Motion",
    "NonFiniteTorqueError",
    "NonNegative",
    "NotTraceableError",
    "ObjectLostError",
    "ObservedObject",
    "PHControlError",
    "PacketFaults",
    "Parameter",
    "PassivePort",
    "PassivityCheck",
    "Payload",
    "Phase",
    "PinholeCamera",
    "PointForce",
    "Pose",
    "PositionPotential",
    "Positive",
    "PositiveVector",
    "Posture",
    "PostureAction",
    "Potential",
    "PowerBalance",
    "Pulse",
    "QuinticSpline",
    "Reading",
    "ReductionServo",
    "Reference",
    "RenderedView",
    "Renderer",
    "ResolvedMotion",
    "RestLengthPort",
    "RigidBody",
    "Robot",
    "RobotDescriptionError",
    "RobotDescriptionWarning",
    "Sampled",
    "SampledFramePath",
    "SampledTrajectory",
    "Schedule",
    "Seen",
    "SeenFrame",
    "Setpoint",
    "Settled",
    "Shaping",
    "SimulatedArm",
    "SimulatedCamera",
    "SimulationError",
    "SimulationInterrupted",
    "Sine",
    "SingleJointSpring",
    "Sinusoid",
    "SlowedPath",
    "SphereContact",
    "Step",
    "Stiffness",
    "StorageCondition",
    "StribeckFriction",
    "Switch",
    "TankedLaw",
    "Target",
    "TorqueFilter",
    "TotalForceRejection",
    "Touched",
    "TrackingTransformation",
    "Trajectory",
    "TrajectoryTracking",
    "TransformedSystem",
    "UdpArm",
    "UnknownNameError",
    "UnreachableTargetError",
    "Vector",
    "VirtualPosition",
    "When",
    "Wrench",
    "__version__",
    "calibrate_hand_eye",
    "casimirs",
    "certify",
    "check_canonical_transformation",
    "check_limits",
    "check_transformed_passivity",
    "compare_models",
    "compile_law",
    "damping_for_gain",
    "drive",
    "equilibrium",
    "exciting_trajectory",
    "extract_features",
    "follow",
    "force_control_conditions",
    "goal_posture",
    "identify",
    "interaction_matrix",
    "invariant_set",
    "l2_gain",
    "load_robot",
    "make_controller",
    "measured_l2_gain",
    "reach",
    "read_camera",
    "read_frame_path",
    "record",
    "register",
    "resolved_motion",
    "simulate",
    "transformed_system",
    "virtual_position",
    "with_tank",
    "within_limits",
]
