"""The rate of a stored energy against the powers that make it up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phcontrol._validation import Array


@dataclass(frozen=True)
class PowerBalance:
    """The rate of a stored energy against the powers that make it up, at every inner sample [W].

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> log = simulate(system, EnergyShaping.tuned(system, [0.2, 0.1]), duration=0.5, q0=[0.0, 0.0])
        >>> log.power_balance("plant").relative_residual < 1e-4
        True
    """

    time: Array
    rate: Array
    """Rate of the stored energy, by finite differences of fourth order over the samples."""
    supplied: Array
    dissipated: Array
    aging: Array
    """∂H_d/∂t at the same coordinates: what the clock alone adds, 0 for the energy of the arm and for most laws."""

    @property
    def residual(self) -> Array:
        """Difference rate − (supplied − dissipated + aging) [W]; zero for an exact run."""
        residual: Array = self.rate - (self.supplied - self.dissipated + self.aging)
        return residual

    @property
    def energy_drift(self) -> float:
        """Largest |∫residual dt| [J]: how much energy appeared or vanished up to any sample.

        Where a force has a kink (a touch) the residual has a narrow spike, and this says what it amounts to.
        """
        gained = np.cumsum(0.5 * (self.residual[1:] + self.residual[:-1]) * np.diff(self.time))
        return float(np.abs(gained).max(initial=0.0))

    @property
    def largest_residual(self) -> float:
        """Largest |residual| [W]."""
        return float(np.abs(self.residual).max(initial=0.0))

    @property
    def relative_residual(self) -> float:
        """Largest |residual| over the largest power."""
        power = max(
            float(np.abs(part).max(initial=0.0)) for part in (self.rate, self.supplied, self.dissipated, self.aging)
        )
        return self.largest_residual / power if power > 0.0 else 0.0
