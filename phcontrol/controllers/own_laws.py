"""Laws from elsewhere: of a user's own module, or of an installed package that offers some."""

from __future__ import annotations

import importlib
import inspect
import sys
from importlib import metadata
from typing import Any

from phcontrol.controllers.controller import Controller
from phcontrol.controllers.law_error import LawError, errors_of
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError

GROUP = "phcontrol.controllers"
"""The entry-point group in which a package offers laws: ``spring = "my_package.spring:Spring"``."""


def check_law(argument: str, law: object, what: str = "") -> type[Controller]:
    """Return a law's class when it is one that can be made: named, and with storage and target stated.

    Raises InvalidArgumentError that says what it is instead.

    Args:
        argument: what it was given as.
        law: the supposed class.
        what: its name in messages; by default its own.
    """
    what = what or getattr(law, "__qualname__", type(law).__name__)
    wanted = "give the class of a law, a subclass of phcontrol.Controller"
    if isinstance(law, Controller):
        raise InvalidArgumentError(argument, f"'{what}' is a law that is already made: {wanted}")
    if not inspect.isclass(law):
        kind = "a function" if callable(law) else f"of type {type(law).__name__}"
        factory = (
            " (what a factory is for, the law's declared parameters and their 'tuned' do)" if callable(law) else ""
        )
        raise InvalidArgumentError(argument, f"'{what}' is {kind}: {wanted}{factory}")
    if not issubclass(law, Controller):
        raise InvalidArgumentError(argument, f"'{what}' is no Controller: {wanted}")
    if inspect.isabstract(law):
        missing = ", ".join(sorted(law.__abstractmethods__))
        raise InvalidArgumentError(argument, f"'{what}' does not state {missing}")
    name = getattr(law, "name", None)
    if not isinstance(name, str) or not name:
        raise InvalidArgumentError(argument, f"'{what}' has no name: give its class a line like name = \"my_law\"")
    return law


def import_law(path: str, folder: str | None = None) -> type[Controller]:
    """Return the law that "my_module:MyLaw" names.

    Args:
        path: module and class. The module is imported, and so run.
        folder: where modules are looked for before anywhere else, for instance the working directory.

    Raises:
        InvalidArgumentError: there is no such module, or what is named is no law.
        UnknownNameError: the module has no such name; lists its laws.
        LawError: the module raised an error; says where.
    """
    module_name, _, name = path.partition(":")
    if not module_name or not name or "/" in module_name or module_name.endswith(".py"):
        module_like = module_name.removesuffix(".py").strip("/").replace("/", ".") or "my_module"
        raise InvalidArgumentError(
            "controller", f"'{path}' must be a module and a class in it, like {module_like}:{name or 'MyLaw'}"
        )
    if folder is not None and folder not in sys.path:
        sys.path.insert(0, folder)
    importlib.invalidate_caches()
    try:
        with errors_of(path, package=module_name.partition(".")[0]):
            found: Any = importlib.import_module(module_name)
    except LawError as error:
        missing = error.__cause__
        if isinstance(missing, ModuleNotFoundError) and _is_part(missing.name, module_name):
            there = "" if folder is None else f" in {folder}"
            message = f"'{path}': there is no module '{missing.name}'{there}, nor is one installed"
            raise InvalidArgumentError("controller", message) from error
        raise
    for part in name.split("."):
        if not hasattr(found, part):
            raise UnknownNameError("law", part, _laws_in(found), f" in {module_name}")
        found = getattr(found, part)
    return check_law("controller", found, path)


def _laws_in(place: Any) -> list[str]:
    """Return the names of the laws in a module but for those of phcontrol."""
    laws = {
        key: value for key, value in vars(place).items() if inspect.isclass(value) and issubclass(value, Controller)
    }
    return [key for key, law in laws.items() if not law.__module__.startswith("phcontrol.")]


def _is_part(missing: str | None, module: str) -> bool:
    """Return whether what is missing is the module itself or a package that it is in."""
    return missing is not None and f"{module}.".startswith(f"{missing}.")


def installed_laws() -> dict[str, list[metadata.EntryPoint]]:
    """Return what installed packages offer as laws, by name; nothing of it is imported."""
    found: dict[str, list[metadata.EntryPoint]] = {}
    for point in metadata.entry_points(group=GROUP):
        if point not in found.setdefault(point.name, []):
            found[point.name].append(point)
    return found


def origin_of(point: metadata.EntryPoint) -> str:
    """Return the package that offers a law, with its version."""
    return "an installed package" if point.dist is None else f"{point.dist.name} {point.dist.version}"


def load_law(points: list[metadata.EntryPoint]) -> type[Controller]:
    """Return the law that an installed package offers. Raises as ``import_law`` does, and when two offer that name."""
    first = points[0]
    if len(points) > 1:
        offers = " and ".join(sorted(f"{origin_of(point)} ({point.value})" for point in points))
        raise InvalidArgumentError("controller", f"'{first.name}' is offered by {offers}: give one as module:class")
    try:
        return import_law(f"{first.module}:{first.attr or ''}")
    except (InvalidArgumentError, UnknownNameError) as error:
        problem = str(error).removeprefix("controller: ")
        raise InvalidArgumentError("controller", f"'{first.name}' of {origin_of(first)}: {problem}") from error
