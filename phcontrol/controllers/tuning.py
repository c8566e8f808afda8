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


class _Seen(NamedTuple):
    """What the arm is like at one posture."""

    inertia: Array
    """M, shape (n, n)."""
    damping: Array
    """d(0), shape (n,) [N·m·s/rad]."""


class Tuning:
    """What default gains are made from: the arm, and a bandwidth ω and damping ratio ζ where they are given.

    *With these* gains are exact at the goal: K_p = ω²M(q*) and C = 2ζωM(q*), full matrices, put every mode of energy
    shaping at ω and ζ. They are right near the goal: elsewhere M is another, and what M(q*) couples lightly may be
    heavy. Lead longer ways by a ``reference``.

    *Without* they suit all postures. With M_d = 2·mean of M over them, of which the diagonal is taken,

        K_p = max(ω²M_d, 0.8 d(0)),   C = 2ζ(K_pM_d)^½:

    M stays below about four times its mean, which leaves a damping ratio of ½^½ or more, and an overshoot of at most
    4.3 % of a step. Friction around rest, d(0), leaves a time constant of about a second. A torque that is
    held for h = 1 ms takes the velocity −hM⁻¹C on; it fades where the largest eigenvalue of that is below 2. Where the
    diagonal does not keep to that (long chains), the whole of M_d is taken, and if need be K_p and C are lowered.

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
        self._bandwidth = BANDWIDTH if bandwidth is None else positive("bandwidth", bandwidth)
        self.damping_ratio = DAMPING_RATIO if damping_ratio is None else positive("damping_ratio", damping_ratio)

    @property
    def stiffness(self) -> Array:
        """K_p, shape (n, n) [N·m/rad]."""
        return self._gains[0]

    @property
    def damping(self) -> Array:
        """C, shape (n, n) [N·m·s/rad]."""
        return self._gains[1]

    def amplification(self, most: float) -> float:
        """Return by how much forces may be amplified, A Y = A K_z Aᵀ: ``most``, or less where friction forbids it.

        The torque then holds A Y times the friction too, for PERIOD: A Y h λ_max(M⁻¹D) is kept below 1.
        """
        fastest = max(
            float(eigh(np.diag(seen.damping), seen.inertia, eigvals_only=True)[-1]) for seen in self._everywhere
        )
        return most if fastest <= 0.0 else min(most, 1.0 / (PERIOD * fastest))

    @lazy
    def _gains(self) -> tuple[Array, Array]:
        if self._desired:
            inertia = self.system.at(self.posture).mass_matrix
            return self._bandwidth**2 * inertia, 2.0 * self.damping_ratio * self._bandwidth * inertia
        inertia = _MARGIN * np.mean([seen.inertia for seen in self._everywhere], axis=0)
        diagonal = np.diag(inertia.diagonal())
        fastest = _HELD / (2.0 * self.damping_ratio * self._held(diagonal))
        if fastest >= self._bandwidth:
            return self._shaped(diagonal, fastest)
        stiffness, damping = self._shaped(inertia, np.inf)
        share = min(1.0, _HELD / self._held(damping))
        return share**2 * self._uncoupled(stiffness), share * damping

    def _uncoupled(self, stiffness: Array) -> Array:
        """Return K_p without what couples a continuous joint to others: there H_d would jump at half a turn."""
        turns = self.system.robot.continuous
        coupled = np.logical_or(turns[:, None], turns[None, :])
        np.fill_diagonal(coupled, False)
        result: Array = np.where(coupled, 0.0, stiffness)
        return result

    def _shaped(self, inertia: Array, fastest: float) -> tuple[Array, Array]:
        """Return K_p and C of a design inertia; every mode of (M_d, C, K_p) has the damping ratio ζ.

        For the sake of friction no joint is made stiffer than at the bandwidth ``fastest`` [rad/s].
        """
        stiffness, own = self._bandwidth**2 * inertia, inertia.diagonal()
        against_friction = np.minimum(_FRICTION * self._everywhere[0].damping, fastest**2 * own)
        stiffness = stiffness + np.diag(np.maximum(0.0, against_friction - self._bandwidth**2 * own))
        squares, modes = eigh(stiffness, inertia)  # modesᵀ M_d modes = 1
        moved = inertia @ modes
        damping = 2.0 * self.damping_ratio * (moved * np.sqrt(squares)) @ moved.T
        return stiffness, 0.5 * (damping + damping.T)

    def _held(self, damping: Array) -> float:
        """Return the largest eigenvalue of hM⁻¹C over all postures: what a held torque takes of a velocity."""
        return PERIOD * max(float(eigh(damping, seen.inertia, eigvals_only=True)[-1]) for seen in self._everywhere)

    @lazy
    def _everywhere(self) -> list[_Seen]:
        """The arm at the goal, at home, and at postures drawn from its limits."""
        robot, generator = self.system.robot, np.random.default_rng(0)
        postures = [self.posture, robot.home, *(robot.random_position(generator) for _ in range(_POSTURES))]
        states = [self.system.at(posture) for posture in postures]
        return [_Seen(x.mass_matrix, x.damping) for x in states]
