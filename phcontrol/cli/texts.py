"""What the texts of options mean: numbers, joints, settings."""

from __future__ import annotations

import json
from typing import Any

from phcontrol.exceptions import InvalidArgumentError

NOT_SET = ("system", "name", "cls", "camera")
"""What a law is made with that no text can be."""


def by_joint(option: str, text: str) -> dict[str, float] | list[float]:
    """Return numbers, or numbers by joint: what "0.1,0.2" or "elbow=0.3" means."""
    parts = [part.strip() for part in text.split(",") if part.strip()]
    try:
        if not parts:
            raise ValueError("empty")
        if not all("=" in part for part in parts):
            return [_number(part) for part in parts]
        pairs = [(name.strip(), _number(value)) for name, value in (part.split("=", 1) for part in parts)]
    except ValueError as error:
        message = f"must be {'angles' if option == '--goal' else 'numbers'} like 0.1,0.2 or pairs like elbow=0.3"
        raise InvalidArgumentError(option, f"{message}, but is '{text}'") from error
    values = dict(pairs)
    if len(values) < len(pairs):
        raise InvalidArgumentError(option, f"names a joint twice: '{text}'")
    return values


def numbers_of(option: str, text: str) -> list[float]:
    """Return the numbers that "0,0,0.002" means."""
    try:
        return [_number(part) for part in text.split(",")]
    except ValueError as error:
        raise InvalidArgumentError(option, f"must be numbers like 0,0,0.002, but is '{text}'") from error


def _number(text: str) -> float:
    """Return the number that a text is; Python's "1_0" is none. Raises ValueError."""
    if "_" in text:
        raise ValueError(text)
    return float(text)


def settings_of(pairs: list[str] | None, *options: str) -> dict[str, Any]:
    """Return what --set sets; ``options`` have options of their own."""
    settings: dict[str, Any] = {}
    for pair in pairs or []:
        name, separator, value = pair.partition("=")
        name = name.strip()
        if not separator:
            raise InvalidArgumentError("--set", f"must be NAME=VALUE, but is '{pair}'")
        if name in options:
            raise InvalidArgumentError("--set", f"'{name}' has an option of its own: use --{name}")
        if name in NOT_SET:
            raise InvalidArgumentError("--set", f"'{name}' cannot be given on the command line")
        if name in settings:
            raise InvalidArgumentError("--set", f"'{name}' is given twice")
        try:
            settings[name] = json.loads(value)
        except (ValueError, RecursionError) as error:
            shown = value if len(value) < 80 else f"{value[:80]}..."
            message = f"'{name}' must be a number, a list like [1, 2], true or false, but is '{shown}'"
            raise InvalidArgumentError("--set", message) from error
    return settings
