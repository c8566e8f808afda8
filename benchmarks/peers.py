"""Simulated seconds per second: ours, MuJoCo's, Drake's and loops by hand on Pinocchio, on the same Panda.

    python benchmarks/peers.py [--repeats N]

The same law (energy shaping, gravity from Pinocchio where it is in Python) on the same frictionless arm at 1 ms, with a
log of every step. All run in turns in one process; times are of the processor. Each row says how far its positions are
from those of the loop by hand, and of first order from our own, as the largest difference of the whole run: a damped
loop forgets what it did wrong.
Peers that are not installed (extra ``peers``) are left out, and a line says so.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import peer_drake
import peer_mujoco
from arms import panda
from reference import closed_loop, energy_shaping

from phcontrol import MechanicalSystem, make_controller, simulate

DT, DURATION = 1e-3, 10.0
_TAKEN = 0.2  # of a velocity in a step, by a damping that is chosen for a long chain
PEERS = {"mujoco": "mujoco", "drake": "pydrake"}
"""Packages and their modules."""


class Way(NamedTuple):
    """One way to run the loop."""

    run: Callable[[], np.ndarray]
    """Returns positions, one row a step."""
    compared_with: str
    """Which loop by hand: "sampled", "continuous", or "" for another law."""
    order: int
    """Of the integrator."""


def found_peers() -> list[str]:
    """Return the peers that are installed."""
    return [name for name, module in PEERS.items() if importlib.util.find_spec(module)]


def ways_of(system: MechanicalSystem, steps: int, *, peers: list[str], by_hand: bool = True) -> dict[str, Way]:
    """Return every way to run the loop on an arm, by name."""
    goal, n = system.robot.near_home(), system.n
    ours = _by_joint(system, make_controller("energy_shaping", system, goal))
    feedback = make_controller("force_feedback", system, goal)
    full, damped = ours.stiffness, ours.damping
    q0, v0 = np.array(system.robot.home), np.zeros(n)
    law = energy_shaping(system.model, goal, full, damped)
    duration = steps * DT
    ways: dict[str, Way] = {}

    def simulated(law: Any, compiled: bool, sampled: bool, integrator: str = "rk4") -> Callable[[], np.ndarray]:
        period = DT if sampled else None
        return lambda: simulate(
            system, law, duration=duration, dt=DT, q0=q0, control_period=period, compiled=compiled,
            integrator=integrator, torque_limit=None,
        ).position  # fmt: skip

    for name, sampled in (("sampled", True), ("continuous", False)):
        if by_hand:
            ways[f"pin.aba and RK4 by hand, {name}"] = Way(
                lambda sampled=sampled: closed_loop(system.model, law, q0, v0, DT, steps, sampled)["q"], name, 4
            )
            ways[f"phcontrol interpreted, RK4, {name}"] = Way(simulated(ours, False, sampled), name, 4)
        ways[f"phcontrol compiled, RK4, {name}"] = Way(simulated(ours, True, sampled), name, 4)
        ways[f"phcontrol compiled, RK4, {name}, force feedback"] = Way(simulated(feedback, True, sampled), "", 4)
        ways[f"phcontrol compiled, semi-implicit Euler, {name}"] = Way(
            simulated(ours, True, sampled, "semi_implicit_euler"), name, 1
        )
    diagonal = full.diagonal(), damped.diagonal()
    if "mujoco" in peers:
        for integrator, order in (("RK4", 4), ("Euler", 1)):
            plain = peer_mujoco.model_of(system, DT, integrator)
            within = peer_mujoco.model_of(system, DT, integrator, (goal, *diagonal))
            if by_hand:
                ways[f"MuJoCo {integrator}, law in Python, sampled"] = Way(
                    lambda plain=plain: peer_mujoco.by_python(plain, law, q0, v0, steps, False)["q"], "sampled", order
                )
                ways[f"MuJoCo {integrator}, law in a control callback, continuous"] = Way(
                    lambda plain=plain: peer_mujoco.by_python(plain, law, q0, v0, steps, True)["q"], "continuous", order
                )
            ways[f"MuJoCo {integrator}, all in C, continuous"] = Way(
                lambda within=within: peer_mujoco.in_c(within, goal, q0, v0, steps)["q"], "continuous", order
            )
    if "drake" in peers and by_hand:
        options: dict[str, dict[str, Any]] = {
            "Drake RK3, law in Python, sampled": {"law": law},
            "Drake RK3, all in C++, continuous": {},
            "Drake discrete, all in C++, sampled": {"discrete": True},
        }
        for name, chosen in options.items():
            run = peer_drake.simulation_of(system, goal, *diagonal, DT, **chosen)
            ways[name] = Way(
                lambda run=run: run(q0, v0, steps)["q"], name.rpartition(", ")[2], 1 if "discrete" in name else 3
            )
    return ways


def _by_joint(system: MechanicalSystem, law: Any) -> Any:
    """Return a law whose gains are diagonal, as peers have them; where the default ones are not, as soft as it takes.

    Long chains have light modes, which a diagonal damping takes hM⁻¹C from in a step: it stays well below 2.
    """
    if all(np.array_equal(gain, np.diag(gain.diagonal())) for gain in (law.stiffness, law.damping)):
        return law
    lightest = float(np.linalg.eigvalsh(system.at(law.goal).mass_matrix)[0])
    damping = _TAKEN * lightest / DT
    return law.changed(stiffness=damping, damping=damping)  # K_p = C · 1/s


def measured_runs(ways: dict[str, Way], steps: int, repeats: int) -> dict[str, dict[str, Any]]:
    """Return a row for each way: simulated seconds per second of the processor, and how far its positions are off."""
    positions = {name: way.run() for name, way in ways.items()}  # compiles what is compiled, and warms up
    truth = {kind: positions.get(f"pin.aba and RK4 by hand, {kind}") for kind in ("sampled", "continuous")}
    rates: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, way in ways.items():
            gc.collect()  # no row pays for what others left
            start = time.process_time()
            way.run()
            rates[name].append(steps * DT / (time.process_time() - start))
    rows = {}
    for name, way in ways.items():
        found = positions[name][: steps + 1]
        alike = (
            positions.get(f"phcontrol compiled, semi-implicit Euler, {way.compared_with}") if way.order == 1 else None
        )
        rows[name] = {"simulated s per s": float(np.median(rates[name])), "best": max(rates[name]), "order": way.order}
        rows[name] |= {"moved [rad]": float(np.abs(found - found[0]).max())}
        rows[name] |= {"from RK4 by hand [rad]": _largest(found, truth.get(way.compared_with))}
        rows[name] |= {"from ours of the same order [rad]": _largest(found, alike)}
    return rows


def _largest(found: np.ndarray, expected: np.ndarray | None) -> float | None:
    """Return the largest difference of two whole runs; None without the other."""
    return None if expected is None else float(np.abs(found - expected).max())


def lines_of(rows: dict[str, dict[str, Any]]) -> list[str]:
    """Return the table."""
    head = f"{'median':>8}{'best':>8}{'order':>7}{'from RK4 by hand':>20}{'from our Euler':>18}"
    lines = [f"{'simulated seconds per second':<58}{head}"]
    for name, row in rows.items():
        off, alike = (
            "-" if row[f"from {other} [rad]"] is None else f"{row[f'from {other} [rad]']:.1e} rad"
            for other in ("RK4 by hand", "ours of the same order")
        )
        lines.append(
            f"{name:<58}{row['simulated s per s']:>8.1f}{row['best']:>8.1f}{row['order']:>7}{off:>20}{alike:>18}"
        )
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7)
    repeats = parser.parse_args().repeats
    peers, steps = found_peers(), round(DURATION / DT)
    for line in lines_of(measured_runs(ways_of(panda(friction=False), steps, peers=peers), steps, repeats)):
        print(line)
    for name in PEERS:
        if name not in peers:
            print(f"{name}: not installed, left out (pip install 'phcontrol[peers]')")


if __name__ == "__main__":
    main()
