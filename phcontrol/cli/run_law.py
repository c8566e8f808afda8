"""``phcontrol run LAW``: a command for every registered law."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_type_hints


def law_command(name: str, general: Callable[..., None]) -> Callable[..., None]:
    """Return ``run NAME``, made of ``run position`` or ``run servo``: the same options but --controller."""
    signature, hints = inspect.signature(general), get_type_hints(general, include_extras=True)

    def command(out: Path | None = None, **arguments: Any) -> None:
        general(controller=name, out=Path("results") / name if out is None else out, **arguments)

    command.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[
            parameter.replace(annotation=hints[key])
            for key, parameter in signature.parameters.items()
            if key != "controller"
        ]
    )
    command.__annotations__ = {key: hint for key, hint in hints.items() if key != "controller"}
    return command
