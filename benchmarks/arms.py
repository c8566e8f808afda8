"""The arms that benchmarks run on: the Panda, and chains of any length."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from phcontrol import MechanicalSystem, load_robot

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]


def panda(*, friction: bool = True) -> MechanicalSystem:
    """Return the Panda with its fingers locked, seven joints; without friction where other simulators have another."""
    return MechanicalSystem(load_robot("panda", locked_joints=FINGERS), friction="robot" if friction else None)


def chain(n: int) -> MechanicalSystem:
    """Return n links of 1 kg and 10 cm, each about x or y of the one before, without friction and without rotors."""
    axes = np.random.default_rng(0).choice(["1 0 0", "0 1 0"], size=n)
    links = "".join(
        f'<link name="l{k + 1}"><inertial><origin xyz="0 0 0.05"/><mass value="1"/>'
        f'<inertia ixx="0.002" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="j{k + 1}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 {0.1 if k else 0.0}"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="1000" velocity="3"/></joint>'
        for k, axis in enumerate(axes)
    )
    with TemporaryDirectory() as folder:
        path = Path(folder, f"chain{n}.urdf")
        path.write_text(f'<robot name="chain{n}"><link name="l0"/>{links}</robot>')
        return MechanicalSystem(load_robot(path))
