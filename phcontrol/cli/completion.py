"""What a shell is offered for an option's value."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

_SUFFIXES = (".urdf", ".xml", ".xacro")


def robots(incomplete: str) -> list[str]:
    """Return the robots that can be named, and descriptions in files, of which this is the beginning."""
    from phcontrol.mechanics.catalogue import example_robots, installed, shipped_robots

    fixed = [name for name, floating in example_robots().items() if not floating]
    return [*_beginning(incomplete, [*shipped_robots(), *installed(), *fixed]), *_files(incomplete, _SUFFIXES)]


def laws(incomplete: str) -> list[str]:
    """Return the laws, those of installed packages too, of which this is the beginning."""
    from phcontrol.controllers.own_laws import installed_laws
    from phcontrol.controllers.registry import CONTROLLERS

    return _beginning(incomplete, [*CONTROLLERS, *installed_laws()])


def laws_of(run: str) -> Callable[[str], list[str]]:
    """Return a function that offers the laws of one kind of run, and those of installed packages."""

    def offered(incomplete: str) -> list[str]:
        from phcontrol.controllers.registry import CONTROLLERS

        return [name for name in laws(incomplete) if name not in CONTROLLERS or CONTROLLERS[name].law.run == run]

    return offered


def with_all(offered: Callable[[str], list[str]]) -> Callable[[str], list[str]]:
    """Return a function that offers ``all``, too."""
    return lambda incomplete: [*_beginning(incomplete, ["all"]), *offered(incomplete)]


def one_of(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Return a function that offers some of these names."""
    known = list(names)
    return lambda incomplete: _beginning(incomplete, known)


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def _files(incomplete: str, suffixes: tuple[str, ...]) -> list[str]:
    """Return files with such endings, and folders, of which this is the beginning."""
    folder = Path(incomplete if incomplete.endswith("/") else Path(incomplete).parent)
    try:
        found = sorted(folder.iterdir())
    except OSError:
        return []
    shown = {f"{path}/" if path.is_dir() else str(path) for path in found if path.is_dir() or path.suffix in suffixes}
    return sorted(name for name in shown if incomplete and name.startswith(incomplete))
