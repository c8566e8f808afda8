"""Simulated seconds per second of ``simulate``, against a hand-written ``pin.aba`` and RK4 loop.

    python benchmarks/simulation.py [--repeats N]

Both run the same law (energy shaping) on the same frictionless seven-joint arm at 1 ms, continuous against
continuous and sampled against sampled, alternating; both log every step.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from reference import closed_loop, energy_shaping

from phcontrol import EnergyShaping, LiveView, MechanicalSystem, load_robot, simulate

DT, DURATION, BUDGET = 1e-3, 1.0, 0.7


def main() -> None:
    """Print one row for each way to run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    repeats = parser.parse_args().repeats
    system = MechanicalSystem(load_robot("pera"), friction=None)
    goal = np.array([-0.3, 1.0, -0.3, -1.3, 0.3, -1.2, 0.2])
    gains = {"stiffness": np.diag(np.full(7, 20.0)), "damping": np.diag(np.full(7, 8.0))}
    controller = EnergyShaping(system, goal=goal, **gains)
    law = energy_shaping(system.model, goal, *gains.values())
    q0, v0, steps = np.array(system.robot.home), np.zeros(7), round(DURATION / DT)
    print(f"simulated seconds per second, {repeats} alternating repeats: median (lowest to highest)")
    for title, period in {"continuous": None, "sampled at 1 ms": DT}.items():

        def ours(period: float | None = period, limit: str | None = None, watch: LiveView | None = None) -> np.ndarray:
            options = {"control_period": period, "torque_limit": limit, "watch": watch}
            log = simulate(system, controller, duration=DURATION, dt=DT, **options)
            return log.position[-1]

        def reference(sampled: bool = period is not None) -> np.ndarray:
            return closed_loop(system.model, law, q0, v0, DT, steps, sampled)["q"][-1]

        difference = np.abs(ours() - reference()).max()
        with LiveView(port=0, real_time=False, announce=lambda server: None) as view:
            ours(watch=view)  # the page is made now, and served by another process
            runs = [reference, ours, lambda: ours(limit="robot"), lambda view=view: ours(watch=view)]
            by_hand, without, with_limits, watched = alternate(runs, repeats)
        print(f"\n{title} (final positions differ by {difference:.1e} rad)")
        print(f"  by hand                      {summary(by_hand)}")
        ways = {"simulate": without, "simulate, torque limits on": with_limits, "simulate, watched at 30 Hz": watched}
        for name, rates in ways.items():
            ratio = float(np.median(rates / by_hand))
            verdict = "met" if ratio >= BUDGET else "MISSED"
            print(f"  {name:<28} {summary(rates)}   ratio {ratio:.2f}, budget {BUDGET} {verdict}")


def alternate(functions: list[Callable[[], object]], repeats: int) -> np.ndarray:
    """Return simulated seconds per second, one row for each function."""
    rates = np.empty((len(functions), repeats))
    for column in range(repeats):
        for row, function in enumerate(functions):
            start = time.perf_counter()
            function()
            rates[row, column] = DURATION / (time.perf_counter() - start)
    return rates


def summary(rates: np.ndarray) -> str:
    """Return median and range."""
    return f"{np.median(rates):6.1f} ({rates.min():.1f} to {rates.max():.1f})"


if __name__ == "__main__":
    main()
