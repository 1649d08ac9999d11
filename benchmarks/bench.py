"""./run bench [NAMES...]: every figure and every peer, interleaved in one run.

Wall time on a shared machine means little, so throughput is process CPU time and every target is a ratio of
two things measured in the same rounds.  ``--strict`` exits 1 when a *must* is missed.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

ROUNDS = 7


@dataclass(frozen=True, slots=True)
class Row:
    """One measured figure against what it must and should be; ``better`` says which way is good."""

    what: str
    value: float
    unit: str
    must: float | None = None
    aim: float | None = None
    better: str = ">"

    def meets(self, bar: float | None) -> bool:
        return bar is None or (self.value >= bar if self.better == ">" else self.value <= bar)


def interleaved(jobs: dict[str, Callable[[], int]], rounds: int = ROUNDS) -> dict[str, float]:
    """Median CPU seconds per item of each job (a job returns how many items it did), jobs in turn in each round."""
    spent: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.process_time()
            count = job()
            spent[name].append((time.process_time() - start) / count)
    return {name: median(values) for name, values in spent.items()}


def table(rows: list[Row]) -> str:
    lines = [f"{'what':66} {'measured':>14} {'must':>9} {'aim':>9}  verdict"]
    for row in rows:
        sign = "" if row.must is None and row.aim is None else row.better + "= " if row.better == ">" else "<= "
        bars = ["" if bar is None else f"{sign}{bar:g}" for bar in (row.must, row.aim)]
        verdict = (
            "MISSED" if not row.meets(row.must) else "aim" if row.aim is not None and row.meets(row.aim) else "must"
        )
        if row.must is None and row.aim is None:
            verdict = ""
        lines.append(f"{row.what:66} {row.value:10.5g} {row.unit:3} {bars[0]:>9} {bars[1]:>9}  {verdict}")
    return "\n".join(lines)


def main() -> int:
    from rows import GROUPS

    parser = argparse.ArgumentParser(prog="./run bench", description=__doc__)
    parser.add_argument("names", nargs="*", help=f"groups to run, default all: {', '.join(GROUPS)}")
    parser.add_argument("--strict", action="store_true", help="exit 1 when a must is missed")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in GROUPS]
    if unknown:
        parser.error(f"no such group: {', '.join(unknown)}; choose from {', '.join(GROUPS)}")
    print(f"tailstack benchmarks · Python {platform.python_version()} · {os.cpu_count()} cores · {platform.machine()}")
    rows: list[Row] = []
    for name in arguments.names or GROUPS:
        print(f"  measuring {name} ...", file=sys.stderr, flush=True)
        rows += GROUPS[name]()
    print(table(rows))
    missed = [row.what for row in rows if not row.meets(row.must)]
    print(
        f"{len(missed)} of {sum(row.must is not None for row in rows)} musts missed"
        + "".join(f"\n  {m}" for m in missed)
    )
    return 1 if missed and arguments.strict else 0


if __name__ == "__main__":
    sys.exit(main())
