"""A Franka arm over its own protocol, by its maker's client pylibfranka."""

from __future__ import annotations

import contextlib
import sys
import warnings
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, flag, positive_vector, text
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.runtime.arm_driver import Pace, Reading
from phcontrol.runtime.arm_error import ArmError
from phcontrol.runtime.control_loop import Gravity
from phcontrol.sensors.measured import NOTHING, Measured

_JOINTS = 7
_WRONG_WEIGHT = np.array([5.0, 5.0, 5.0, 5.0, 1.5, 1.5, 1.5])  # of model and robot, before it is said [N·m]
_ADVICE = {
    "joint_velocity_violation": "a joint was too fast: give the loop a TorqueFilter with Limits.franka(system)",
    "joint_position_limits_violation": "a joint ran into its stop: give the loop a TorqueFilter with Limits.franka",
    "controller_torque_discontinuity": "the torque jumped: give the loop a TorqueFilter with Limits.franka(system)",
    "tau_j_range_violation": "the motors carried too much: give the loop a TorqueFilter with Limits.franka(system)",
    "power_limit_violation": "the motors gave too much power: move more slowly",
    "communication_constraints_violation": "too many torques came late: see what `phcontrol preflight` finds",
    "joint_reflex": "it felt a collision: raise collision_torque, if there was none",
    "cartesian_reflex": "it felt a collision: raise collision_force, if there was none",
}
_MODES = {
    "Reflex": "a reflex stopped it; clear what it ran into, and give recover=True",
    "UserStopped": "the enabling or stop button is pressed: release it",
    "Guiding": "it is being guided by hand: release the guiding button",
    "Move": "another program moves it: end that first",
    "AutomaticErrorRecovery": "it is recovering from an error: wait for it",
    "Other": "open the brakes and activate FCI in the robot's Desk",
}


