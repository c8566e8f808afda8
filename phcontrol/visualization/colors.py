"""The colours of plots and pages."""

INK = "#30343b"
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5195", "#6b705c")
"""A palette that stays apart for colour-blind eyes, one colour a joint."""
