"""Gains that suit a robot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from phcontrol._lazy import lazy
from phcontrol._validation import Array, positive
from phcontrol.mechanics.system import MechanicalSystem

BANDWIDTH = 4.0
"""Of default gains, where the arm bears it [rad/s]."""
DAMPING_RATIO = 1.0
"""Of default gains."""
PERIOD = 1e-3
"""For how long a torque may be held under default gains [s]."""

_POSTURES = 48  # at which inertia and friction are looked at, beside the goal and home
_MARGIN = 2.0  # of the inertia that is designed for, over the mean
_HELD = 1.2  # how far a held damping may take a velocity: it fades below 2, and RK4 bears 2.7 in a step of 2 ms
_FRICTION = 0.8  # of the friction around rest, as the least stiffness [1/s]
_LEFT = 0.5  # of a joint's damping, what may be left to its friction where a held torque bears no more
_LOWERED = 0.8  # by which the bandwidth of the joint that a held torque bears least is lowered at a time
_FAST = 1.0  # a joint's speed where it has no limit, at which dry friction is small beside its slope at rest [rad/s]


class _Seen(NamedTuple):
    """What the arm is like at one posture."""

    inertia: Array
    """M, shape (n, n)."""
    friction: Array
    """D around rest, shape (n, n) [N·m·s/rad]: of dry friction its slope there, which is steep."""
    moving: Array
    """D at the joints' largest speeds, where dry friction hardly counts, shape (n, n) [N·m·s/rad]."""


