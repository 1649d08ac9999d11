"""Is mode auto of the gate ever wrong towards optimism?  Fresh random designs of all classes, held to near limits.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/validity_study.py FILE [--designs N] [--seed N] [--nu LOW HIGH] [--effects] [FORM ...]
    .venv/bin/python benchmarks/validity_study.py FILE --designs 0     # the table alone

A form is an estimator, or one with its triangulation: ``dlt`` (the default), ``pose+weighted``; of several, each design
has the next.  Two to eight views, 6 to 40 fiducials (4 to 40 where the estimator knows the intrinsics), all laws, both
readings, biases, near and far targets, quantiles from P90 to P99.9 (``tests/random_designs.py``).  With ``--effects``
two of three designs have some of what can go wrong in an image as well.  Of each the limits 0.9 to 1.3 times first
order: at which of them does first order pass it, with the default guard band and without any; and what does a sampled
verdict say at one of them.  The chain's quantile itself comes from pairs of trials, sampled further where it is near
what is tolerated (1 % beyond the limit).  Each design is a line of FILE as soon as it is known; another seed adds
others.  Prints the table of ``docs/method.md``, and the designs that were passed wrongly.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests")]

from random_designs import FIDUCIALS
from tailstack.errors import NotConvergedError
from tailstack.system import Estimator
from validity_trials import Form, Trial, held_to_limits

NU = (0.003, 0.2)
TRIALS, JUDGED = 8192, 2**14
JUDGED_EVERY = 8  # of so many designs one has a verdict sampled
EFFECTS = ("intrinsics_error", "image_field", "motion", "sees", "temperature", "diameter_mm")


def effects_of(document: dict[str, Any]) -> list[str]:
    places = [*document["views"], document, document["fiducials"]]
    return [effect for effect in EFFECTS if any(effect in place for place in places)]


def bound(wrong: int, of: int) -> float:
    """Of a rate, 95 % (Clopper and Pearson, one side)."""
    return 1.0 if wrong == of else float(beta.ppf(0.95, wrong + 1, of - wrong))


def line(name: str, rows: Sequence[Trial]) -> str:
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
    cells.append(str(missed))
    for guard in (10, 0):
        wrong = sum(row.wrong(guard) for row in believed)
        cells.append(f"{wrong}, {100 * bound(wrong, len(believed)):.2f} %")
    return "| " + " | ".join(cells) + " |"


def table(rows: Sequence[Trial]) -> str:
    head = (
        "| | designs | believed | passed by first order, largest excess: guard band 10 % | no guard band | sampled, "
        "passed, largest excess | failed, would keep the limit by 1 % | wrong passes, 95 % bound | without guard band |"
    )
    groups: dict[str, list[Trial]] = {}
    for row in rows:
        present = effects_of(row.document) or ["no effect"]
        for name in (row.form.name, f"{row.views} views", *present, *(["published"] if row.published else [])):
            groups.setdefault(name, []).append(row)
    lines = [line(name, groups[name]) for name in sorted(groups)]
    return "\n".join([head, "|" + 9 * "---|", *lines, line("all", rows)])


def read(text: str) -> Trial:
    """A line of the file."""
    row = json.loads(text)
    row["form"] = Form(**row["form"])
    for name in ("passed_by_first_order", "failed_by_first_order"):
        row[name] = {int(guard): factor for guard, factor in row[name].items()}
    return Trial(**row)


def form_of(text: str, effects: bool) -> Form:
    estimator, _, triangulation = text.partition("+")
    few = (4, 5) if Estimator(estimator).believes_intrinsics else ()
    return Form(estimator, triangulation, effects, (*few, *FIDUCIALS))


def main(argv: Sequence[str] | None = None) -> list[Trial]:
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("forms", nargs="*", default=["dlt"])
    parser.add_argument("--designs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=2028)
    parser.add_argument("--nu", type=float, nargs=2, default=NU, help="range of the validity number")
    parser.add_argument("--effects", action="store_true")
    asked = parser.parse_intermixed_args(argv)
    rng = np.random.default_rng(asked.seed)
    for k in range(asked.designs):
        form = form_of(asked.forms[k % len(asked.forms)], asked.effects and k // len(asked.forms) % 3 > 0)
        judged = 0 if k % JUDGED_EVERY else JUDGED
        try:
            trial = held_to_limits(rng, trials=TRIALS, judged_trials=judged, nu=tuple(asked.nu), form=form)
        except NotConvergedError as refusal:
            print("no estimate:", form, refusal, flush=True)
            continue
        with asked.file.open("a") as file:
            file.write(json.dumps(asdict(trial)) + "\n")
    rows = [read(text) for text in asked.file.read_text().splitlines()]
    print(table(rows))
    for row in rows:
        if row.wrong(0):
            print("wrong:", row, effects_of(row.document))
    return rows


if __name__ == "__main__":
    main()
