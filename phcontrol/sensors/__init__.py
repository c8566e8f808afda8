"""What a controller is shown of the truth."""

from phcontrol.sensors.measured import NOTHING, Measured

__all__ = ["NOTHING", "Measured"]
