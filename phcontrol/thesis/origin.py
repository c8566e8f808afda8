"""Whose a statement is."""

from __future__ import annotations

from enum import Enum


class Origin(Enum):
    """Where a claim comes from: three kinds of the thesis's, and ours."""

    THEOREM = "theorem"
    """The thesis proves it, or states it with an equation."""
    TEXT = "text"
    """The thesis says it in words, with or without a number."""
    FIGURE = "figure"
    """It can be read off a figure or its caption."""
    OURS = "ours"
    """The thesis says nothing of it: our own aim, law, arm or check."""

    @property
    def of_the_thesis(self) -> bool:
        """Whether the thesis states it."""
        return self is not Origin.OURS