class FrankaArm:
    """A driver for a Franka Research 3 or Franka Emika Robot; a context manager that starts and ends torque control.

        with FrankaArm("172.16.0.2", system) as arm:
            loop = ControlLoop(system, make_controller("energy_shaping", system, arm.position), 1e-3)
            drive(loop, arm, 10.0)

    Torque control begins with the first ``read``, and from then on the robot waits for nobody: what takes longer than
    a few milliseconds (making a law, a filter or a log) belongs before it. ``position`` says where the arm stands.

    The robot is the clock (``pace`` is "read"): every millisecond ``read`` gets its state, and the torque has to be
    back within some 300 µs. The robot adds its own weight, and that of the hand and load it was told of (in Desk, or
    ``arm.robot.set_load``): what is sent is u − g. What it adds differs from the model's g by their errors; the law
    does not notice more of it than that.

    **Ends**: leaving the block ends torque control, and the robot holds itself; so does any error. **Watchdog**: where
    no torque comes (a process that is stopped, killed, or too slow), the robot goes on with the last one, and after
    some 20 ms (20 torques missing in a row) stops by ``communication_constraints_violation``; that is the robot's, and
    no simulator's by default.

    Args:
        address: of the robot [host name or IP].
        system: the model of the arm: seven joints, named ``…joint1`` to ``…joint7``, in this order.
        realtime: insist on a real-time kernel and scheduler, which libfranka then sets for the calling thread.
        recover: clear an error that the robot still has from before (``automatic_error_recovery``).
        collision_torque: beyond which external torques stop the robot [N·m], one or one each joint; as it is if None.
        collision_force: beyond which external forces at the hand do [N, N·m], one or six; as it is if None.
        external_force: measure f_e by the robot's own estimate, with the sign turned: libfranka counts what the robot
            does to its environment. It is the difference of torque sensors and the robot's model, with friction and
            the errors of the load it was told of in it.

    Raises:
        PHControlError: pylibfranka is not installed.
        InvalidArgumentError: the model is not of such an arm.
        ArmError: on entering, no robot answers or it is not ready; later, it stopped by itself.

    Example:
        >>> from phcontrol import FrankaArm, InvalidArgumentError, MechanicalSystem, load_robot
        >>> try:
        ...     FrankaArm("172.16.0.2", MechanicalSystem(load_robot("ur5")))
        ... except InvalidArgumentError as error:
        ...     print(str(error)[:7])  # the model is not of such an arm
        system:
    """

    gravity: Gravity = "robot"
    pace: Pace = "read"

    def __init__(
        self,
        address: str,
        system: MechanicalSystem,
        *,
        realtime: bool = False,
        recover: bool = False,
        collision_torque: ArrayLike | None = None,
        collision_force: ArrayLike | None = None,
        external_force: bool = False,
    ) -> None:
        self.address = text("address", address)
        check_system(system)
        _check_joints(system)
        self.system = system
        self._realtime, self._recover = flag("realtime", realtime), flag("recover", recover)
        self._external_force = flag("external_force", external_force)
        self._torques = _thresholds("collision_torque", collision_torque, _JOINTS)
        self._forces = _thresholds("collision_force", collision_force, 6)
        if (self._torques is None) != (self._forces is None):
            raise InvalidArgumentError("collision_torque", "and collision_force must be given together")
        self._franka = _load_pylibfranka()
        self.robot: Any = None
        """pylibfranka's own ``Robot``; None outside the block."""
        self._control: Any = None
        self._begins = False
        self._last: Array = np.zeros(_JOINTS)
        self.position: Array = np.full(_JOINTS, np.nan)
        """Where the arm stood when it was connected, shape (7,) [rad]."""
        self.weight_error: Array = np.zeros(_JOINTS)
        """Torque sensors minus the model's weight, likewise, shape (7,) [N·m]."""
        self.counts = {"readings": 0, "lost": 0}
        """States that came, and those that did not."""

    def __enter__(self) -> FrankaArm:
        franka = self._franka
        config = franka.RealtimeConfig.kEnforce if self._realtime else franka.RealtimeConfig.kIgnore
        try:
            self.robot = franka.Robot(self.address, config)
        except Exception as error:  # of several kinds, and the network's own
            raise ArmError(_no_robot(self.address, error, self._realtime)) from error
        try:
            state = self._ready_state()
            self._compare_weight(state)
            if self._torques is not None and self._forces is not None:
                self.robot.set_collision_behavior(self._torques, self._torques, self._forces, self._forces)
        except Exception as error:
            self.robot = None
            if isinstance(error, PHControlError):
                raise
            raise ArmError(f"the robot at {self.address} is not ready: {_told(error)}") from error
        self.position, self._begins = np.array(state.q), True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        control, robot, self._control, self.robot, self._begins = self._control, self.robot, None, None, False
        if control is not None:
            try:
                control.readOnce()
                last = self._franka.Torques(self._last.tolist())
                last.motion_finished = True
                control.writeOnce(last)
            except Exception:  # it still moves, or has stopped already
                with contextlib.suppress(Exception):
                    robot.stop()

    def read(self) -> Reading:
        """Wait for the robot's next state, and return it; the first begins torque control.

        Raises ArmError when the robot has stopped.
        """
        if self._begins:
            self._begin()
        if self._control is None:
            raise ArmError("the robot is not under control: use the arm as a context manager, `with FrankaArm(...)`")
        try:
            state, elapsed = self._control.readOnce()
        except Exception as error:
            raise self._stopped(error) from error
        self.counts["readings"] += 1
        self.counts["lost"] += max(0, round(1e3 * elapsed.to_sec()) - 1)
        measured = NOTHING
        if self._external_force:
            measured = Measured(external_force=-np.array(state.tau_ext_hat_filtered))
        return Reading(
            np.array(state.q), np.array(state.dq), measured, torque=np.array(state.tau_J_d), elapsed=elapsed.to_sec()
        )

    def write(self, torque: Array) -> None:
        """Send a torque, shape (7,) [N·m]. Raises ArmError when the robot has stopped."""
        if self._control is None:
            raise ArmError("the robot is not under control: a torque answers a reading, `arm.read()` in a `with` block")
        try:
            self._control.writeOnce(self._franka.Torques(torque.tolist()))
        except Exception as error:
            raise self._stopped(error) from error
        self._last = torque

    def _begin(self) -> None:
        self._begins = False
        try:
            self._control = self.robot.start_torque_control()
        except Exception as error:
            raise ArmError(f"the robot at {self.address} does not start torque control: {_told(error)}") from error

    def _ready_state(self) -> Any:
        """Return the robot's state, which is one to start from. Raises ArmError where it is not."""
        state = self.robot.read_once()
        if self._recover and (state.current_errors or _mode(state) == "Reflex"):
            self.robot.automatic_error_recovery()
            state = self.robot.read_once()
        mode = _mode(state)
        if mode != "Idle":
            advice = _MODES.get(mode, "it must be idle")
            errors = f" ({state.current_errors})" if state.current_errors else ""
            raise ArmError(f"the robot at {self.address} is in mode {mode}, not Idle{errors}: {advice}")
        return state

    def _compare_weight(self, state: Any) -> None:
        """Compare the torque sensors of the robot at rest with the model's weight, and say where they differ much."""
        weight = self.system.motor_torque(self.system.at(np.array(state.q)).gravity)
        self.weight_error = np.array(state.tau_J) - weight
        much = np.abs(self.weight_error) > _WRONG_WEIGHT
        if much.any():
            names = np.array(self.system.robot.joint_names)[much].tolist()
            warnings.warn(
                f"at rest the robot's torque sensors differ from the model's weight by "
                f"{np.round(self.weight_error[much], 2).tolist()} N·m at {names}: does the model hold what the hand "
                "holds, and stand as the robot does?",
                stacklevel=3,
            )

    def _stopped(self, error: Exception) -> ArmError:
        """Return the error of a robot that stopped, and let go of it."""
        self._control = None
        told = _told(error)
        advice = "; ".join(hint for name, hint in _ADVICE.items() if name in told.lower())
        return ArmError(f"the robot at {self.address} stopped: {told}" + (f". {advice}" if advice else ""))


