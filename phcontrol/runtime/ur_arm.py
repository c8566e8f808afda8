"""A Universal Robots arm by ur_rtde's direct torque control. Tested against a stand-in of its client only."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, number, per_joint, positive, text
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.runtime.arm_driver import Pace, Reading
from phcontrol.runtime.arm_error import ArmError
from phcontrol.runtime.control_loop import Gravity

_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
_RUNNING = 7
_MODES = {
    -1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "power off", 4: "power on",
    5: "idle (its brakes are on)", 6: "backdrive", 7: "running", 8: "updating its firmware",
}  # fmt: skip


class URArm:
    """A driver for a UR arm in direct torque control at 500 Hz; a context manager that starts and ends it.

        with URArm("192.168.1.2", system) as arm:
            loop = ControlLoop(system, law, arm.period, torque_filter=...)
            drive(loop, arm, 10.0)

    **Untested on hardware**: there is no simulator of ``direct_torque`` to be had offline. It was written after
    ur_rtde 1.6.5 and Universal Robots' script manual (PolyScope 5.25, 10.12 and later), and its tests use a stand-in
    of ur_rtde. Try it first with a stop button in your hand, at a low ``torque_limit``.

    The robot adds its weight itself (that of the payload it was told of too), and a part of its friction: the torque
    sent is u − g, and a model of friction in the law should have what is left. **Watchdog**: without a new torque the
    robot goes back to position control; ur_rtde's own watchdog, which is set and kicked here, ends the script when
    torques come more rarely than ``slowest_rate``.

    Args:
        address: of the robot [host name or IP].
        system: the model of the arm: UR's six joints in its order.
        period: [s]; 2 ms is the robot's.
        viscous_scale: what part of its viscous friction the robot compensates, 0 to 1, one or one each joint.
        coulomb_scale: the same of its dry friction.
        slowest_rate: of torques, before the watchdog ends the script [1/s].

    Raises:
        PHControlError: ur_rtde is not installed.
        InvalidArgumentError: the model is not of such an arm.
        ArmError: no robot answers, it is not running, or it stopped.

    Example:
        >>> from phcontrol import InvalidArgumentError, MechanicalSystem, URArm, load_robot
        >>> try:
        ...     URArm("192.168.0.2", MechanicalSystem(load_robot("pera")))
        ... except InvalidArgumentError as error:
        ...     print(str(error)[:7])  # the model is not of such an arm
        system:
    """

    gravity: Gravity = "robot"
    pace: Pace = "clock"

    def __init__(
        self,
        address: str,
        system: MechanicalSystem,
        *,
        period: float = 2e-3,
        viscous_scale: ArrayLike = 0.0,
        coulomb_scale: ArrayLike = 0.0,
        slowest_rate: float = 50.0,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.address, self.period = text("address", address), positive("period", period)
        check_system(system)
        _check_joints(system)
        self._scales = [
            _scale(name, value) for name, value in (("viscous_scale", viscous_scale), ("coulomb_scale", coulomb_scale))
        ]
        self._slowest = number("slowest_rate", slowest_rate, minimum=1.0)
        self._clock = clock
        self._modules = _load_rtde()
        self._control: Any = None
        self._receive: Any = None
        self._stamp, self._arrived = -np.inf, 0.0
        self._sent = np.zeros(6)

    def __enter__(self) -> URArm:
        control, receive = self._modules
        try:
            self._receive = receive.RTDEReceiveInterface(self.address, 1.0 / self.period)
            self._check_mode()
            self._control = control.RTDEControlInterface(self.address, 1.0 / self.period)
            self._control.setWatchdog(self._slowest)
        except ArmError:
            raise
        except Exception as error:
            raise ArmError(
                f"no robot answers at {self.address}: {error}. Is it on, in remote control, and the address its own?"
            ) from error
        self._sent = np.zeros(6)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        control, self._control, receive, self._receive = self._control, None, self._receive, None
        try:
            if control is not None:
                control.stopScript()
        finally:
            for interface in (control, receive):
                if interface is not None:
                    interface.disconnect()

    def read(self) -> Reading:
        """Return the newest reading; its age counts from when it was first seen. Raises ArmError after a stop."""
        if self._receive is None:
            raise ArmError("the robot is not under control: use the arm as a context manager, `with URArm(...)`")
        receive = self._receive
        if receive.isProtectiveStopped() or receive.isEmergencyStopped():
            raise ArmError(
                f"the robot at {self.address} stopped (protective or emergency stop): keep it in its limits by a "
                "TorqueFilter, and clear the stop on its panel"
            )
        now, stamp = self._clock(), receive.getTimestamp()
        if stamp != self._stamp:
            self._stamp, self._arrived = stamp, now
        return Reading(
            np.array(receive.getActualQ()),
            np.array(receive.getActualQd()),
            age=max(0.0, now - self._arrived),
            torque=self._sent.copy(),
        )

    def write(self, torque: Array) -> None:
        """Send a torque, shape (6,) [N·m]. Raises ArmError where the robot does not take it."""
        if self._control is None:
            raise ArmError("the robot is not under control: use the arm as a context manager, `with URArm(...)`")
        viscous, coulomb = self._scales
        if not self._control.directTorque(torque.tolist(), viscous, coulomb):
            raise ArmError(f"the robot at {self.address} did not take a torque: its script has ended")
        self._control.kickWatchdog()
        self._sent = torque

    def _check_mode(self) -> None:
        mode = int(self._receive.getRobotMode())
        if mode != _RUNNING:
            named = _MODES.get(mode, f"mode {mode}")
            raise ArmError(f"the robot at {self.address} is {named}, not running: switch it on and release its brakes")


def _load_rtde() -> tuple[Any, Any]:
    """Return the modules rtde_control and rtde_receive. Raises PHControlError, saying how to install them."""
    try:
        import rtde_control
        import rtde_receive
    except ImportError as error:
        raise PHControlError(f"a UR arm needs ur_rtde: pip install 'phcontrol[ur]' ({error})") from error
    return rtde_control, rtde_receive


def _scale(name: str, value: ArrayLike) -> list[float]:
    scale = np.broadcast_to(per_joint(name, value, 6), (6,))
    if (scale < 0.0).any() or (scale > 1.0).any():
        raise InvalidArgumentError(name, f"must be 0 to 1, but is {scale.tolist()}")
    return [float(x) for x in scale]


def _check_joints(system: MechanicalSystem) -> None:
    """Raise InvalidArgumentError unless the model's joints are UR's six, in its order."""
    names = system.robot.joint_names
    if len(names) != len(_JOINTS) or any(not name.endswith(own) for name, own in zip(names, _JOINTS, strict=True)):
        raise InvalidArgumentError(
            "system", f"must have the joints {', '.join(_JOINTS)} in this order, but has {', '.join(names)}"
        )
