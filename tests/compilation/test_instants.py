"""The instants at which a traced law is compared with its own: as many as asked for, slow and fast, free and pushed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phcontrol import INTEGRATORS, make_controller
from phcontrol.compilation.compiled_loop import EXPLICIT, METHODS
from phcontrol.compilation.instants import instants
from tests.conftest import make_system


@pytest.fixture(scope="module")
def drawn():
    law = make_controller("force_feedback_measured", make_system("pera"))
    return [instant for instant, _ in instants(law, 60, seed=1)]


def test_there_are_as_many_as_asked_for(drawn):
    assert len(drawn) == 60


def test_a_quarter_is_slow_and_a_third_free(drawn):
    slow = [np.abs(instant.velocity).max() < 0.1 for instant in drawn]
    assert sum(slow) == 15
    free = [not instant.measured.external_force.any() for instant in drawn]
    assert sum(free) == 20


def test_explicit_methods_are_those_that_a_stiff_arm_makes_unstable():
    assert set(METHODS) == set(INTEGRATORS)
    assert set(EXPLICIT) == {name for name, one in INTEGRATORS.items() if one.stability < math.inf}
