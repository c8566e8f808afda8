"""The port-Hamiltonian system that a law promises."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.exceptions import AnswerError, InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState

Blocks = Mapping[tuple[str, str], Array]
"""Blocks of a matrix by the names of their rows and columns. Of a block off the diagonal its mirror image follows."""
Part = tuple[Array, Array]
"""Coordinates, and the derivative of H_d with respect to them."""

DrivenParts = tuple[Mapping[str, Array], Array]
"""How a signal enters the rows of parts, by name, and the signal."""

MOMENTUM = "momentum"
"""Name of the part p̂, which every target has: the one on which torques act."""


class Drive(NamedTuple):
    """What moves a closed loop beside its energy and f_e: a goal that moves, a force that is desired.

    It comes from outside: ``signal`` depends on time and measurements alone, never on the state of arm or controller,
    and it enters no row of a momentum (that would be a torque, and no promise).
    """

    port: Array
    """How the signal enters, shape (len(x), k)."""
    signal: Array
    """Shape (k,)."""


class Target:
    """The port-Hamiltonian system that a law promises: ẋ = (J − R)∇H_d + port·f_e, at one state.

    Args:
        coordinates: x, for instance (q̃, p̂, z).
        interconnection: J_d, skew-symmetric; or a function that returns it when it is asked for.
        dissipation: R_d, symmetric positive semidefinite; likewise.
        gradient: ∇H_d with respect to x.
        port: how f_e enters, shape (len(x), n); likewise.
        drive: what else moves x; only of a law that says what it is driven by (``Controller.driven_by``), unless it
            brings no energy in.
        parts: where in x the parts are, by name. One is the momentum p̂, one each of the law's own states has the
            state's name.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Target
        >>> target = Target.of({"error": (np.ones(1), np.ones(1)), "momentum": (np.zeros(1), np.zeros(1))},
        ...                    interconnection={("error", "momentum"): np.eye(1)})
        >>> target.interconnection
        array([[ 0.,  1.],
               [-1.,  0.]])
    """

    def __init__(
        self,
        coordinates: Array,
        interconnection: Array | Callable[[], Array],
        dissipation: Array | Callable[[], Array],
        gradient: Array,
        port: Array | Callable[[], Array],
        drive: Drive | None = None,
        parts: Mapping[str, slice] | None = None,
    ) -> None:
        self.coordinates, self.gradient, self.drive = coordinates, gradient, drive
        self.parts: Mapping[str, slice] = {} if parts is None else parts
        self._matrices = (interconnection, dissipation, port)

    @classmethod
    def of(
        cls,
        parts: Mapping[str, Part],
        interconnection: Blocks | Callable[[], Blocks],
        dissipation: Blocks | Callable[[], Blocks] = {},  # noqa: B006 - never written to
        port: Mapping[str, Array] | Callable[[], Mapping[str, Array]] = {},  # noqa: B006
        drive: DrivenParts | None = None,
    ) -> Target:
        """Make a target of named parts and blocks.

        Args:
            parts: coordinates and gradient of each part, in order.
            interconnection: blocks of J_d by (row, column); the block (column, row) is minus the transpose, unless
                it is given too. Functions are called when the matrix is asked for.
            dissipation: blocks of R_d; (column, row) is the transpose.
            port: how f_e enters the rows of a part.
            drive: how a signal enters them, and the signal.
        """
        if MOMENTUM not in parts:
            raise InvalidArgumentError("target", f"has no part '{MOMENTUM}', but {', '.join(map(repr, parts))}")
        slices, end = {}, 0
        for name, (coordinates, gradient) in parts.items():
            for what, value in (("coordinates", coordinates), ("gradient", gradient)):
                if np.ndim(value) != 1:
                    message = f"part '{name}': its {what} must be a vector, but have {np.ndim(value)} dimensions"
                    raise InvalidArgumentError("target", message)
            if len(coordinates) != len(gradient):
                message = f"part '{name}' has {len(coordinates)} coordinates, but a gradient of {len(gradient)}"
                raise InvalidArgumentError("target", message)
            slices[name] = slice(end, end := end + len(coordinates))

        def matrix(blocks: Blocks | Callable[[], Blocks], mirror: float) -> Array:
            result, given = np.zeros((end, end)), blocks() if callable(blocks) else blocks
            for (row, column), block in given.items():
                place = _entries(f"block ('{row}', '{column}')", slices, row, column)
                _check_block(f"block ('{row}', '{column}')", block, result[place].shape)
                result[place] = block
                if row != column and (column, row) not in given:
                    result[slices[column], slices[row]] = mirror * block.T
            return result

        def entry(blocks: Mapping[str, Array], width: int) -> Array:
            result = np.zeros((end, width))
            for row, block in blocks.items():
                place = _entries(f"entry of a force into '{row}'", slices, row)[0]
                _check_block(f"entry of a force into '{row}'", block, result[place].shape)
                result[place] = block
            return result

        return cls(
            np.concatenate([coordinates for coordinates, _ in parts.values()]),
            lambda: matrix(interconnection, -1.0),
            lambda: matrix(dissipation, 1.0),
            np.concatenate([gradient for _, gradient in parts.values()]),
            lambda: entry(port() if callable(port) else port, len(parts[MOMENTUM][0])),
            None if drive is None else Drive(entry(drive[0], len(drive[1])), drive[1]),
            slices,
        )

    @classmethod
    def mechanical(
        cls,
        x: MechanicalState,
        interconnection: str,
        *,
        error: Array,
        gradient: Array,
        damping: Array,
        momentum: Array | None = None,
        coupling: Array | None = None,
    ) -> Target:
        """Return the target of a potential Ψ(error) and a damper in place of the arm's own potential, on (error, p̂).

            [[0, A T⁻ᵀ], [−T⁻¹Aᵀ, J̄₂ − D̄ − ḠCḠᵀ]] ∇H_d,   H_d = ½|p̂|² + Ψ,   f_e enters as [0; T⁻¹]

        Args:
            x: the state.
            interconnection: which J̄₂, "coriolis" or "canonical".
            error: what Ψ is written in, mostly q − q_d [rad].
            gradient: ∂Ψ/∂error.
            damping: C, shape (n, n) [N·m·s/rad].
            momentum: p̂, by default p̄.
            coupling: A T⁻ᵀ, where the error's rate is A T⁻ᵀp̂; T⁻ᵀ by default.
        """
        p = x.transformed_momentum if momentum is None else momentum
        return cls.of(
            {"error": (error, gradient), MOMENTUM: (p, p)},
            lambda: {
                ("error", MOMENTUM): x.inverse_factor.T if coupling is None else coupling,
                (MOMENTUM, MOMENTUM): x.interconnection(interconnection),
            },
            lambda: {(MOMENTUM, MOMENTUM): x.transformed_damping + x.transformed_injection(damping)},
            lambda: {MOMENTUM: x.inverse_factor},
        )

    @lazy
    def interconnection(self) -> Array:
        """J_d, skew-symmetric."""
        return _value(self._matrices[0])

    @lazy
    def dissipation(self) -> Array:
        """R_d, symmetric positive semidefinite."""
        return _value(self._matrices[1])

    @lazy
    def port(self) -> Array:
        """How f_e enters, shape (len(x), n)."""
        return _value(self._matrices[2])

    @property
    def momentum(self) -> Array:
        """The part p̂. Raises InvalidArgumentError when no part is named so."""
        if MOMENTUM not in self.parts:
            raise InvalidArgumentError("target", "has no part 'momentum', from which the torque follows: see Target.of")
        return self.coordinates[self.parts[MOMENTUM]]

    def rate(self, external_force: Array | None = None) -> Array:
        """Return ẋ as promised, under an external force [N·m]; without one, what it adds is left out."""
        rate: Array = (self.interconnection - self.dissipation) @ self.gradient
        if external_force is not None:
            rate += self.port @ external_force
        return rate if self.drive is None else rate + self.driven()

    def driven(self) -> Array:
        """Return the part of ẋ that the drive makes."""
        return np.zeros(len(self.gradient)) if self.drive is None else self.drive.port @ self.drive.signal


def check_target(target: object, law: type) -> None:
    """Raise AnswerError unless what a law states as its target is one."""
    if not isinstance(target, Target):
        raise AnswerError(
            law, "target", f"returned {None if target is None else type(target).__name__}, expected a Target"
        )


def _entries(what: str, slices: Mapping[str, slice], *names: str) -> tuple[slice, ...]:
    for name in names:
        if name not in slices:
            raise InvalidArgumentError("target", f"{what} names no part; there are {', '.join(map(repr, slices))}")
    return tuple(slices[name] for name in names)


def _check_block(what: str, block: Array, shape: tuple[int, ...]) -> None:
    if np.shape(block) != shape:
        raise InvalidArgumentError("target", f"{what} must have shape {shape}, but has shape {np.shape(block)}")


def joined(first: DrivenParts, second: DrivenParts) -> DrivenParts:
    """Return two drives of different parts as one."""
    (ports, signal), (other_ports, other) = first, second
    before = {name: np.hstack([port, np.zeros((len(port), len(other)))]) for name, port in ports.items()}
    after = {name: np.hstack([np.zeros((len(port), len(signal))), port]) for name, port in other_ports.items()}
    return before | after, np.concatenate([signal, other])


def _value(matrix: Array | Callable[[], Array]) -> Array:
    return matrix() if callable(matrix) else matrix
