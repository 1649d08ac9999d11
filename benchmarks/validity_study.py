"""Is mode auto of the gate ever wrong towards optimism?  Fresh random designs of all classes, held to near limits.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/validity_study.py [DESIGNS [SEED]]

Two to eight views, 6 to 40 fiducials, all laws, both readings and forms, biases, near and far targets, quantiles from
P90 to P99.9 (``tests/random_designs.py``), validity numbers between 0.003 and 0.2.  Of each the limits 0.9 to 1.3 times
first order: at which of them does first order pass it, with the default guard band and without any; and what does a
sampled verdict say at one of them.  The chain's quantile itself comes from pairs of trials, sampled further where it is
near what is tolerated (1 % beyond the limit).  Prints the table of ``docs/method.md``.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests")]

from random_designs import VIEWS
from validity_trials import Trial, held_to_limits

NU = (0.003, 0.2)
TRIALS, JUDGED = 8192, 2**14
JUDGED_EVERY = 8  # of so many designs one has a verdict sampled


def line(name: str, rows: list[Trial]) -> str:
    believed = [row for row in rows if row.believed]
    cells = [name, str(len(rows)), str(len(believed))]
    for guard in (10, 0):
        largest = max((row.excess(guard) for row in believed), default=-1.0)
        passed = sum(row.passed_by_first_order.get(guard) is not None for row in rows)
        cells.append(f"{passed}, {100 * largest:+.1f} %")
    judged = [row for row in rows if row.sampled is not None]
    passed_here = [row for row in judged if row.sampled is not None and row.sampled[1] == "pass"]
    largest = max((row.ratio / row.sampled[0] - 1 for row in passed_here if row.sampled), default=-1.0)
    cells.append(f"{len(judged)}, {len(passed_here)}, {100 * largest:+.1f} %")
    missed = 0
    for row in believed:
        at = row.failed_by_first_order.get(10)
        missed += at is not None and row.ratio < at / 1.01
    cells += [str(missed), str(sum(row.wrong(10) for row in rows)), str(sum(row.wrong(0) for row in rows))]
    return "| " + " | ".join(cells) + " |"


def table(rows: list[Trial]) -> str:
    head = (
        "| views | designs | believed | passed by first order, largest excess: guard band 10 % | no guard band "
        "| sampled, passed, largest excess | failed, would keep the limit by 1 % | wrong passes | without guard band |"
    )
    lines = [line(str(views), [row for row in rows if row.views == views]) for views in VIEWS]
    published = line("of these published", [row for row in rows if row.published])
    return "\n".join([head, "|" + 9 * "---|", *lines, line("all", rows), published])


def main(designs: int = 2000, seed: int = 2028) -> list[Trial]:
    rng = np.random.default_rng(seed)
    rows: list[Trial] = []
    start = time.process_time()
    for k in range(designs):
        rows.append(held_to_limits(rng, trials=TRIALS, judged_trials=0 if k % JUDGED_EVERY else JUDGED, nu=NU))
        if rows[-1].wrong(0):
            print("wrong:", rows[-1], flush=True)
        if (k + 1) % 250 == 0:
            print(f"{k + 1} designs, {time.process_time() - start:.0f} s\n{table(rows)}", file=sys.stderr, flush=True)
    print(table(rows))
    return rows


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
