"""Where robot descriptions are: shipped arms, URDF files, example-robot-data."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from phcontrol._validation import file_path
from phcontrol.exceptions import RobotDescriptionError, UnknownNameError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


FETCHED = "robot_descriptions:"
"""What names of robot_descriptions begin with."""


def shipped_robots() -> dict[str, str]:
    """Return the robots that come with phcontrol: title by name."""
    return {name: entry["title"] for name, entry in table().items()}


def example_robots() -> dict[str, bool]:
    """Return the names of example-robot-data, and for each whether it has a floating base."""
    return {name: bool(loader.free_flyer) for name, loader in _example_loaders().items()}


@dataclass
class Description:
    """Where a robot's URDF is, and what is known of it beside that."""

    name: str
    path: Path
    extras: dict[str, Any] = field(default_factory=dict)
    semantic_path: Path | None = None
    reference_posture: str | None = None
    has_rotor_parameters: bool = False
    is_file: bool = False
    package_directories: tuple[Path, ...] = ()
    text: str | None = None
    """The URDF itself, where it is not to be read from ``path``."""

    @property
    def label(self) -> str:
        """What errors call it: the path of a file of the user's own, the name of an arm that has one."""
        return str(self.path) if self.is_file else f"{self.name} ({self.path.name})"


def find(source: str | os.PathLike[str]) -> Description:
    """Return where the description of a robot is. Raises UnknownNameError or RobotDescriptionError."""
    file_path("source", source)
    name = os.fspath(source)
    is_path = isinstance(source, os.PathLike) or os.sep in name or Path(name).suffix in (".urdf", ".xml", ".xacro")
    if is_path:
        path = Path(name)
        if not os.path.isfile(path):  # which raises nothing
            raise RobotDescriptionError(f"{path}: no such file")
        text = _expanded(path) if path.suffix == ".xacro" else None
        return Description(path.stem, path, package_directories=(path.parent,), is_file=True, text=text)
    if name.startswith(FETCHED):
        return _find_fetched(name.removeprefix(FETCHED))
    if name in table():
        return Description(name, _urdf_directory() / f"{name}.urdf", extras=table()[name])
    if name in installed():
        return _find_installed(name)
    loaders = _example_loaders()
    if name not in loaders:
        known = [*table(), *installed(), *loaders]
        raise UnknownNameError("robot", name, known, "; a path to a URDF, xacro or MJCF file works too")
    return _find_example(name, loaders[name])


def _expanded(path: Path) -> str:
    """Return the URDF that a xacro file makes. Its expressions are run as Python: open files that you trust."""
    try:
        from xacrodoc import XacroDoc
    except ImportError as error:
        raise RobotDescriptionError(
            f"{path}: a xacro file needs xacrodoc (pip install 'phcontrol[models]'), or to be expanded to URDF first "
            "(xacro in.xacro > out.urdf)"
        ) from error
    try:
        return str(XacroDoc.from_file(str(path)).to_urdf_string())
    except Exception as error:  # whatever the expressions of the file raise
        raise RobotDescriptionError(f"{path}: cannot be expanded: {type(error).__name__}: {error}") from error


def _find_fetched(name: str) -> Description:
    """Return a description of robot_descriptions, which fetches it by git when it is not on this machine yet."""
    try:
        from robot_descriptions import DESCRIPTIONS
    except ImportError as error:
        raise RobotDescriptionError(
            f"{FETCHED}{name}: needs robot_descriptions (pip install 'phcontrol[models]')"
        ) from error
    if name not in DESCRIPTIONS:
        raise UnknownNameError("robot", name, DESCRIPTIONS, " of robot_descriptions")
    module = importlib.import_module(f"robot_descriptions.{name}")
    for attribute in ("URDF_PATH", "MJCF_PATH", "XACRO_PATH"):
        if hasattr(module, attribute):
            path = Path(getattr(module, attribute))
            directory = Path(getattr(module, "PACKAGE_PATH", path.parent))
            text = _expanded(path) if attribute == "XACRO_PATH" else None
            return Description(name, path, package_directories=(directory, directory.parent), is_file=True, text=text)
    raise RobotDescriptionError(f"{FETCHED}{name}: names neither a URDF nor an MJCF")


def _find_installed(name: str) -> Description:
    """Return a description that another package ships, where that is installed."""
    entry = installed()[name]
    package, relative = entry["package"], entry["file"]
    try:
        path = Path(str(importlib.metadata.distribution(package).locate_file(relative)))
    except importlib.metadata.PackageNotFoundError as error:
        raise RobotDescriptionError(f"{name}: comes with {package}: pip install {package}") from error
    if not path.is_file():
        raise RobotDescriptionError(f"{name}: {package} has no file {relative} any more")
    extras = {key: entry[key] for key in ("tool_frame", "home", "effort", "velocity") if key in entry}
    return Description(name, path, extras=extras, package_directories=tuple(path.parents)[:4])


def _find_example(name: str, loader: Any) -> Description:
    from example_robot_data.robots_loader import getModelPath

    if loader.free_flyer:
        raise RobotDescriptionError(f"{name}: has a floating base; phcontrol controls fixed-base arms")
    if not loader.urdf_filename:
        raise RobotDescriptionError(f"{name}: is described by SDF, not URDF")
    relative = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
    try:
        root = Path(getModelPath(str(relative)))
    except OSError as error:
        raise RobotDescriptionError(
            f"{name}: its files are not installed: pip install example-robot-data brings them ({error})"
        ) from error
    semantic = root / loader.path / loader.srdf_subpath / loader.srdf_filename if loader.srdf_filename else None
    posture = homes().get(name)
    return Description(
        name,
        root / relative,
        extras={} if posture is None else {"home": posture},
        semantic_path=semantic if semantic and semantic.is_file() else None,
        reference_posture=loader.ref_posture,
        has_rotor_parameters=loader.has_rotor_parameters,
        package_directories=(root.parent.parent, root),
    )


@cache
def _example_loaders() -> dict[str, Any]:
    from example_robot_data.robots_loader import ROBOTS

    return dict(ROBOTS)


@cache
def _urdf_directory() -> Path:
    package = Path(__file__).parents[1]
    for directory in (package / "urdf", package.parent / "urdf"):
        if (directory / "robots.toml").is_file():
            return directory
    raise RobotDescriptionError("the urdf folder of phcontrol is missing: reinstall the package")


@cache
def table() -> dict[str, Any]:
    """Return robots.toml: what is known of each shipped robot, by name."""
    return _read("robots.toml")


@cache
def installed() -> dict[str, Any]:
    """Return installed.toml: arms whose descriptions come with packages of others, by name."""
    return _read("installed.toml")


@cache
def homes() -> dict[str, list[float]]:
    """Return homes.toml: home postures for arms of example-robot-data, by name [rad]."""
    return _read("homes.toml")


def _read(name: str) -> dict[str, Any]:
    content: dict[str, Any] = tomllib.loads((_urdf_directory() / name).read_text(encoding="utf-8"))
    return content
