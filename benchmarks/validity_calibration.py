"""How good first order is where the validity number says so: the calibration behind ``propagation/validity.py``.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/validity_calibration.py [LAYOUTS [TRIALS [FORM ...]]]

For every count of views (2 to 8) and group of fiducials (6, 7-8, 9-14, 20-40): LAYOUTS random designs
(``tests/random_designs.py``) whose validity number, as it is counted for their fiducials, lies between 0.004 and 0.16.
Of each the ratio of the chain's quantile to first order's, both from the same trials, so that most of the chance
cancels; a ratio outside its band is sampled again with sixteen times the trials.  Prints, for each count of views and
level of the statement, how many layouts there were, the share within the band, and the worst ratios; the same for the
quantiles above P95 and below, with the bands that first-order intervals have there, and for the mean of the worst 5 %.
"""

from __future__ import annotations

import sys
import time
from math import log
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests")]

from random_designs import VIEWS, random_design
from tailstack.design import check_design, load_design
from tailstack.montecarlo import compile_plan, draw, evaluate, gains_in_plan_order
from tailstack.propagation.linear import linearise
from tailstack.propagation.validity import COUNTED, error_percent
from tailstack.scoring import trust_of
from tailstack.system import System

QUANTILES = (0.9, 0.95, 0.99, 0.999)
CVAR_LIKE = 0.99
GROUPS = {"6": (6,), "7-8": (7, 8), "9-14": (9, 10, 11, 12, 13, 14), "20-40": (20, 40)}
RANGE = (0.004, 0.16)
BATCH = 8192


def ratios(system: System, error: str, trials: int, seed: int) -> np.ndarray:
    """Chain over first order, of each quantile and then of the mean of the worst 5 %."""
    plan, model = compile_plan(system), linearise(system, system.targets[0])
    gain, metric = gains_in_plan_order(plan, model.blocks, 0, error), ("tcp", "localisation").index(error)
    chain, linear = np.empty(trials), np.empty(trials)
    for start in range(0, trials, BATCH):
        z = draw(plan, seed, np.arange(start, min(start + BATCH, trials)))
        part = slice(start, start + len(z))
        chain[part] = np.linalg.norm(evaluate(plan, z)[:, 0, metric], axis=1)
        linear[part] = np.linalg.norm(z @ gain.T + model.bias_mm(error), axis=1)
    found = [np.quantile(chain, q) / np.quantile(linear, q) for q in QUANTILES]
    worst = max(1, trials // 20)
    found.append(np.sort(chain)[-worst:].mean() / np.sort(linear)[-worst:].mean())
    return np.array(found)


def bands(percents: list[float]) -> np.ndarray:
    return np.array([log(1 + percent / 100) for percent in percents])


def layout(rng: np.random.Generator, views: int, fiducials: int, published: bool, trials: int) -> dict[str, Any]:
    times = COUNTED.get(fiducials, 1.0)
    document = random_design(rng, views, fiducials, published, (RANGE[0] / times, RANGE[1] / times))
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


def report(rows: list[dict[str, Any]], views: int, level: str) -> None:
    chosen = [row for row in rows if row["trust"].status == level]
    if not chosen:
        return
    found = np.array([row["ratios"] for row in chosen])
    cells = []
    for k, name in enumerate(("P90", "P95", "P99", "P99.9", "CVaR95")):
        percent = chosen[0]["percents"][k]
        text = f"{found[:, k].min():.3f} .. {found[:, k].max():.3f}"
        if np.isfinite(percent):
            within = np.mean(np.abs(np.log(found[:, k])) <= bands([percent])[0])
            low = np.mean(np.log(found[:, k]) > bands([percent])[0])
            text = f"{within:6.1%} in {percent:g} % (optimistic {low:.1%}) {text}"
        cells.append(f"{name} {text}")
    print(f"{views} views, {level}: {len(chosen)} layouts; " + "; ".join(cells), flush=True)


def main(layouts: int = 300, trials: int = BATCH, *forms: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for form in forms or ("normalised",):
        print(f"--- {form} triangulation")
        for views in VIEWS:
            own, start = [], time.process_time()
            for place, (_, counts) in enumerate(GROUPS.items()):
                rng = np.random.default_rng([2027, views, place, form == "published"])
                own += [
                    layout(rng, views, int(rng.choice(counts)), form == "published", trials) for _ in range(layouts)
                ]
            for level in ("good to 1 %", "good to 5 %", "good to 20 %", "not valid"):
                report(own, views, level)
            for row in own:
                if row["trust"].expected_error_percent is None:
                    continue
                beyond = np.log(row["ratios"]) > bands(row["percents"])
                if beyond.any():
                    trust = row["trust"]
                    print(f"    optimistic: {row['fiducials']} fiducials, {trust.status}, depth {trust.nu_depth:.3f}, "
                          f"crossing {trust.nu_crossing:.3f}, disagreement {trust.nu_disagreement:.3f}, "
                          f"{row['error']}, {np.round(row['ratios'], 3)}, {row['rules']}")  # fmt: skip
            rows += own
            print(f"    {time.process_time() - start:.0f} s", flush=True)
    return rows


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:3]), *sys.argv[3:])
