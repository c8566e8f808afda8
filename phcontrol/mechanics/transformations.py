"""Whether a transformation (Φ, U, β) of an arm is a generalised canonical one, and makes it passive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from phcontrol._validation import count
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.mechanics.transformed_system import (
    EnergyChange,
    InputChange,
    Structure,
    Transformation,
    TransformedSystem,
    transformed_system,
)

TOLERANCE = 1e-6


@dataclass(frozen=True)
class CanonicalCheck:
    """What was found at random points of (q, p, t).

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, check_canonical_transformation, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> unit_mass = lambda q, p, t: np.concatenate([q, system.at(q).solve_factor(p)])
        >>> nothing, no_input = lambda q, p, t: 0.0, lambda q, p, t: np.zeros(2)
        >>> check = check_canonical_transformation(unit_mass, nothing, no_input, system, samples=3)
        >>> check.samples, check.passed, check.residual < 1e-6
        (3, True, True)
    """

    samples: int
    residual: float
    """Largest entry of (2.25), divided by the largest of its terms at the same point (at least by 1)."""
    smallest_dissipation: float
    """Smallest eigenvalue of R + S, which must not be negative."""

    @property
    def passed(self) -> bool:
        """Whether the transformation turns the arm into another port-Hamiltonian system."""
        return self.residual <= TOLERANCE and self.smallest_dissipation >= -TOLERANCE


@dataclass(frozen=True)
class PassivityCheck:
    """What was found of Theorem 2.2.2 at random points of (q, p, t).

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, check_transformed_passivity, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> unit_mass = lambda q, p, t: np.concatenate([q, system.at(q).solve_factor(p)])
        >>> found = check_transformed_passivity(unit_mass, lambda q, p, t: 50.0, system, samples=3)
        >>> found.samples, found.residual < 1e-6
        (3, True)
    """

    samples: int
    growth: float
    """Largest H̄̇ − ȳᵀū, over the power of its terms: not positive for a passive system."""
    lowest_storage: float
    """Smallest H + U [J]; the theorem asks for H + U ≥ 0, which a constant in U can give."""
    residual: float
    """Largest entry of (2.25): whether the passive system is port-Hamiltonian in Φ."""
    printed_condition: float
    """Smallest left-hand side of (2.30) over the power of the terms. Where it is negative the thesis says that the
    system is not passive, and may be wrong (errata E31)."""

    @property
    def passed(self) -> bool:
        """Whether ū → ȳ is passive with the storage function H + U."""
        return self.growth <= TOLERANCE and self.lowest_storage >= -TOLERANCE


def check_canonical_transformation(
    transformation: Transformation,
    energy_change: EnergyChange,
    input_change: InputChange,
    system: MechanicalSystem,
    *,
    interconnection_change: Structure | None = None,
    dissipation_change: Structure | None = None,
    samples: int = 20,
    seed: int = 0,
    horizon: float = 10.0,
) -> CanonicalCheck:
    """Check the partial differential equation (2.25) at random points (:func:`transformed_system`).

    Args:
        transformation: Φ(q, p, t).
        energy_change: U(q, p, t) [J].
        input_change: β(q, p, t) [N·m].
        system: the arm.
        interconnection_change: K(q, p, t), zero when not given.
        dissipation_change: S(q, p, t), likewise; R + S must be positive semidefinite.
        samples: number of points.
        seed: of the random points.
        horizon: times are drawn from 0 to this [s].

    Raises InvalidArgumentError for a Φ whose coordinates do not determine (q, p), a K that is not skew, and an S that
    is not symmetric.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, check_canonical_transformation, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> unit_mass = lambda q, p, t: np.concatenate([q, system.at(q).solve_factor(p)])
        >>> stretched = lambda q, p, t: np.concatenate([2.0 * q, system.at(q).solve_factor(p)])
        >>> nothing, no_input = lambda q, p, t: 0.0, lambda q, p, t: np.zeros(2)
        >>> check_canonical_transformation(unit_mass, nothing, no_input, system, samples=3).passed
        True
        >>> check_canonical_transformation(unit_mass, lambda q, p, t: q @ q, no_input, system, samples=3).passed
        False
    """
    found = list(
        _points(transformation, energy_change, input_change, system, interconnection_change, dissipation_change,
                samples, seed, horizon)
    )  # fmt: skip
    return CanonicalCheck(samples, max(each.residual for each in found), min(each.least_dissipation for each in found))


def check_transformed_passivity(
    transformation: Transformation,
    energy_change: EnergyChange,
    system: MechanicalSystem,
    *,
    input_change: InputChange | None = None,
    interconnection_change: Structure | None = None,
    dissipation_change: Structure | None = None,
    samples: int = 20,
    seed: int = 0,
    horizon: float = 10.0,
) -> PassivityCheck:
    """Check that ū = u + β → ȳ = y + α is passive with the storage function H + U (Theorem 2.2.2), Φ and U in time too.

    Along the arm's own motion d/dt(H + U) − ȳᵀū = ∂(H + U)/∂xᵀ[(J − R)∂H/∂x − gβ] + ∂(H + U)/∂t: u drops out, by
    α = gᵀ∂U/∂x. Passive is what has none of it positive; that needs neither (2.25) nor K and S, which are asked for
    ``residual`` and (2.30) only. Where (2.25) holds it is −∂H̄ᵀ(R + S)∂H̄ and what H̄ grows by with time.

    Arguments are those of :func:`check_canonical_transformation`; without ``input_change`` β is that of (2.25).

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, check_transformed_passivity, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> unit_mass = lambda q, p, t: np.concatenate([q, system.at(q).solve_factor(p)])
        >>> check_transformed_passivity(unit_mass, lambda q, p, t: 50.0, system, samples=3).passed  # U = 50 J
        True
    """
    found = list(
        _points(transformation, energy_change, input_change, system, interconnection_change, dissipation_change,
                samples, seed, horizon)
    )  # fmt: skip
    unit = max(1e-300, float(np.median([each.power for each in found])))
    return PassivityCheck(
        samples,
        growth=max(each.growth / max(each.power, unit) for each in found),
        lowest_storage=min(each.storage for each in found),
        residual=max(each.residual for each in found),
        printed_condition=min(each.printed_condition / max(each.power, unit) for each in found),
    )


def _points(
    transformation: Transformation,
    energy_change: EnergyChange,
    input_change: InputChange | None,
    system: MechanicalSystem,
    interconnection_change: Structure | None,
    dissipation_change: Structure | None,
    samples: int,
    seed: int,
    horizon: float,
) -> Iterator[TransformedSystem]:
    """Yield what the transformation makes of the arm at random points."""
    count("samples", samples)
    generator = np.random.default_rng(seed)
    for _ in range(samples):
        position, velocity = system.robot.random_position(generator), generator.normal(size=system.n)
        time = float(generator.uniform(0.0, horizon))
        yield transformed_system(
            transformation,
            energy_change,
            system,
            position,
            system.at(position, velocity).momentum,
            time,
            input_change=input_change,
            interconnection_change=interconnection_change,
            dissipation_change=dissipation_change,
        )
