"""How a change of the torque reaches the storage function."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState


class PassivePort(NamedTuple):
    """How a change of the torque reaches the storage function: Ḣ_d = … − dissipated_power + outputᵀ(u − u★).

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping(system, goal=[0.0, 0.0], stiffness=20.0, damping=5.0)
        >>> x = system.at([0.1, 0.0], [0.2, -0.1])
        >>> port = law.passive_port(0.0, x, np.zeros(0))
        >>> np.allclose(port.output, x.velocity), bool(port.dissipated_power >= 5.0 * x.velocity @ x.velocity)
        (True, True)
    """

    output: Array
    """ŷ = Ḡᵀp̂, shape (n,) [rad/s]."""
    dissipated_power: float
    """∇H_dᵀR_d∇H_d ≥ 0 [W]."""
    resistance: Array
    """½∂(dissipated_power)/∂q̇ at a fixed D(q̇), shape (n,) [N·m]: the force by which the law, and friction, damp."""

    @classmethod
    def of(
        cls,
        x: MechanicalState,
        velocity: Array,
        injected: Array,
        sliding: Array | None = None,
        further_losses: float = 0.0,
    ) -> PassivePort:
        """Return the port of a law whose closed loop dissipates vᵀ(injected) + wᵀD(q̇)w + further losses.

        Args:
            x: the state.
            velocity: v = T⁻ᵀp̂, shape (n,) [rad/s].
            injected: the injected damping's force, mostly G C Gᵀv, shape (n,) [N·m].
            sliding: w, the velocity with which friction appears in the closed loop; None where it is compensated.
            further_losses: what does not depend on q̇ [W].
        """
        matrix = x.gears
        output = velocity if matrix is None else matrix.T.dot(velocity)
        power = further_losses + velocity.dot(injected)
        if sliding is not None and x.system.friction is not None:
            friction = x.resistance(sliding)
            power, injected = power + sliding.dot(friction), injected + friction
        return cls(output, float(power), injected)
