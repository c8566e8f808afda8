"""The public names by subject: ``phcontrol.laws``, ``phcontrol.references`` and so on, each loaded with its first use.

A group holds what is public in some folders of the package, under the same names as ``phcontrol`` itself; errors and
warnings are in ``phcontrol.errors``, wherever they are raised. ``python -m phcontrol._groups`` writes the files of all
groups after a public name was added (a test demands it).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

_HERE = Path(__file__).parent
_IMPORT = re.compile(r"^from \.([\w.]+) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
_ERROR = re.compile(r"(Error|Warning|Interrupted)$")


class Group(NamedTuple):
    """What a group is about, and the folders whose public names it has."""

    summary: str
    folders: tuple[str, ...]


GROUPS: Mapping[str, Group] = MappingProxyType(
    {
        "robots": Group("Arms and plants: descriptions, payloads, friction, states, transformations.", ("mechanics",)),
        "potentials": Group("Energies of the configuration that a law shapes.", ("potentials",)),
        "references": Group(
            "Along what an arm or a frame is led, also while goals change.", ("trajectories", "setpoints")
        ),
        "laws": Group("Laws, what they are made of, their schedules and energy tanks.", ("controllers", "tanks")),
        "contacts": Group("What touches or pushes an arm: bodies, disturbances.", ("environments",)),
        "sensing": Group("What a law is shown: sensors, observers, cameras, images.", ("sensors", "vision")),
        "simulations": Group("Runs of closed loops and their logs.", ("simulation",)),
        "certificates": Group("What is true of a closed loop: certificates, modes, gains, equilibria.", ("analysis",)),
        "gains": Group("Gains from a specification, and gains that are tuned.", ("design",)),
        "estimation": Group("What an arm carries and how it rubs, from logs.", ("identification",)),
        "compiled": Group("Laws and loops in C, and their exact derivatives.", ("compilation",)),
        "scenarios": Group("Many runs: what varies, what is measured, and who simulates.", ("sweeps",)),
        "drivers": Group("A law on an arm: loops, drivers, limits, torque filter.", ("runtime", "safety")),
        "pictures": Group("Plots and pages of runs.", ("visualization",)),
        "errors": Group("Every error and warning.", ()),
    }
)
"""The groups by name."""

WRITTEN = tuple(name for name in GROUPS if name != "potentials")
"""Groups that are files of their own; ``potentials`` is a folder that has its names itself."""


def places() -> dict[str, str]:
    """Return the module of each public name, relative to the package."""
    stub = (_HERE / "__init__.pyi").read_text(encoding="utf-8")
    return {
        name: module for module, several, one in _IMPORT.findall(stub) for name in re.findall(r"\w+", several or one)
    }


def names_of(group: str) -> list[str]:
    """Return the names of a group: constants, classes, functions, each in alphabetical order."""
    found = []
    for name, module in places().items():
        is_error = bool(_ERROR.search(name))
        if group == "errors" if is_error else module.split(".")[0] in GROUPS[group].folders:
            found.append(name)
    return sorted(found, key=lambda name: (not name.isupper(), not name[0].isupper(), name))


def stub_of(group: str) -> str:
    """Return the text of a group's stub, which says where each name is."""
    where, names = places(), names_of(group)
    modules = sorted({where[name] for name in names})
    lines = [f'"""{GROUPS[group].summary}"""', "", "# Written by python -m phcontrol._groups.", ""]
    for module in modules:
        several = [name for name in names if where[name] == module]
        line = f"from .{module} import {', '.join(several)}"
        lines += [line] if len(line) <= 120 else [f"from .{module} import (", *(f"    {n}," for n in several), ")"]
    return "\n".join([*lines, "", "__all__ = [", *(f'    "{name}",' for name in names), "]", ""])


def module_of(group: str) -> str:
    """Return the text of a group's module."""
    return (
        f'"""{GROUPS[group].summary}"""\n\nimport lazy_loader\n\n'
        '__getattr__, __dir__, __all__ = lazy_loader.attach_stub("phcontrol", __file__)\n'
    )


def write() -> None:
    """Write the files of every group."""
    for group in WRITTEN:
        (_HERE / f"{group}.pyi").write_text(stub_of(group), encoding="utf-8")
        (_HERE / f"{group}.py").write_text(module_of(group), encoding="utf-8")


if __name__ == "__main__":
    write()
