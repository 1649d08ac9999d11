"""How good first order is, as a function of nu: the calibration behind ``propagation/validity.py``.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/validity_calibration.py [SCENES [TRIALS]]

Random layouts (cubes and random clouds of 6-20 fiducials, 6-50 mm half-size, target up to 120 mm away), noise only;
views 60 or 90 degrees apart with 0.3-5 px, and views 0.3-30 degrees apart with 0.03-1 px.  First-order quantiles
against Monte Carlo.  Prints, for each level, the number of layouts and the share whose P95 is within its band, for six
fiducials and for more.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests")]

from scenes import cube_fiducials, system_of, target, with_noise
from tailstack.errors import IllPosedError
from tailstack.estimation.checks import check_geometry
from tailstack.montecarlo.estimators import quantile_estimate
from tailstack.montecarlo.simulate import simulate
from tailstack.propagation.linear import covariance, linearise
from tailstack.propagation.validity import validity
from tailstack.tail.gaussian import norm_quantile

QUANTILES = (0.5, 0.95, 0.99, 0.999)


def random_scene(rng: np.random.Generator, narrow: bool):
    half, count = float(rng.choice([6, 10, 15, 20, 30, 50])), int(rng.choice([6, 7, 8, 10, 12, 20]))
    fiducials = cube_fiducials(half, (0, 0, 0)) if rng.random() < 1 / 3 else rng.uniform(-half, half, (count, 3))
    direction = rng.standard_normal(3)
    aim = direction / np.linalg.norm(direction) * rng.uniform(0, 120)
    azimuths = (0.0, float(rng.choice([np.pi / 2, np.pi / 3])))
    noise = float(rng.choice([0.3, 0.5, 1, 2, 5]))
    if narrow:
        azimuths = (0.0, float(np.radians(np.exp(rng.uniform(np.log(0.3), np.log(30))))))
        noise = float(rng.choice([0.03, 0.1, 0.3, 0.5, 1]))
    return system_of(fiducials, views=with_noise(noise, azimuths_rad=azimuths), targets=(target(aim),))


def rows_of(narrow: bool, scenes: int, trials: int) -> list:
    """(fiducials, validity, first-order over Monte Carlo at each quantile) of random layouts."""
    rng = np.random.default_rng([2026, narrow])
    rows = []
    while len(rows) < scenes:
        system = random_scene(rng, narrow)
        try:
            check_geometry(system)
        except IllPosedError:
            continue
        model = linearise(system, system.targets[0])
        if not 0.003 < model.nu < 0.3:
            continue
        first = covariance(model, "localisation")
        samples = simulate(system, trials=trials, seed=len(rows), quantile=min(QUANTILES))
        found = [quantile_estimate(samples, 0, "localisation", q) for q in QUANTILES]
        ratios = [norm_quantile(q, np.zeros(3), first) / f.value_mm for q, f in zip(QUANTILES, found, strict=True)]
        rows.append((len(system.fiducials_mm), validity(model.nu, len(system.fiducials_mm)), ratios))
    return rows


def main(scenes: int = 400, trials: int = 100_000) -> None:
    print(f"{'views, deg':>9} {'fiducials':>9} {'level':>14} {'layouts':>8} {'within':>8}  "
          "P95 ratio: 5 % .. 95 %, worst; P99.9: median")  # fmt: skip
    for narrow in (False, True):
        rows = rows_of(narrow, scenes, trials)
        for few in (False, True):
            for level in ("good to 1 %", "good to 5 %", "good to 20 %", "not valid"):
                chosen = [row for row in rows if (row[0] == 6) == few and row[1].status == level]
                if not chosen:
                    continue
                p95 = np.array([row[2][1] for row in chosen])
                far = float(np.median([row[2][3] for row in chosen]))
                band = chosen[0][1].expected_error_percent
                # The Monte Carlo P95 has its own error of about 0.4 % at these trials.
                share = "" if band is None else f"{np.mean(np.abs(1 / p95 - 1) <= band / 100 + 0.004):8.1%}"
                low, high = np.quantile(p95, [0.05, 0.95])
                worst = p95[np.argmax(np.abs(p95 - 1))]
                views, fiducials = "0.3-30" if narrow else "60, 90", "6" if few else "7-20"
                print(f"{views:>9} {fiducials:>9} {level:>14} {len(chosen):8d} {share:>8}  "
                      f"{low:.3f} .. {high:.3f}, {worst:.3f}; {far:.3f}")  # fmt: skip


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
