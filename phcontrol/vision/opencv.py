"""OpenCV, loaded when it is used."""

from __future__ import annotations

from typing import Any

from phcontrol.exceptions import PHControlError


def load_opencv() -> Any:
    """Return the module cv2. Raises PHControlError, saying how to install it."""
    try:
        import cv2
    except ImportError as error:
        raise PHControlError("images need OpenCV: pip install 'phcontrol[vision]'") from error
    return cv2
