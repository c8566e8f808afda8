"""See, reach, grasp: a camera in the hand finds an object, the hand goes there, and its fingers hold it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phcontrol._files import write_json
from phcontrol._validation import choice, count, positive
from phcontrol.analysis.certificate import Certificate
from phcontrol.analysis.certify import SAMPLES, certify
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.event_schedule import STOP, EventSchedule, HandOver, Phase, Switch
from phcontrol.controllers.events import Lost, Seen, Settled, Touched
from phcontrol.controllers.force_regulation import ForceRegulation
from phcontrol.controllers.hamiltonian_servo import HamiltonianServo
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.environments.compliant_body import CompliantBody
from phcontrol.environments.grasp_contact import GraspContact
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.pick_reach import way_in_image
from phcontrol.runs.pick_scene import FEATURES, WATCHED, WatchedView, length_of, pick_camera, random_object
from phcontrol.sensors.camera_sensor import CameraSensor
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.trajectories.limits import check_samples
from phcontrol.trajectories.minimum_jerk import MinimumJerk
from phcontrol.vision.interaction import back_project
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROBOT = "pera_with_gripper"
START = (-0.3, 0.8, -0.2, -1.4, 0.2, -1.2, 0.1, 1.0)
"""Where the arm looks from: elbow bent, hand open [rad]."""
FORCE, FORCE_TOLERANCE = 0.5, 0.02
"""With which the fingers shall hold [N·m], and how much of it the mean of the last second may be off."""
TOUCH_ANGLE, PREPARED_ANGLE = 0.38, 0.44
"""Of the gripper where its fingers are as far apart as the object is wide, and a little before [rad]."""
STEP, CAMERA_RATE, FORCE_NOISE = 2e-3, 30.0, 0.005
"""Of simulation and control [s], of the camera [1/s], and of the force sensor [N·m]."""
DURATION = 15.0
"""Simulated time of each pick [s]."""
_STIFFNESS = (150.0, 150.0, 100.0, 100.0, 60.0, 40.0, 40.0, 1.0)  # [N·m/rad]
_REST_STIFFNESS = (150.0, 150.0, 100.0, 100.0, 60.0, 40.0, 40.0, 2.0)  # [N·m/rad]
_DAMPING = (40.0, 40.0, 25.0, 25.0, 10.0, 6.0, 6.0, 1.5)  # [N·m·s/rad]


@dataclass(frozen=True)
class Pick:
    """What came of one object."""

    number: int
    switches: tuple[Switch, ...]
    phase: str
    """The phase at the end."""
    report: str
    """What the schedule says at the end."""
    frames: int
    """Images taken while the arm looked and reached."""
    seen: int
    """Of these, how many showed the object wholly."""
    force: float
    """Mean contact moment of the gripper in the last second [N·m]."""
    distance: float
    """From the grip point to the object at the end [m]."""
    departures: tuple[str, ...]
    """Where the arm left its position, velocity and effort limits."""

    @property
    def in_view(self) -> bool:
        """Whether every image showed the object."""
        return self.frames > 0 and self.seen == self.frames

    @property
    def force_error(self) -> float:
        """How far off the force is, relative."""
        return abs(self.force / FORCE - 1.0)

    @property
    def held(self) -> bool:
        """Whether the object is held, with the force that is asked for."""
        return self.phase == "hold" and self.force_error <= FORCE_TOLERANCE and not self.departures

    def __str__(self) -> str:
        times = ", ".join(f"{switch.entering} {switch.time:.2f}" for switch in self.switches)
        problem = "; ".join([self.report, f"{self.force:.4f} N·m", *self.departures])
        outcome = f"held with {self.force:.4f} N·m" if self.held else f"NOT HELD: {problem}"
        return (
            f"{self.number:>3}  {self.seen:>3} of {self.frames:>3} images  {1e3 * self.distance:5.2f} mm  {outcome}  "
            f"[{times}]"
        )


@dataclass(frozen=True)
class PickRun:
    """What came of all objects."""

    picks: tuple[Pick, ...]
    logs: tuple[Log, ...]
    certificates: tuple[Certificate, ...]
    """Of each law of the schedule but those that just go on."""
    wall_time: float

    @property
    def passed(self) -> bool:
        """Whether all objects were in view and are held, by laws that have their certificates."""
        kept = all(certificate.passed for certificate in self.certificates)
        return kept and all(pick.held and pick.in_view for pick in self.picks)

    @property
    def log(self) -> Log:
        """The first pick's."""
        return self.logs[0]

    def summary(self) -> str:
        """Return what a reader wants to know: a line for each object, and the totals."""
        picks, total = self.picks, len(self.picks)
        held = sum(pick.held for pick in picks)
        worst = max(pick.force_error for pick in picks)
        jumps = [switch.torque_jump for pick in picks for switch in pick.switches]
        lines = [
            f"{total} objects at random poses, seen by {CAMERA_RATE:g} images a second",
            "  no  images that show it    grip point  outcome, and when each phase began [s]",
            *map(str, picks),
            f"in view in every image: {sum(pick.in_view for pick in picks)} of {total}",
            f"held with {FORCE:g} N·m within {100 * FORCE_TOLERANCE:g} %: {held} of {total}, "
            f"worst {100 * worst:.2f} % off",
            f"largest jump of a torque at a switch: {max(jumps, default=0.0):.2g} N·m",
            *(f"{each.controller}: certificate {each.verdict}" for each in self.certificates),
            f"{self.wall_time:.0f} s for {sum(float(log.time[-1]) for log in self.logs):.0f} simulated seconds",
        ]
        return "\n".join(lines)

    def write(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write the first pick's log, a picture, all picks and the certificates; return where."""
        from phcontrol.visualization.plots import save_figure

        folder = Path(directory)
        content = self.to_dict()
        return [
            self.log.save(folder / "log.npz"),
            write_json(folder / "picks.json", content["picks"]),
            write_json(folder / "certificates.json", content["certificates"]),
            save_figure(self.figure(), folder / "pick.png"),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return all picks and certificates, for JSON."""
        picks = [
            pick.__dict__ | {"switches": [switch._asdict() for switch in pick.switches], "held": pick.held}
            for pick in self.picks
        ]
        certificates = [each.to_dict() for each in self.certificates]
        return {"passed": self.passed, "picks": json.loads(json.dumps(picks)), "certificates": certificates}

    def figure(self) -> Figure:
        """Return a picture of all picks: features, grip point's distance, gripper, force."""
        from phcontrol.visualization.pick_figure import pick_figure

        return pick_figure(self.logs, [pick.switches for pick in self.picks], FORCE)


def run_pick(
    *,
    objects: int = 20,
    seed: int = 0,
    duration: float = DURATION,
    camera: PinholeCamera | None = None,
    features: str = FEATURES[0],
    samples: int = SAMPLES,
    progress: bool | None = None,
    watch: Any = None,
) -> PickRun:
    """Pick objects at random poses, one after another, from rendered images.

    The chain: *look*, until the object is seen; *reach*, led within the velocity limits to where the object must then
    be; *servo*, until it is seen as from between the fingers; *close* the hand nearly; *grasp*, until it is touched;
    *hold* it with a force. What does not come in time ends in a stop.

    The object's three features do not say from which side the hand comes.

    Args:
        objects: how many.
        seed: of their poses, and of all noise.
        duration: simulated time of each [s].
        camera: the camera in the hand; by default one with a lens that bends the image.
        features: by what the object is found: "marker" on its face, or "colour".
        samples: states at which each law is certified; 0 for no certificates.
        progress: as in ``simulate``.
        watch: likewise.
    """
    choice("features", features, FEATURES)
    count("objects", objects)
    positive("duration", duration)
    system = MechanicalSystem(load_robot(ROBOT))
    mounted = (pick_camera() if camera is None else camera).mounted_on(system.robot)
    begun = time.perf_counter()
    picks, logs = [], []
    for number in range(1, objects + 1):
        thing = random_object(mounted, system.at(START), np.random.default_rng([seed, number]), features)
        schedule = pick_schedule(system, mounted, length_of(features))
        pick, log = _pick(number, system, schedule, thing, duration, seed, features, progress=progress, watch=watch)
        picks.append(pick)
        logs.append(log)
    wall_time = time.perf_counter() - begun
    laws = _different(schedule.laws) if samples else []
    certificates = tuple(certify(law, system, samples=samples) for law in laws)
    return PickRun(tuple(picks), tuple(logs), certificates, wall_time)


def pick_schedule(system: MechanicalSystem, camera: PinholeCamera, length: float) -> EventSchedule:
    """Return the chain look, reach, servo, close, grasp, hold for an arm with a gripper.

    Args:
        system: the arm, ``pera_with_gripper``.
        camera: in its hand, mounted.
        length: L of what is looked for [m].
    """
    robot = system.robot
    # where the object has to be seen: at the grip point
    grip = robot.placement(str(camera.frame), robot.home).actInv(robot.placement("tool", robot.home).translation)
    goal = camera.focal_length / grip[2] * np.array([grip[0], grip[1], length])

    def seen(at: HandOver) -> ObservedObject:
        """Return what is seen at a hand-over; before anything is, what would be at its goal."""
        features = at.features if at.features[2] > 0.0 else goal
        placement = system.at(at.position).placement(str(camera.frame))
        return ObservedObject(camera, placement.act(back_project(features, camera.focal_length, length)), length=length)

    def reach(at: HandOver) -> Controller:
        return EnergyShaping.tuned(system, reference=way_in_image(system, seen(at), at.desired, goal))

    def servo(at: HandOver) -> Controller:
        options: dict[str, Any] = {"camera": camera, "object_length": length, "lost": "hold"}
        return HamiltonianServo.tuned(system, goal, posture=at.position, **options)

    def close(at: HandOver) -> Controller:
        prepared = np.append(at.position[:-1], min(at.position[-1], PREPARED_ANGLE))
        return EnergyShaping.tuned(
            system, reference=MinimumJerk.within_limits(robot, at.position, prepared, fraction=0.2)
        )

    def grasp(at: HandOver) -> Controller:
        return ImpedanceGrasping(
            system,
            goal=at.desired,
            stiffness=_STIFFNESS,
            rest_stiffness=_REST_STIFFNESS,
            damping=_DAMPING,
            regulation=ForceRegulation(np.append(np.zeros(system.n - 1), FORCE), gain=0.3, rate_limit=0.5),
        )

    lost, touched = (Lost(1.0), STOP), Touched(0.1, "gripper", lasting=0.05)
    return EventSchedule(
        [
            Phase("look", EnergyShaping.tuned(system, START), [(Seen(0.1), "reach")], within=3.0),
            Phase("reach", reach, [(Settled(0.05, position=0.02, lasting=0.1), "servo"), lost], within=12.0),
            Phase("servo", servo, [(Settled(0.02, features=5e-5, lasting=0.2), "close"), lost], within=12.0),
            Phase(
                "close", close, [(Settled(0.05, position=0.02, lasting=0.1), "grasp"), (touched, "grasp")], within=8.0
            ),
            Phase("grasp", grasp, [(touched, "hold")], within=4.0),
            Phase("hold", "grasp"),
        ]
    )


def _pick(
    number: int,
    system: MechanicalSystem,
    schedule: EventSchedule,
    thing: ObservedObject,
    duration: float,
    seed: int,
    features: str,
    **shown: Any,
) -> tuple[Pick, Log]:
    view = WatchedView(thing, features)
    foam = CompliantBody(
        GraspContact("gripper", TOUCH_ANGLE, thing.position, "tool"),
        stiffness=8.0,  # [N·m/rad]
        damping=0.2,  # [N·m·s/rad]
        mass=0.01,  # [kg·m²]
    )
    log = simulate(
        system,
        schedule,
        duration=duration,
        dt=STEP,
        control_period=STEP,
        q0=START,
        scene=thing,
        bodies=[foam],
        sensors=[
            CameraSensor(thing, rate=CAMERA_RATE, source=view, seed=seed + number),
            ForceSensor(noise=FORCE_NOISE, seed=seed + number),
        ],
        **shown,
    )
    switches = tuple(schedule.switches(log.time, log.controller_state))
    end = next((switch.time for switch in switches if switch.entering not in WATCHED), float(log.time[-1]))
    frames = [seen for k, seen in enumerate(view.seen) if k / CAMERA_RATE <= end]
    last = log.time >= log.time[-1] - 1.0
    robot = system.robot
    tool = robot.placement("tool", log.position[-1]).translation
    state = log.controller_state[-1]
    return (
        Pick(
            number,
            switches,
            schedule.phase(state),
            schedule.report(state),
            len(frames),
            sum(frames),
            float(log.contact_force[last].mean()),
            float(np.linalg.norm(tool - thing.position)),
            tuple(map(str, check_samples(robot, log.time, log.position, log.velocity, log.torque).violations)),
        ),
        log,
    )


def _different(laws: Sequence[Controller]) -> list[Controller]:
    """Return a law of each kind."""
    return list({law.name: law for law in reversed(laws)}.values())[::-1]
