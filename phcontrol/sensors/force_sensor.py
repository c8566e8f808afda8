"""A force sensor with the faults of real ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, finite_array, number, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState


@dataclass(frozen=True)
class _State:
    """What was sampled and is still on its way, oldest first, and the source of noise."""

    times: tuple[float, ...]
    values: tuple[Array, ...]
    shown: Array
    noise: np.random.Generator


class ForceSensor:
    """Shows the external generalised force f_e, or the total force f, of the joints.

    A sample is the truth, plus ``bias``, plus Gaussian noise, cut off at ±``saturation``; it is shown
    ``delay`` after it was taken and held until the next.

    Args:
        quantity: "external_force" for f_e, "total_force" for f (3.52).
        frame: of a wrench sensor mounted at that frame: it feels the wrench F with 𝒥ᵀF = f_e (least squares;
            exact when f_e comes from a wrench there), has its faults in the six components of F [N, N·m]
            in the frame's own axes, and shows 𝒥ᵀF. Of ``external_force`` only.
        noise: standard deviation, for each component or one for all [N·m].
        bias: likewise.
        delay: [s].
        period: time between samples [s]; None for every step of the loop.
        saturation: largest magnitude it can show, for each component or one for all; None for none.
        seed: of the noise.

    Example:
        >>> from phcontrol import ForceSensor, MechanicalSystem, load_robot, make_controller, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = make_controller("force_feedback_measured", system)
        >>> sensor = ForceSensor(noise=0.01, delay=2e-3, period=1e-3)  # [N·m], [s], [s]
        >>> log = simulate(system, law, duration=0.2, disturbance=[1.0, 0.0], sensors=[sensor])
        >>> log.measured["external_force"][-1].round(0)
        array([ 1., -0.])
    """

    def __init__(
        self,
        quantity: str = "external_force",
        *,
        frame: str | None = None,
        noise: ArrayLike = 0.0,
        bias: ArrayLike = 0.0,
        delay: float = 0.0,
        period: float | None = None,
        saturation: ArrayLike | None = None,
        seed: int = 0,
    ) -> None:
        self.quantity = choice("quantity", quantity, ("external_force", "total_force"))
        if frame is not None and quantity != "external_force":
            raise InvalidArgumentError("frame", "a wrench sensor at a frame shows external_force, not total_force")
        self.frame = frame
        self.noise, self.bias = finite_array("noise", noise), finite_array("bias", bias)
        if (self.noise < 0.0).any():
            raise InvalidArgumentError("noise", "must be >= 0")
        self.delay = number("delay", delay, minimum=0.0)
        self.period = None if period is None else positive("period", period)
        self.saturation = None if saturation is None else finite_array("saturation", saturation)
        if self.saturation is not None and (self.saturation <= 0.0).any():
            raise InvalidArgumentError("saturation", "must be > 0")
        self.seed = seed

    def start(self, x: MechanicalState, external_force: Array) -> _State:
        """Return the state before the first sample: it shows zero."""
        self._check_size("noise", self.noise, x)
        self._check_size("bias", self.bias, x)
        if self.saturation is not None:
            self._check_size("saturation", self.saturation, x)
        return _State((), (), np.zeros(x.system.n), np.random.default_rng(self.seed))

    def update(self, state: _State, t: float, x: MechanicalState, external_force: Array, torque: Array) -> _State:
        """Take a sample and show the newest that is ``delay`` old."""
        times, values = (*state.times, t), (*state.values, self._sample(state.noise, x, external_force))
        ripe = sum(time <= t - self.delay + 1e-9 for time in times)
        shown = values[ripe - 1] if ripe else state.shown
        return _State(times[ripe:], values[ripe:], shown, state.noise)

    def reading(self, state: _State) -> Array:
        """Return the force shown, shape (n,) [N·m]."""
        return state.shown

    def _sample(self, noise: np.random.Generator, x: MechanicalState, external_force: Array) -> Array:
        if self.frame is None:
            truth = external_force if self.quantity == "external_force" else x.total_force(external_force)
            return self._with_faults(noise, truth)
        jacobian = x.frame_jacobian(self.frame, "local")
        wrench = np.linalg.lstsq(jacobian.T, external_force, rcond=None)[0]
        force: Array = self._with_faults(noise, wrench).dot(jacobian)
        return force

    def _with_faults(self, noise: np.random.Generator, truth: Array) -> Array:
        value: Array = truth + self.bias
        if self.noise.any():
            value = value + self.noise * noise.standard_normal(truth.size)
        if self.saturation is not None:
            value = np.clip(value, -self.saturation, self.saturation)
        return value

    def _check_size(self, name: str, value: Array, x: MechanicalState) -> None:
        size = x.system.n if self.frame is None else 6
        if value.shape not in ((), (size,)):
            raise InvalidArgumentError(name, f"must be a scalar or have shape ({size},), but has shape {value.shape}")
