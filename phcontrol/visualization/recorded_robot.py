"""The arm of a log, with the meshes that may be opened for it."""

from __future__ import annotations

from pathlib import Path

from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.catalogue import example_robots, find, shipped_robots
from phcontrol.mechanics.loading import robot_from_record
from phcontrol.mechanics.robot import Robot
from phcontrol.simulation.log import Log


def recorded_robot(log: Log) -> Robot:
    """Return the arm that a log describes.

    A log that was read from a file may be anyone's, and its page may go to anyone: of the folders that it names for
    its meshes none is believed. A robot that comes with phcontrol or example-robot-data has the folders that it has
    on this machine; any other has none. Raises PHControlError when the log does not say what robot it is of.
    """
    if "robot_record" not in log.metadata:
        raise PHControlError("this log does not hold its robot's description: give the robot")
    record = dict(log.metadata["robot_record"])
    if log.path is not None:
        record["package_directories"] = [str(folder) for folder in _installed_folders(record.get("name"))]
    return robot_from_record(record)


def _installed_folders(name: object) -> tuple[Path, ...]:
    """Return where the meshes of a robot that can be named are on this machine."""
    if not isinstance(name, str) or not (name in shipped_robots() or example_robots().get(name) is False):
        return ()
    try:
        return find(name).package_directories
    except PHControlError:
        return ()
