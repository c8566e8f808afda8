"""An arm brings an object to where it should be in its camera's image: the first thing to try with a camera."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import positive, vector
from phcontrol.analysis.certify import SAMPLES, certify
from phcontrol.controllers.registry import CONTROLLERS, find_law
from phcontrol.controllers.visual_servo import FEATURE_GOAL, OBJECT_LENGTH
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.position import PositionRun
from phcontrol.sensors.camera_sensor import CameraSensor
from phcontrol.simulation.closed_loop import simulate
from phcontrol.vision.goal_posture import goal_posture
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera

if TYPE_CHECKING:
    from matplotlib.figure import Figure

START = (0.004, 0.003, 0.0028)
"""Where an object is in the image at home, by default [m]."""


class ServoRun(PositionRun):
    """What came of the run; ``goal`` is τ_d [m]."""

    picture = "servo.png"

    @property
    def final_error(self) -> float:
        """Largest error of a feature at the end [m]."""
        return float(np.abs(self.log.features[-1] - self.goal).max())

    @property
    def outcome(self) -> str:
        """Return what is left of the error at the end, in words."""
        return f"{1e3 * self.final_error:.2e} mm on the image plane (largest error of a feature)"

    def figure(self, title: str) -> Figure:
        """Return a picture of the run."""
        from phcontrol.visualization.plots import servo_figure

        return servo_figure(self.log, self.goal, title)


def run_servo(
    system: MechanicalSystem,
    *,
    controller: str = "hamiltonian_servo",
    start: ArrayLike = START,
    goal: ArrayLike = FEATURE_GOAL,
    interconnection: str = "coriolis",
    samples: int = SAMPLES,
    seed: int = 0,
    camera_rate: float | None = None,
    options: dict[str, Any] | None = None,
    **simulation: Any,
) -> ServoRun:
    """Put an object where it is seen with the features ``start`` from the arm's home, servo, and certify the law.

    The posture that the law refers to is computed from what is seen at the start, unless ``options`` names one.

    Args:
        system: the arm.
        controller: "reduction_servo" or "hamiltonian_servo".
        start: features (μ, ν, l) at home [m].
        goal: τ_d [m].
        interconnection: "coriolis" or "canonical".
        samples: states at which the law is certified.
        seed: of these states.
        camera_rate: frames in a second [Hz], each one frame late, with features predicted in between; None for
            features at every instant.
        options: gains of the law, replacing the defaults.
        simulation: passed on to ``simulate``.
    """
    law_type = find_law(controller).law
    if law_type.run != "servo":
        servos = [name for name, entry in CONTROLLERS.items() if entry.law.run == "servo"]
        raise UnknownNameError("servo law", controller, servos)
    chosen = dict(options or {})
    camera = chosen.get("camera") or PinholeCamera()
    camera = camera.mounted_on(system.robot, chosen.get("frame"))
    length = positive("object_length", chosen.get("object_length", OBJECT_LENGTH))
    first = vector("start", start, 3)
    if first[2] <= 0.0:
        raise InvalidArgumentError("start", f"must have a length l > 0, of an object in front of the camera: {first}")
    size = (length, 0.2 * length, 0.25 * length)
    scene = ObservedObject.seen_as(camera, first, system.at(system.robot.home), size)
    if "posture" not in chosen:
        chosen["posture"] = goal_posture(system, scene, goal)
    law = law_type.tuned(system, goal, interconnection=interconnection, **chosen)
    sensors = None if camera_rate is None else [CameraSensor(scene, rate=camera_rate)]
    begun = time.perf_counter()
    log = simulate(system, law, scene=scene, sensors=sensors, **simulation)
    wall_time = time.perf_counter() - begun
    return ServoRun(
        log,
        certify(law, system, samples=samples, seed=seed, log=log),
        law.check_goal(system, goal),
        wall_time,
        system.robot,
    )
