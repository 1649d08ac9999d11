"""What a quality department reads beside how often an error is beyond its limit: dppm, sigma level and Ppk.

All three are of the exceedance, or stand beside it: none decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import NormalDist
from typing import NamedTuple

from .score import MetricScore, TargetScore
from .tables import PAPER, Column, Table, tabulate
from .verdicts import ERRORS, MeasureResult
from .verification import TargetEstimate

PARTS = 1e6


class LimitedError(NamedTuple):
    """An error with a limit, as a row is about it."""

    site: str
    words: str
    unit: str
    limit: float
    beyond: float  # share of shots
    at_most: float | None  # upper end of that, from trials
    ppk: float | None


def ppk_of(limit: float, mean: float, std: float, one_sided: bool = False) -> float | None:
    """``(limit - |mean|) / (3 std)`` of a number that is limited either way, by its nearer end, on one side with the
    mean as it is; None: it does not vary.

    It is of the number itself, mean and standard deviation with their sign, not of its size.
    """
    return (limit - (mean if one_sided else abs(mean))) / (3 * std) if std > 0 else None


def sigma_level(share: float) -> float | None:
    """Standard deviations from mean to limit at which a normal number has this share beyond the limit, on one side and
    without the shift of 1.5 that some add; None: nothing is beyond it, or everything."""
    return -NormalDist().inv_cdf(share) if 0 < share < 1 else None


def limited_errors(
    targets: Sequence[TargetScore] | Sequence[TargetEstimate], measures: Sequence[MeasureResult]
) -> Iterator[LimitedError]:
    """Of a score or of a check by simulation, in the order of the record."""
    for target in targets:
        for name, metric in (("tcp", target), ("localisation", target.localisation)):
            if isinstance(metric, MetricScore):
                limit, share, at_most = metric.limit_mm, metric.exceedance_probability, None
            elif metric.exceedance is not None:
                limit, share = metric.exceedance.limit_mm, metric.exceedance.probability
                at_most = metric.exceedance.interval[1]
            else:
                continue
            if limit is not None:
                yield LimitedError(target.name, ERRORS[name], "mm", limit, share or 0.0, at_most, None)
    for each in measures:
        if each.limit is not None:
            share = each.exceedance_probability or 0.0
            yield LimitedError(each.site, each.words, each.unit, each.limit, share, None, each.ppk)


def quality_table(
    targets: Sequence[TargetScore] | Sequence[TargetEstimate], measures: Sequence[MeasureResult]
) -> Table | None:
    """One row for each error with a limit; None where there is none."""
    rows = list(limited_errors(targets, measures))
    of_trials = Column("dppm at most", "", "significant", 3, PAPER, of=lambda row: row.at_most and row.at_most * PARTS)
    columns = (
        Column("At", of=lambda row: row.site),
        Column("Error", of=lambda row: row.words),
        Column("Unit", of=lambda row: row.unit),
        Column("Limit", "", "stated", 3, of=lambda row: row.limit),
        Column("Beyond limit", "%", "percent", 3, of=lambda row: row.beyond),
        Column("dppm", "", "significant", 3, of=lambda row: row.beyond * PARTS),
        *((of_trials,) if any(row.at_most is not None for row in rows) else ()),
        Column("Sigma level", "", "fixed", 2, of=lambda row: sigma_level(row.beyond)),
        Column("Ppk", "", "fixed", 2, brief="Ppk", of=lambda row: row.ppk),
    )
    note = (
        "dppm: shots beyond the limit per million. Sigma level: where a normal number would have as many beyond its "
        "limit, on one side, without a shift of 1.5. Ppk: (limit - |mean|) / (3 std), of what is one number with its "
        "sign, on one side with the mean as it is; sizes of vectors have none. What decides is the requirement."
    )
    return tabulate("Quality", "Quality figures of what has a limit", columns, rows, note) if rows else None
