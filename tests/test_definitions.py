"""What is true of every definition in the package."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil

import pytest

import phcontrol

FILLED_IN_STEPS = {"Description"}
MODULES = [module.name for module in pkgutil.walk_packages(phcontrol.__path__, "phcontrol.")]


@pytest.mark.parametrize("module", MODULES)
def test_dataclasses_are_values(module):
    """States, reports and settings are passed around and kept: what cannot be changed cannot be changed by mistake."""
    loaded = importlib.import_module(module)
    for found in vars(loaded).values():
        if isinstance(found, type) and found.__module__ == module and dataclasses.is_dataclass(found):
            assert found.__dataclass_params__.frozen or found.__name__ in FILLED_IN_STEPS, found
