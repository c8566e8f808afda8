"""Studies: a scenario in, a log and what it shows out."""
