"""The closed loop that a sweep is about, and what a scenario changes of it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, choice, flag, number, per_joint, positive, text, whole_multiple
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.registry import find_law, make_controller
from phcontrol.environments.body import Body
from phcontrol.environments.contact_geometry import JointContact, SphereContact
from phcontrol.environments.disturbances import Disturbance, Pulse, Step, Wrench
from phcontrol.environments.rigid_body import RigidBody
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.mechanics.friction import StribeckFriction
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.payload import Payload
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.sensors.joint_sensor import JointSensor
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.trajectories.minimum_jerk import MinimumJerk

SECTIONS = {
    "arm": ("robot", "locked_joints", "armature", "friction", "payload", "hand"),
    "law": ("name", "goal", "interconnection", "reference", "options"),
    "run": ("duration", "dt", "control_period", "integrator", "torque_limit", "torque_delay", "start"),
    "sensor": ("noise", "bias", "delay", "period"),
    "joint_sensor": (
        "position_noise",
        "position_bias",
        "position_resolution",
        "velocity_noise",
        "velocity_bias",
        "velocity_resolution",
        "delay",
    ),
    "disturbance": ("start", "duration"),
    "contact": ("joint", "position", "side", "frame", "radius", "stiffness", "damping"),
}
"""What describes the nominal loop, and the entries of each part."""
OF_JOINTS = ("position_noise", "position_resolution", "velocity_noise", "velocity_resolution", "joint_delay")
OF_EACH_JOINT = ("position_bias", "velocity_bias")
"""What varies of the joint sensor: one number for all joints, and one for each."""
REFERENCES = ("none", "minimum_jerk")


class Nominal:
    """A closed loop by its description, and the arguments of ``simulate`` for variations of it.

    The law computes with the nominal arm throughout: what a scenario changes of the arm (payload, masses, friction) is
    changed of the plant alone.

    Args:
        description: the parts that ``SECTIONS`` names, as dictionaries.

    Raises what reading the description, loading the arm and making the law raise.
    """

    def __init__(self, description: Mapping[str, Mapping[str, Any]]) -> None:
        parts = {name: checked_section(name, description.get(name, {})) for name in SECTIONS}
        arm, law, self.run = parts["arm"], parts["law"], self._run_of(parts["run"])
        self._sensor, self._disturbance, self._contact = parts["sensor"], parts["disturbance"], parts["contact"]
        self._joint_sensor = parts["joint_sensor"]
        carried = arm.get("payload")
        self._named = text("arm.robot", arm.get("robot"))
        self.robot: Robot = load_robot(
            self._named,
            locked_joints=arm.get("locked_joints", ()),
            armature=arm.get("armature"),
            payload=None if carried is None else Payload(**carried) if isinstance(carried, dict) else Payload(carried),
        )
        friction = arm.get("friction", "robot")
        self._friction = StribeckFriction(**friction) if isinstance(friction, dict) else friction
        self._friction = None if self._friction == "none" else self._friction
        self.system = MechanicalSystem(self.robot, friction=self._friction)
        self.hand = str(arm.get("hand", self.system.hand_frame))
        self.robot.frame_id(self.hand)
        start = parts["run"].get("start")
        self.start: Array = np.array(self.robot.home if start is None else self.robot.position(start, "run.start"))
        self.law = self._law_of(law)
        self._joints = {name: index for index, name in enumerate(self.robot.joint_names)}
        JointSensor(**self._joint_sensor).faults(self.robot.n)

    @property
    def goal(self) -> Array | None:
        """The posture that the law brings the arm to in the end, shape (n,) [rad]; None for a law that has none."""
        return self.law.target_posture(self.run["duration"])

    def arguments(self, values: Mapping[str, float], seed: int = 0) -> dict[str, Any]:
        """Return what ``simulate`` is called with for a scenario.

        Args:
            values: what it changes, by the names of ``VARIABLES``.
            seed: of the sensors' noise.
        """
        start = self._start_with(values)
        return self.run | {
            "system": self._plant(values),
            "controller": self._law_with(values),
            "q0": start,
            "v0": self._per_joint("initial_velocity", values),
            "disturbance": self._disturbed(values),
            "sensors": self._sensors(values, seed),
            "joint_sensor": self._encoders(values, seed),
            "bodies": self._bodies(values),
            "control_period": values.get("control_period", self.run["control_period"]),
            "torque_delay": values.get("torque_delay", self.run["torque_delay"]),
        }

    # --- parts --------------------------------------------------------------------------------------

    def _run_of(self, run: dict[str, Any]) -> dict[str, Any]:
        if "duration" not in run:
            raise InvalidArgumentError("run.duration", "must be given [s]")
        limited = flag("run.torque_limit", run.get("torque_limit", True))
        period, dt = run.get("control_period"), positive("run.dt", run.get("dt", 1e-3))
        late = number("run.torque_delay", run.get("torque_delay", 0.0), minimum=0.0)
        if late:
            whole_multiple("run.torque_delay", late, dt)
        return {
            "duration": positive("run.duration", run["duration"]),
            "dt": dt,
            "torque_delay": late,
            "integrator": choice("integrator", run.get("integrator", "rk4"), INTEGRATORS),
            "control_period": None if period is None else positive("run.control_period", period),
            "torque_limit": "robot" if limited else None,
        }

    def _law_of(self, law: dict[str, Any]) -> Controller:
        name, options = text("law.name", law.get("name")), dict(law.get("options", {}))
        entry, goal = find_law(name, str(Path.cwd())), law.get("goal")
        posture = (
            None if goal is None else self.robot.position(goal, "law.goal") if _is_posture(goal, self.robot) else goal
        )
        if choice("law.reference", law.get("reference", "none"), REFERENCES) == "minimum_jerk":
            if "reference" not in entry.law.parameters:
                raise InvalidArgumentError("law.reference", f"is not for {name}, which takes none")
            end = self.robot.near_home() if posture is None else posture
            options["reference"] = MinimumJerk.within_limits(self.robot, self.start, end)
        form = law.get("interconnection", "coriolis")
        return make_controller(name, self.system, posture, interconnection=form, **options)

    @property
    def files(self) -> dict[str, str]:
        """The SHA-256 of each file of the user's own that the runs depend on: the arm's, and that of a law's module."""
        module = sys.modules.get(type(self.law).__module__)
        own = None if type(self.law).__module__.split(".")[0] == "phcontrol" else getattr(module, "__file__", None)
        found = {"arm": Path(self._named), "law": None if own is None else Path(own)}
        return {
            part: sha256(file.read_bytes()).hexdigest()
            for part, file in found.items()
            if file is not None and file.is_file()
        }

    def _law_with(self, values: Mapping[str, float]) -> Controller:
        changed: dict[str, Any] = {}
        for name, value in values.items():
            head, _, gain = name.partition(".")
            if head == "gain":
                changed[gain] = value
            elif head == "gain_factor":
                changed[gain] = value * np.asarray(getattr(self.law, gain))
        return self.law.changed(**changed) if changed else self.law

    def _plant(self, values: Mapping[str, float]) -> MechanicalSystem:
        names = {name.partition(".")[0] for name in values}
        robot, friction = self.robot, self._friction
        if names & {"mass_factor", "link_mass_factor"}:
            robot = self._scaled(values)
        if "payload_mass" in names:
            com = [values.get(f"payload_{axis}", 0.0) for axis in "xyz"]
            robot = robot.with_payload(Payload(values["payload_mass"], com, frame=self.hand))
        if names & {"friction_factor", "viscous_friction", "coulomb_friction"}:
            friction = self._changed_friction(values)
        if robot is self.robot and friction is self._friction:
            return self.system
        return MechanicalSystem(robot, friction=friction)

    def _scaled(self, values: Mapping[str, float]) -> Robot:
        model, whole = pin.Model(self.robot.model), values.get("mass_factor", 1.0)
        for index in range(1, model.njoints):
            factor = whole * values.get(f"link_mass_factor.{model.names[index]}", 1.0)
            link = model.inertias[index]
            model.inertias[index] = pin.Inertia(factor * link.mass, link.lever, factor * link.inertia)
        return replace(self.robot, model=model)

    def _changed_friction(self, values: Mapping[str, float]) -> StribeckFriction:
        nominal = self.system.friction
        if nominal is None:
            nominal = StribeckFriction()
        if not isinstance(nominal, StribeckFriction):
            raise InvalidArgumentError("friction_factor", f"is for friction of joints, not {type(nominal).__name__}")
        if "viscous_friction" in values or "coulomb_friction" in values:
            dry = values.get("coulomb_friction", nominal.coulomb)
            nominal = StribeckFriction(
                viscous=values.get("viscous_friction", nominal.viscous),
                coulomb=dry,
                static=np.maximum(dry, nominal.static if "coulomb_friction" not in values else dry),
                stribeck_velocity=nominal.stribeck_velocity,
                smoothing=nominal.smoothing,
            )
        return nominal.scaled(values.get("friction_factor", 1.0))

    def _start_with(self, values: Mapping[str, float]) -> Array:
        start: Array = self.start.copy()
        for name, value in values.items():
            head, _, joint = name.partition(".")
            if head == "initial_position":
                start[self._joints[joint]] = value
        start += self._per_joint("initial_offset", values)
        return start

    def _per_joint(self, wanted: str, values: Mapping[str, float]) -> Array:
        found = np.zeros(self.robot.n)
        for name, value in values.items():
            head, _, joint = name.partition(".")
            if head == wanted:
                found[self._joints[joint]] = value
        return found

    def _disturbed(self, values: Mapping[str, float]) -> Disturbance | None:
        torque = self._per_joint("disturbance", values)
        push = np.array([values.get(f"push_{axis}", 0.0) for axis in "xyz"])
        start = values.get("disturbance_start", self._disturbance.get("start", 0.0))
        duration = values.get("disturbance_duration", self._disturbance.get("duration"))
        parts: list[Disturbance] = []
        if any(name.startswith("disturbance.") for name in values):
            parts.append(Step(torque, start) if duration is None else Pulse(torque, start, duration))
        if any(name.startswith("push_") for name in values):
            parts.append(Wrench(self.hand, np.concatenate([push, np.zeros(3)])))
        return None if not parts else parts[0] if len(parts) == 1 else parts[0] + parts[1]

    def _sensors(self, values: Mapping[str, float], seed: int) -> list[ForceSensor] | None:
        chosen = self._sensor | {
            name.removeprefix("sensor_"): value for name, value in values.items() if name.startswith("sensor_")
        }
        return [ForceSensor(**chosen, seed=seed)] if chosen else None

    def _encoders(self, values: Mapping[str, float], seed: int) -> JointSensor | None:
        """Return the joint sensor; None where nothing of it is described, nor varied."""
        heads = {name.partition(".")[0] for name in values}
        if not self._joint_sensor and not heads & {*OF_JOINTS, *OF_EACH_JOINT}:
            return None
        chosen: dict[str, Any] = dict(self._joint_sensor)
        chosen |= {name.replace("joint_delay", "delay"): values[name] for name in OF_JOINTS if name in values}
        for name in OF_EACH_JOINT:
            bias = np.array(per_joint(name, chosen.get(name, 0.0), self.robot.n))
            for joint, index in self._joints.items():
                bias[index] = values.get(f"{name}.{joint}", bias[index])
            chosen[name] = bias
        return JointSensor(**chosen, seed=seed)

    def _bodies(self, values: Mapping[str, float]) -> list[Body]:
        if not self._contact:
            return []
        given = self._contact | {
            name.removeprefix("contact_"): value for name, value in values.items() if name.startswith("contact_")
        }
        position = number("contact.position", given.get("position", 0.0))
        geometry: JointContact | SphereContact
        if "joint" in given:
            geometry = JointContact(given["joint"], position, given.get("side", "below"))
        else:
            frame = given.get("frame", self.hand)
            geometry = SphereContact(frame, given.get("radius", 0.05), "plane", position=(0.0, 0.0, position))
        return [RigidBody(geometry, stiffness=given.get("stiffness", 1e4), damping=given.get("damping", 0.0))]

    def check(self, names: set[str]) -> None:
        """Raise InvalidArgumentError where what is varied changes nothing in this loop."""
        heads = {name.partition(".")[0] for name in names}
        sensed = any(head.startswith("sensor_") for head in heads) or self._sensor
        if sensed and "external_force" not in self.law.needs:
            raise InvalidArgumentError(
                "sensor", f"{self.law.name} is shown no force, so that its noise, bias and delay change nothing: "
                "take a law that needs external_force ('phcontrol controllers')"
            )  # fmt: skip
        of_sampled = ["run.torque_delay"] if self.run["torque_delay"] else []
        of_sampled += ["joint_sensor"] if self._joint_sensor else []
        of_sampled += sorted(heads & {*OF_JOINTS, *OF_EACH_JOINT, "torque_delay"})
        if of_sampled and self.run["control_period"] is None and "control_period" not in heads:
            raise InvalidArgumentError(of_sampled[0], "is of a sampled law: give run.control_period, too")
        touched = sorted(head for head in heads if head.startswith("contact_"))
        if touched and not self._contact:
            raise InvalidArgumentError(touched[0], "needs something to touch: describe it in [contact]")
        placed = sorted(heads & {"payload_x", "payload_y", "payload_z"})
        if placed and "payload_mass" not in heads:
            raise InvalidArgumentError(placed[0], "places a payload: vary payload_mass, too")
        timed = sorted(heads & {"disturbance_start", "disturbance_duration"})
        if timed and "disturbance" not in heads:
            raise InvalidArgumentError(timed[0], "times a disturbance: vary disturbance.JOINT, too")


def checked_section(name: str, given: Any) -> dict[str, Any]:
    """Return a part of a description. Raises UnknownNameError, listing its entries, for one that is not among them."""
    if not isinstance(given, Mapping):
        raise InvalidArgumentError(name, f"must be a table of {', '.join(SECTIONS[name])}, but is {given!r}")
    for key in given:
        if key not in SECTIONS[name]:
            raise UnknownNameError("entry", key, SECTIONS[name], f" of [{name}]")
    return dict(given)


def _is_posture(goal: Any, robot: Robot) -> bool:
    return isinstance(goal, dict) or np.shape(goal) == (robot.n,)
