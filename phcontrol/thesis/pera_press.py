"""The seven-joint PERA presses a wall with 10 N, soft to hard, with the force measured and observed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import sqrtm

from phcontrol._validation import Array
from phcontrol.controllers.force_control import ForceControl
from phcontrol.environments.contact_geometry import SphereContact
from phcontrol.environments.rigid_body import RigidBody
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.holding import Holding
from phcontrol.sensors.momentum_observer import MomentumObserver
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.measures import settling_time
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORCE = 10.0  # [N]
STIFFNESSES = (1e3, 1e4, 1e5)  # of the wall [N/m]
POSTURE = np.array([-1.01, -1.09, -0.17, -0.68, 0.38, -1.48, 0.23])  # [rad]; little mass is felt along the normal
NORMAL = np.array([-1.0, 0.0, 0.0])  # of the wall, towards the arm
WALL = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # its frame: z along the normal
RADIUS = 0.01  # of the fingertip [m]
HOLD = {"tangential_stiffness": 1e5, "rotational_stiffness": 2000.0, "joint_stiffness": 5000.0}  # [N/m], [N·m/rad]
ELBOW = "elbow_roll"
AMPLIFICATION, DAMPING_RATIO = 0.25, 1.75  # A K_z Aᵀ and C relative to modal frequency; see modal_damping
OBSERVER_GAIN = 300.0  # [1/s]
DURATION, DT = 2.0, 1e-3


def run() -> Outcome:
    """Press three walls with f_e measured and three with the momentum observer; once more with the arm's friction."""
    compensated = MechanicalSystem(load_robot("pera"), friction=None)
    logs = {}
    for stiffness in STIFFNESSES:
        logs[f"measured-{stiffness:g}"] = press(compensated, stiffness)
        logs[f"observed-{stiffness:g}"] = press(compensated, stiffness, observed=True)
    with_friction = MechanicalSystem(load_robot("pera"))
    logs["friction-1000"] = press(with_friction, STIFFNESSES[0])
    return Outcome(
        "pera-press",
        "the seven-joint arm presses a wall with 10 N",
        logs,
        _claims(logs),
        {"pera-press": lambda: _figure(logs)},
        notes=(
            "joint friction is taken as compensated (absent from plant and model); with the PERA's own, not "
            f"compensated, the force error after 1 s on the softest wall is {_error(logs['friction-1000']):.2g} N.",
            "what the observer costs: the error after 1 s is "
            + ", ".join(f"{_error(logs[f'observed-{k:g}']):.1e} N (k = {k:g} N/m)" for k in STIFFNESSES)
            + ", and the peak force at first touch is higher, "
            + ", ".join(
                f"{_peak(logs[f'observed-{k:g}']):.1f} for {_peak(logs[f'measured-{k:g}']):.1f} N" for k in STIFFNESSES
            )
            + ".",
        ),
    )


def press(system: MechanicalSystem, stiffness: float, *, observed: bool = False) -> Log:
    """Press one wall, from first touch at rest."""
    x = system.at(POSTURE)
    tip = x.placement("tool").translation
    contact = SphereContact("tool", RADIUS, "plane", position=tip - RADIUS * NORMAL, rotation=WALL)
    wall = RigidBody(contact, stiffness=stiffness, damping=0.2 * np.sqrt(0.9 * stiffness), onset=1e-5)
    controller = ForceControl(
        system,
        force=FORCE * NORMAL,
        frame="tool",
        damping=modal_damping(x),
        coupling=np.sqrt(AMPLIFICATION),
        force_gain=1.0,
        holding=[Holding("tool", x, NORMAL, joint=ELBOW, **HOLD)],
    )
    sensors = [MomentumObserver(system, OBSERVER_GAIN)] if observed else None
    return simulate(system, controller, duration=DURATION, dt=DT, q0=POSTURE, bodies=[wall], sensors=sensors)


