"""The measurements beside joint positions and velocities that a controller may need."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

from phcontrol._validation import Array, described
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.vision.scene import Scene


class Measured(NamedTuple):
    """What sensors show a controller at one instant. What was not measured is None.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Measured
        >>> Measured(external_force=np.array([1.0, 0.0])).features is None
        True
    """

    external_force: Array | None = None
    """f_e, shape (n,): generalised force of the environment on the joints [N·m]."""
    total_force: Array | None = None
    """f = −∂H/∂q − D q̇ + f_e, shape (n,): all forces but the motors' (3.52) [N·m]."""
    features: Array | None = None
    """τ = (μ, ν, l), shape (3,): where in the image an object is, and how long (5.1) [m]; NaN when not seen."""


NOTHING = Measured()
"""No measurement at all.

Example:
    >>> from phcontrol import NOTHING, Measured
    >>> NOTHING.external_force is None, NOTHING == Measured()
    (True, True)
"""


def measure_truly(
    x: MechanicalState,
    external_force: Array,
    quantities: Collection[str],
    scene: Scene | None = None,
    scene_state: Array | None = None,
) -> Measured:
    """Return what perfect sensors of the named quantities would show at a state of the plant, looking at a scene."""
    return Measured(
        external_force=external_force if "external_force" in quantities else None,
        total_force=x.total_force(external_force) if "total_force" in quantities else None,
        features=None
        if scene is None or "features" not in quantities
        else scene.features(x, scene.initial_state() if scene_state is None else scene_state),
    )


def check_needs(law: str, needs: Any) -> None:
    """Raise InvalidArgumentError or UnknownNameError unless ``needs`` of a law is a tuple of names of measurements."""
    if not isinstance(needs, tuple) or not all(isinstance(name, str) for name in needs):
        known = ", ".join(map(repr, Measured._fields))
        message = f'must be a tuple of names of {known}, like ("external_force",), but is {described(needs)}'
        raise InvalidArgumentError(f"{law}.needs", message)
    for name in needs:
        if name not in Measured._fields:
            raise UnknownNameError("measurement", name, Measured._fields, f" in {law}.needs")
