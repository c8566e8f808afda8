"""Search for input that the library does not stand, by atheris (coverage-guided) or at random.

    pip install atheris
    python -m tests.fuzz.search TARGET [--seconds 60] [--random] [--seed 0]

Prints how many inputs were tried, and each kind of crash once, with bytes that bring it back.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import time
import traceback
from collections import Counter
from pathlib import Path

NAMES = ("robot_description", "log_file", "arguments", "control_loop", "command_line")


def main() -> None:
    """Search, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", choices=NAMES)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--random", action="store_true", help="without atheris")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    counts: Counter[str] = Counter()
    crashes: dict[tuple[str, str], bytes] = {}
    if options.random:
        from tests.fuzz.targets import TARGETS, run
    else:
        import atheris

        with atheris.instrument_imports(include=["phcontrol"]):
            from tests.fuzz.targets import TARGETS, run
    target, start = TARGETS[options.target], time.monotonic()

    def report() -> None:
        print(options.target, dict(counts), "kinds of crashes:", len(crashes))
        for (kind, place), data in crashes.items():
            print(f"  {kind} at {place}: {data!r}")
        sys.stdout.flush()

    def one_input(data: bytes) -> None:
        if time.monotonic() - start > options.seconds:
            report()
            os._exit(1 if crashes else 0)
        try:
            counts[run(target, data)] += 1
        except BaseException as error:
            counts["crashed"] += 1
            places = [
                f"{Path(frame.filename).name}:{frame.lineno}"
                for frame in traceback.extract_tb(error.__traceback__)
                if "phcontrol/" in frame.filename
            ]
            crashes.setdefault((f"{type(error).__name__}: {str(error)[:60]}", " ".join(places[-2:])), data)

    if options.random:
        generator = random.Random(options.seed)
        while True:
            one_input(generator.randbytes(160))
    atheris.Setup([sys.argv[0], f"-seed={options.seed + 1}", "-max_len=192", "-len_control=0"], one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