def modal_damping(x: MechanicalState) -> Array:
    """Return C = κ M^½ Ω M^½, with Ω² = M^-½ K M^-½ and K the stiffness of the springs and of the softest wall.

    In modal coordinates each mode of the loop then has the same poles relative to its frequency ω: those of
    σ³ + κσ² + (1 + a)σ + aκ, a = A K_z Aᵀ. With a = ¼ and κ = 1.75 all decay at 0.42 ω or faster, and on a
    stiffer wall the slow one stays at a/(1 + a) times C over the mass.
    """
    jacobian = x.frame_jacobian("tool", "local_world_aligned")
    along, elbow = NORMAL @ jacobian[:3], np.eye(x.system.n)[x.system.robot.joint_index(ELBOW)]
    across = jacobian[:3] - np.outer(NORMAL, along)
    stiffness = (
        STIFFNESSES[0] * np.outer(along, along)
        + HOLD["tangential_stiffness"] * across.T @ across
        + HOLD["rotational_stiffness"] * jacobian[3:].T @ jacobian[3:]
        + HOLD["joint_stiffness"] * np.outer(elbow, elbow)
    )
    root = np.real(sqrtm(x.mass_matrix))
    inverse = np.linalg.inv(root)
    damping = DAMPING_RATIO * root @ np.real(sqrtm(inverse @ stiffness @ inverse)) @ root
    symmetric: Array = 0.5 * (damping + damping.T)
    return symmetric


def _error(log: Log) -> float:
    """Return the largest force error from 1 s on [N]."""
    return float(np.abs(log.contact_force[log.time >= 1.0] - FORCE).max())


def _peak(log: Log) -> float:
    return float(log.contact_force.max())


def slide(log: Log) -> float:
    """Return how far the tip moved along the wall [m]."""
    robot = load_robot("pera")
    tips = np.array([robot.placement("tool", q).translation for q in log.position[::10]])
    away = tips - tips[0]
    along = away - np.outer(away @ NORMAL, NORMAL)
    return float(np.linalg.norm(along, axis=1).max())


def _claims(logs: dict[str, Log]) -> list[Claim]:
    claims = []
    for k in STIFFNESSES:
        log = logs[f"measured-{k:g}"]
        claims += [
            Claim(f"force-{k:g}", f"force error after 1 s, k = {k:g} N/m, f_e measured", Origin.OURS, "our aim",
                  (1e-3,), "N", 0.0, [Finding((_error(log),))], "<="),
            Claim(f"slide-{k:g}", f"slide along the wall, k = {k:g} N/m", Origin.OURS, "our aim", (0.1,), "mm", 0.0,
                  [Finding((1e3 * slide(log),))], "<="),
            Claim(f"settled-{k:g}", f"force within 5 %, k = {k:g} N/m", Origin.OURS, "our aim", (0.7,), "s", 0.0,
                  [Finding((settling_time(log, FORCE),))], "<="),
        ]  # fmt: skip
    return claims


def _figure(logs: dict[str, Log]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 4.8), layout="constrained")
    axes = figure.subplots()
    for color, stiffness in zip(("#0072b2", "#009e73", "#d55e00"), STIFFNESSES, strict=True):
        for name, line in (("measured", "-"), ("observed", "--")):
            log = logs[f"{name}-{stiffness:g}"]
            axes.plot(log.time, log.contact_force, color=color, linestyle=line, label=f"k = {stiffness:g} N/m, {name}")
    friction = logs["friction-1000"]
    axes.plot(friction.time, friction.contact_force, color="#999999", label="k = 1000 N/m, friction not compensated")
    axes.axhline(FORCE, color="black", linewidth=0.6)
    axes.set(xlabel="t [s]", ylabel="contact force [N]", title="The PERA presses a wall with 10 N", xlim=(0.0, 1.2))
    axes.legend(fontsize=8)
    axes.grid(alpha=0.25)
    return figure
