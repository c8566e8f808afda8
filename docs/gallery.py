"""The pictures of the gallery: one function each, whose code stands beside its picture on the page.

    python docs/gallery.py [NAME ...]     # writes docs/gallery/NAME.png; without names, all of them

A function returns a figure; its docstring is the caption.
"""

# ruff: noqa: RUF005

from __future__ import annotations

import inspect
import io
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import phcontrol as ph
from phcontrol.visualization.colors import COLORS, INK

FOLDER = Path(__file__).parent / "gallery"
STYLE = {
    "axes.prop_cycle": mpl.cycler(color=COLORS),
    "axes.edgecolor": INK, "axes.grid": True, "axes.titlecolor": INK, "axes.titlesize": 10, "grid.alpha": 0.25,
    "legend.frameon": False, "legend.fontsize": 8, "figure.figsize": (6.4, 3.4), "figure.constrained_layout.use": True,
}  # fmt: skip
FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
GOAL = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]


def one_run() -> Figure:
    """A run on one page: the arm from the side and from above with its goal, joints, errors, torques and energies."""
    system = ph.MechanicalSystem(ph.load_robot("ur5"))
    goal = system.robot.near_home()
    way = ph.MinimumJerk.within_limits(system.robot, system.robot.home, goal)
    law = ph.make_controller("force_feedback", system, reference=way)
    return ph.simulate(system, law, duration=4.0).plot()


def positions() -> Figure:
    """Joint positions of the PERA under energy shaping; dashed, where they should be."""
    system = ph.MechanicalSystem(ph.load_robot("pera"))
    law = ph.EnergyShaping.tuned(system, GOAL)
    return ph.simulate(system, law, duration=4.0).plot.position().figure


def energies() -> Figure:
    """The storage function of the same loop never grows: it is a Lyapunov function of the closed loop."""
    system = ph.MechanicalSystem(ph.load_robot("pera"))
    law = ph.EnergyShaping.tuned(system, GOAL)
    return ph.simulate(system, law, duration=4.0).plot.energy().figure


def torques() -> Figure:
    """Torques of the Panda's motors over their limits, along a minimum-jerk motion."""
    system = ph.MechanicalSystem(ph.load_robot("panda", locked_joints=FINGERS, armature=0.1))
    way = ph.MinimumJerk.within_limits(system.robot, system.robot.home, system.robot.near_home())
    law = ph.make_controller("force_feedback", system, reference=way)
    return ph.simulate(system, law, duration=3.0).plot.torque(limits=True).figure


def under_a_load() -> Figure:
    """One constant load, three laws: a spring gives way; modeled forces fed back, and integral action, take it up."""
    system = ph.MechanicalSystem(ph.load_robot("pera_shoulder"))
    figure, axes = plt.subplots()
    for name in ("energy_shaping", "force_feedback", "integral_action"):
        law = ph.make_controller(name, system, [0.3, 0.2])
        log = ph.simulate(system, law, duration=8.0, q0=[0.3, 0.2], disturbance=ph.Step([2.0, 0.0], start=1.0))
        axes.plot(log.time, log.position[:, 0] - 0.3, label=name.replace("_", " "))
    axes.set(xlabel="t [s]", ylabel="q₁ − q_d,₁ [rad]", title="2 N·m from 1 s on")
    axes.legend()
    return figure


def compared() -> Figure:
    """Two stiffnesses, laid over each other by `compare`."""
    system = ph.MechanicalSystem(ph.load_robot("pera_shoulder"))
    laws = {k: ph.EnergyShaping(system, goal=[0.3, 0.2], stiffness=k, damping=4.0) for k in (10.0, 40.0)}
    logs = {f"{k:g} N·m/rad": ph.simulate(system, law, duration=3.0) for k, law in laws.items()}
    return ph.compare(logs)


def held_torque() -> Figure:
    """Tracking with a torque that is held for 2 ms: compensated for with `hold`, the error is smaller by far."""
    system = ph.MechanicalSystem(ph.load_robot("pera"))
    swing = ph.Sinusoid(0.3 * np.ones(7), 0.4 * np.ones(7), offset=system.robot.home)
    start = swing.at(0.0)
    figure, axes = plt.subplots()
    for hold, label in ((0.0, "as in continuous time"), (2e-3, "hold=2 ms")):
        law = ph.TrajectoryTracking.tuned(system, trajectory=swing, hold=hold)
        log = ph.simulate(system, law, duration=3.0, q0=start.position, v0=start.velocity, control_period=2e-3)
        desired = np.array([swing.at(t).position for t in log.time])
        axes.semilogy(log.time, np.maximum(np.abs(log.position - desired).max(axis=1), 1e-12), label=label)
    axes.set(xlabel="t [s]", ylabel="largest |q − q_d| [rad]", title="a torque held for 2 ms")
    axes.legend()
    return figure


