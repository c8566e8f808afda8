"""Runs that work with any arm: a law to a posture, along a trajectory, by a camera; certificates of every arm."""
