"""Time of one control step, ``system.at(q, v)`` and ``controller.evaluate``, on seven joints.

    python benchmarks/control_step.py [--rounds N]

Each law and interconnection is timed together with (a) the bare Pinocchio calls that it needs and (b) a
hand-written Slotine-Li law, all interleaved in one run; the ratios are what to look at.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from reference import slotine_li
from timing import interleaved

from phcontrol import Measured, MechanicalSystem, TrajectoryTracking, load_robot, make_controller
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.mechanics.kernels import KERNELS

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
FEATURES = np.array([0.003, -0.002, 0.0025])  # (μ, ν, l) [m], for the laws of visual servoing
BUDGETS = {  # of the ratio to Slotine-Li
    ("energy_shaping", "coriolis"): 1.0,
    ("force_feedback", "coriolis"): 2.0,
    ("force_feedback_measured", "coriolis"): 2.0,
    ("tracking", "coriolis"): 1.3,
    ("tracking_measured", "coriolis"): 1.3,
    ("hamiltonian_servo", "coriolis"): 5.0,
    ("hamiltonian_servo", "canonical"): 20.0,
}
CANONICAL_BUDGET = 10.0


def main() -> None:
    """Print one table for each arm."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=200, help="rounds of 20 calls each")
    rounds = parser.parse_args().rounds
    print(f"kernels: {KERNELS}")
    for title, system in {
        "panda, fingers locked (viscous friction)": MechanicalSystem(load_robot("panda", locked_joints=FINGERS)),
        "pera (Coulomb and viscous friction)": MechanicalSystem(load_robot("pera")),
        "pera, without friction": MechanicalSystem(load_robot("pera"), friction=None),
    }.items():
        table(title, system, rounds)


def table(title: str, system: MechanicalSystem, rounds: int) -> None:
    """Time all laws on one arm and print the table."""
    generator = np.random.default_rng(0)
    q, v = system.robot.random_position(generator), generator.normal(size=system.n)
    force = generator.normal(size=system.n)
    law = slotine_li(system.model, np.array(system.robot.home), np.eye(system.n) * 20.0, 2.0)
    candidates: dict[str, Callable[[], object]] = {"Slotine-Li, by hand": lambda: law(q, v)}
    bare = dict.fromkeys(CONTROLLERS, "bare M C g") | {"energy_shaping": "bare g", "classical_impedance": "bare g"}
    candidates |= bare_calls(system, q, v)
    trajectory = TrajectoryTracking.tuned(system).trajectory
    candidates["a sinusoid alone"] = lambda: trajectory.at(1.0)  # a part of each step of tracking
    for name, entry in CONTROLLERS.items():
        for form in entry.law.forms:
            candidates[f"{name} {form}"] = step(system, name, form, q, v, force)
    times = interleaved(candidates, rounds)
    reference = times["Slotine-Li, by hand"].median
    print(f"\n{title}\n{'':<44}{'median':>9}{'p99':>9}{'spread':>8}{'/ bare':>8}{'/ S-L':>8}  budget")
    for name, timing in times.items():
        law_name, _, form = name.partition(" ")
        line = f"{name:<44}{timing.median:>6.1f} µs{timing.p99:>6.1f} µs{timing.spread:>8.0%}"
        if law_name in CONTROLLERS:
            budget = BUDGETS.get((law_name, form), None if form == "coriolis" else CANONICAL_BUDGET)
            ratio = timing.median / reference
            verdict = "" if budget is None else f"{budget:>6.1f} {'met' if ratio <= budget else 'MISSED'}"
            line += f"{timing.median / times[bare[law_name]].median:>8.1f}{ratio:>8.2f}{verdict}"
        print(line)


def bare_calls(system: MechanicalSystem, q: np.ndarray, v: np.ndarray) -> dict[str, Callable[[], object]]:
    """Return the Pinocchio calls that the laws cannot do without."""
    model, data = system.model, system.model.createData()

    def all_three() -> None:
        pin.crba(model, data, q)
        pin.computeCoriolisMatrix(model, data, q, v)
        pin.computeGeneralizedGravity(model, data, q)

    return {"bare g": lambda: pin.computeGeneralizedGravity(model, data, q), "bare M C g": all_three}


def step(
    system: MechanicalSystem, name: str, form: str, q: np.ndarray, v: np.ndarray, force: np.ndarray
) -> Callable[[], object]:
    """Return one control step of a law."""
    controller = make_controller(name, system, interconnection=form)
    state = np.full(controller.state_size, 0.1)
    measured = Measured(external_force=force, total_force=force, features=FEATURES)
    return lambda: controller.evaluate(1.0, system.at(q, v), state, measured)


if __name__ == "__main__":
    main()
