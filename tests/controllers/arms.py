"""Arms on which default gains are tried: those of the catalogue, and generated chains."""

from __future__ import annotations

import warnings
from functools import cache

from benchmarks.arms import FINGERS, chain
from phcontrol import MechanicalSystem, load_robot

ROTORS = {"armature": 0.05}  # where friction is described without them
CATALOGUE = {
    "pera": {}, "pera_shoulder_elbow": {}, "pera_shoulder": {}, "pera_gripper": {}, "pera_with_gripper": {},
    "panda": {"locked_joints": FINGERS}, "ur3": {}, "ur3_gripper": {}, "ur5": {}, "ur10": {}, "kinova": {},
    "xarm7": ROTORS, "z1": ROTORS, "talos_arm": ROTORS, "asr_twodof": {}, "finger_edu": {},
    "double_pendulum_continuous": ROTORS, "bravo7_no_ee": {},
}  # fmt: skip
CHAINS = {"chain of 14": 14, "chain of 30": 30}


@cache
def arm(name: str) -> MechanicalSystem:
    """Return an arm of the catalogue, or a chain."""
    if name in CHAINS:
        return chain(CHAINS[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return MechanicalSystem(load_robot(name, **CATALOGUE[name]))
