"""Sweeps that take a second."""

from __future__ import annotations

import copy

import pytest

SMALL = {
    "arm": {"robot": "pera_shoulder", "friction": {"viscous": 0.5}},
    "law": {"name": "force_feedback_measured", "goal": [0.3, 0.5]},
    "run": {"duration": 0.05, "control_period": 1e-3},
    "vary": {
        "payload_mass": {"uniform": [0.0, 0.5]},
        "friction_factor": {"distribution": "lognorm", "s": 0.3},
        "sensor_noise": {"uniform": [0.0, 0.1]},
        "sensor_delay": {"uniform": [0.0, 3e-3]},
        "disturbance.each": {"distribution": "norm", "scale": 1.0},
    },
    "sampling": {"method": "random", "runs": 12, "seed": 3, "chunk": 4},
    "measures": ["final_error", "peak_torque", "peak_velocity"],
}


@pytest.fixture
def small():
    """Return the arguments of a small sweep, to be changed."""
    return copy.deepcopy(SMALL)
