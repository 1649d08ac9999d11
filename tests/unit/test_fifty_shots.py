"""Fifty shots that stand for all: against closed forms, the score's own numbers, and draws of an independent chain."""

from math import isclose, log, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi, ncx2
from test_levels import clipped_on, on

import reference_chain
from plain_data import DEMO, EXAMPLES, replaced
from tailstack import load_design
from tailstack.results.score import SHOTS
from tailstack.scoring import score
from tailstack.system import System
from tailstack.tail.declared import WITHIN, LinearLaw, MixedLaw

ORDERS = (np.arange(SHOTS) + 0.5) / SHOTS

LAWS: list[tuple[float, float, float, float, Any]] = [  # with an answer, bias, std, uniform part along x, quantiles
    (1.0, 10.0, 0.1, 0.0, lambda p: 0.1 * np.sqrt(ncx2(3, 1e4).ppf(p))),  # narrow
    (1.0, 0.5, 0.0, 1.0, lambda p: np.where(p < 0.5, p, 2 * p - 0.5)),  # bent
    (1.0, 0.7, 0.0, 0.0, lambda p: np.full(len(p), 0.7)),  # known
    (0.875, 0.0, 0.3, 0.0, lambda p: 0.3 * chi(3).ppf(np.where(p < 0.875, p / 0.875, np.nan))),
]


@pytest.mark.parametrize(("answered", "bias", "std", "wide", "quantile"), LAWS)
def test_quantiles_are_those_of_closed_forms(
    answered: float, bias: float, std: float, wide: float, quantile: Any
) -> None:
    """closed_form: each lies between quantiles of orders WITHIN, and as much for the law's error, away."""
    law = LinearLaw(bias * np.eye(3)[0], std**2 * np.eye(3), wide * np.eye(3)[:, :1], np.zeros(1, dtype=np.int64))
    found = MixedLaw([law], np.array([answered])).middles(SHOTS)
    low, high = ((1 + 1e-4 * side) * quantile(ORDERS + 2 * side * WITHIN) for side in (-1, 1))
    assert np.array_equal(np.isnan(found), np.isnan(high))
    assert not ((found < low) | (found > high)).any()


MISSED = replaced(DEMO, ("fiducials", "loss_probability"), 0.02)


@pytest.mark.parametrize("design", [DEMO, EXAMPLES / "mean_and_tail.yaml", EXAMPLES / "clip_on.yaml", MISSED])
def test_a_score_has_them_of_what_decides(design: Any) -> None:
    """The order 0.95 is among the fifty; those beyond the limit are fifty times its probability, rounded."""
    found = score(load_design(design), losses=False, fifty_shots=True)
    values = np.array([np.inf if value is None else value for value in found.fifty_shots.values])
    assert values[47] == pytest.approx(found.targets[0].p95_mm, rel=1e-3)
    fifty = SHOTS * found.fifty_shots.exceedance_probability
    assert (values > found.fifty_shots.limit).sum() == round(fifty) or isclose(
        fifty % 1, 0.5, abs_tol=2 * SHOTS * WITHIN
    )


def columns_of(system: System) -> dict[str, NDArray[np.float64]]:
    """(3, k) mm of a standard deviation (normal) or an end (uniform) of each source: central differences of the plain
    chain by SVD."""
    target, count, columns = system.targets[0], len(system.fiducials_mm), {}
    sizes = {f"{of}_noise:{view.name}": [0.7] * (2 * points)
             for view in system.views for of, points in (("fiducial", count), ("target", 1))}  # fmt: skip
    sizes |= {link.name: link.sources.half_width.tolist() for link in system.interfaces}
    for name, widths in sizes.items():
        ends = []
        for width, unit in zip(widths, np.eye(len(widths)), strict=True):
            step = 1e-3 * width * unit
            above, below = (reference_chain.run(system, target, {name: side * step})["tcp"] for side in (1, -1))
            ends.append((above - below) / 2e-3)
        columns[name] = np.array(ends).T
    return columns


def test_they_part_draws_of_an_independent_chain_into_fiftieths() -> None:
    """independent: gains by central differences of the SVD chain, 400,000 draws of NumPy.  By Dvoretzky, Kiefer and
    Wolfowitz the empirical law is further away than the band in 1 of 1,000,000 seeds."""
    system = clipped_on(requirements=(on("pooled"),))
    shots = score(system, losses=False, fifty_shots=True).fifty_shots
    rng, count, error = np.random.default_rng(60), 400_000, np.zeros(3)
    for name, columns in columns_of(system).items():
        size = (count, columns.shape[1])
        drawn = rng.uniform(-1, 1, size) if name == "structure_connector" else rng.standard_normal(size)
        error = error + drawn @ columns.T
    norms = np.sort(np.linalg.norm(error, axis=1))
    orders = np.searchsorted(norms, np.array(shots and shots.values, dtype=np.float64)) / count
    assert np.abs(orders - ORDERS).max() < sqrt(log(2e6) / (2 * count)) + 2 * WITHIN
