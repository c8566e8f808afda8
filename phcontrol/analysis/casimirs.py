"""Whether the Casimir functions of Theorem 2.4.1 exist for a closed loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phcontrol._differences import jacobian
from phcontrol._validation import Array, count
from phcontrol.analysis.certify import require_certificate
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem

TOLERANCE = 1e-6
"""On the asymmetry: differences of differences leave 1e-9."""
_SINGULAR = 1e-12
_INNER, _OUTER = 1e-4, 1e-2  # of the finite differences, in natural units


@dataclass(frozen=True)
class CasimirCheck:
    """What was found of 𝒦(x) = −(J_d − R_d)⁻¹port at random states.

    Example:
        >>> from phcontrol import MechanicalSystem, casimirs, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> found = casimirs(make_controller("integral_action", system), system)
        >>> found.samples, found.regularity > 1e-6
        (4, True)
    """

    regularity: float
    """Smallest singular value of J_d − R_d over its largest; the theorem needs it invertible."""
    asymmetry: float
    """Largest |∂𝒦_ij/∂x_k − ∂𝒦_kj/∂x_i| over the largest |𝒦| (2.53), a natural unit away; infinite where there is no
    𝒦."""
    constancy: float
    """Largest |∂𝒦/∂x| in the same measure: where it is 0 too, the Casimirs are linear, 𝒞_j = Σᵢ𝒦_ij xᵢ, and H_r
    (2.56) is the Bregman form of ``Equilibrium.shifted_storage``."""
    samples: int

    @property
    def exist(self) -> bool:
        """Whether functions 𝒞_j with ∂𝒞_j/∂x = 𝒦_j exist, so that H_d − Σ f_e,j 𝒞_j is a Lyapunov function."""
        return self.asymmetry <= TOLERANCE

    @property
    def linear(self) -> bool:
        """Whether they are linear in the target's coordinates."""
        return self.constancy <= TOLERANCE


def casimirs(controller: Controller, system: MechanicalSystem, *, samples: int = 4, seed: int = 0) -> CasimirCheck:
    """Check the condition (2.53) of Theorem 2.4.1 for the closed loop under a constant external force.

    𝒦(x) = −(J_d − R_d)⁻¹port must be the gradient of functions 𝒞_j(x): the one-forms Σᵢ𝒦_ij dx_i must be closed. That
    does not depend on coordinates, so it is looked at in those of the arm, y = (q, q̇, controller state): with
    𝒥 = ∂x/∂y the derivative of 𝒥ᵀ𝒦 must be symmetric. Derivatives are finite differences.

    They exist for energy shaping, classical impedance, tracking and integral action, and for force feedback that
    measures f_e: there 𝒦 is constant. For force feedback of modeled forces 𝒦 = [0; (ḠCḠᵀ)⁻¹T⁻¹; …] and they exist for a
    constant mass matrix only (errata E34).

    Raises InvalidArgumentError for a law that is driven, sees an object or changes hands; PHControlError for one
    without a certificate on this system.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, casimirs, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> casimirs(EnergyShaping.tuned(system), system).samples
        4
    """
    count("samples", samples)
    driven = controller.driven_by or ("external_force" in controller.needs and _has_drive(controller, system))
    if driven or "features" in controller.needs or len(controller.phases) > 1:
        raise InvalidArgumentError("controller", f"{controller.name} is not a port-Hamiltonian loop with f_e alone")
    require_certificate(controller, system, "what is said of its Casimirs", rest=False)
    generator, n = np.random.default_rng(seed), system.n
    units = NaturalUnits.of(controller, system, 0.0).motion
    regularity, asymmetry, constancy = np.inf, 0.0, 0.0
    for _ in range(samples):
        here = np.concatenate(
            [system.robot.random_position(generator), generator.normal(size=n), controller.random_state(generator)]
        )
        promise = _seen(controller, system, here).promise()
        values = np.linalg.svd(promise.J - promise.R, compute_uv=False)
        regularity = min(regularity, float(values[-1] / values[0]))
        if regularity <= _SINGULAR:
            return CasimirCheck(regularity, np.inf, np.inf, samples)
        pulled = _pulled(controller, system, units)
        forms = float(np.abs(pulled(here)).max(initial=0.0))
        if forms == 0.0:  # no port: nothing is felt
            continue
        size = len(here)
        slope, _ = jacobian(lambda y: pulled(y).ravel(), here, units, _OUTER)  # noqa: B023 - called here
        derivative = (slope * units).reshape(size, n, size)  # ∂(𝒥ᵀ𝒦)_aj/∂y_b
        asymmetry = max(asymmetry, float(np.abs(derivative - derivative.transpose(2, 1, 0)).max()) / forms)
        bent, _ = jacobian(lambda y: _gradients(controller, system, y).ravel(), here, units, _OUTER)
        largest = float(np.abs(_gradients(controller, system, here)).max())
        constancy = max(constancy, float(np.abs(bent * units).max()) / largest)
    return CasimirCheck(regularity, asymmetry, constancy, samples)


def _seen(controller: Controller, system: MechanicalSystem, y: Array) -> Seen:
    n = system.n
    return Seen.of(controller, system, SampledState(0.0, y[:n], y[n : 2 * n], y[2 * n :], np.zeros(n), None, ""))


def _has_drive(controller: Controller, system: MechanicalSystem) -> bool:
    nothing = np.zeros(2 * system.n + controller.state_size)
    return bool(_seen(controller, system, nothing).promise().signal.size)


def _gradients(controller: Controller, system: MechanicalSystem, y: Array) -> Array:
    """Return 𝒦 = −(J_d − R_d)⁻¹port, shape (len(x), n) (2.46)."""
    promise = _seen(controller, system, y).promise()
    return np.asarray(np.linalg.solve(promise.R - promise.J, promise.port), dtype=float)


def _pulled(controller: Controller, system: MechanicalSystem, units: Array) -> Callable[[Array], Array]:
    """Return 𝒥ᵀ𝒦 in natural units, shape (len(y), n), as a function of y."""

    def pulled(y: Array) -> Array:
        slope, _ = jacobian(lambda there: _seen(controller, system, there).coordinates(), y, units, _INNER)
        forms: Array = (slope * units).T @ _gradients(controller, system, y)
        return forms

    return pulled
