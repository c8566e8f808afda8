"""``phcontrol doctor``."""

from __future__ import annotations

import importlib.util
import json
import platform
import sys
from importlib import metadata
from typing import Annotated

import typer

from phcontrol._lazy import lazy
from phcontrol._version import __version__
from phcontrol.cli.options import JsonOption
from phcontrol.compilation.cache import LARGEST, cache_folder, problem_above, problem_of
from phcontrol.compilation.caller import CALLER
from phcontrol.compilation.compiler import find_compiler
from phcontrol.mechanics.kernels import KERNELS

_LISTED = 5e6  # packages of at least 5 MB are listed by name
_NEEDED = ("pin", "numpy", "scipy", "daqp", "proxsuite")
_OPTIONAL = {  # module: package, extra, what for
    "casadi": ("casadi", "compile", "compile_law and phcontrol export"),
    "control": ("control", "control", "linear loops as control.StateSpace"),
    "pink": ("pin-pink", "kinematics", "goals for a frame: reach, follow, --reach"),
    "pylibfranka": ("pylibfranka", "franka", "Franka arms: FrankaArm"),
    "rtde_control": ("ur_rtde", "ur", "UR arms: URArm"),
    "mujoco": ("mujoco", "mujoco", "MuJoCo as a plant: MujocoArm"),
    "xacrodoc": ("xacrodoc", "models", "robots from xacro files"),
    "robot_descriptions": ("robot_descriptions", "models", "robots by the names of robot_descriptions"),
    "pyarrow": ("pyarrow", "sweeps", "results of phcontrol sweep"),
    "distributed": ("distributed", "cluster", "sweeps on Dask: phcontrol sweep --scheduler"),
    "cv2": ("opencv-python-headless", "vision", "features out of images"),
}


def doctor(
    sizes: Annotated[
        bool, typer.Option("--sizes", help="Say how much of the disk phcontrol and each package it needs take.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what is installed and found here, and what is missing for what.

    Versions, compiled parts, the C compiler and the cache of compiled laws; the packages' sizes with --sizes.
    """
    if sizes:
        _say_sizes(as_json)
        return
    found, missing = examined()
    if as_json:
        typer.echo(json.dumps({"found": found, "missing": missing}, indent=2))
        return
    width = max(map(len, found))
    for name, value in found.items():
        typer.echo(f"{name:<{width}}  {value}")
    for line in missing:
        typer.echo(f"missing: {line}")
    if not missing:
        typer.echo("nothing is missing")


def examined() -> tuple[dict[str, str], list[str]]:
    """Return what is found, by its name, and lines that say what is missing, and for what."""
    found = {"phcontrol": __version__, "Python": platform.python_version(), "system": platform.platform()}
    missing: list[str] = []
    for package in _NEEDED:
        found[package] = _version(package) or "not found"
    for module, (package, extra, purpose) in _OPTIONAL.items():
        version = _version(package) if importlib.util.find_spec(module) else ""
        found[package] = version or "not installed"
        if not version:
            missing.append(f"{package}, for {purpose}: pip install 'phcontrol[{extra}]'")
    in_c = not lazy.__module__.endswith("phcontrol._lazy")
    found["kernels of a control step"] = KERNELS
    found["attributes on first use"] = "compiled" if in_c else "Python"
    found["calls of compiled laws"] = CALLER
    if KERNELS != "compiled" or not in_c or CALLER != "C":
        missing.append("compiled parts of the package, for speed: install it where there is a C compiler")
    compiler = find_compiler()
    found["C compiler"] = "none" if compiler is None else f"{compiler.path}: {compiler.version}"
    if compiler is None:
        missing.append("a C compiler (cc, gcc, clang, or what CC names), for compile_law: laws run interpreted")
    found["cache of compiled laws"] = _cache(missing)
    return found, missing


def _say_sizes(as_json: bool) -> None:
    from phcontrol.cli.installed_size import sizes_of

    sizes = sizes_of("phcontrol")
    if as_json:
        typer.echo(json.dumps(sizes, indent=2))
        return
    for name, size in sizes.items():
        if size >= _LISTED:
            typer.echo(f"{size / 1e6:8.1f} MB  {name}")
    small = [size for size in sizes.values() if size < _LISTED]
    typer.echo(f"{sum(small) / 1e6:8.1f} MB  {len(small)} smaller packages")
    typer.echo(f"{sum(sizes.values()) / 1e6:8.1f} MB  all {len(sizes)} packages")


def _cache(missing: list[str]) -> str:
    folder = cache_folder()
    if sys.platform == "win32":
        return f"{folder}: not used on Windows"
    try:
        if not folder.exists():
            return f"{folder}: empty"
        problem = problem_of(folder) or problem_above(folder)
        objects = list(folder.glob("*.so"))
        size = sum(path.stat().st_size for path in objects)
    except OSError as error:
        problem, objects, size = str(error.strerror or error), [], 0
    if problem:
        missing.append(f"a cache that is the user's alone, for compile_law: {folder}: {problem}")
        return f"{folder}: refused, {problem}"
    return f"{folder}: {len(objects)} laws and loops, {size / 2**20:.1f} of at most {LARGEST / 2**20:.0f} MB"


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""
