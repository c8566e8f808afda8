"""Every study by name, in the thesis's order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from phcontrol._validation import choice
from phcontrol.thesis.study import Outcome


@dataclass(frozen=True)
class Study:
    """A study: the module whose ``run`` it is, and the arguments."""

    module: str
    summary: str
    arguments: tuple[Any, ...] = ()

    def run(self) -> Outcome:
        """Run it; its module is loaded now, not before."""
        function: Callable[..., Outcome] = import_module(f"phcontrol.thesis.{self.module}").run
        return function(*self.arguments)


def _grasp(name: str, body: str, quantity: str, sampled: bool) -> Study:
    kind = "sampled stand-in for the measured" if sampled else "the simulated"
    figure = name[4:].replace("-", ".")
    summary = f"{kind} {quantity} grasping a {body} body (thesis figure {figure})"
    return Study("grasping", summary, (name, body, quantity, sampled))


STUDIES: dict[str, Study] = {
    "fig-2-3": Study("fig_2_3", "the stiffness of the gripper's spring (thesis figure 2.3)"),
    "fig-3-1": Study("fig_3_1", "position control of the shoulder under a constant force (thesis figure 3.1)"),
    "fig-4-1": Study("fig_4_1", "force control of the gripper on a squash ball (thesis figure 4.1)"),
    "fig-4-2": _grasp("fig-4-2", "rigid", "position", False),
    "fig-4-3": _grasp("fig-4-3", "rigid", "force", False),
    "fig-4-4": _grasp("fig-4-4", "compliant", "position", False),
    "fig-4-5": _grasp("fig-4-5", "compliant", "force", False),
    "fig-4-7": _grasp("fig-4-7", "rigid", "position", True),
    "fig-4-8": _grasp("fig-4-8", "rigid", "force", True),
    "fig-4-9": _grasp("fig-4-9", "compliant", "position", True),
    "fig-4-10": _grasp("fig-4-10", "compliant", "force", True),
    "fig-6-1": Study("tracking", "the shoulder follows a sinusoid (thesis figure 6.1)", ("fig-6-1",)),
    "fig-6-2": Study("tracking", "its error, and what makes it the thesis's (thesis figure 6.2)", ("fig-6-2",)),
    "fig-6-3": Study("tracking", "three frequencies, stand-in for the measured (thesis figure 6.3)", ("fig-6-3",)),
    "fig-6-4": Study("tracking", "their errors, stand-in for the measured (thesis figure 6.4)", ("fig-6-4",)),
    "theorems": Study("theorems", "the thesis's theorems: closed loops, power balances, definite matrices, the gain"),
    "statements": Study("statements", "the thesis's equations, examples, remarks and appendix A, chapter by chapter"),
    "track-pera": Study("track_pera", "all seven joints follow sinusoids, control at 1 kHz"),
    "pera-press": Study("pera_press", "the seven-joint arm presses a wall with 10 N, soft to hard"),
    "grasp-grid": Study("grasp_grid", "the grasping laws compared under equal conditions, over bodies and gains"),
    "fig-5-3": Study("fig_5_3", "visual servoing of the three-joint arm with both laws (thesis figure 5.3)"),
    "servo-pera": Study("servo_pera", "visual servoing of the seven-joint arm from 24 random starts"),
    "servo-images": Study("servo_images", "the same from the pixels of rendered images with noise, at camera rate"),
}


def run_study(name: str) -> Outcome:
    """Run a study by name. Raises UnknownNameError, listing the studies."""
    return STUDIES[choice("study", name, STUDIES)].run()
