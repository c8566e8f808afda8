"""Trajectory tracking with the force sensor's reading in the law as (6.15) prints it."""

from __future__ import annotations

from phcontrol._validation import Array
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import Measured


class PrintedTracking(TrajectoryTracking):
    """(6.15) with the signs of errata E22 mended, but with −f, the total force of (6.1), where −f_e belongs.

    −f holds +D q̇, and −β of (6.14) holds +D q̇_d: the friction is counted twice (errata E26), and so is the change of
    the kinetic energy with q. Its certificate fails. Take it in the form "transformed", the thesis's.
    """

    name = "printed_tracking"

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State what the corrected law does, and all of −f but −∂V/∂q, which that has already."""
        stated = super().shape(t, x, state, measured)
        return stated._replace(effort=stated.effort - x.total_force() - x.potential_gradient)
