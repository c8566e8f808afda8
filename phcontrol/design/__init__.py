"""Gains from a specification: what a closed loop should do, turned into the arguments of a law."""
