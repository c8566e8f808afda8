"""What is true of every definition in the package."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
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


def bases():
    return {
        found
        for module in MODULES
        for found in vars(importlib.import_module(module)).values()
        if inspect.isclass(found) and found.__module__ == module and inspect.isabstract(found)
    }


@pytest.mark.parametrize("module", MODULES)
def test_what_a_class_of_ones_own_must_say_is_demanded(module):
    """A body without ``touch`` or a law without ``storage`` cannot be made, rather than do nothing in silence."""
    demanded = {found.__name__: set(found.__abstractmethods__) for found in bases() if found.__module__ == module}
    assert demanded == DEMANDED.get(module.removeprefix("phcontrol."), {})


DEMANDED = {
    "compilation.compiled_law": {"CompiledLaw": {"storage", "target"}},
    "controllers.controller": {"Controller": {"storage", "target"}},
    "controllers.damped_law": {"DampedLaw": {"joint_damping", "shaped"}},
    "controllers.dynamic_extension": {"DynamicExtension": {"shaped"}},
    "controllers.events": {"Event": {"holds"}, "_Sight": {"holds"}},
    "controllers.law_sequence": {"LawSequence": {"acting"}},
    "controllers.joint_damped_law": {"JointDampedLaw": {"shaped", "storage", "target"}},
    "controllers.position_law": {"PositionLaw": {"storage", "target"}},
    "controllers.regulated_law": {"RegulatedLaw": {"spring_force", "storage", "target"}},
    "controllers.tanked_regulation": {"TankedRegulation": {"spring_force"}},
    "controllers.shaped_law": {"ShapedLaw": {"shaped", "storage", "target"}},
    "controllers.visual_servo": {"VisualServo": {"servo_motion", "servo_velocity"}},
    "potentials.potential": {
        "Potential": {"coordinate_gradient", "coordinate_map", "coordinates", "energy", "gradient_rate"}
    },
    "poles.poles": {"Poles": {"place"}},
    "design.specification": {"Specification": {"__str__", "choose"}},
    "simulation.signals": {"Exported": {"signals"}},
    "setpoints.live_motion": {"LiveMotion": {"_redirect", "checked", "duration"}},
    "tanks.action": {"Action": {"torque"}},
    "environments.body": {"Body": {"fastest_rate", "initial_state", "touch"}},
    "environments.disturbances": {"Disturbance": {"__call__"}, "_Shaped": {"__call__"}},
}
