"""Images of a marker as a camera would take them, made ray by ray."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

CELLS = 40  # pixels of the marker's picture along one of its cells


@cache
def rays(camera, fineness):
    """Points (x, y) of Z = 1 that are shown at each fine pixel, by OpenCV, shape (height, width, 2)."""
    width, height = camera.image_size
    columns = (np.arange(width * fineness) + 0.5) / fineness - 0.5
    rows = (np.arange(height * fineness) + 0.5) / fineness - 0.5
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
    distortion = np.array(camera.distortion or [0.0] * 5)
    if hasattr(cv2, "undistortPointsIter"):  # OpenCV 4
        points = cv2.undistortPointsIter(pixels, camera.matrix, distortion, np.eye(3), np.eye(3), criteria)
    else:
        points = cv2.undistortPoints(pixels, camera.matrix, distortion, criteria=criteria)
    return points.reshape(height * fineness, width * fineness, 2)


def picture_of(dictionary, identity):
    """The marker with a white rim of one cell, and how many cells it has along a side without that."""
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    cells = family.markerSize + 2
    marker = cv2.aruco.generateImageMarker(family, identity, CELLS * cells)
    return np.pad(marker, CELLS, constant_values=255), cells


def marker_image(camera, pose, side, identity=0, dictionary="APRILTAG_36h11", fineness=3):
    """The image of a marker at a pose in the camera's frame, on a grey ground."""
    picture, cells = picture_of(dictionary, identity)
    plane = rays(camera, fineness)
    directions = np.concatenate([plane, np.ones((*plane.shape[:2], 1))], axis=-1)
    normal = pose.rotation[:, 2]
    points = directions * (normal @ pose.translation / (directions @ normal))[..., None] - pose.translation
    cell = side / cells
    column = (points @ pose.rotation[:, 0]) / cell + 0.5 * cells + 1.0
    row = (points @ pose.rotation[:, 1]) / cell + 0.5 * cells + 1.0
    inside = (column >= 0.0) & (column < cells + 2.0) & (row >= 0.0) & (row < cells + 2.0)
    shown = np.full(column.shape, 140.0)
    shown[inside] = picture[(CELLS * row[inside]).astype(int), (CELLS * column[inside]).astype(int)]
    width, height = camera.image_size
    grey = shown.reshape(height, fineness, width, fineness).mean(axis=(1, 3))
    return np.repeat(np.round(grey).astype(np.uint8)[..., None], 3, axis=-1)