def modes() -> Figure:
    """The linear view of integral action on the UR5: its modes, step and frequency responses, and gain."""
    from phcontrol.visualization.linear_plots import linear_figure

    system = ph.MechanicalSystem(ph.load_robot("ur5"))
    return linear_figure(ph.linearize(ph.IntegralAction.tuned(system), system), "integral action on the UR5")


def pressing() -> Figure:
    """Force control: the gripper approaches a ball at a limited speed and presses with the force that it should."""
    gripper = ph.MechanicalSystem(ph.load_robot("pera_gripper"))
    ball = ph.RigidBody(ph.JointContact("gripper", 0.20), stiffness=20.0, damping=0.5)
    law = ph.ForceControl(gripper, force=[3.5], damping=5.0, coupling=1.0, force_gain=1.0, approach_speed=0.2)
    log = ph.simulate(gripper, law, duration=4.0, dt=2e-3, bodies=[ball])
    figure, axes = plt.subplots()
    axes.plot(log.time, log.contact_force, label="contact force")
    axes.axhline(3.5, linestyle="--", color=COLORS[1], label="desired")
    axes.set(xlabel="t [s]", ylabel="force [N·m]", title="a gripper finds a ball and presses")
    axes.legend()
    return figure


def pushed_hand() -> Figure:
    """Cartesian impedance: a push of 12 N on the hand of a Panda moves it by 12/600 m, and it comes back."""
    system = ph.MechanicalSystem(ph.load_robot("panda", locked_joints=FINGERS))
    law = ph.CartesianImpedance.tuned(system, translational_stiffness=600.0, rotational_stiffness=30.0)
    frame = system.hand_frame
    push = ph.Wrench(frame, lambda t: np.array([0.0, 0.0, -12.0 if 1.0 < t < 3.0 else 0.0, 0.0, 0.0, 0.0]))
    log = ph.simulate(system, law, duration=5.0, dt=2e-3, q0=system.robot.near_home(), disturbance=push)
    hand = log.frame(frame).position
    figure, axes = plt.subplots()
    axes.plot(log.time, 1e3 * (hand - hand[0]), label=["x", "y", "z"])
    axes.axhline(-20.0, linestyle="--", linewidth=0.9, color=INK, label="12 N / 600 N/m")
    axes.set(xlabel="t [s]", ylabel="hand [mm]", title="12 N downwards from 1 s to 3 s")
    axes.legend(ncols=4)
    return figure


def figure_of_eight() -> Figure:
    """The hand of a Panda along a figure of eight, by a spring and a damper on its pose."""
    system = ph.MechanicalSystem(ph.load_robot("panda", locked_joints=FINGERS))
    law = ph.CartesianTracking.tuned(system)
    log = ph.simulate(system, law, duration=6.0, dt=2e-3, q0=system.robot.near_home())
    hand = log.frame(system.hand_frame).position
    desired = np.array([law.path.at(t).position for t in log.time])
    figure, axes = plt.subplots(figsize=(6.4, 3.8))
    axes.plot(hand[:, 1], hand[:, 2], label="hand")
    axes.plot(desired[:, 1], desired[:, 2], "--", linewidth=1.0, color=INK, label="desired")
    axes.set(xlabel="y [m]", ylabel="z [m]", title="a figure of eight", aspect="equal")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def wiped_table() -> Figure:
    """Wiping: the hand presses on a table with 10 N along its normal, while a path leads it across against friction."""
    system = ph.MechanicalSystem(ph.load_robot("panda", locked_joints=FINGERS))
    frame, start = system.hand_frame, np.array([-0.3, 0.35, 0.0, -2.0, 0.0, 2.35, 0.5])
    hand = system.at(start).placement(frame)
    end = ph.Pose(hand.translation + [0.0, 0.3, 0.0], hand.rotation)
    law = ph.CartesianTracking(
        system,
        path=ph.FrameLine(frame, hand, end, 4.0, start=1.0),
        translational_stiffness=1500.0,
        rotational_stiffness=60.0,
        free_direction=(0.0, 0.0, 1.0),
        wrench=(0.0, 0.0, -10.0, 0.0, 0.0, 0.0),
    )
    place = ph.SphereContact(frame, 0.01, "plane", position=(0.0, 0.0, hand.translation[2] - 0.0105))
    table = ph.RigidBody(place, stiffness=2e4, damping=200.0, friction=0.4)
    log = ph.simulate(system, law, duration=5.5, q0=start, bodies=[table])
    motion = log.frame(frame)
    figure, axes = plt.subplots()
    axes.plot(log.time, log.contact_force, label="pressing")
    axes.plot(log.time, -motion.wrench[:, 1], label="friction along the way")
    axes.set(xlabel="t [s]", ylabel="force [N]", title="10 N on a table, friction 0.4", ylim=(-1.0, 14.0))
    axes.legend(ncols=2)
    return figure