def _load_pylibfranka() -> Any:
    """Return the module pylibfranka. Raises PHControlError, saying how to install it, and where it cannot be."""
    try:
        import pylibfranka
    except ImportError as error:
        message = "a Franka arm needs pylibfranka: pip install 'phcontrol[franka]'"
        if not (3, 10) <= sys.version_info[:2] <= (3, 12):
            running = f"{sys.version_info[0]}.{sys.version_info[1]}"
            message = f"pylibfranka has wheels for Python 3.10 to 3.12 only, and this is Python {running}"
        raise PHControlError(f"{message} ({error})") from error
    return pylibfranka


def _check_joints(system: MechanicalSystem) -> None:
    """Raise InvalidArgumentError unless the model's joints are the robot's seven, in its order."""
    names = system.robot.joint_names
    if len(names) != _JOINTS:
        raise InvalidArgumentError(
            "system",
            f"must have the robot's 7 joints, but {system.robot.name} has {len(names)}: {', '.join(names)}; lock the "
            "fingers (locked_joints)",
        )
    order = [k for k, name in enumerate(names) if not name.endswith(f"joint{k + 1}")]
    if order:
        raise InvalidArgumentError(
            "system",
            f"must have the robot's joints in its order, joint1 to joint7, but number {order[0] + 1} of "
            f"{system.robot.name} is '{names[order[0]]}'",
        )


def _thresholds(name: str, value: ArrayLike | None, size: int) -> list[float] | None:
    if value is None:
        return None
    return [float(x) for x in positive_vector(name, np.broadcast_to(np.asarray(value, dtype=float), (size,)), size)]


def _mode(state: Any) -> str:
    return str(state.robot_mode).rsplit(".", 1)[-1].removeprefix("k")


def _no_robot(address: str, error: Exception, realtime: bool) -> str:
    if realtime and "realtime" in type(error).__name__.lower() + str(error).lower():
        return f"{_told(error)}: see what `phcontrol preflight` says, or give realtime=False"
    return (
        f"no robot answers at {address}: {_told(error)}. Is FCI activated, the address the robot's, and the cable in "
        "the control box?"
    )


def _told(error: Exception) -> str:
    """Return what libfranka says, on one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return " ".join(lines)[:400] or type(error).__name__
