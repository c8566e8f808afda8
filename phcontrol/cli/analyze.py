"""``phcontrol analyze``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from phcontrol.analysis.l2_gain import l2_gain
from phcontrol.analysis.linearization import Linearization, linearize
from phcontrol.cli.arm import goal_of
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.errors import say_aside
from phcontrol.cli.laws import law_of
from phcontrol.cli.options import (
    ControllerOption,
    FormOption,
    GoalOption,
    JsonOption,
    RobotOption,
    SetOption,
)
from phcontrol.cli.texts import settings_of
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.law_error import errors_of
from phcontrol.controllers.registry import make_controller
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.system import MechanicalSystem

_SHOWN = 12  # modes in the table
_SETTLED = 0.05  # of the final value


def analyze(
    controller: ControllerOption,
    robot: RobotOption = "pera",
    goal: GoalOption = None,
    interconnection: FormOption = "coriolis",
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    differences: Annotated[
        bool, typer.Option("--differences", help="Finite differences, also where exact derivatives are to be had.")
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(help="File for poles, step responses, frequency responses and gain.", metavar="FILE.png"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Look at a closed loop about its rest: modes, stable periods, steps, gain.

    Exit code 1 if a mode grows.
    """
    system, entry = arm.system(robot), law_of(controller)
    options = settings_of(settings, "interconnection", "goal")
    with errors_of(controller, entry.law):
        law = make_controller(
            controller, system, goal_of(system, goal, None, None), interconnection=interconnection, **options
        )
        found = linearize(law, system, exact=False if differences else None)
    facts = facts_of(law, system, found)
    if as_json:
        typer.echo(json.dumps(facts, indent=2))
    else:
        for line in lines_of(facts):
            typer.echo(line)
    if picture is not None:
        from phcontrol.visualization.linear_plots import linear_figure
        from phcontrol.visualization.plots import save_figure

        written = save_figure(linear_figure(found, f"{law.name} on {system.robot.name}"), picture)
        say_aside(f"wrote {written}", as_json)
    if not facts["stable"]:
        raise typer.Exit(1)


def facts_of(law: Controller, system: MechanicalSystem, found: Linearization) -> dict[str, Any]:
    """Return all that is said of a loop, for JSON."""
    unstable = bool((found.eigenvalues.real - found.uncertainty > 0.0).any())
    try:
        bound = l2_gain(law, system)
        gain: dict[str, Any] = {"bound": bound.bound, "source": bound.source, "linear": _finite(bound.linear_norm)}
    except PHControlError as error:
        gain = {"bound": None, "source": str(error), "linear": _finite(found.norm)}
    return {
        "controller": law.name,
        "interconnection": law.interconnection,
        "robot": system.robot.name,
        "position": found.position.tolist(),
        "derivatives": "exact" if found.exact else "finite differences",
        "accuracy": found.accuracy,
        "stable": not unstable,
        "modes": [
            {
                "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                "uncertainty": mode.uncertainty,
                "frequency": mode.frequency,
                "damping_ratio": _finite(mode.damping_ratio),
                "time_constant": _finite(mode.time_constant),
                "joints": dict(mode.joints),
                "own_states": mode.own_states,
            }
            for mode in found.spectrum
        ],
        "longest_period": {str(delay): _finite(found.longest_period(delay)) for delay in (0, 1)},
        "steps": [] if unstable else steps_of(found),
        "l2_gain": gain,
    }


def steps_of(found: Linearization) -> list[dict[str, Any]]:
    """Return what a step of 1 N·m in each joint makes of that joint: how far it goes, how soon, how much beyond."""
    fading = -found.eigenvalues.real[found.eigenvalues.real + found.uncertainty < 0.0]
    duration = 8.0 / float(fading.min()) if fading.size else 1.0
    time, outputs = found.step_response(duration, 2000)
    rows = []
    for k, joint in enumerate(found.joints):
        way = outputs[:, k, k]
        final, most = float(way[-1]), float(way[np.abs(way).argmax()])
        outside = np.flatnonzero(np.abs(way - final) > _SETTLED * abs(most))
        rows.append(
            {
                "joint": joint,
                "final": final,
                "largest": most,
                "settled": float(time[outside[-1]]) if outside.size else 0.0,
            }
        )
    return rows


def lines_of(facts: dict[str, Any]) -> list[str]:
    """Return the table."""
    how = facts["derivatives"] + ("" if facts["derivatives"] == "exact" else f", to {facts['accuracy']:.0e}")
    state = "no mode grows" if facts["stable"] else "UNSTABLE"
    lines = [
        f"{facts['controller']} ({facts['interconnection']}) on {facts['robot']}, about its rest: {state} "
        f"(derivatives: {how})",
        f"  {'mode [1/s]':<24}{'ω [rad/s]':>11}{'ζ':>8}{'time constant':>16}  moves",
    ]
    for mode in facts["modes"][:_SHOWN]:
        real, imaginary = (part if abs(part) > mode["uncertainty"] else 0.0 for part in mode["eigenvalue"])
        value = f"{real:.4g}" + (f" ± {imaginary:.4g}j" if imaginary else "")
        ratio = "-" if mode["damping_ratio"] is None else f"{mode['damping_ratio']:.3f}"
        constant = "stays" if mode["time_constant"] is None else f"{mode['time_constant']:.3g} s"
        joints = ", ".join(f"{name} {share:.0%}" for name, share in mode["joints"].items())
        own = f" (own states {mode['own_states']:.0%})" if mode["own_states"] > 0.5 else ""
        lines.append(f"  {value:<24}{mode['frequency']:>11.3g}{ratio:>8}{constant:>16}  {joints}{own}")
    if len(facts["modes"]) > _SHOWN:
        lines.append(f"  and {len(facts['modes']) - _SHOWN} faster ones")
    for delay, text in (("0", "held"), ("1", "held, and a period late")):
        period = facts["longest_period"][delay]
        lines.append(f"  torque {text}: stable up to a period of {_milliseconds(period)}")
    if facts["steps"]:
        lines.append(f"  {'f_e = 1 N·m on':<24}{'moves it by':>14}{'at most':>14}{'within 5 % after':>19}")
    for row in facts["steps"]:
        lines.append(
            f"  {row['joint']:<24}{row['final']:>10.2e} rad{row['largest']:>10.2e} rad{row['settled']:>17.3g} s"
        )
    gain = facts["l2_gain"]
    if gain["bound"] is None:
        lines.append(f"  L₂ gain: none ({gain['source']})")
    else:
        linear = "-" if gain["linear"] is None else f"{gain['linear']:.4g}"
        lines.append(
            f"  L₂ gain from f_e: at most {gain['bound']:.4g} rad/s per N·m ({gain['source']}), linear loop {linear}"
        )
    return lines


def _milliseconds(period: float | None) -> str:
    return "any length" if period is None else "none" if period == 0.0 else f"{1e3 * period:.3g} ms"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
