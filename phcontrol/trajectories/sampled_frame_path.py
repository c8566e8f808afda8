"""The path of a frame from samples of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import finite_array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.interpolated_path import InterpolatedPath, quaternions
from phcontrol.trajectories.pose import rotation
from phcontrol.trajectories.splines import SampledTrajectory


class SampledFramePath(InterpolatedPath):
    """The path of a frame from samples, as a recording or a planner gives them.

    Position and quaternion are interpolated, or smoothed, as :class:`SampledTrajectory` does it. The ends are taken as
    they are: unless the motion begins and ends at rest, its twist jumps there. ``read_frame_path`` reads one
    from a file.

    Args:
        frame: name of the link or frame that moves.
        times: increasing, shape (m,) [s].
        positions: shape (m, 3) [m]; at least two, with smoothing at least five.
        rotations: rotation matrices, shape (m, 3, 3), two that follow each other less than half a turn apart;
            None leaves the orientation free.
        smoothing: λ ≥ 0 [s³]; 0 passes every sample.

    Example:
        >>> import numpy as np
        >>> from phcontrol import SampledFramePath
        >>> t = np.linspace(0.0, 2.0, 41)
        >>> path = SampledFramePath("hand", t, np.stack([0.5 + 0.1 * np.cos(t), 0.1 * np.sin(t), 0.0 * t], axis=1))
        >>> path.at(1.0).position.round(4)
        array([0.554 , 0.0841, 0.    ])
    """

    def __init__(
        self,
        frame: str,
        times: ArrayLike,
        positions: ArrayLike,
        rotations: ArrayLike | None = None,
        *,
        smoothing: float = 0.0,
    ) -> None:
        columns = finite_array("positions", positions)
        if columns.ndim != 2 or columns.shape[1] != 3:
            raise InvalidArgumentError("positions", f"must have shape (samples, 3), but has shape {columns.shape}")
        if rotations is not None:
            turns = finite_array("rotations", rotations)
            if turns.shape != (len(columns), 3, 3):
                expected = (len(columns), 3, 3)
                raise InvalidArgumentError("rotations", f"must have shape {expected}, but has shape {turns.shape}")
            exact = [rotation(f"rotations[{k}]", turn) for k, turn in enumerate(turns)]
            columns = np.hstack([columns, quaternions("rotations", exact)])
        super().__init__(frame, SampledTrajectory(times, columns, smoothing=smoothing))
