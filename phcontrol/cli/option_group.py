"""Options that go together, as one argument of a command."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, fields
from typing import Any, get_type_hints


@dataclass(frozen=True)
class OptionGroup:
    """What a command takes as one argument, and its user gives as an option for each field."""

    @classmethod
    def parameters(cls) -> list[inspect.Parameter]:
        """Return the parameters of a command that stand for the fields."""
        hints = get_type_hints(cls, include_extras=True)
        return [
            inspect.Parameter(
                field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
            )
            for field in fields(cls)
        ]

    @classmethod
    def taken_from(cls, arguments: dict[str, Any]) -> OptionGroup:
        """Return the group of these arguments, without those that belong to it."""
        return cls(**{field.name: arguments.pop(field.name) for field in fields(cls)})
