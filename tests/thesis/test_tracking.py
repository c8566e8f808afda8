"""The tracking law as printed is another law than Theorem 6.1.1's, by exactly the friction and the kinetic term."""

from __future__ import annotations

import numpy as np

from phcontrol import TrajectoryTracking, certify
from phcontrol.thesis.printed_tracking import PrintedTracking
from phcontrol.thesis.tracking import GAINS, shoulder, sinusoid


def test_the_law_as_printed_counts_the_friction_twice():
    system = shoulder(0.01)
    options = {"trajectory": sinusoid(1 / 30), "interconnection": "transformed", **GAINS}
    printed, corrected = PrintedTracking(system, **options), TrajectoryTracking(system, **options)
    assert certify(corrected, samples=20).passed
    assert not certify(printed, samples=20).passed
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, v, h = rng.normal(size=2), rng.normal(size=2), 1e-6
        x = system.at(q, v)

        def kinetic(q, p):
            return 0.5 * p @ np.linalg.solve(system.at(q).mass_matrix, p)

        p = x.mass_matrix @ v
        step = h * np.eye(2)
        slope = np.array([(kinetic(q + e, p) - kinetic(q - e, p)) / (2 * h) for e in step])
        extra = printed.evaluate(1.0, x, np.zeros(0)).torque - corrected.evaluate(1.0, x, np.zeros(0)).torque
        np.testing.assert_allclose(extra, x.damping * v + slope, atol=1e-7)
