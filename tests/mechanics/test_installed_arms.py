"""Arms whose descriptions come with packages of others: each is tested where its package is installed."""

from __future__ import annotations

import importlib.metadata
import warnings
from pathlib import Path

import numpy as np
import pytest

from phcontrol import (
    MechanicalSystem,
    RobotDescriptionError,
    RobotDescriptionWarning,
    certify,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.mechanics import catalogue
from phcontrol.mechanics.catalogue import installed

HEAVIEST = {"fr3": 19.0, "iiwa14": 33.0, "gen3": 10.5, "ur3e": 12.0, "ur5e": 22.0, "ur10e": 36.0}
"""Masses of the arms by their makers' data sheets, hand or gripper included [kg], and some more."""


def test_every_entry_says_whose_it_is():
    for name, entry in installed().items():
        assert {"title", "package", "file", "licence", "tool_frame", "home"} <= set(entry), name
    assert set(installed()) == set(HEAVIEST)


@pytest.mark.parametrize(
    ("package", "file", "complaint"),
    [
        ("numpy", "numpy/version.py", None),
        ("numpy", "numpy/arm.urdf", "own: numpy has no file numpy/arm.urdf any more"),
        ("no-package-of-arms", "arm.urdf", "own: comes with no-package-of-arms: pip install no-package-of-arms"),
    ],
)
def test_a_description_is_found_in_the_package_that_ships_it(monkeypatch, package, file, complaint):
    """In a package that is always there, whose place Python itself says."""
    entry = {"package": package, "file": file, "title": "own", "home": [0.5]}
    monkeypatch.setattr(catalogue, "installed", lambda: {"own": entry})
    if complaint:
        with pytest.raises(RobotDescriptionError, match=f"^{complaint}$"):
            catalogue.find("own")
        return
    found = catalogue.find("own")
    assert found.path.samefile(Path(np.__file__).parent / "version.py")
    assert (found.name, found.extras, found.is_file) == ("own", {"home": [0.5]}, False)


@pytest.fixture(params=sorted(installed()))
def arm(request):
    package = installed()[request.param]["package"]
    try:
        importlib.metadata.distribution(package)
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(f"needs the description: pip install {package}")
    if installed()[request.param]["file"].endswith(".xml"):
        pytest.importorskip("mujoco")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RobotDescriptionWarning)  # every limit is known
        return load_robot(request.param)


def test_it_starts_inside_its_limits_above_the_floor_and_not_stretched(arm):
    system = MechanicalSystem(arm)
    assert (arm.home >= arm.lower).all()
    assert (arm.home <= arm.upper).all()
    way = arm.difference(arm.near_home(), arm.home)
    for share in np.linspace(0.0, 1.0, 9):
        x = system.at(arm.home + share * way)
        for frame in arm.frame_names:
            moves = np.abs(x.frame_jacobian(frame, "local_world_aligned")[:3]).max() > 1e-9
            assert x.placement(frame).translation[2] > (0.05 if moves else -0.01), frame
    jacobian = system.at(arm.home).frame_jacobian(arm.tool_frame, "local_world_aligned")
    assert np.linalg.svd(jacobian, compute_uv=False)[-1] > 0.1


def test_it_carries_itself_and_weighs_what_it_should(arm):
    """Against the makers' data: what is too light or too heavy by far is another arm."""
    mass = sum(inertia.mass for inertia in arm.model.inertias)
    assert 0.5 * HEAVIEST[arm.name] < mass < HEAVIEST[arm.name]
    weight = MechanicalSystem(arm).at(arm.home).potential_gradient
    assert (np.abs(weight) < 0.6 * arm.effort_limit).all()


def test_a_law_holds_it(arm):
    system = MechanicalSystem(arm)
    law = make_controller("energy_shaping", system)
    assert certify(law, samples=8).passed
    log = simulate(system, law, q0=arm.near_home(), duration=0.05, progress=False)
    assert np.isfinite(log.position).all()
