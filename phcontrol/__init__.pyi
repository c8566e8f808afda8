"""Energy-based control of robot arms, with a certificate for every controller."""

# Every public name and where it lives; __init__.py loads each when it is first used.

from .analysis.casimirs import CasimirCheck, casimirs
from .analysis.certificate import Certificate
from .analysis.certify import certify
from .analysis.detectability import InvariantSet, invariant_set
from .analysis.equilibrium import Equilibrium, equilibrium
from .analysis.force_conditions import ForceConditions, force_control_conditions
from .analysis.l2_gain import GainBound, damping_for_gain, l2_gain, measured_l2_gain
from .analysis.linearization import Linearization, linearize
from .analysis.model_comparison import ModelComparison, compare_models
from .analysis.modes import Mode
from .analysis.safe_set import SafeSet, safe_set
from .analysis.sampled_loop import SampledLoop
from .compilation.compiled_law import compile_law
from .compilation.errors import CompilationError, CompilationWarning, NotTraceableError
from .compilation.loop_derivatives import LoopDerivatives
from .compilation.loop_jacobian import LoopJacobian
from .controllers.adaptive_payload import AdaptivePayload
from .controllers.cartesian_impedance import CartesianImpedance
from .controllers.cartesian_tracking import CartesianTracking
from .controllers.classical_force import ClassicalForceControl
from .controllers.classical_impedance import ClassicalImpedance
from .controllers.command import Command
from .controllers.controller import Controller
from .controllers.energy_shaping import EnergyShaping
from .controllers.event_schedule import EventSchedule, HandOver, Phase, Switch
from .controllers.events import After, Event, Lost, Moment, Seen, Settled, Touched, When
from .controllers.force_control import ForceControl
from .controllers.force_feedback import ForceFeedback
from .controllers.force_regulation import ForceRegulation
from .controllers.hamiltonian_servo import HamiltonianServo
from .controllers.impedance_grasping import ImpedanceGrasping, RestLengthPort
from .controllers.integral_action import IntegralAction
from .controllers.law_error import LawError
from .controllers.parameters import Flag, Gain, Matrix, NonNegative, Parameter, Positive, PositiveVector, Vector
from .controllers.passive_port import PassivePort
from .controllers.reduction_servo import ReductionServo
from .controllers.registry import CONTROLLERS, make_controller, register
from .controllers.schedule import Schedule
from .controllers.shaping import Shaping
from .controllers.tanked_law import TankedLaw
from .controllers.target import Target
from .controllers.total_force_rejection import TotalForceRejection
from .controllers.trajectory_tracking import TrajectoryTracking
from .controllers.virtual_position import VirtualPosition, virtual_position
from .controllers.with_tank import with_tank
from .design.design_gains import design_gains
from .design.designed_gains import DesignedGains
from .design.desired_bandwidth import DesiredBandwidth
from .design.desired_gain import DesiredGain
from .design.desired_settling import DesiredSettling
from .design.quadratic_cost import QuadraticCost
from .design.sampling_budget import SamplingBudget
from .design.smooth_objective import SmoothObjective
from .design.specification import Specification
from .design.torque_budget import TorqueBudget
from .design.trial import Trial
from .design.tune import tune
from .design.tuned_gains import TunedGains
from .environments.body import Body
from .environments.compliant_body import CompliantBody
from .environments.contact_geometry import JointContact, SphereContact
from .environments.disturbances import Disturbance, Pulse, Sampled, Sine, Step, Wrench
from .environments.grasp_contact import GraspContact
from .environments.rigid_body import RigidBody
from .exceptions import (
    AnswerError,
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
from .identification.excitation import ExcitingTrajectory, exciting_trajectory
from .identification.identified import Identification
from .identification.identify import identify
from .identification.motion import Motion
from .mechanics.friction import DeclaredFriction, StribeckFriction
from .mechanics.loading import load_robot
from .mechanics.matrix_damping import MatrixDamping
from .mechanics.payload import Payload
from .mechanics.pose import Pose
from .mechanics.potentials import ConstantTorque, GripperSpring
from .mechanics.robot import Robot
from .mechanics.state import MechanicalState
from .mechanics.stop_velocity import StopVelocity
from .mechanics.system import MechanicalSystem
from .mechanics.transformations import (
    CanonicalCheck,
    PassivityCheck,
    check_canonical_transformation,
    check_transformed_passivity,
)
from .mechanics.transformed_system import TransformedSystem, transformed_system
from .potentials.frame_spring import FrameSpring
from .potentials.frame_wrench import FrameWrench
from .potentials.holding import Holding
from .potentials.joint_force import JointForce
from .potentials.joint_spring import JointSpring
from .potentials.point_force import PointForce
from .potentials.position_potential import PositionPotential
from .potentials.potential import Potential
from .potentials.single_joint_spring import SingleJointSpring
from .runtime.arm_driver import ArmDriver, Reading, drive
from .runtime.arm_error import ArmError
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
from .sensors.camera_sensor import CameraSensor
from .sensors.force_sensor import ForceSensor
from .sensors.joint_sensor import JointSensor
from .sensors.measured import NOTHING, Measured
from .sensors.momentum_observer import MomentumObserver
from .sensors.wrist_sensor import Tool, WristSensor
from .setpoints.live_frame_path import LiveFramePath
from .setpoints.live_trajectory import LiveTrajectory
from .setpoints.live_value import LiveValue
from .setpoints.setpoint import Setpoint
from .simulation.closed_loop import simulate
from .simulation.integrators import INTEGRATORS
from .simulation.log import Log
from .simulation.log_slopes import LogSlopes
from .simulation.outcome import Outcome
from .simulation.power_balance import PowerBalance
from .simulation.simulate_many import simulate_many
from .simulation.simulation_error import SimulationError, SimulationInterrupted
from .sweeps.dask_scheduler import DaskScheduler
from .sweeps.engine import Engine, EngineError
from .sweeps.local_processes import LocalProcesses
from .sweeps.statement import Statement
from .sweeps.sweep import Sweep
from .sweeps.sweep_results import SweepResults
from .tanks.action import Action
from .tanks.energy_tank import EnergyTank
from .tanks.external_action import ExternalAction
from .tanks.posture_action import PostureAction
from .tanks.stiffness import Stiffness
from .trajectories.figure_of_eight import FigureOfEight
from .trajectories.files import read_frame_path
from .trajectories.fourier_series import FourierSeries
from .trajectories.frame_arc import FrameArc
from .trajectories.frame_line import FrameLine
from .trajectories.frame_path import FramePath, FrameReference
from .trajectories.frame_spline import FrameSpline
from .trajectories.inverse_kinematics import Posture, UnreachableTargetError, follow, reach
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
from .visualization.live import LiveView
from .visualization.log_plots import LogPlots, compare
from .visualization.recording import record

__version__: str
__all__ = [
    "CONTROLLERS",
    "INTEGRATORS",
    "NOTHING",
    "Action",
    "AdaptivePayload",
    "After",
    "AnswerError",
    "ArmDriver",
    "ArmError",
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
    "DaskScheduler",
    "DataFileError",
    "DeclaredFriction",
    "DesignedGains",
    "DesiredBandwidth",
    "DesiredGain",
    "DesiredSettling",
    "Disturbance",
    "EnergyShaping",
    "EnergyTank",
    "Engine",
    "EngineError",
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
    "FrankaArm",
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
    "JointSensor",
    "JointSpring",
    "LawError",
    "LimitReport",
    "Limits",
    "Linearization",
    "LiveFramePath",
    "LiveTrajectory",
    "LiveValue",
    "LiveView",
    "LocalProcesses",
    "Log",
    "LogPlots",
    "LogSlopes",
    "LoopCamera",
    "LoopDerivatives",
    "LoopJacobian",
    "LoopLog",
    "LoopMode",
    "LoopRecord",
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
    "Mode",
    "ModelComparison",
    "Moment",
    "MomentumObserver",
    "Motion",
    "MujocoArm",
    "NonFiniteTorqueError",
    "NonNegative",
    "NotTraceableError",
    "ObjectLostError",
    "ObservedArm",
    "ObservedObject",
    "Outcome",
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
    "Preflight",
    "Pulse",
    "QuadraticCost",
    "QuinticSpline",
    "Reading",
    "RealTime",
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
    "SafeSet",
    "Sampled",
    "SampledFramePath",
    "SampledLoop",
    "SampledTrajectory",
    "SamplingBudget",
    "Schedule",
    "Seen",
    "SeenFrame",
    "SensedArm",
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
    "SmoothObjective",
    "Specification",
    "SphereContact",
    "Statement",
    "Step",
    "Stiffness",
    "StopVelocity",
    "StorageCondition",
    "StribeckFriction",
    "Sweep",
    "SweepResults",
    "Switch",
    "TankedLaw",
    "Target",
    "Tool",
    "TorqueBudget",
    "TorqueFilter",
    "TotalForceRejection",
    "Touched",
    "TrackingTransformation",
    "Trajectory",
    "TrajectoryTracking",
    "TransformedSystem",
    "Trial",
    "TunedGains",
    "URArm",
    "UdpArm",
    "UnknownNameError",
    "UnreachableTargetError",
    "Vector",
    "VirtualPosition",
    "When",
    "Wrench",
    "WristSensor",
    "__version__",
    "calibrate_hand_eye",
    "casimirs",
    "certify",
    "check_canonical_transformation",
    "check_limits",
    "check_transformed_passivity",
    "compare",
    "compare_models",
    "compile_law",
    "damping_for_gain",
    "design_gains",
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
    "linearize",
    "load_robot",
    "make_controller",
    "measured_l2_gain",
    "preflight",
    "reach",
    "read_camera",
    "read_frame_path",
    "read_loop_log",
    "record",
    "register",
    "resolved_motion",
    "safe_set",
    "simulate",
    "simulate_many",
    "transformed_system",
    "tune",
    "virtual_position",
    "with_tank",
    "within_limits",
]
