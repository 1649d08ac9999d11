"""One condition of the tables, sampled; its statistics, and how they scatter over experiments of the paper's size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from scipy.stats import beta, norm

from ..montecarlo import compile_plan, run_indices
from ..propagation.linear import LinearModel, covariance, linearise
from ..system import Array, Reading, System
from ..tail.gaussian import norm_mean, norm_quantile
from .paper_records import PaperCell
from .published import CELLS, TRIALS, Printed, Quantity, Setting, Table
from .settings import under

BAND = 0.99
WIDTH = float(norm.ppf(0.5 + BAND / 2))
P95 = 0.95
PART = 20_000  # trials sampled in one go
AXIS: dict[Quantity, int] = {"std_x": 0, "std_y": 1, "std_z": 2}
OTHER = {Reading.PHYSICAL: Reading.EQ18, Reading.EQ18: Reading.PHYSICAL}


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """A condition: errors of the full chain, and the linear model in both readings."""

    setting: Setting
    localisation: Array  # (3, n) mm, con
    tcp: Array  # (3, n) mm, tcp
    model: LinearModel
    other: LinearModel
    reprojection_px: float  # mean over trials of the RMS


@dataclass(frozen=True, slots=True)
class Statistic:
    """A number of a sample with its scatter over samples of the paper's size, and its own."""

    value: float
    published_error: float
    standard_error: float


def sampled(system: System, target: int, setting: Setting, trials: int, seed: int) -> Sampled:
    """The chain under a condition.  Without noise one trial is all there is."""
    here = under(system, setting)
    plan = compile_plan(here)
    count = trials if setting.noise_px > 0 else 1
    parts = [
        run_indices(plan, seed, first, min(PART, count - first), reprojection=True) for first in range(0, count, PART)
    ]
    errors = np.concatenate([part.errors[target] for part in parts], axis=-1)
    rms = np.concatenate([part.reprojection for part in parts if part.reprojection is not None])
    other = replace(here, reading=OTHER[here.reading])
    return Sampled(
        setting, errors[1], errors[0], linearise(here, here.targets[target]), linearise(other, other.targets[target]),
        float(rms.mean()),
    )  # fmt: skip


def statistic(errors: Array, quantity: Quantity) -> Statistic:
    """``quantity`` of errors (3, n), mm.

    Over experiments of 2,000 trials a mean scatters by s / sqrt(2000), a standard deviation by its fourth moment, and
    the 1,900th of 2,000 ordered norms as the quantile at a Beta(1900, 101) variate, whatever the law.
    """
    count = errors.shape[1]
    if quantity in AXIS:
        x = errors[AXIS[quantity]] - errors[AXIS[quantity]].mean()
        value = sqrt(float(x @ x) / max(count - 1, 1))
        fourth = float((x**4).mean())
        one = sqrt(max(fourth - value**4, 0.0)) / (2 * value) if value > 0 else 0.0
        return Statistic(value, one / sqrt(TRIALS), one / sqrt(count))
    norms = np.linalg.norm(errors, axis=0)
    if quantity == "mean":
        one = float(norms.std())
        return Statistic(float(norms.mean()), one / sqrt(TRIALS), one / sqrt(count))
    ordered = np.sort(norms)
    rank = round(P95 * TRIALS)
    ends = np.quantile(ordered, beta.ppf(norm.cdf([-1.0, 1.0]), rank, TRIALS - rank + 1))
    scatter = float(ends[1] - ends[0]) / 2
    return Statistic(float(np.quantile(ordered, P95)), scatter, scatter * sqrt(TRIALS / count))


def first_order(model: LinearModel, quantity: Quantity) -> float:
    """The same number of the linear model's exact law, mm."""
    mean, spread = model.localisation_bias_mm, covariance(model, "localisation")
    if quantity in AXIS:
        return sqrt(float(spread[AXIS[quantity], AXIS[quantity]]))
    return norm_mean(mean, spread) if quantity == "mean" else norm_quantile(P95, mean, spread)


def cell(at: Sampled, table: Table, row: str, quantity: Quantity, printed: Printed | None) -> PaperCell:
    """One cell; ``printed`` is what stands there, if it is held and compared with."""
    found = statistic(at.localisation, quantity)
    rounding = 0.0 if printed is None else printed.rounding_mm
    width = sqrt(found.published_error**2 + found.standard_error**2 + rounding**2 / 3)
    z = None if printed is None else (printed.value_mm - found.value) / width
    return PaperCell(
        table=table,
        row=row,
        quantity=quantity,
        rotation_deg=at.setting.rotation_deg,
        translation_mm=at.setting.translation_mm,
        noise_px=at.setting.noise_px,
        value_mm=found.value,
        standard_error_mm=found.standard_error,
        tcp_mm=statistic(at.tcp, quantity).value,
        first_order_mm=first_order(at.model, quantity),
        other_reading_mm=first_order(at.other, quantity),
        printed_mm=None if printed is None else printed.value_mm,
        rounding_mm=None if printed is None else rounding,
        published_error_mm=found.published_error,
        band_mm=(found.value - WIDTH * width, found.value + WIDTH * width),
        z=z,
        outside=None if z is None else abs(z) > WIDTH,
    )


def printed_at(table: Table, row: str, quantity: Quantity) -> Printed | None:
    """What is held of a cell."""
    held: Sequence[Printed] = [p for p in CELLS if (p.table, p.row, p.quantity) == (table, row, quantity)]
    return held[0] if held else None
