"""Which torques effort and rate limits allow: of the motors, and of what is sent to a robot that adds its own part."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.safety.clipping import clipped


class RobotShare(NamedTuple):
    """What a robot adds by itself to the torque that it is sent: its weight, G⁻¹g(q), shape (n,) each [N·m]."""

    now: Array
    """In the coming period."""
    before: Array
    """In the period before."""
    held: Array | None = None
    """What its motors still carry, where it missed the torque that was sent last, so that the next one must be within
    a step of this too; None where it did not."""


def torque_range(
    effort: Array, step: Array, previous: Array | None = None, share: RobotShare | None = None
) -> tuple[Array, Array]:
    """Return the lowest and the highest torque that the motors may carry, shape (n,) each [N·m].

        |u| ≤ effort,  |u − u₋| ≤ step,   and where a robot adds s itself, so that u − s is sent,
        |u − s| ≤ effort,  |(u − s) − (u₋ − s₋)| ≤ step.

    A previous torque beyond the effort counts as at it. Where the four contradict each other, which takes a weight
    beyond the effort or one that changes by more than two steps at once, the middle is left, within the effort.

    Args:
        effort: of the motors, infinite for no limit, shape (n,) [N·m].
        step: the largest change from one period to the next, infinite for no limit, shape (n,) [N·m].
        previous: u₋, what the motors carried; None leaves the steps out.
        share: s and s₋; None where the robot adds nothing.

    >>> import numpy as np
    >>> share = RobotShare(now=np.array([30.0]), before=np.array([30.0]))
    >>> torque_range(np.array([40.0]), np.array([1.0]), np.array([-9.5]), share)
    (array([-10.]), array([-8.5]))
    """
    if share is None:
        if previous is None:
            return -effort, effort
        start = clipped(previous, -effort, effort)
        return np.maximum(start - step, -effort), np.minimum(start + step, effort)
    low, high = np.maximum(share.now, 0.0) - effort, np.minimum(share.now, 0.0) + effort
    if previous is not None:
        for last in (previous, share.held):
            if last is not None:
                start = clipped(last, -effort, effort)
                moved = start + (share.now - share.before)
                low = np.maximum(low, np.maximum(start, moved) - step)
                high = np.minimum(high, np.minimum(start, moved) + step)
    contrary = low > high
    if np.logical_or.reduce(contrary):
        middle = clipped(0.5 * (low + high), -effort, effort)
        low, high = np.where(contrary, middle, low), np.where(contrary, middle, high)
    return low, high
