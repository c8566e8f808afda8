"""What the texts of options mean: numbers, joints, settings."""

from __future__ import annotations

import json
from typing import Any

from phcontrol.exceptions import InvalidArgumentError

NOT_SET = ("system", "name", "cls", "camera")
"""What a law is made with that no text can be."""
_CONSTANTS = {"true": True, "false": False, "none": None, "null": None}


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
            raise InvalidArgumentError("--set", f"must be NAME=VALUE, but is '{_shortened(pair)}'")
        if name in options:
            raise InvalidArgumentError("--set", f"'{name}' has an option of its own: use --{name}")
        if name in NOT_SET:
            raise InvalidArgumentError("--set", f"'{name}' cannot be given on the command line")
        if name in settings:
            raise InvalidArgumentError("--set", f"'{name}' is given twice")
        settings[name] = _setting(name, value.strip())
    return settings


def _setting(name: str, value: str) -> Any:
    """Return what a value means: a number, true or false, None, a word, a list "1,2" of these, rows "1,0; 0,1".

    JSON is taken too: [1, 2], "a, b".
    """
    if value[:1] in ("[", "{", '"'):
        try:
            return json.loads(value)
        except (ValueError, RecursionError) as error:
            raise _no_setting(name, value, "is no JSON, which it begins like") from error
    if ";" not in value:
        return _items(name, value, value) if "," in value else _word(name, value, value)
    rows = [_items(name, row, value) for row in value.split(";")]
    if len({len(row) for row in rows}) > 1:
        raise _no_setting(name, value, f"has rows of {', '.join(str(len(row)) for row in rows)} entries")
    return rows


def _items(name: str, text: str, value: str) -> list[Any]:
    """Return the entries of a list: all numbers, or all words."""
    items = [_word(name, item, value) for item in text.split(",")]
    words = [item for item in items if isinstance(item, str)]
    if words and len(words) < len(items):
        raise _no_setting(name, value, f"mixes numbers and words ('{_shortened(words[0])}')")
    return items


def _word(name: str, text: str, value: str) -> Any:
    text = text.strip()
    if not text:
        raise _no_setting(name, value, "has nothing where a value should be" if value else "is empty")
    if text.lower() in _CONSTANTS:
        return _CONSTANTS[text.lower()]
    try:
        number = _number(text)
        return int(text) if text.lstrip("+-").isdecimal() and len(text) < 16 else number
    except ValueError:
        return text


def _no_setting(name: str, value: str, problem: str) -> InvalidArgumentError:
    return InvalidArgumentError(
        "--set",
        f"'{name}' {problem}: '{_shortened(value)}'. It must be a number, a word, true, false, None, a list like 1,2 "
        "or rows like '1,0; 0,1'",
    )


def _shortened(text: str) -> str:
    return text if len(text) < 80 else f"{text[:80]}..."
