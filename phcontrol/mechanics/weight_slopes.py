"""How fast the weight that joints carry can change, in any posture."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.mechanics.system import MechanicalSystem


def weight_slopes(system: MechanicalSystem) -> Array:
    """Return H with |∂²V_g/∂q_i∂q_j| ≤ H_ij in every posture, shape (n, n) [N·m/rad]; V_g is gravity's potential alone.

    For joint i at or before j on the way to a body k, both revolute, ∂²r_k/∂q_i∂q_j = a_i × (a_j × (r_k − o_j)): no
    longer than the way from joint j to the centre of mass of k, stretched out, d_jk. So H_ij = |g| Σ_k m_kd_jk. A
    prismatic j has 1 in place of d_jk, a prismatic i nothing. It is infinite where a prismatic joint without limits is
    on the way.

    Args:
        system: the arm.
    """
    model, robot = system.model, system.robot
    strength = float(np.linalg.norm(model.gravity.linear))
    turns = [_turns(model, joint) for joint in range(model.njoints)]
    reach = _reaches(system)
    ways: Array = np.zeros((model.njoints, model.njoints))  # of joint j: Σ m_k d_jk
    for body in range(1, model.njoints):
        inertia = model.inertias[body]
        way, joint = float(np.linalg.norm(inertia.lever)), body
        while joint > 0:
            size = inertia.mass * (way if turns[joint] else 1.0)
            before = joint
            while before > 0:
                if turns[before]:
                    ways[before, joint] += size
                before = int(model.parents[before])
            way += reach[joint] + float(np.linalg.norm(model.jointPlacements[joint].translation))
            joint = int(model.parents[joint])
    full: Array = strength * np.maximum(ways, ways.T)[1:, 1:]
    if robot.coupling is None:
        return full
    sizes = np.abs(robot.coupling.matrix)
    reduced: Array = sizes.T @ full @ sizes
    return reduced


def _turns(model: pin.Model, joint: int) -> bool:
    return joint > 0 and "P" not in model.joints[joint].shortname().removeprefix("JointModel")


def _reaches(system: MechanicalSystem) -> Array:
    """Return how far each joint of the model can push out what follows it [m]: 0 for revolute ones."""
    model, robot = system.model, system.robot
    reach: Array = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        if _turns(model, joint):
            continue
        index = model.joints[joint].idx_q
        ends = np.maximum(np.abs(robot.lower), np.abs(robot.upper))
        if robot.coupling is None:
            reach[joint] = ends[index]
        else:
            row = np.abs(robot.coupling.matrix[index])
            reach[joint] = float(np.where(row > 0.0, row * ends, 0.0).sum()) + abs(float(robot.coupling.offset[index]))
    return reach
