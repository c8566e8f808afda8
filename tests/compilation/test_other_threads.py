"""A law that runs in another thread while one is traced computes what it always does."""

from __future__ import annotations

import sys
import threading
import types

import pytest

from phcontrol.compilation.tracing import compares_float, tracing


def asks_for_the_type(value):
    return type(value) is float


def test_other_threads_are_answered_right_when_they_ask_for_a_type():
    """The name ``float`` of a module that compares types with it is left as it is while a law is traced."""
    module, found = sys.modules[__name__], []
    assert compares_float(module)

    class Law:
        pass

    def ask():
        found.append(asks_for_the_type(1.0))

    with tracing([Law]):
        assert "max" in vars(module)  # the module is one of those that are patched
        thread = threading.Thread(target=ask)
        thread.start()
        thread.join()
    assert found == [True]
    assert "max" not in vars(module)


@pytest.mark.parametrize(
    ("text", "compares"),
    [
        ("type(x) is float", True), ("type(x) is not float", True), ("type(x) == float", True),
        ("type(x) in (int, float)", True), ("type(x) in (float, int)", True), ("type(x) not in {float, str}", True),
        ("float(x) if x else 0.0", False), ("isinstance(x, float)", False), ("isinstance(x, (int, float))", False),
        ("np.zeros(3, float)", False), ("max(float(x), 0.0) in (1.0, 2.0)", False),
    ],
)  # fmt: skip
def test_comparisons_with_float_are_found(text, compares):
    module = types.ModuleType("made_up")
    exec(f"def f(x):\n    return {text}\n", vars(module))
    module.f.__module__ = "made_up"
    assert compares_float(module) == compares
