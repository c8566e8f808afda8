"""Timings in turns with references, and what tests share with them."""