class Tuning:
    """What default gains are made from: the arm, and a bandwidth ω and damping ratio ζ where they are given.

    *With these* gains are exact at the goal: K_p = ω²M(q*) and C = 2ζωM(q*), full matrices, put every mode of energy
    shaping at ω and ζ. They are right near the goal: elsewhere M is another, and what M(q*) couples lightly may be
    heavy. Lead longer ways by a ``reference``.

    *Without* they suit all postures. With M_d = 2·mean of M over them, of which the diagonal is taken,

        K_p = max(ω²M_d, 0.8 d(0)),   C = 2ζ(K_pM_d)^½:

    M stays below about four times its mean, which leaves a damping ratio of ½^½ or more, and an overshoot of at most
    4.3 % of a step. Friction around rest, d(0), leaves a time constant d(0)/K_p of 1.25 s at most: of dry friction
    that is its slope at rest, as it is smoothed there, by which the last of an error goes. On the way it hardly counts.

    A torque that is held for h = 1 ms takes the velocity on by e^(−X) − φ(X)hM⁻¹C, with X = hM⁻¹D and
    φ(X) = (1 − e^(−X))/X. It fades where hC is less than M X coth(X/2), which is 2M without friction and D itself where
    that is large: friction helps. D is that of moving joints here. Where the diagonal does not keep to that, up to half
    of C is left to D in joints that friction holds, and they are made less stiff; where that is not enough (long
    chains), the whole of M_d is taken, and if need be K_p and C are lowered.

    Args:
        system: the model of the arm.
        goal: where the law should rest: a posture [rad], or what else it takes for a goal.
        posture: at which the arm's inertia is taken [rad].
        bandwidth: the desired ω [rad/s].
        damping_ratio: the desired ζ.
    """

    def __init__(
        self,
        system: MechanicalSystem,
        goal: Array,
        posture: Array,
        bandwidth: float | None = None,
        damping_ratio: float | None = None,
    ) -> None:
        self.system, self.goal, self.posture = system, goal, posture
        self._desired = bandwidth is not None or damping_ratio is not None
        self.bandwidth = BANDWIDTH if bandwidth is None else positive("bandwidth", bandwidth)
        self.damping_ratio = DAMPING_RATIO if damping_ratio is None else positive("damping_ratio", damping_ratio)

    @property
    def stiffness(self) -> Array:
        """K_p, shape (n, n) [N·m/rad]."""
        return self._gains[0]

    @property
    def damping(self) -> Array:
        """C, shape (n, n) [N·m·s/rad]."""
        return self._gains[1]

    def amplification(self, most: float) -> Array:
        """Return by how much forces may be amplified, A Y = A K_z Aᵀ =: S, diagonal, shape (n, n).

        That is ``most``, or less where friction forbids it. The torque holds A Y times the friction too, for PERIOD:
        hS^½D̄S^½ must stay below 1. s_i is at most the inverse of h times the sum of |D̄_ij| over j, at every posture:
        diag(Σ|D̄_ij|) − D̄ is positive semidefinite, because its diagonal dominates.
        """
        sums = np.zeros(self.system.n)
        for seen in self._everywhere:
            inverse = np.linalg.inv(np.linalg.cholesky(seen.inertia))
            sums = np.maximum(sums, np.abs(inverse @ seen.friction @ inverse.T).sum(axis=1))
        return np.diag(1.0 / np.maximum(1.0 / most, PERIOD * sums))

    @lazy
    def _gains(self) -> tuple[Array, Array]:
        if self._desired:
            inertia = self.system.at(self.posture).mass_matrix
            return self.bandwidth**2 * inertia, 2.0 * self.damping_ratio * self.bandwidth * inertia
        inertia = _MARGIN * np.mean([seen.inertia for seen in self._everywhere], axis=0)
        for design in (np.diag(inertia.diagonal()), inertia):
            gains = self._stiffest(design)
            if gains is not None:
                return self._uncoupled(gains[0]), gains[1]
        stiffness, damping = self._shaped(inertia, np.full(self.system.n, self.bandwidth))
        share = min(1.0, _HELD / self._held(damping)[0])
        return share**2 * self._uncoupled(stiffness), share * damping

    def _stiffest(self, inertia: Array) -> tuple[Array, Array] | None:
        """Return K_p and C of a design inertia, as stiff against friction as a held torque bears; None for none."""
        friction = _FRICTION * self._everywhere[0].friction.diagonal()
        fastest = np.maximum(self.bandwidth, np.sqrt(friction / inertia.diagonal()))
        left = np.zeros(self.system.n)  # of the damping, what is left to friction
        is_diagonal = not (inertia - np.diag(inertia.diagonal())).any()
        while True:
            stiffness, damping = self._shaped(inertia, fastest)
            damping = damping - np.diag(np.minimum(left, _LEFT * damping.diagonal()))
            taken, motion = self._held(damping)
            if taken <= _HELD:
                return stiffness, damping
            reducible = fastest > self.bandwidth
            if not reducible.any():
                return None
            joint = int(np.argmax(np.where(reducible, motion * (damping @ motion), -np.inf)))
            own = min(float(seen.moving[joint, joint]) for seen in self._everywhere)
            if is_diagonal and left[joint] < own:
                left[joint] = own
            else:
                fastest[joint] = max(self.bandwidth, _LOWERED * fastest[joint])

    def _uncoupled(self, stiffness: Array) -> Array:
        """Return K_p without what couples a continuous joint to others: there H_d would jump at half a turn."""
        turns = self.system.robot.continuous
        coupled = np.logical_or(turns[:, None], turns[None, :])
        np.fill_diagonal(coupled, False)
        result: Array = np.where(coupled, 0.0, stiffness)
        return result

    def _shaped(self, inertia: Array, fastest: Array) -> tuple[Array, Array]:
        """Return K_p and C of a design inertia; every mode of (M_d, C, K_p) has the damping ratio ζ.

        Against friction joints are made stiffer, as at the bandwidths ``fastest``, shape (n,) [rad/s].
        """
        own = inertia.diagonal()
        stiffness = self.bandwidth**2 * inertia + np.diag((fastest**2 - self.bandwidth**2) * own)
        squares, modes = eigh(stiffness, inertia)  # modesᵀ M_d modes = 1
        moved = inertia @ modes
        damping = 2.0 * self.damping_ratio * (moved * np.sqrt(squares)) @ moved.T
        return stiffness, 0.5 * (damping + damping.T)

    def _held(self, damping: Array) -> tuple[float, Array]:
        """Return what a held torque takes of a velocity, λ_max(hM⁻¹C) without friction, and of which, shape (n,).

        With friction it is over what it may take, M X coth(X/2), times 2.
        """
        scales = self._scales
        values, vectors = np.linalg.eigh(PERIOD * (scales @ damping @ scales.transpose(0, 2, 1)))
        worst = int(np.argmax(values[:, -1]))
        return float(values[worst, -1]), scales[worst].T @ vectors[worst, :, -1]

    @lazy
    def _scales(self) -> Array:
        """S of each posture with S⁻¹S⁻ᵀ = ½M X coth(X/2), X = hM⁻¹D of moving joints, shape (postures, n, n)."""
        found = []
        for seen in self._everywhere:
            inverse = np.linalg.inv(np.linalg.cholesky(seen.inertia))
            rates, axes = np.linalg.eigh(PERIOD * (inverse @ seen.moving @ inverse.T))
            half = np.maximum(0.5 * rates, 1e-8)  # where x coth x is 1
            found.append((axes / np.sqrt(half / np.tanh(half))).T @ inverse)
        return np.array(found)

    @lazy
    def _everywhere(self) -> list[_Seen]:
        """The arm at the goal, at home, and at postures drawn from its limits."""
        robot, generator = self.system.robot, np.random.default_rng(0)
        postures = [self.posture, robot.home, *(robot.random_position(generator) for _ in range(_POSTURES))]
        fast = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, _FAST)
        found = []
        for posture in postures:
            x = self.system.at(posture)
            moving = self.system.at(posture, fast).damping_matrix
            found.append(_Seen(x.mass_matrix, x.damping_matrix, 0.5 * (moving + moving.T)))
        return found
