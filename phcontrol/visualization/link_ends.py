"""Where a link ends that nothing hangs on."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array

_SHORT = 1e-3  # [m], below which a link has no length to be drawn
_LINKS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)


def link_end(model: pin.Model, joint: int) -> Array | None:
    """Return the far end of the last link of a chain, in the frame of its joint, shape (3,) [m].

    It is the frame on the link that is furthest from the joint; without one, twice as far as the centre of mass. None
    where a further joint follows, which shows the link's length, and for a link of no length.
    """
    if any(parent == joint for parent in model.parents[1:]):
        return None
    ends = [
        frame.placement.translation for frame in model.frames if frame.parentJoint == joint and frame.type in _LINKS
    ]
    ends.sort(key=np.linalg.norm)
    for end in (*ends[-1:], 2.0 * model.inertias[joint].lever):
        if np.linalg.norm(end) > _SHORT:
            return np.array(end)
    return None
