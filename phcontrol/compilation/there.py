"""What is in a place that a function reads."""

from __future__ import annotations

import types
from typing import Any


def there(where: Any, name: str) -> Any:
    """Return what a cell, a dict or a class has now; None where there is nothing."""
    if isinstance(where, types.CellType):
        try:
            return where.cell_contents
        except ValueError:
            return None
    return where.get(name) if isinstance(where, dict) else getattr(where, name, None)
