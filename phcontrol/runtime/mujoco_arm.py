"""An arm in MuJoCo: another plant than phcontrol's own, with contacts and friction, behind the same driver."""

from __future__ import annotations

import copy
import os
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, flag, positive, real_array, vector, whole_multiple
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.mujoco_file import compiled, load_mujoco
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.runtime.arm_driver import Pace, Reading
from phcontrol.runtime.control_loop import GRAVITY, Gravity
from phcontrol.runtime.mujoco_model import addresses, model_of_urdf, silence_actuators
from phcontrol.safety.clipping import clipped
from phcontrol.sensors.measured import Measured

_MOST_SUBSTEPS = 10_000  # of MuJoCo in a period
Integrator = Literal["Euler", "RK4", "implicit", "implicitfast"]


class MujocoArm:
    """A driver whose arm is a MuJoCo model; each ``write`` lets one period pass.

        arm = MujocoArm(system, "scene.xml")
        loop = ControlLoop(system, law, arm.period, clock=lambda: arm.time)
        drive(loop, arm, 5.0)

    The model of the law (``system``) and the plant have nothing in common but the joints' names, by which they are put
    together: masses, friction, contacts, and what else stands in the scene are MuJoCo's. Torques act on the joints,
    clipped to the robot's effort; the MJCF's own actuators of these joints are switched off, others are left alone.
    ``model`` and ``data`` are MuJoCo's own objects, to look at and to push at (``data.xfrc_applied``).

    Readings are exact. The external force is that of MuJoCo's contacts and of ``xfrc_applied`` in the last step:
    𝒥ᵀF, without joint limits and friction. While the process stands still so does the plant's time: there is nothing
    for a watchdog to do.

    Args:
        system: the model of the arm, for the names of its joints and their effort limits.
        model: an MJCF file, or an MjModel; None for what MuJoCo reads in the robot's URDF
            (``mujoco_model.model_of_urdf``).
        period: of the loop [s], a whole multiple of MuJoCo's time step.
        step: MuJoCo's time step [s]; by default that of the MJCF file, and one period where that is longer, or for a
            URDF.
        integrator: MuJoCo's; by default that of the MJCF file, and RK4 for a URDF.
        position: at the start [rad]; by default home.
        gravity: "controller", or "robot" for an arm that adds its weight itself, as MuJoCo computes it.
        friction: whether a plant of a URDF has the system's friction.
        contacts: whether a plant of a URDF has its simple collision shapes.

    Raises:
        PHControlError: MuJoCo is not installed.
        RobotDescriptionError: MuJoCo cannot read the file.
        InvalidArgumentError: the joints are not those of the robot.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, MujocoArm, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"), friction=None)
        >>> arm = MujocoArm(system, period=1e-3)
        >>> arm.write(system.at(arm.read().position).potential_gradient)  # [N·m]: its weight
        >>> bool(np.abs(arm.read().velocity).max() < 1e-6)
        True
    """

    pace: Pace = "write"

    def __init__(
        self,
        system: MechanicalSystem,
        model: str | os.PathLike[str] | Any | None = None,
        *,
        period: float = 1e-3,
        step: float | None = None,
        integrator: Integrator | None = None,
        position: ArrayLike | None = None,
        gravity: Gravity = "controller",
        friction: bool = True,
        contacts: bool = False,
    ) -> None:
        check_system(system)
        self._mujoco = mujoco = load_mujoco()
        self.system, self.period = system, positive("period", period)
        chosen: Any = choice("gravity", gravity, GRAVITY)
        self.gravity: Gravity = chosen
        flag("friction", friction)
        flag("contacts", contacts)
        if model is None:
            self.model = model_of_urdf(system, friction=friction, contacts=contacts)
            step = self.period if step is None else step
        else:
            # a copy: steps and actuators are set on it
            self.model = _of_mujoco(model)
            if step is None:
                step = min(float(self.model.opt.timestep), self.period)
        if step is not None:
            self.model.opt.timestep = positive("step", step)
        if integrator is not None:
            kinds = {kind: getattr(mujoco.mjtIntegrator, f"mjINT_{kind.upper()}") for kind in _integrators()}
            self.model.opt.integrator = kinds[choice("integrator", integrator, kinds)]
        self._substeps = whole_multiple("period", self.period, float(self.model.opt.timestep))
        if self._substeps > _MOST_SUBSTEPS:
            raise InvalidArgumentError(
                "step", f"makes {self._substeps} steps of each period, which never ends; at most {_MOST_SUBSTEPS} are"
            )
        self._places, self._freedoms = addresses(self.model, system)
        silence_actuators(self.model, self._freedoms)
        self.data = mujoco.MjData(self.model)
        self._still = mujoco.MjData(self.model)
        self._weight = np.zeros(self.model.nv)
        self._pull = np.zeros(self.model.nv)
        self._sent = np.zeros(system.n)
        self.reset(position)

    def __repr__(self) -> str:
        return f"<MujocoArm of {self.system.robot.name}, every {self.period:g} s>"

    def reset(self, position: ArrayLike | None = None) -> None:
        """Start again at rest, at a position [rad]; by default home. Other joints are where the MJCF has them."""
        start = self.system.robot.home if position is None else position
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self._places] = vector("position", start, self.system.n)
        self._mujoco.mj_forward(self.model, self.data)
        self._periods = 0
        self._sent = self._own_weight() if self.gravity == "controller" else np.zeros(self.system.n)

    @property
    def time(self) -> float:
        """The plant's time [s]."""
        return self._periods * self.period

    def read(self) -> Reading:
        """Return what the sensors show now: position, velocity, external force, and the torque sent before."""
        data = self.data
        return Reading(
            np.array(data.qpos[self._places]),
            np.array(data.qvel[self._freedoms]),
            Measured(external_force=self._external_force()),
            torque=self._sent.copy(),
        )

    def write(self, torque: Array) -> None:
        """Apply a torque, and let one period pass. Raises PHControlError when MuJoCo's plant diverges."""
        finite = real_array(torque, (self.system.n,))
        if finite is None:
            raise PHControlError(f"the torque is not {self.system.n} finite numbers: {torque!r}")
        self._sent, data, limit = finite, self.data, self.system.robot.effort_limit
        for _ in range(self._substeps):
            carried = finite if self.gravity == "controller" else finite + self._own_weight()
            data.qfrc_applied[self._freedoms] = clipped(carried, -limit, limit)
            self._mujoco.mj_step(self.model, data)
        self._periods += 1
        if not np.isfinite(data.qpos).all():
            raise PHControlError(f"MuJoCo's plant diverged at t = {self.time:g} s: a smaller step, or lower gains")

    def _own_weight(self) -> Array:
        """Return the torque that holds the arm where it is, shape (n,) [N·m]."""
        still = self._still
        still.qpos[:], still.qvel[:] = self.data.qpos, 0.0
        self._mujoco.mj_fwdPosition(self.model, still)
        self._mujoco.mj_rne(self.model, still, 0, self._weight)
        return np.array(self._weight[self._freedoms])

    def _external_force(self) -> Array:
        """Return 𝒥ᵀF of contacts and of what pushes at bodies, shape (n,) [N·m]."""
        mujoco, model, data = self._mujoco, self.model, self.data
        self._pull[:] = 0.0
        if data.ncon:
            kinds, force = data.efc_type, np.array(data.efc_force)
            force[~np.isin(kinds, _contact_kinds(mujoco))] = 0.0
            mujoco.mj_mulJacTVec(model, data, self._pull, force)
        for body in np.flatnonzero(data.xfrc_applied.any(axis=1)):
            push = data.xfrc_applied[body]
            mujoco.mj_applyFT(model, data, push[:3], push[3:], data.xipos[body], int(body), self._pull)
        return np.array(self._pull[self._freedoms])


def _of_mujoco(model: Any) -> Any:
    """Return the MjModel of a file, or a copy of an MjModel. Raises InvalidArgumentError for anything else."""
    if isinstance(model, (str, os.PathLike)):
        return compiled(model, os.fspath(model))
    if not isinstance(model, load_mujoco().MjModel):
        raise InvalidArgumentError(
            "model", f"must be the path of an MJCF file, a mujoco.MjModel or None, but is {type(model).__name__}"
        )
    return copy.copy(model)


def _integrators() -> tuple[str, ...]:
    return "Euler", "RK4", "implicit", "implicitfast"


def _contact_kinds(mujoco: Any) -> list[int]:
    names = ("CONTACT_FRICTIONLESS", "CONTACT_PYRAMIDAL", "CONTACT_ELLIPTIC")
    return [int(getattr(mujoco.mjtConstraint, f"mjCNSTR_{name}")) for name in names]
