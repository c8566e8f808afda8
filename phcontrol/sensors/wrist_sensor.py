"""A force and torque sensor in the wrist: without its offset and the weight of the tool behind it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, number, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem, check_system

_TOLD_APART = 1e-6  # the least of a singular value, of the largest, with which a parameter can be told


class Tool(NamedTuple):
    """What hangs on the sensor, fingers and load included.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Tool
        >>> Tool(mass=0.5, centre=np.array([0.0, 0.0, 0.1])).mass  # [kg]
        0.5
    """

    mass: float
    """[kg]."""
    centre: Array
    """Of its mass, in the sensor's frame, shape (3,) [m]."""


class WristSensor:
    """Makes the external force f_e of what a six-axis sensor between hand and arm reads.

        F_read = offset + weight + F,   weight = (m Rᵀγ, c × m Rᵀγ),   f_e = 𝒥ᵀF

    with R the sensor's rotation, γ the acceleration of gravity and 𝒥 the Jacobian of the sensor's frame, in its own
    axes. What the tool's inertia does to the sensor when it is accelerated stays in F, and so in f_e: about m times
    the hand's acceleration. The model of the arm has to hold the tool too, whose weight the motors carry.

    Args:
        system: the model of the arm.
        frame: the sensor's, in whose axes it reads.
        tool: what hangs on it; None for nothing.
        offset: what it reads without any load, shape (6,) [N, N·m]; ``tare`` measures it.

    Readings are of what acts on the tool: F first, then the torque about the frame's origin. A sensor that shows what
    the arm does to the tool has the other sign. Its ``tare`` and ``with_tool`` return another sensor.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, Tool, WristSensor, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> sensor = WristSensor(system, "tool", Tool(mass=0.5, centre=np.array([0.0, 0.0, 0.05])))
        >>> x = system.at(system.robot.home)
        >>> bool(np.abs(sensor.external_force(x, sensor.weight(x))).max() < 1e-12)  # the tool alone
        True
    """

    quantity = "external_force"

    def __init__(
        self, system: MechanicalSystem, frame: str, tool: Tool | None = None, *, offset: ArrayLike = (0.0,) * 6
    ) -> None:
        check_system(system)
        system.frame_id(frame)
        self.system, self.frame = system, frame
        self.tool = Tool(0.0, np.zeros(3)) if tool is None else tool
        number("tool.mass", self.tool.mass, minimum=0.0)
        vector("tool.centre", self.tool.centre, 3)
        self.offset: Array = np.array(vector("offset", offset, 6))

    def __repr__(self) -> str:
        return f"<WristSensor at {self.frame}, with {self.tool.mass:.3g} kg>"

    def weight(self, x: MechanicalState) -> Array:
        """Return what the tool's weight does to the sensor at a state, shape (6,) [N, N·m]."""
        force = self.tool.mass * self._down(x)
        return np.concatenate([force, np.cross(self.tool.centre, force)])

    def wrench(self, x: MechanicalState, reading: ArrayLike) -> Array:
        """Return F of a reading, in the sensor's frame, shape (6,) [N, N·m]."""
        wrench: Array = vector("reading", reading, 6) - self.offset - self.weight(x)
        return wrench

    def external_force(self, x: MechanicalState, reading: ArrayLike) -> Array:
        """Return f_e of a reading, shape (n,) [N·m]."""
        force: Array = self.wrench(x, reading) @ x.frame_jacobian(self.frame, "local")
        return force

    def tare(self, position: ArrayLike, readings: ArrayLike) -> WristSensor:
        """Return the sensor with the offset that makes F zero at a posture, where nothing touches the tool.

        Args:
            position: of the arm, at rest [rad].
            readings: one or many, shape (6,) or (k, 6) [N, N·m]; their mean counts.
        """
        mean = _rows("readings", readings, 6).mean(axis=0)
        return WristSensor(self.system, self.frame, self.tool, offset=mean - self.weight(self.system.at(position)))

    def with_tool(self, positions: Sequence[ArrayLike], readings: ArrayLike) -> WristSensor:
        """Return the sensor with the tool and the offset that readings at several postures tell, by least squares.

        Args:
            positions: k postures at rest [rad], in which nothing touches the tool and the hand points elsewhere each.
            readings: of each, shape (k, 6) [N, N·m].

        Raises InvalidArgumentError where the postures cannot tell mass, centre and offset apart: three hands
        can, in whose axes gravity has three directions.
        """
        wrenches = _rows("readings", readings, 6)
        if len(positions) != len(wrenches):
            raise InvalidArgumentError(
                "readings", f"must be one for each of {len(positions)} postures, not {len(wrenches)}"
            )
        rows = []
        for position in positions:
            down = self._down(self.system.at(position))
            row = np.zeros((6, 10))
            row[:3, 0], row[3:, 1:4] = down, -_cross(down)
            row[:, 4:] = np.eye(6)
            rows.append(row)
        matrix = np.concatenate(rows)
        sizes = np.linalg.svd(matrix, compute_uv=False)
        if len(matrix) < 10 or sizes[-1] < _TOLD_APART * sizes[0]:
            raise InvalidArgumentError(
                "positions", "do not tell the tool's weight from the sensor's offset: turn the hand to more directions"
            )
        found = np.linalg.lstsq(matrix, wrenches.ravel(), rcond=None)[0]
        if found[0] <= 0.0:
            raise InvalidArgumentError(
                "readings", f"say that the tool weighs {found[0]:.3g} kg: is their sign that of what acts on the tool?"
            )
        tool = Tool(float(found[0]), found[1:4] / found[0])
        return WristSensor(self.system, self.frame, tool, offset=found[4:])

    def _down(self, x: MechanicalState) -> Array:
        """Return Rᵀγ, shape (3,) [m/s²]."""
        down: Array = x.placement(self.frame).rotation.T @ np.asarray(self.system.model.gravity.linear)
        return down


def _cross(a: Array) -> Array:
    """Return [a]×."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _rows(name: str, values: ArrayLike, size: int) -> Array:
    rows = np.atleast_2d(finite_array(name, values))
    if rows.ndim != 2 or rows.shape[1] != size or not len(rows):
        raise InvalidArgumentError(name, f"must have shape ({size},) or (k, {size}), but has shape {rows.shape}")
    return rows
