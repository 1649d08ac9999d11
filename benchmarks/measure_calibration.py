"""How good first order is of each measure where the validity number says so: what lets a score decide its limits.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/measure_calibration.py FILE [--designs N] [--seed N]
    .venv/bin/python benchmarks/measure_calibration.py FILE --designs 0     # the table alone

Random designs as ``validity_study.py`` has them (all estimators and triangulations that are trusted, half with corners,
half with effects), each with a trajectory of 20 to 150 mm, a body of four to six points 10 to 60 mm from its target,
another body that it is read against, and a requirement on each component, either way and one-sided.  Of each site the
ratio of the chain's quantile to first order's, in the same deviates, so that most of the chance cancels: 16,384 trials,
and eight times as many where a ratio is outside its band, which is that of the point times what the score says
(``ErrorModel.times_apart``).  Each design is a line of FILE as soon as it is known;
another seed adds others.

The table: for each measure and level of the statement, how many sites there are, and for each quantile how many are
outside their band and the ratios farthest from one; in the end the 95 % bound (Clopper and Pearson) of the rate at P95,
of designs: a design counts once, as what its sites share makes them alike.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests")]

from random_designs import VIEWS, random_design
from tailstack.contributors import mean_at
from tailstack.design import check_design, load_design
from tailstack.errors import TailstackError
from tailstack.montecarlo.chain import OTHER_STREAM, columns_of_shots, draw, measure_trials, norms_of, run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.radial import gains_in_plan_order
from tailstack.propagation.linear import chain_of, linearise_all
from tailstack.propagation.validity import error_percent
from tailstack.scoring import trust_of
from tailstack.system import System
from validity_study import FORMS

QUANTILES = (0.9, 0.95, 0.99, 0.999)
TRIALS, BATCH, AGAIN = 2**14, 2**13, 8
NU = (0.002, 0.15)
LEVELS = ("good to 1 %", "good to 5 %", "good to 20 %")
COMPONENTS = [(f"{of}{axis}", side) for of in ("", "localisation_") for axis in "xyz" for side in ("both", "above")]


def unit(rng: np.random.Generator) -> np.ndarray:
    found = rng.normal(size=3)
    return np.asarray(found / np.linalg.norm(found))


def with_measures(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The design, measured wherever a measure can be read."""
    (target,) = document["targets"]
    aim, reach = np.array(target["position_mm"]), rng.uniform(10, 60)
    targets = [target | {"entry": "entry", "corridor_mm": 2.0}]
    if rng.random() < 0.3:
        targets[0]["ends"] = "two_shots"
    targets.append({"name": "entry", "position_mm": (aim + rng.uniform(20, 150) * unit(rng)).tolist()})
    bodies = []
    for body, centre in (("a", aim), ("b", aim + rng.uniform(0, 60) * unit(rng))):
        names = [f"{body}{k}" for k in range(rng.integers(4, 7))]
        targets += [{"name": name, "position_mm": (centre + reach * unit(rng)).tolist()} for name in names]
        bodies.append({"name": body, "targets": names})
    bodies[0]["against"] = "b"
    stated = [
        {"name": f"r{k}", "error": name, "limit_mm": 9.0, "targets": ["t"]} | ({} if side == "both" else {"side": side})
        for k, (name, side) in enumerate(COMPONENTS)
    ]
    stated.append({"name": "distance", "error": "point_to_point", "limit_mm": 9.0, "targets": ["t", "entry"]})
    return document | {"targets": targets, "bodies": bodies, "requirements": stated}


