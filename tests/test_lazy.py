"""Quantities computed on first use and once, in Python and in C."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref
from pathlib import Path

import pytest

from phcontrol import _lazy

CODE = """
import sys
sys.modules["phcontrol._lazy_compiled"] = None
from phcontrol._lazy import lazy
print(lazy.__module__)
"""


def implementations():
    found = {"chosen": _lazy.lazy}
    source = {}
    text = Path(_lazy.__file__).read_text(encoding="utf-8").split("if not TYPE_CHECKING")[0]
    exec(compile(text, "lazy", "exec"), source)
    return found | {"python": source["lazy"]}


@pytest.mark.parametrize("lazy", implementations().values(), ids=implementations())
def test_a_lazy_quantity_is_computed_once_and_is_then_a_plain_attribute(lazy):
    calls = []

    class Thing:
        @lazy
        def size(self):
            """How large."""
            calls.append(self)
            return [len(calls)]

        @lazy
        def broken(self):
            raise ArithmeticError("no")

    thing, other = Thing(), Thing()
    assert thing.size is thing.size
    assert thing.size == [1]
    assert other.size == [2]
    assert calls == [thing, other]
    assert thing.__dict__ == {"size": [1]}
    assert Thing.size.__doc__ == "How large."
    assert Thing.size is Thing.__dict__["size"]
    with pytest.raises(ArithmeticError, match="no"):
        thing.broken  # noqa: B018
    assert "broken" not in thing.__dict__
    thing.size = [7]
    assert thing.size == [7]
    del thing.size
    assert thing.size == [3]


@pytest.mark.parametrize("lazy", implementations().values(), ids=implementations())
def test_a_lazy_quantity_leaks_nothing(lazy):
    class Thing:
        @lazy
        def itself(self):
            return self

    thing = Thing()
    assert thing.itself is thing
    gone = weakref.ref(thing)
    kind = weakref.ref(Thing)
    del thing, Thing
    gc.collect()
    assert gone() is None
    assert kind() is None


def test_without_the_compiled_one_python_takes_its_place():
    result = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "phcontrol._lazy"
