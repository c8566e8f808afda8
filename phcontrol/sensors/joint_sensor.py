"""The encoders of the joints with the faults of real ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, count, finite_array, number, per_joint
from phcontrol.exceptions import InvalidArgumentError

_APART = 1  # its noise is another than that of a ForceSensor with the same seed


class JointFaults(NamedTuple):
    """What is wrong with a reading of q and q̇, one number for each joint's position and then for each's velocity."""

    noise: Array
    """Standard deviations, shape (2n,)."""
    bias: Array
    """Shape (2n,)."""
    resolution: Array
    """Shape (2n,), 0 for none."""


@dataclass(frozen=True)
class _State:
    """What was read and is still on its way, oldest first, what is shown, and the source of noise."""

    times: tuple[float, ...]
    values: tuple[Array, ...]
    shown: Array
    faults: JointFaults
    noise: np.random.Generator


class JointSensor:
    """Shows a sampled law the position q and the velocity q̇ of the joints.

    A reading, one each step of the loop, is

        q̂ = r·round((q + b + ν)/r),   ν ~ N(0, σ²)

    with bias b, noise σ and resolution r (nothing is rounded for r = 0), and likewise of q̇. It is shown ``delay``
    after it was taken; until the first is so old, the first is shown. The law starts from what it is shown, and a
    momentum observer computes with it. Sensors of forces, cameras and the log's energies keep to the truth.

    Args:
        position_noise: σ of q, for each joint or one for all [rad].
        position_bias: b, likewise.
        position_resolution: r, likewise: 2π over the counts of an encoder.
        velocity_noise: σ of q̇, for each joint or one for all [rad/s].
        velocity_bias: b, likewise.
        velocity_resolution: r, likewise.
        delay: [s].
        seed: of the noise.

    Example:
        >>> from phcontrol import EnergyShaping, JointSensor, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law, sensor = EnergyShaping.tuned(system, [0.3, 0.2]), JointSensor(position_bias=0.02)  # [rad]
        >>> log = simulate(system, law, duration=4.0, dt=5e-3, control_period=5e-3, joint_sensor=sensor)
        >>> (log.measured["position"] - log.position)[-1].round(6), log.measured["position"][-1].round(2)
        (array([0.02, 0.02]), array([0.3, 0.2]))
    """

    def __init__(
        self,
        *,
        position_noise: ArrayLike = 0.0,
        position_bias: ArrayLike = 0.0,
        position_resolution: ArrayLike = 0.0,
        velocity_noise: ArrayLike = 0.0,
        velocity_bias: ArrayLike = 0.0,
        velocity_resolution: ArrayLike = 0.0,
        delay: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.position_noise = _not_negative("position_noise", position_noise)
        self.position_bias = finite_array("position_bias", position_bias)
        self.position_resolution = _not_negative("position_resolution", position_resolution)
        self.velocity_noise = _not_negative("velocity_noise", velocity_noise)
        self.velocity_bias = finite_array("velocity_bias", velocity_bias)
        self.velocity_resolution = _not_negative("velocity_resolution", velocity_resolution)
        self.delay = number("delay", delay, minimum=0.0)
        self.seed = count("seed", seed, minimum=0)

    def faults(self, n: int) -> JointFaults:
        """Return its faults for n joints. Raises InvalidArgumentError where they are for another number of joints."""
        given = (
            [per_joint(f"{of}_{name}", getattr(self, f"{of}_{name}"), n) for of in ("position", "velocity")]
            for name in JointFaults._fields
        )
        return JointFaults(*(np.concatenate(pair) for pair in given))

    def noise_source(self) -> np.random.Generator:
        """Return where its noise comes from: of each reading 2n standard normal numbers."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(_APART,)))

    def start(self, position: Array, velocity: Array) -> _State:
        """Return the state before the first reading, where it shows the truth."""
        faults = self.faults(position.size)
        return _State((), (), np.concatenate([position, velocity]), faults, self.noise_source())

    def update(self, state: _State, t: float, position: Array, velocity: Array) -> _State:
        """Take a reading and show the newest that is ``delay`` old."""
        reading = _read(state, position, velocity)
        times, values = (*state.times, t), (*state.values, reading)
        ripe = sum(time <= t - self.delay + 1e-9 for time in times)
        shown = values[ripe - 1] if ripe else reading if not state.times else state.shown
        return _State(times[ripe:], values[ripe:], shown, state.faults, state.noise)

    def reading(self, state: _State) -> tuple[Array, Array]:
        """Return q [rad] and q̇ [rad/s] as they are shown, shape (n,) each."""
        n = state.shown.size // 2
        return state.shown[:n], state.shown[n:]


def _read(state: _State, position: Array, velocity: Array) -> Array:
    faults = state.faults
    value: Array = np.concatenate([position, velocity]) + faults.bias
    if faults.noise.any():
        value = value + faults.noise * state.noise.standard_normal(value.size)
    rounded = faults.resolution > 0.0
    step = faults.resolution[rounded]
    value[rounded] = step * np.rint(value[rounded] / step)
    return value


def _not_negative(name: str, value: ArrayLike) -> Array:
    array = finite_array(name, value)
    if (array < 0.0).any():
        raise InvalidArgumentError(name, "must be >= 0")
    return array