def paired_numbers(system: System, trials: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(M, n) of the measures' sites: their numbers by the full chain, and by first order in the same deviates; and (M,)
    how many times larger they would be if nothing of the errors at their targets cancelled."""
    plan, models = compile_plan(system, vertex={}), linearise_all(chain_of(system))
    gains = [
        gains_in_plan_order(plan, model.blocks, (k,), error)
        for k, model in enumerate(models.values()) for error in ("tcp", "localisation")
    ]  # fmt: skip
    means = [mean_at(model, error, {}) for model in models.values() for error in ("tcp", "localisation")]
    matrix, mean = np.vstack(gains), np.concatenate(means)[:, None]
    again = columns_of_shots(plan)
    names, chain, first, apart = [target.name for target in system.targets], [], [], []

    def by_target(z: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(names, (matrix @ z.T + mean).reshape(len(names), 6, -1), strict=True))

    for start in range(0, trials, BATCH):
        indices = np.arange(start, start + BATCH)
        exact = measure_trials(plan, seed, start, run_indices(plan, seed, start, BATCH).errors)[2 * len(names) :]
        z = draw(plan, seed, indices)
        points = by_target(z)
        z[:, again] = draw(plan, seed, indices, OTHER_STREAM)[:, again]
        others, own = by_target(z), []
        for _, site in system.derived_metrics:
            at = points | ({site.other_shot: others[site.other_shot]} if site.other_shot else {})
            e = sum((weights[:, :, None] * at[name]).sum(axis=1) for name, weights in site.weights.items())
            pair = np.asarray(e).reshape(-1, 3, BATCH)
            own.append(np.max([norms_of(each, site.is_one_sided) for each in pair], axis=0))
            if start == 0:
                halves = [(rows[:, :3], at[name][:3]) for name, rows in site.weights.items()]
                halves += [(rows[:, 3:], at[name][3:]) for name, rows in site.weights.items()]
                most = sum(np.linalg.norm(rows, 2) ** 2 * (e**2).sum(axis=0).mean() for rows, e in halves)
                apart.append(np.sqrt(most / (pair**2).sum(axis=(0, 1)).mean()))
        first.append(np.array(own))
        sides = [metric.site.is_one_sided for metric in system.derived_metrics]
        chain.append(np.array([norms_of(each, side) for each, side in zip(exact, sides, strict=True)]))
    return np.hstack(chain), np.hstack(first), np.array(apart)


def compare(rng: np.random.Generator, form: str) -> dict[str, Any] | None:
    estimator, triangulation = form.split("+")
    views, few = int(rng.choice(VIEWS)), () if estimator in ("dlt", "reprojection") else (4, 5)
    fiducials = int(rng.choice((*few, 6, 7, 8, 10, 12, 14, 20, 40)))
    effects, corners = rng.random(2) < 0.5
    document = random_design(
        rng, views, fiducials, False, NU, estimator=estimator, triangulation=triangulation, effects=bool(effects),
        corners=bool(corners),
    )  # fmt: skip
    document, seed = with_measures(document, rng), int(rng.integers(2**31))
    try:
        system, _, _ = check_design(load_design(document))
        names = [metric.measure.name + (" (doubted)" if metric.site.doubt else "") for metric in system.derived_metrics]
        trust = trust_of(system, linearise_all(chain_of(system)))
        if trust.expected_error_percent is None:
            return None
        percents = np.array([error_percent(trust, q) for q in QUANTILES])
        ratios = None
        for trials in (TRIALS, AGAIN * TRIALS):
            *numbers, apart = paired_numbers(system, trials, seed)
            chain, first = (np.quantile(each, QUANTILES, axis=1).T for each in numbers)
            ratios = np.where(first > 0, chain / np.where(first > 0, first, 1), 1.0)
            times = np.maximum(apart, 1.0)[:, None]
            out = np.abs(np.log(ratios)) > np.log1p(times * percents / 100)
            if not out[[not name.endswith("(doubted)") for name in names]].any():
                break
    except TailstackError as refusal:
        return {"form": form, "refusal": str(refusal)}
    return {
        "form": form, "views": views, "fiducials": fiducials, "status": trust.status, "percents": percents.tolist(),
        "effects": bool(effects), "corners": bool(corners), "trials": trials, "seed": seed, "names": names,
        "apart": np.round(apart, 3).tolist(),
        "ratios": np.round(ratios, 5).tolist(), "document": document,
    }  # fmt: skip


def print_table(rows: list[dict[str, Any]]) -> None:
    told = [row for row in rows if "ratios" in row]
    print(
        f"{len(told)} designs\n\n| measure | statement | sites | P90 | P95 | P99 | P99.9 | designs, out at P95, bound |"
    )
    print("|" + 8 * "---|")
    cells: dict[tuple[str, str], list[tuple[int, list[float], list[float]]]] = defaultdict(list)
    for place, row in enumerate(told):
        for name, ratios, apart in zip(row["names"], row["ratios"], row["apart"], strict=True):
            percents = [max(1.0, apart) * percent for percent in row["percents"]]
            for key in ((name, row["status"]), (name, "all")):
                cells[key].append((place, ratios, percents))
    order = [*LEVELS, "all"]
    for name, level in sorted(cells, key=lambda key: (key[0], order.index(key[1]))):
        chosen = cells[name, level]
        ratios, percents = (np.array([each[k] for each in chosen]) for k in (1, 2))
        out = np.abs(np.log(ratios)) > np.log1p(percents / 100)
        text = [
            f"{out[:, k].sum()}: {ratios[:, k].min():.3f} … {ratios[:, k].max():.3f}" for k in range(len(QUANTILES))
        ]
        designs, wrong = {each[0] for each in chosen}, {chosen[k][0] for k in np.flatnonzero(out[:, 1])}
        bound = 100 * beta.ppf(0.95, len(wrong) + 1, len(designs) - len(wrong)) if len(wrong) < len(designs) else 100
        print(
            "| "
            + " | ".join([name, level, str(len(chosen)), *text, f"{len(designs)}, {len(wrong)}, {bound:.1f} %"])
            + " |"
        )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--designs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=2061)
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    for k in range(asked.designs):
        row = compare(rng, FORMS[k % len(FORMS)])
        if row is not None:
            with asked.file.open("a") as file:
                file.write(json.dumps(row) + "\n")
    print_table([json.loads(line) for line in asked.file.read_text().splitlines()])


if __name__ == "__main__":
    main()
