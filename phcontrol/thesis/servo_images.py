"""Visual servoing of the seven-joint PERA from the pixels of rendered images, at camera rate (needs OpenCV)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.hamiltonian_servo import HamiltonianServo
from phcontrol.controllers.reduction_servo import ReductionServo
from phcontrol.controllers.visual_servo import FEATURE_GOAL
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.camera_sensor import CameraSensor
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome
from phcontrol.vision.extraction import extract_features
from phcontrol.vision.goal_posture import goal_posture
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.rendered_view import RenderedView
from phcontrol.vision.rendering import Image, Renderer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GOAL = np.array(FEATURE_GOAL)  # [m]
CAMERA = PinholeCamera(image_size=(640, 480), field_of_view=np.deg2rad(60.0))
FRONT = np.array([-0.5, 0.6, 0.1, -1.3, 0.0, -1.5, 0.0])  # from here the object is seen as desired [rad]
AWAY = np.array([0.19, 0.32, -0.16, -0.11, 0.32, 0.22, -0.23])  # from there to where the arm starts [rad]
TURN = 0.4  # of the object in the image at the goal [rad]
RATE = 30.0  # [Hz]
BLUR, CORNER_NOISE, GREY_NOISE = 1.0, 1.0, 5.0  # [pixels], [pixels], [of 255]
DURATION, PERIOD = 8.0, 1e-3  # [s]
LAST = 1.0  # over which the result is judged [s]
LAWS: dict[str, type[HamiltonianServo] | type[ReductionServo]] = {
    "hamiltonian": HamiltonianServo,
    "reduction": ReductionServo,
}


def run() -> Outcome:
    """Servo with both laws, from pixels."""
    system = MechanicalSystem(load_robot("pera"))
    camera = CAMERA.mounted_on(system.robot)
    scene = ObservedObject.seen_as(camera, GOAL, system.at(FRONT), turn=TURN)
    logs = {law: servo(system, law, scene) for law in LAWS}
    errors = {law: pixel_errors(system, scene, log) for law, log in logs.items()}
    claims = [
        claim
        for law, (away, longer) in errors.items()
        for claim in (
            Claim(f"centred-{law}", f"the object ends in the middle: largest distance in the last second ({law})",
                  Origin.OURS, "our aim", (2.0,), "pixels", 0.0, [Finding((away,))], "<="),
            Claim(f"length-{law}", f"and as long as desired: largest error in the last second ({law})",
                  Origin.OURS, "our aim", (2.0,), "%", 0.0, [Finding((longer,))], "<="),
        )
    ]  # fmt: skip
    pictures = {law: (_frame(system, scene, log, 0), _frame(system, scene, log, -1)) for law, log in logs.items()}
    width, height = CAMERA.image_size or (0, 0)
    return Outcome(
        "servo-images",
        "visual servoing of the seven-joint arm from rendered images",
        logs,
        claims,
        {"servo-images": lambda: _figure(logs, camera, pictures["hamiltonian"])},
        notes=(
            f"{width} × {height} pixels at {RATE:g} Hz, each frame one frame late; lens blur {BLUR:g} pixel, each "
            f"corner of the box displaced by {CORNER_NOISE:g} pixel and each grey value by {GREY_NOISE:g} of 255 in "
            f"each frame (standard deviations); torques at {1.0 / PERIOD:g} Hz on predicted features.",
            "judged by the images without noise that the camera would take during the last second.",
        ),
    )


def servo(system: MechanicalSystem, law: str, scene: ObservedObject, seed: int = 0) -> Log:
    """Run one law on what is found in rendered images."""
    start = FRONT + AWAY
    goal = goal_posture(system, scene, GOAL, start)
    controller = LAWS[law].tuned(system, GOAL, posture=goal, camera=scene.camera)
    renderer = Renderer(scene, blur=BLUR, corner_noise=CORNER_NOISE, grey_noise=GREY_NOISE)
    return simulate(
        system,
        controller,
        duration=DURATION,
        dt=PERIOD,
        control_period=PERIOD,
        q0=start,
        scene=scene,
        sensors=[CameraSensor(scene, rate=RATE, source=RenderedView(renderer), seed=seed)],
    )


def pixel_errors(system: MechanicalSystem, scene: ObservedObject, log: Log) -> tuple[float, float]:
    """Return how far the object is from the middle [pixels] and its length from the goal [%], at worst at the end."""
    goal = scene.camera.to_pixels(GOAL)
    away, longer = 0.0, 0.0
    for row in np.flatnonzero(log.time >= DURATION - LAST)[:: int(0.1 / PERIOD)]:
        features = extract_features(_frame(system, scene, log, int(row)), scene.camera)
        if features is None:
            return float("inf"), float("inf")
        pixels = scene.camera.to_pixels(features) - goal
        away = max(away, float(np.hypot(pixels[0], pixels[1])))
        longer = max(longer, 100.0 * abs(float(pixels[2])) / float(goal[2]))
    return away, longer


def _frame(system: MechanicalSystem, scene: ObservedObject, log: Log, row: int) -> Image:
    """Return the image that would be taken at a row of a log, without noise."""
    placement = system.at(log.position[row]).placement(str(scene.camera.frame))
    return Renderer(scene, blur=BLUR).render(placement)


def _figure(logs: dict[str, Log], camera: PinholeCamera, pictures: tuple[Image, Image]) -> Figure:
    from matplotlib.figure import Figure

    from phcontrol.visualization.colors import COLORS

    figure = Figure(figsize=(12.0, 6.6), layout="constrained")
    figure.suptitle("The PERA servos from rendered images, 30 Hz, one frame late, noise of one pixel")
    (first, last, path), row = figure.subplots(2, 3)
    for axes, picture, title in ((first, pictures[0], "at the start"), (last, pictures[1], "at the end")):
        axes.imshow(picture[:, :, ::-1])
        axes.set_title(f"what the camera sees {title}", fontsize=10)
    names = ("column [pixels]", "row [pixels]", "length [pixels]")
    goal = camera.to_pixels(GOAL)
    for color, (law, log) in zip(COLORS, logs.items(), strict=False):
        true, shown = (_in_pixels(camera, features) for features in (log.features, log.measured["features"]))
        path.plot(true[:, 0], true[:, 1], color=color, label=law)
        for part, axes in enumerate(row):
            axes.plot(log.time, shown[:, part], color=color, linewidth=0.5, alpha=0.5)
            axes.plot(log.time, true[:, part], color=color, label=law)
            axes.axhline(goal[part], color="black", linewidth=0.5, linestyle=":")
            axes.set(xlabel="t [s]", ylabel=names[part])
            axes.grid(alpha=0.25)
    width, height = camera.image_size or (0, 0)
    path.set(xlim=(0, width), ylim=(height, 0), aspect="equal", xlabel=names[0], ylabel=names[1])
    path.set_title("path of the object in the image", fontsize=10)
    path.grid(alpha=0.25)
    row[0].set_title("true, and (thin) as found and predicted", fontsize=10)
    row[0].legend(fontsize=8)
    return figure


def _in_pixels(camera: PinholeCamera, features: Array) -> Array:
    return np.array([camera.to_pixels(row) for row in features])
