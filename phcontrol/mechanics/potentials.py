"""Potential energies beside gravity: springs of the mechanism itself."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, number, positive


class Potential(Protocol):
    """What a system needs of an extra potential V(q)."""

    def energy(self, position: Array) -> float:
        """Return V(q) [J]."""
        ...

    def gradient(self, position: Array) -> Array:
        """Return ∂V/∂q, shape (n,) [N·m]."""
        ...


class GripperSpring:
    """The PERA gripper's spring: one stiffness closing, another opening, with a smooth transition.

    With x = q − c_g and r = sqrt(a_f + x²):

        K_g(q) = ½(k₁ + k₂) − ½(k₁ − k₂) x/r                       (2.17), corrected: errata E4
        V(q)   = ¼(k₁ + k₂)x² − ¼(k₁ − k₂)(x r − a_f ln((x + r)/√a_f))    (2.18), corrected: errata E5

    so that ∂V/∂q = K_g(q) x and V(c_g) = 0: k₁ acts where the gripper closes beyond rest (q ≤ c_g).

    Args:
        closing_stiffness: k_g1 [N·m/rad].
        opening_stiffness: k_g2 [N·m/rad].
        rest_angle: c_g [rad].
        smoothing: a_f [rad²].

    Example:
        >>> from phcontrol import GripperSpring, MechanicalSystem, load_robot
        >>> spring = GripperSpring(closing_stiffness=0.6, opening_stiffness=0.3, rest_angle=0.1, smoothing=0.01)
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"), potentials=[spring])
        >>> gripper.at([0.1]).potential_gradient.round(3)  # at its rest angle [N·m]
        array([-0.042])
    """

    def __init__(
        self,
        *,
        closing_stiffness: float,
        opening_stiffness: float,
        rest_angle: float,
        smoothing: float,
    ) -> None:
        self.closing_stiffness = positive("closing_stiffness", closing_stiffness)
        self.opening_stiffness = positive("opening_stiffness", opening_stiffness)
        self.rest_angle = number("rest_angle", rest_angle)
        self.smoothing = positive("smoothing", smoothing)
        self._mean = 0.5 * (self.closing_stiffness + self.opening_stiffness)
        self._half_difference = 0.5 * (self.closing_stiffness - self.opening_stiffness)

    def stiffness(self, position: Array) -> Array:
        """Return K_g(q), elementwise [N·m/rad]."""
        offset = position - self.rest_angle
        stiffness: Array = self._mean - self._half_difference * offset / np.sqrt(self.smoothing + offset * offset)
        return stiffness

    def energy(self, position: Array) -> float:
        """Return V(q) [J]."""
        total = 0.0
        for offset in np.asarray(position - self.rest_angle).ravel().tolist():
            root = math.sqrt(self.smoothing + offset * offset)
            logarithm = math.asinh(offset / math.sqrt(self.smoothing))
            total += 0.5 * self._mean * offset**2
            total -= 0.5 * self._half_difference * (offset * root - self.smoothing * logarithm)
        return total

    def gradient(self, position: Array) -> Array:
        """Return ∂V/∂q = K_g(q)(q − c_g), shape (n,) [N·m]."""
        gradient: Array = self.stiffness(position) * (position - self.rest_angle)
        return gradient

    def tangent_stiffness(self, position: Array) -> Array:
        """Return the diagonal of ∂²V/∂q², ½(k₁ + k₂) − ½(k₁ − k₂)(2s − s³) with s = x/r, shape (n,) [N·m/rad]."""
        offset = position - self.rest_angle
        slope = offset / np.sqrt(self.smoothing + offset * offset)
        stiffness: Array = self._mean - self._half_difference * slope * (2.0 - slope * slope)
        return stiffness


class OnJoint:
    """A potential of one joint, as a potential of the whole arm.

    Args:
        potential: of a position of shape (1,).
        index: of the joint.
    """

    def __init__(self, potential: Potential, index: int) -> None:
        self.potential, self.index = potential, index

    def energy(self, position: Array) -> float:
        """Return V(q) [J]."""
        return self.potential.energy(position[self.index : self.index + 1])

    def gradient(self, position: Array) -> Array:
        """Return ∂V/∂q, shape (n,) [N·m]."""
        gradient = np.zeros_like(position)
        gradient[self.index] = self.potential.gradient(position[self.index : self.index + 1])[0]
        return gradient

    def tangent_stiffness(self, position: Array) -> Array:
        """Return the diagonal of ∂²V/∂q², shape (n,) [N·m/rad], of a potential that has one (``GripperSpring``)."""
        stiffness = np.zeros_like(position)
        own: Any = self.potential
        stiffness[self.index] = own.tangent_stiffness(position[self.index : self.index + 1])[0]
        return stiffness


class ConstantTorque:
    """A torque that joints carry wherever they are, an offset: V(q) = τᵀq, ∂V/∂q = τ.

    Args:
        torque: τ, shape (n,) [N·m].

    >>> import numpy as np
    >>> from phcontrol import ConstantTorque
    >>> ConstantTorque([1.0, -2.0]).gradient(np.zeros(2))
    array([ 1., -2.])
    """

    def __init__(self, torque: ArrayLike) -> None:
        self.torque = finite_array("torque", torque)

    def energy(self, position: Array) -> float:
        """Return τᵀq [J]."""
        return float(self.torque.dot(position))

    def gradient(self, position: Array) -> Array:
        """Return τ, shape (n,) [N·m]."""
        return self.torque
