"""``phcontrol run LAW``: a command for every registered law."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from phcontrol.cli.options import OUT_HELP


def law_command(name: str, general: Callable[..., None]) -> Callable[..., None]:
    """Return ``run NAME``, made of ``run position`` or ``run servo``: the same options but --controller."""
    signature, hints = inspect.signature(general), get_type_hints(general, include_extras=True)
    place = Path("results") / name
    hints["out"] = Annotated[Path, typer.Option(help=OUT_HELP)]

    def command(out: Path = place, **arguments: Any) -> None:
        general(controller=name, out=out, **arguments)

    command.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[
            parameter.replace(annotation=hints[key], default=place if key == "out" else parameter.default)
            for key, parameter in signature.parameters.items()
            if key != "controller"
        ]
    )
    command.__annotations__ = {key: hint for key, hint in hints.items() if key != "controller"}
    return command
