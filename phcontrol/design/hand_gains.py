"""The stiffness and damping of a hand for a bandwidth and a damping ratio."""

from __future__ import annotations

from typing import Any

import numpy as np

from phcontrol._validation import Array, positive
from phcontrol.controllers.cartesian_law import CartesianLaw
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.specification import Choice
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics import kernels
from phcontrol.poles.poles import SHARE

_FELT = 0.02  # of the desired damping, from which friction counts
_SINGULAR = 1e-6  # smallest eigenvalue of the hand's mobility over the largest, in natural units
_LENGTH = 0.3  # with which radians are compared to metres [m]


class HandModes:
    """The hand of a Cartesian law at its rest: mobility, and the modes that a stiffness gives it."""

    def __init__(self, problem: DesignProblem) -> None:
        law = problem.make()
        assert isinstance(law, CartesianLaw)
        x = problem.state
        self.rotates = law.rotational_stiffness is not None
        self.rows = 6 if self.rotates else 3
        self.task = x.task_space(law.frame, self.rows)
        self.law, self.inertia, self.friction = law, x.mass_matrix, problem.friction
        self.turn: Array = np.array(x.frame_kinematics(law.frame).rotation)
        units = np.array([1.0, 1.0, 1.0, _LENGTH, _LENGTH, _LENGTH])[: self.rows]
        spread = np.linalg.eigvalsh(self.task.mobility * units[:, None] * units)
        if spread[0] < _SINGULAR * spread[-1]:
            raise PHControlError(
                f"the hand '{law.frame}' is in a singular posture at {problem.posture}: it has no bandwidth there in "
                "every direction. Give another goal"
            )

    def stiffness(self, linear: Array, turning: Array | None) -> Array:
        """Return K in the axes of the world, shape (rows, rows)."""
        K: Array = np.zeros((self.rows, self.rows))
        K[:3, :3] = linear
        if turning is not None:
            K[3:, 3:] = turning
        return K

    def squares(self, stiffness: Array) -> Array:
        """Return ω² of the modes, those of B K, slowest first [1/s²]."""
        root = _root(stiffness)
        values: Array = np.asarray(np.linalg.eigvalsh(root @ self.task.mobility @ root), dtype=float)
        return values

    def damping(self, stiffness: Array, ratio: float) -> Array:
        """Return D_x that gives every mode the ratio, shape (rows, rows)."""
        linear = _root(stiffness[:3, :3])
        turning, axes = (_root(stiffness[3:, 3:]), np.eye(3)) if self.rotates else (None, None)
        factor = kernels.damping_root(linear, turning, axes, self.task.mobility, ratio)
        damping: Array = factor @ factor.T
        return damping

    def felt_friction(self) -> Array:
        """Return the friction of the joints as a damping of the hand, Λ𝒥M⁻¹D M⁻¹𝒥ᵀΛ."""
        lever = np.linalg.solve(self.task.mobility, self.task.jacobian @ np.linalg.inv(self.inertia))
        felt: Array = lever @ self.friction @ lever.T
        return felt

    def arguments(self, linear: Array, turning: Array | None) -> dict[str, Any]:
        """Return K_t and K_r in the axes that the law takes them in."""
        goal = self.turn
        made: dict[str, Any] = {
            "translational_stiffness": _even(goal.T @ linear @ goal if self.law.axes == "tool" else linear)
        }
        if turning is not None:
            made["rotational_stiffness"] = _even(goal.T @ turning @ goal)
        return made

    def damping_arguments(self, stiffness: Array, ratio: float) -> tuple[dict[str, Any], bool, tuple[str, ...]]:
        """Return ζ, or D_x where the joints' friction is a part of it; whether that can be; and what is to be said."""
        if not self.friction.any():
            return {"damping_ratio": ratio}, True, ()
        desired, felt = self.damping(stiffness, ratio), self.felt_friction()
        inverse = np.linalg.inv(np.linalg.cholesky(desired))
        share = float(np.linalg.eigvalsh(inverse @ felt @ inverse.T)[-1])
        if share <= _FELT:
            return {"damping_ratio": ratio}, True, ()
        if share <= 1.0 - SHARE:
            note = "the joints' friction is a part of the damping: D_x is that of this posture, in world axes"
            return {"task_damping": _even(desired - felt)}, True, (note,)
        note = f"the friction around rest alone damps the hand {share:.2g} times as much as is desired: ζ is larger"
        return {"damping_ratio": ratio}, False, (note,)


def hand_gains(problem: DesignProblem, bandwidth: float, damping_ratio: float) -> Choice:
    """Return K_t and K_r that put the hand's slowest modes at ω, all with ζ.

    With B = 𝒥M⁻¹𝒥ᵀ the squares of the frequencies are the eigenvalues of B K. K = ω²B⁻¹ would make all ω², but
    couples translation with rotation, which K_t and K_r do not. With B_tt^(−½)B_trB_rr^(−½) = U diag(ρ) Vᵀ,

        K_t = ω²B_tt^(−½)U diag(1/(1 − ρ))UᵀB_tt^(−½),   K_r = ω²B_rr^(−½)V diag(1/(1 − ρ))VᵀB_rr^(−½)

    make three pairs of modes, in each one at ω and one at ω((1 + ρ)/(1 − ρ))^½: the nearest that there can be.
    """
    omega, ratio = positive("bandwidth", bandwidth), positive("damping_ratio", damping_ratio)
    hand, square = HandModes(problem), bandwidth**2
    B, notes = hand.task.mobility, []
    if hand.rotates:
        still, turned = _root(B[:3, :3], -0.5), _root(B[3:, 3:], -0.5)
        U, rho, V = np.linalg.svd(still @ B[:3, 3:] @ turned)
        rates = square / (1.0 - rho)
        linear: Array = still @ (U * rates) @ U.T @ still
        turning: Array | None = turned @ (V.T * rates) @ V @ turned
        fastest = float(np.sqrt((1.0 + rho[0]) / (1.0 - rho[0])))
        notes.append(
            f"three modes of the hand are at ω, three are faster, up to {fastest:.3g} ω: K_t and K_r do not couple "
            "translation with rotation, as the inertia does"
        )
    else:
        linear, turning = square * _root(B, -1.0), None
    K = hand.stiffness(linear, turning)
    damping, exact, more = hand.damping_arguments(K, ratio)
    gains = hand.arguments(linear, turning) | damping
    if len(hand.inertia) > hand.rows:
        gains["nullspace_damping"] = omega
    poles = np.concatenate([np.roots([1.0, 2.0 * ratio * w, w**2]) for w in np.sqrt(hand.squares(K))])
    return Choice(gains, poles.astype(complex), exact, (*notes, *more))


def _root(matrix: Array, power: float = 0.5) -> Array:
    """Return a power of a positive definite matrix, by default its symmetric square root."""
    values, vectors = np.linalg.eigh(matrix)
    root: Array = (vectors * values**power) @ vectors.T
    return root


def _even(matrix: Array) -> Array:
    even: Array = 0.5 * (matrix + matrix.T)
    return even
