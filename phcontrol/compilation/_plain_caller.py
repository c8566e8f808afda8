"""The caller of compiled laws by ctypes: where the one in C was not built."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.there import there
from phcontrol.mechanics import kernels

_VECTOR = ctypes.POINTER(ctypes.c_double)
_LAW = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, *[_VECTOR] * 6)


class Caller:
    """Calls a compiled law at an address, with the same arguments and answers as the one in C."""

    def __init__(
        self,
        address: int,
        joints: int,
        state: int,
        measured: tuple[int, int, int],
        numbers: Array,
        fallback: Callable[..., Any],
        command: Callable[..., Any],
        owner: object,
        watched: tuple[Any, ...] = ((), (), (), ()),
    ) -> None:
        self._law, self._joints, self._state, self._measured = _LAW(address), joints, state, measured
        self._numbers, self._fallback, self._command, self._owner = numbers.copy(), fallback, command, owner
        self._watched = watched
        self._steps = self._fallbacks = 0

    @property
    def counts(self) -> tuple[int, int]:
        """How many steps were asked for, and how many of them were left to the fallback."""
        return self._steps, self._fallbacks

    def __call__(self, *arguments: Any) -> Any:
        """Return the command."""
        self._steps += 1
        values = self._values(arguments)
        if values is not None and self._is_as_it_was():
            out = np.empty(self._joints + self._state)
            pointers = [value.ctypes.data_as(_VECTOR) for value in (*values, self._numbers, out)]
            if self._law(arguments[0], *pointers) and np.isfinite(out).all():
                return self._command(out[: self._joints].copy(), out[self._joints :].copy())
        self._fallbacks += 1
        return self._fallback(*arguments)

    def _is_as_it_was(self) -> bool:
        """Whether all that is watched is the same; where it is not, the fallback says what."""
        dicts, lists, arrays, others = self._watched
        return (
            all(found.get(name) is value for found, *pairs in dicts for name, value in zip(*pairs, strict=True))
            and all(
                len(entries) == len(values) and all(one is other for one, other in zip(entries, values, strict=True))
                for entries, values in lists
            )
            and all(array.tobytes() == copy.tobytes() for array, copy in arrays)
            and all(there(where, name) is value for where, name, value in others)
        )

    def _values(self, arguments: tuple[Any, ...]) -> list[Array] | None:
        """Return q, v, state and what is measured, copied; None where one is not a plain array of finite numbers."""
        if not 4 <= len(arguments) <= 5 or not isinstance(arguments[0], float) or not math.isfinite(arguments[0]):
            return None
        sizes = self._joints, self._joints, self._state
        found = [kernels.finite_copy(value, size) for value, size in zip(arguments[1:4], sizes, strict=True)]
        seen = [kernels.finite_copy(arguments[4][k], size) if len(arguments) == 5 else None
                for k, size in enumerate(self._measured) if size]  # fmt: skip
        plain = [value for value in (*found, *seen) if value is not None]
        if len(plain) < len(found) + len(seen):
            return None
        return [*plain[:3], np.concatenate([np.zeros(0), *plain[3:]])]
