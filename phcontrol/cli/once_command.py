"""A command that takes an option once, unless it says that it may be repeated."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperCommand


class OnceCommand(TyperCommand):
    """A command that refuses an option given twice: the last one would win in silence."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Return what is left of the arguments. Raises BadParameter for an option that is given twice."""
        order = self.make_parser(ctx).parse_args(args=list(args))[2]
        for option in list[Any](order):
            multiple, flag = getattr(option, "multiple", True), getattr(option, "is_flag", False)
            if not multiple and not flag and option.param_type_name == "option" and order.count(option) > 1:
                raise typer.BadParameter("is given twice: give it once", ctx, option)
        return super().parse_args(ctx, args)
