"""How good first order is where the validity number says so: the calibration behind ``propagation/validity.py``.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/validity_calibration.py [LAYOUTS [TRIALS [FORM|ESTIMATOR ...]]]

For every count of views (2 to 8) and group of fiducials (6, 7-8, 9-14, 20-40): LAYOUTS random designs
(``tests/random_designs.py``) whose validity number, as it is counted for their fiducials, lies between 0.004 and 0.16.
Of each the ratio of the chain's quantile to first order's, both from the same trials, so that most of the chance
cancels; a ratio outside its band is sampled again with sixteen times the trials.  Prints, for each count of views and
level of the statement, how many layouts there were, and for each quantile the share whose ratio is within the band of
first-order intervals there and the ratios farthest from one; then the same by fiducials, and every layout that is
beyond its band towards optimism.
"""

from __future__ import annotations

import sys
from math import log
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests")]

from random_designs import VIEWS, random_design
from tailstack.design import check_design, load_design
from tailstack.propagation.linear import linearise
from tailstack.propagation.validity import COUNTED, error_percent
from tailstack.scoring import trust_of
from tailstack.system import System
from validity_trials import BATCH, paired_norms

QUANTILES = (0.9, 0.95, 0.99, 0.999)
CVAR_LIKE = 0.99
GROUPS = {"6": (6,), "7-8": (7, 8), "9-14": (9, 10, 11, 12, 13, 14), "20-40": (20, 40)}
FEWEST = {"pose": (4, 5), "pose_with_prior": (4, 5), "reprojection": ()}  # counts of fiducials beside those of DLT
RANGE = (0.004, 0.16)
STATEMENTS = ("good to 1 %", "good to 5 %", "good to 20 %")


def ratios(system: System, error: str, trials: int, seed: int) -> np.ndarray:
    """Chain over first order, of each quantile and then of the mean of the worst 5 %."""
    chain, linear = paired_norms(system, error, trials, seed)
    found = [np.quantile(chain, q) / np.quantile(linear, q) for q in QUANTILES]
    worst = max(1, trials // 20)
    return np.array([*found, np.sort(chain)[-worst:].mean() / np.sort(linear)[-worst:].mean()])


def bands(percents: list[float]) -> np.ndarray:
    return np.array([log(1 + percent / 100) for percent in percents])


def layout(rng: np.random.Generator, views: int, fiducials: int, form: str, trials: int) -> dict[str, Any]:
    times = COUNTED.get(fiducials, 1.0)
    span, estimator = (RANGE[0] / times, RANGE[1] / times), form if form in FEWEST else "dlt"
    document = random_design(rng, views, fiducials, form == "published", span, estimator=estimator)
    system, findings, _ = check_design(load_design(document))
    trust = trust_of(system, {"t": linearise(system, system.targets[0])})
    error, seed = str(rng.choice(["localisation", "tcp"])), int(rng.integers(2**31))
    found = ratios(system, error, trials, seed)
    percents = [error_percent(trust, q) for q in (*QUANTILES, CVAR_LIKE)]
    if trust.expected_error_percent is not None and (np.abs(np.log(found)) > bands(percents)).any():
        found = ratios(system, error, 16 * trials, seed)
    rules = sorted({finding.rule for finding in findings})
    return {
        "views": views, "fiducials": fiducials, "trust": trust, "percents": percents, "ratios": found, "rules": rules,
        "document": document, "error": error,
    }  # fmt: skip


def row_of(rows: list[dict[str, Any]], views: str, level: str) -> str:
    """A row of the table: of each quantile the share within its band, and the ratios farthest from one."""
    found = np.array([row["ratios"] for row in rows])
    cells = [views, level, str(len(rows))]
    for k in range(len(QUANTILES) + 1):
        within = np.mean(np.abs(np.log(found[:, k])) <= bands([rows[0]["percents"][k]])[0])
        cells.append(f"{within:.1%}, {found[:, k].min():.3f} … {found[:, k].max():.3f}")
    return "| " + " | ".join(cells) + " |"


def main(layouts: int = 300, trials: int = BATCH, *forms: str) -> None:
    for form in forms or ("normalised",):
        rows: list[dict[str, Any]] = []
        print(f"{form}\n\n| views | statement | layouts | P90 | P95 | P99 | P99.9 | CVaR95 |")
        print("|" + 8 * "---|", flush=True)
        for views in VIEWS:
            own = []
            for place, counts in enumerate(GROUPS.values()):
                rng = np.random.default_rng([2027, views, place, form == "published"])
                few = FEWEST.get(form, ()) if place == 0 else ()
                fiducials = rng.choice((*few, *counts), layouts)
                own += [layout(rng, views, int(count), form, trials) for count in fiducials]
            rows += own
            for level in STATEMENTS:
                chosen = [row for row in own if row["trust"].status == level]
                if chosen:
                    print(row_of(chosen, str(views), level), flush=True)
        for name, counts in GROUPS.items():
            for level in STATEMENTS:
                chosen = [row for row in rows if row["trust"].status == level and row["fiducials"] in counts]
                if chosen:
                    print(row_of(chosen, f"all, {name} fiducials", level))
        print()
        for row in rows:
            trust = row["trust"]
            if trust.expected_error_percent is not None and (np.log(row["ratios"]) > bands(row["percents"])).any():
                print(f"beyond: {row['views']} views, {row['fiducials']} fiducials, {trust.statement}; "
                      f"{row['error']}, {np.round(row['ratios'], 3)}, {row['rules']}")  # fmt: skip


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:3]), *sys.argv[3:])
