"""How good first order is where the validity number says so: the calibration behind ``propagation/validity.py``.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/validity_calibration.py FILE [--layouts N] [--trials N] [--seed N] [FORM ...]
    .venv/bin/python benchmarks/validity_calibration.py FILE --layouts 0     # the tables alone

A form is a triangulation of DLT, an estimator, or both: ``published``, ``pose``, ``pose+weighted``.  For every count of
views (2 to 8) and group of fiducials (6, 7-8, 9-14, 20-40): random designs (``tests/random_designs.py``) whose validity
number, as it is counted for their fiducials, lies between 0.004 and 0.16.  Of each the ratio of the chain's quantile to
first order's, both from the same trials, so that most of the chance cancels; a ratio outside its band is sampled again
with more trials.  Each layout is a line of FILE as soon as it is known; another seed adds others to it, so that a run
that was killed, or that was too short, is continued.

The tables: for each form, count of views and level of the statement, how many layouts there are, and for each quantile
the share whose ratio is within the band of first-order intervals there and the ratios farthest from one; the same by
fiducials and by what is remarked of the geometry; and every layout that is beyond its band, or of which some trials
have no estimate.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from math import log
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests")]

from random_designs import DETERMINATION, VIEWS, random_design
from tailstack.design import check_design, load_design
from tailstack.errors import NotConvergedError
from tailstack.propagation.linear import linearise
from tailstack.propagation.validity import COUNTED, error_percent
from tailstack.scoring import trust_of
from tailstack.system import Estimator, System, Triangulation
from validity_trials import BATCH, paired_norms

QUANTILES = (0.9, 0.95, 0.99, 0.999)
CVAR_LIKE = 0.99
GROUPS = {"6": (6,), "7-8": (7, 8), "9-14": (9, 10, 11, 12, 13, 14), "20-40": (20, 40)}
FEWEST = {"pose": (4, 5), "pose_with_prior": (4, 5)}  # counts of fiducials beside those of DLT
RANGE = (0.004, 0.16)
STATEMENTS = ("good to 1 %", "good to 5 %", "good to 20 %", "not valid")


def ratios(system: System, error: str, trials: int, seed: int) -> np.ndarray:
    """Chain over first order, of each quantile and then of the mean of the worst 5 %."""
    chain, linear = paired_norms(system, error, trials, seed)
    found = [np.quantile(chain, q) / np.quantile(linear, q) for q in QUANTILES]
    worst = max(1, trials // 20)
    return np.array([*found, np.sort(chain)[-worst:].mean() / np.sort(linear)[-worst:].mean()])


def parts_of(form: str) -> tuple[str, str]:
    """The estimator of a form, and its triangulation or ""."""
    first, _, second = form.partition("+")
    return (first, second) if first in list(Estimator) else ("dlt", first)


def layout(
    rng: np.random.Generator, views: int, fiducials: int, form: str, trials: int, trials_again: int
) -> dict[str, Any]:
    times = COUNTED.get(fiducials, 1.0)
    estimator, triangulation = parts_of(form)
    span = RANGE[0] / times, RANGE[1] / times
    document = random_design(rng, views, fiducials, False, span, estimator=estimator, triangulation=triangulation)
    system, findings, _ = check_design(load_design(document))
    # what would be said of it if its class were calibrated, which is what this decides
    trust = trust_of(
        replace(system, triangulation=Triangulation.NORMALISED), {"t": linearise(system, system.targets[0])}
    )
    percents = [error_percent(trust, q) for q in (*QUANTILES, CVAR_LIKE)]
    error, seed = str(rng.choice(["localisation", "tcp"])), int(rng.integers(2**31))
    row = {
        "form": form, "views": views, "fiducials": fiducials, "status": trust.status, "statement": trust.statement,
        "nu": trust.nu * times, "percents": percents, "rules": sorted({finding.rule for finding in findings}),
        "error": error, "seed": seed, "trials": trials,
    }  # fmt: skip
    try:
        found = ratios(system, error, trials, seed)
        if trust.expected_error_percent is not None and (np.abs(np.log(found)) > bands(percents)).any():
            found, row["trials"] = ratios(system, error, trials_again, seed), trials_again
    except NotConvergedError as refusal:
        return {**row, "refusal": str(refusal), "document": document}
    out = trust.expected_error_percent is not None and (np.abs(np.log(found)) > bands(percents)).any()
    return {**row, "ratios": found.tolist(), **({"document": document} if out else {})}


def bands(percents: list[float]) -> np.ndarray:
    return np.array([log(1 + percent / 100) for percent in percents])


def row_of(rows: list[dict[str, Any]], name: str, level: str) -> str:
    """A row of the table: of each quantile the share within its band, and the ratios farthest from one."""
    found = np.array([row["ratios"] for row in rows])
    cells = [name, level, str(len(rows))]
    for k in range(len(QUANTILES) + 1):
        within = np.mean(np.abs(np.log(found[:, k])) <= bands([rows[0]["percents"][k]])[0])
        cells.append(f"{within:.1%}, {found[:, k].min():.3f} … {found[:, k].max():.3f}")
    return "| " + " | ".join(cells) + " |"


def print_table(form: str, rows: list[dict[str, Any]]) -> None:
    """rows: all of the form."""
    print(f"\n{form}: {len(rows)} layouts\n\n| | statement | layouts | P90 | P95 | P99 | P99.9 | CVaR95 |")
    print("|" + 8 * "---|")
    simulated = [row for row in rows if "ratios" in row]
    groups = {f"{views} views": [row for row in simulated if row["views"] == views] for views in VIEWS}
    for count in sorted({count for counts in (*FEWEST.values(), *GROUPS.values()) for count in counts}):
        groups[f"{count} fiducials"] = [row for row in simulated if row["fiducials"] == count]
    for rule in DETERMINATION:
        groups[f"remarked: {rule}"] = [row for row in simulated if rule in row["rules"]]
    for name, group in {**groups, "all": simulated}.items():
        for level in STATEMENTS:
            chosen = [row for row in group if row["status"] == level]
            if chosen:
                print(row_of(chosen, name, level))
    print()
    for row in rows:
        text = f"{row['views']} views, {row['fiducials']} fiducials, {row['statement']}; {row['error']}"
        if "ratios" not in row:
            print(f"no estimate: {text}: {row['refusal']}")
        elif row["status"] != "not valid" and (np.abs(np.log(row["ratios"])) > bands(row["percents"])).any():
            print(f"beyond: {text}, {np.round(row['ratios'], 3)} of {row['trials']} trials, {row['rules']}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("forms", nargs="*", default=["normalised"])
    parser.add_argument("--layouts", type=int, default=150, help="of each form, count of views and group of fiducials")
    parser.add_argument("--trials", type=int, default=BATCH)
    parser.add_argument("--trials-again", type=int, default=16 * BATCH, help="where a ratio is outside its band")
    parser.add_argument("--seed", type=int, default=2027)
    asked = parser.parse_args()
    for form in asked.forms if asked.layouts else ():
        for views in VIEWS:
            for place, counts in enumerate(GROUPS.values()):
                rng = np.random.default_rng([asked.seed, views, place, form == "published"])
                few = FEWEST.get(parts_of(form)[0], ()) if place == 0 else ()
                for count in rng.choice((*few, *counts), asked.layouts):
                    row = layout(rng, views, int(count), form, asked.trials, asked.trials_again)
                    with asked.file.open("a") as file:
                        file.write(json.dumps(row) + "\n")
    rows = [json.loads(line) for line in asked.file.read_text().splitlines()]
    for form in sorted({row["form"] for row in rows}):
        print_table(form, [row for row in rows if row["form"] == form])


if __name__ == "__main__":
    main()