def inside_the_limits() -> Figure:
    """A goal outside the limits, with and without the torque filter: the fastest joint, over its velocity limit."""
    system = ph.MechanicalSystem(ph.load_robot("pera"))
    law = ph.EnergyShaping.tuned(system, system.robot.upper + 0.1)
    limits = ph.Limits(system, position_margin=0.01, velocity_margin=0.1)
    figure, axes = plt.subplots()
    for guard, label in ((None, "without"), (ph.TorqueFilter(system, period=1e-3, limits=limits), "with the filter")):
        log = ph.simulate(system, law, duration=0.6, control_period=1e-3, torque_filter=guard)
        axes.plot(log.time, (np.abs(log.velocity) / system.robot.velocity_limit).max(axis=1), label=label)
    axes.axhline(1.0, linestyle="--", color=COLORS[1], linewidth=0.9)
    axes.set(xlabel="t [s]", ylabel="fastest joint / its limit", title="towards a goal outside the limits")
    axes.legend()
    return figure


def energy_tank() -> Figure:
    """A posture that an energy tank pays for: the tank's level while the arm moves within the hand's null space."""
    system = ph.MechanicalSystem(ph.load_robot("panda", locked_joints=FINGERS))
    law = ph.CartesianImpedance.tuned(system, translational_stiffness=600.0, rotational_stiffness=30.0, posture="tank")
    elbow = ph.Step([0.0, 0.0, 6.0, 0.0, 0.0, 0.0, 0.0], start=1.0) + ph.Step([0.0, 0.0, -6.0, 0.0, 0.0, 0.0, 0.0], 2.0)
    log = ph.simulate(system, law, duration=4.0, dt=2e-3, q0=system.robot.near_home(), disturbance=elbow)
    figure, axes = plt.subplots()
    axes.plot(log.time, log.tank_level)
    axes.set(xlabel="t [s]", ylabel="level [J]", title="the tank, while someone turns the elbow for a second")
    return figure


def image_servo() -> Figure:
    """What a camera in the hand sees: the object goes to the middle of the image, from 30 frames a second."""
    system = ph.MechanicalSystem(ph.load_robot("pera"))
    camera = ph.PinholeCamera(image_size=(640, 480), field_of_view=np.pi / 2)
    thing = ph.ObservedObject.seen_as(camera, [0.004, 0.003, 0.0028], system.at(system.robot.home))
    servo = ph.HamiltonianServo.tuned(system, [0.0, 0.0, 0.002], camera=camera)
    sensor = ph.CameraSensor(thing, rate=30.0, noise=2e-5)
    log = ph.simulate(system, servo, duration=6.0, dt=2e-3, scene=thing, sensors=[sensor])
    pixels = np.array([camera.to_pixels(features) for features in log.features])
    figure, axes = plt.subplots(figsize=(5.2, 3.6))
    axes.plot(pixels[:, 0], pixels[:, 1])
    axes.plot(*pixels[0, :2], "o", color=INK, label="at first")
    axes.plot(*camera.to_pixels(servo.goal)[:2], "x", color=COLORS[1], label="desired")
    axes.set(xlim=(0, 640), ylim=(480, 0), xlabel="column", ylabel="row", title="in the image", aspect="equal")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def rendered_image() -> Figure:
    """An image as the camera in the PERA's hand takes it: rendered, with a lens and noise; features come from it."""
    system = ph.MechanicalSystem(ph.load_robot("pera"))
    x = system.at(system.robot.home)
    camera = ph.PinholeCamera(image_size=(320, 240), field_of_view=1.2).mounted_on(system.robot)
    thing = ph.ObservedObject.seen_as(camera, [0.002, 0.001, 0.003], x)
    image = ph.Renderer(thing, corner_noise=0.5, grey_noise=4.0).render(
        x.placement(camera.frame), np.random.default_rng(0)
    )
    column, row, length = camera.to_pixels(ph.extract_features(image, camera))
    figure, axes = plt.subplots(figsize=(4.6, 3.5))
    axes.imshow(image[:, :, ::-1])
    axes.plot([column - length / 2, column + length / 2], [row, row], color=COLORS[0], linewidth=2)
    axes.set_axis_off()
    axes.set_title("found: where it is and how long")
    return figure


