"""MuJoCo's own reading of its files."""

from __future__ import annotations

import os
from typing import Any

from phcontrol.exceptions import RobotDescriptionError


def load_mujoco(purpose: str = "a MuJoCo plant") -> Any:
    """Return the module mujoco. Raises RobotDescriptionError, saying how to install it for a purpose."""
    try:
        import mujoco
    except ImportError as error:
        raise RobotDescriptionError(f"{purpose} needs MuJoCo: pip install 'phcontrol[mujoco]'") from error
    return mujoco


def compiled(path: str | os.PathLike[str], label: str) -> Any:
    """Return the MjModel of an MJCF file; ``label`` is what errors call it.

    Raises RobotDescriptionError where MuJoCo is not installed, or cannot read it.
    """
    mujoco = load_mujoco(f"{label}: an MJCF file")
    if not os.path.isfile(path):  # which raises nothing
        raise RobotDescriptionError(f"{label}: there is no such MJCF file")
    try:
        return mujoco.MjModel.from_xml_path(os.fspath(path))
    except Exception as error:  # MuJoCo raises several kinds
        raise RobotDescriptionError(f"{label}: MuJoCo cannot read it: {' '.join(str(error).split())}") from error
