"""How the motion of a closed loop changes with everything that it depends on, by the chain rule."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phcontrol._validation import Array


@dataclass(frozen=True)
class LoopJacobian:
    """Derivatives of a closed loop ẏ = f(y, f_e, t), y = (q, q̇, controller state), at one instant; in SI units.

    Kept in parts, so that a loop whose torque is held can be made of them too: of the plant q̈(q, q̇, u, f_e), of what
    is measured m(q, q̇, f_e), and of the law (u, ż)(q, q̇, z, m, t). Those with respect to numbers have as many columns
    as were asked for.

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, MechanicalSystem, linearize, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> linear = linearize(EnergyShaping.tuned(system), system, exact=False)
        >>> jacobian = linear.jacobian
        >>> jacobian.joints, np.allclose(jacobian.state, linear.A)
        (2, True)
    """

    plant: Array = field(repr=False)
    """∂q̈/∂(q, q̇), shape (n, 2n)."""
    plant_torque: Array = field(repr=False)
    """∂q̈/∂u, shape (n, n)."""
    plant_force: Array = field(repr=False)
    """∂q̈/∂f_e, shape (n, n)."""
    measured: Array = field(repr=False)
    """∂m/∂(q, q̇), shape (k, 2n)."""
    measured_force: Array = field(repr=False)
    """∂m/∂f_e, shape (k, n)."""
    law: Array = field(repr=False)
    """∂(u, ż)/∂(q, q̇, z), shape (n + s, 2n + s)."""
    law_measured: Array = field(repr=False)
    """∂(u, ż)/∂m, shape (n + s, k)."""
    law_time: Array = field(repr=False)
    """∂(u, ż)/∂t, shape (n + s,)."""
    law_numbers: Array = field(repr=False)
    """∂(u, ż)/∂p of the law's own numbers, shape (n + s, p)."""
    plant_inertias: Array = field(repr=False)
    """∂q̈/∂π of the plant's inertial parameters, shape (n, 10 a body)."""
    measured_inertias: Array = field(repr=False)
    """∂m/∂π, shape (k, 10 a body)."""

    @property
    def joints(self) -> int:
        """The number of joints n."""
        return len(self.plant)

    @property
    def command(self) -> Array:
        """∂(u, ż)/∂y, with what is measured following the plant, shape (n + s, 2n + s)."""
        whole: Array = self.law.copy()
        whole[:, : 2 * self.joints] += self.law_measured @ self.measured
        return whole

    @property
    def command_force(self) -> Array:
        """∂(u, ż)/∂f_e, shape (n + s, n)."""
        whole: Array = self.law_measured @ self.measured_force
        return whole

    @property
    def state(self) -> Array:
        """∂ẏ/∂y, shape (2n + s, 2n + s)."""
        n, rate = self.joints, self._closed(self.command)
        rate[:n, n : 2 * n] = np.eye(n)
        rate[n : 2 * n, : 2 * n] += self.plant
        return rate

    @property
    def force(self) -> Array:
        """∂ẏ/∂f_e, shape (2n + s, n)."""
        n, rate = self.joints, self._closed(self.command_force)
        rate[n : 2 * n] += self.plant_force
        return rate

    @property
    def time(self) -> Array:
        """∂ẏ/∂t, shape (2n + s,)."""
        return self._closed(self.law_time[:, None])[:, 0]

    @property
    def numbers(self) -> Array:
        """∂ẏ/∂p of the law's numbers, shape (2n + s, p)."""
        return self._closed(self.law_numbers)

    @property
    def inertias(self) -> Array:
        """∂ẏ/∂π of the plant's inertias, the law's model as it is, shape (2n + s, 10 a body)."""
        n, rate = self.joints, self._closed(self.law_measured @ self.measured_inertias)
        rate[n : 2 * n] += self.plant_inertias
        return rate

    def _closed(self, command: Array) -> Array:
        """Return what a change of (u, ż) makes of ẏ, column by column."""
        n = self.joints
        rate: Array = np.zeros((n + len(command), command.shape[1]))
        rate[n : 2 * n] = self.plant_torque @ command[:n]
        rate[2 * n :] = command[n:]
        return rate
