"""A group of commands that are imported when they are called, not when they are listed."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from importlib import import_module
from typing import Any, ClassVar, NamedTuple

from typer.core import TyperGroup

from phcontrol.cli.command import command_of


class Listed(NamedTuple):
    """A command as the list of all shows it."""

    place: str
    """Module and function, "phcontrol.cli.view:view"."""
    summary: str


class LazyGroup(TyperGroup):
    """A group that knows its commands by name and one line each; the rest is loaded with the first call.

    So ``phcontrol --help`` does not load Pinocchio, and ``phcontrol view`` no law.
    """

    listed: ClassVar[dict[str, Listed]] = {}

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Commands(self.listed)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names, in their order."""
        return list(self.listed)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, item.summary) for name, item in self.listed.items()])


class _Commands(MutableMapping[str, Any]):
    """Commands by name; each is made when it is first asked for."""

    def __init__(self, listed: dict[str, Listed]) -> None:
        self._listed, self._made = listed, dict[str, Any]()

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            module, _, function = self._listed[name].place.partition(":")
            self._made[name] = command_of(name, getattr(import_module(module), function))
        return self._made[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._made[name] = command

    def __delitem__(self, name: str) -> None:
        del self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._listed)

    def __len__(self) -> int:
        return len(self._listed)