def observed_force() -> Figure:
    """A momentum observer sees a push on the arm without a force sensor."""
    system = ph.MechanicalSystem(ph.load_robot("ur5"))
    law = ph.make_controller("force_feedback_measured", system)
    push = ph.Pulse([0.0, 20.0, 0.0, 0.0, 0.0, 0.0], start=0.5, duration=0.5)
    observer = ph.MomentumObserver(system, gain=30.0)
    log = ph.simulate(system, law, duration=1.5, q0=law.goal, disturbance=push, sensors=[observer])
    figure, axes = plt.subplots()
    axes.plot(log.time, log.external_force[:, 1], "--", color=INK, label="true")
    axes.plot(log.time, log.measured["external_force"][:, 1], label="observed, 30 1/s")
    axes.set(xlabel="t [s]", ylabel="f_e of the shoulder [N·m]", title="a push of half a second")
    axes.legend()
    return figure


def identified() -> Figure:
    """Friction found from a log of an exciting motion: measured torques, and those that the model predicts."""
    from phcontrol.visualization.identification_figure import identification_figure

    robot = ph.load_robot("pera_shoulder")
    plant = ph.MechanicalSystem(robot, friction=ph.StribeckFriction(viscous=[1.5, 0.8], coulomb=[0.4, 0.3]))
    motion = ph.exciting_trajectory(robot, what=("viscous", "coulomb"), duration=8.0, candidates=20)
    law = ph.TrajectoryTracking.tuned(ph.MechanicalSystem(robot), trajectory=motion)
    log = ph.simulate(plant, law, q0=motion.at(0.0).position, duration=8.0, dt=2e-3)
    return identification_figure(ph.identify(log, ("viscous", "coulomb"), model=robot))


def integrators() -> Figure:
    """How far the power balance, taken from the samples, is from closing, by integrator and step: slopes are orders."""
    system = ph.MechanicalSystem(ph.load_robot("pera_shoulder"), friction=None)
    law = ph.EnergyShaping(system, goal=[0.3, 0.2], stiffness=20.0, damping=2.0)
    steps = (1e-3, 2e-3, 5e-3, 1e-2)
    figure, axes = plt.subplots()
    for name, line in (
        ("semi_implicit_euler", "o-"),
        ("implicit_midpoint", "o-"),
        ("rk4", "o-"),
        ("discrete_gradient", "x:"),
    ):
        logs = [ph.simulate(system, law, duration=1.0, dt=h, q0=[0.0, 0.0], integrator=name) for h in steps]
        axes.loglog(steps, [abs(log.power_balance("plant").energy_drift) for log in logs], line, label=name)
    axes.set(xlabel="step [s]", ylabel="energy that does not balance [J]", title="power balance of the plant")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def changing_goal() -> Figure:
    """A goal that is changed twice while the arm runs: the course to it is jerk-limited, so that H_d never jumps."""
    arm = ph.MechanicalSystem(ph.load_robot("pera_shoulder"))
    goal = ph.LiveTrajectory(arm.robot, [0.0, 0.0])
    law = ph.EnergyShaping.tuned(arm, reference=goal)
    setpoint = ph.Setpoint(goal=goal)
    setpoint.change(goal=[0.4, 0.2], at=0.5)
    setpoint.change(goal=[-0.2, 0.3], at=1.2)
    log = ph.simulate(arm, law, duration=4.0, q0=[0.0, 0.0], setpoint=setpoint)
    return log.plot.position().figure


PICTURES: dict[str, Callable[[], Figure]] = {
    name: value
    for name, value in list(globals().items())
    if inspect.isfunction(value) and value.__module__ == __name__ and not name.startswith("_")
}
"""Every picture by its name, in the order of the page."""


def _write(figure: Figure, path: Path) -> int:
    """Write a figure as a small PNG, with a palette of 128 colours; return its size in bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100, bbox_inches="tight", pad_inches=0.05)
    plt.close(figure)
    image = Image.open(buffer).convert("RGB").quantize(128, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    path.parent.mkdir(exist_ok=True)
    image.save(path, optimize=True)
    return path.stat().st_size


def main(names: list[str]) -> None:
    """Make pictures and say how large they are."""
    total = 0
    with mpl.rc_context(STYLE):
        for name in names or PICTURES:
            size = _write(PICTURES[name](), FOLDER / f"{name}.png")
            total += size
            print(f"{size / 1e3:7.1f} kB  {name}", flush=True)
    print(f"{total / 1e3:7.1f} kB  in all")


if __name__ == "__main__":
    main(sys.argv[1:])
