"""Two runs of suite.py side by side: what became faster or slower.

    python benchmarks/compare.py OLD.json NEW.json [--beyond 10]

Compares ratios to what was timed in the same run (steps over the hand-written Slotine-Li law, simulations over the
hand-written loop), because they mean the same on another day; and operations and differences as they are. Prints what
changed by more than --beyond percent, what is new and what is gone. Exit code 1 when something became slower.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

COST = ("ratio", "compiled ratio", "interpreted ratio", "evaluate ratio", "step ratio", "operations")
"""What is better when it is smaller."""
GAIN = ("over the loop by hand",)
"""What is better when it is larger."""
_BY_HAND = "pin.aba and RK4 by hand"


def figures(run: dict[str, Any]) -> dict[str, float]:
    """Return what is compared, by part, row and figure."""
    found = {}
    for part, rows in run["parts"].items():
        for name, row in rows.items():
            for key in COST:
                if isinstance(row.get(key), (int, float)):
                    found[f"{part} | {name} | {key}"] = float(row[key])
            rate = row.get("best")
            for kind in ("sampled", "continuous"):
                reference = rows.get(f"{_BY_HAND}, {kind}")
                if rate and reference and kind in name:
                    found[f"{part} | {name} | {GAIN[0]}"] = rate / reference["best"]
    return found


def compared(old: dict[str, Any], new: dict[str, Any], beyond: float) -> tuple[list[str], bool]:
    """Return lines that say what changed by more than a share, and whether something became slower."""
    before, after = figures(old), figures(new)
    lines, slower = [], False
    if old["machine"].get("processor") != new["machine"].get("processor"):
        lines.append("the machines differ: ratios may, too")
    if old.get("quick") or new.get("quick"):
        lines.append("a quick run is among them, whose times mean nothing")
    for name in before:
        if name not in after:
            lines.append(f"{'gone':<8} {name}")
            continue
        change = after[name] / before[name] - 1.0 if before[name] else 0.0
        if abs(change) <= beyond:
            continue
        worse = change < 0.0 if name.endswith(GAIN) else change > 0.0
        slower = slower or worse
        lines.append(
            f"{'slower' if worse else 'faster':<8} {name}: {before[name]:.4g} to {after[name]:.4g} ({change:+.0%})"
        )
    lines += [f"{'new':<8} {name}: {after[name]:.4g}" for name in after if name not in before]
    return lines, slower


def main() -> None:
    """Print what changed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--beyond", type=float, default=10.0, help="percent")
    options = parser.parse_args()
    old, new = (json.loads(path.read_text(encoding="utf-8")) for path in (options.old, options.new))
    if old.get("format") != new.get("format"):
        sys.exit(f"the files have formats {old.get('format')} and {new.get('format')}: run the suite again")
    print(f"{old['commit']} ({old['date']}) to {new['commit']} ({new['date']})")
    lines, slower = compared(old, new, options.beyond / 100.0)
    print("\n".join(lines) if lines else f"nothing changed by more than {options.beyond:g} %")
    if slower:
        sys.exit(1)


if __name__ == "__main__":
    main()
