"""The files of a new project: an arm, a law of one's own, its test, a sweep, a notebook and a page on them."""

from __future__ import annotations

import json
from typing import Any

ARM = '''"""The arm: where its description is, and what that leaves out."""

from pathlib import Path

from phcontrol import MechanicalSystem, load_robot

SOURCE = {quoted}
"""A name that ``phcontrol robots`` lists, or the path of a URDF, MJCF or xacro file from this folder."""
LOCKED: list[str] = {locked}
"""Joints that stay where they are at home, fingers for instance."""
ARMATURE: list[float] | None = {rotors}
"""Reflected inertia of the rotors, one each joint [kg m²]; None for those of the description."""


def make_system() -> MechanicalSystem:
    """Return the plant: the arm with its friction."""
    beside = Path(__file__).parent / SOURCE
    source = str(beside) if beside.is_file() else SOURCE
    return MechanicalSystem(load_robot(source, locked_joints=LOCKED, armature=ARMATURE))
'''

LAW = '''"""A law of your own: a storage function, and the port-Hamiltonian system that the closed loop will be."""

from phcontrol import Controller, Gain, Target, Vector


class MyLaw(Controller):
    """Hold a posture by a spring and a damper: H_d = kinetic energy + ½ q̃ᵀK_p q̃."""

    name = "my_law"
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    stiffness: Gain = Gain("K_p", "N·m/rad", tuned=lambda tuning: tuning.stiffness)
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)

    def storage(self, t, x, state, measured=None):
        """Return H_d [J]."""
        error = x.position_error(self.goal)
        return x.kinetic_energy + 0.5 * error @ self.stiffness @ error

    def target(self, t, x, state, measured=None):
        """Return what the closed loop is meant to be; the torque follows from it."""
        error = x.position_error(self.goal)
        return Target.mechanical(
            x, self.interconnection, error=error, gradient=self.stiffness @ error, damping=self.damping
        )
'''

TEST = '''"""The law is what it promises on this arm, and brings the arm to its goal. Run with ``python -m pytest``."""

import numpy as np
from phcontrol import certify, simulate

from arm import make_system
from law import MyLaw


def test_the_closed_loop_is_what_the_law_promises():
    system = make_system()
    certificate = certify(MyLaw.tuned(system), system, samples=64)
    assert certificate.passed, str(certificate)


def test_the_arm_comes_to_its_goal_and_its_energy_falls():
    system = make_system()
    law = MyLaw.tuned(system, system.robot.near_home())
    log = simulate(system, law, duration=10.0, dt=5e-3, integrator="discrete_gradient")
    assert np.abs(system.robot.difference(log.position[-1], law.goal)).max() < 0.02  # [rad]
    assert np.diff(log.storage).max() < 1e-6  # [J]
'''

SWEEP = """# Does the law hold the arm if masses, friction and start are not what they should be?
# phcontrol sweep sweep.toml --out results/sweep; what else can vary: phcontrol's documentation, "How sure?"
measures = ["final_error", "peak_torque", "peak_velocity", "peak_position"]

[arm]
robot = {quoted}
locked_joints = {locked}{armature}

[law]
name = "law:MyLaw"

[run]
duration = 2.0  # [s]

[vary]
mass_factor = {{ uniform = [0.9, 1.1] }}
friction_factor = {{ uniform = [0.5, 1.5] }}
initial_offset.each = {{ uniform = [-0.05, 0.05] }}  # [rad]

[sampling]
method = "random"
runs = 64
seed = 0

[require]  # what each run must keep; of torque and velocity: parts of the arm's limits
peak_torque = 1.0
peak_velocity = 1.0
"""

README = """# {title}

A law of your own on {robot}, with a test that certifies it. Made by `phcontrol init`.

| file | what is in it |
|---|---|
| `arm.py` | which arm: `{source}` |
| `law.py` | `MyLaw`: change its `storage` and `target`; the torque follows from them |
| `test_law.py` | its certificate, and a run; needs `pip install pytest` |
| `sweep.toml` | the law on 64 arms with drawn masses, friction and starts; needs `pip install 'phcontrol[sweeps]'` |
| `first_run.ipynb` | the same step by step, with plots: `pip install notebook && jupyter notebook` |

```sh
python -m pytest                                                # is the law what it promises, on this arm?
phcontrol certify --robot {argument} --controller law:MyLaw{lock}
phcontrol run position --robot {argument} --controller law:MyLaw{lock} --record run.html
phcontrol sweep sweep.toml --out results/sweep                  # and if the arm is not quite the one described?
phcontrol sweep-report results/sweep --spec sweep.toml
```

Run these in this folder. What may go into a law, and what a failed line of a certificate means, is in phcontrol's
documentation: *A law of your own* and *Choosing a controller*. `phcontrol analyze`, `design` and `export` take the same
`--robot` and `--controller` (`design` for laws of phcontrol only).
"""

_NOTEBOOK = (
    ("markdown", "# {title}: first run\n\nRun the cells from top to bottom (in this folder)."),
    ("code", "from arm import make_system\n\nsystem = make_system()\nsystem.robot.joint_names"),
    ("markdown", "The law, with gains that suit the arm, about a posture near home."),
    (
        "code",
        "from law import MyLaw\n\nlaw = MyLaw.tuned(system, system.robot.near_home())\n"
        "law.stiffness.diagonal()  # [N·m/rad]",
    ),
    ("markdown", "Is the closed loop what the law promises, at states where laws go wrong?"),
    ("code", "from phcontrol import certify\n\ncertificate = certify(law, system, samples=64)\nprint(certificate)"),
    ("markdown", "From home to the goal: a step, so torques may be large."),
    (
        "code",
        "from phcontrol import simulate\n\n"
        'log = simulate(system, law, duration=5.0, integrator="discrete_gradient", progress=False)\n'
        "log.position[-1] - law.goal  # [rad]",
    ),
    ("code", "log.plot.position();"),
    ("code", "log.plot.energy();"),
)


def files_of(
    title: str, robot: str, source: str, locked: list[str], rotors: list[float] | None = None
) -> dict[str, str]:
    """Return the text of each file of a project by its name.

    Args:
        title: of the project.
        robot: what the arm is called.
        source: a name that ``load_robot`` knows, or a path from the project's folder.
        locked: joints that stay at home.
        rotors: their reflected inertias, one each joint [kg m²]; None for those of the description.
    """
    argument = source if " " not in source else f"'{source}'"
    lock = "".join(f" --lock {joint}" for joint in locked)
    lock += "" if rotors is None else f" --armature {','.join(map(str, rotors))}"
    values = {"title": title, "robot": robot, "source": source, "quoted": json.dumps(source, ensure_ascii=False)}
    values |= {"rotors": repr(rotors), "armature": "" if rotors is None else f"\narmature = {rotors}  # [kg m²]"}
    values |= {"locked": json.dumps(locked, ensure_ascii=False), "argument": argument, "lock": lock}
    return {
        "arm.py": ARM.format(**values),
        "law.py": LAW,
        "test_law.py": TEST,
        "sweep.toml": SWEEP.format(**values),
        "README.md": README.format(**values),
        "first_run.ipynb": notebook([(kind, text.replace("{title}", title)) for kind, text in _NOTEBOOK]),
    }


def notebook(cells: list[tuple[str, str]]) -> str:
    """Return a notebook of ("markdown" or "code", text) cells, without outputs, as JSON."""
    made: list[dict[str, Any]] = []
    for number, (kind, text) in enumerate(cells):
        cell = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": text.splitlines(keepends=True)}
        made.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    data = {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(data, indent=1, ensure_ascii=False) + "\n"
