"""What of an error a requirement limits, over shots and installations together: one row of ``STATISTICS`` each.

Everything that judges asks the row; to add one is to add a row.  A value is read off a summary of the law to first
order, and estimated from trials with an interval; what is a quantile of the pooled law, or is decided by one, says so.
What is a weighted mean of quantiles says of which: the optimiser has its slopes from theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, Protocol

HIGHEST = 0.9999  # quantile of the pooled law that a requirement reaches


class LawNumbers(Protocol):
    """What is known of the law of an error to first order."""

    @property
    def mean_norm_mm(self) -> float: ...
    @property
    def cvar_mm(self) -> float: ...
    @property
    def exceedance(self) -> float | None: ...


Estimate = tuple[float, tuple[float, float]]  # a value and its interval
Mixture = tuple[tuple[float, float], ...]  # quantiles, each with its weight


class Trials(Protocol):
    """The trials of an error."""

    def mean(self) -> Estimate: ...
    def cvar(self, quantile: float) -> Estimate: ...
    def exceedance(self, limit: float) -> Estimate: ...


@dataclass(frozen=True, slots=True, eq=False)
class Statistic:
    """A row; texts have {q} (100 * quantile), {rest} (100 - q), {n}, {beyond} with its unit, {of}, {error}, {shots}."""

    name: str  # in documents and records
    meaning: str  # one sentence without a full stop
    headline: str  # what its value is: P95; {of}: "" or " of the error at the tool"
    sentence: str  # how a sentence begins that goes on with the value
    needs: tuple[str, ...] = ()  # fields of a requirement beside the limit in the unit of the measure
    reads: tuple[str, ...] = ("quantile",)  # fields that it reads if they are there
    unit: str = ""  # of its value; empty: that of the measure
    by_quantile: bool = False  # whether it keeps its limit just where the quantile that is asked for does
    of_law: Callable[[LawNumbers], float | None] | None = None  # None: it is that quantile itself
    of_trials: Callable[[Trials, float, float], Estimate] | None = None  # quantile, limit
    trusted_as: Callable[[float], float] = float  # the quantile whose calibration of first order is taken for it
    calibrated: bool = True  # whether there is one; otherwise a simulation decides
    mixture: Callable[[float], Mixture] | None = None  # what quantiles it is the mean of; None: not for the optimiser
    implies: str = ""  # what else holds where it keeps its limit; a text as the others
    convex: bool = False  # whether it is convex in the half-widths, whatever the laws: weights that never fall with p


NODES = 16  # of a mean over quantiles: to 1e-6 of it


@lru_cache(maxsize=64)
def from_quantile(start: float) -> Mixture:
    """The mean of all quantiles from one on, by Gauss and Legendre's points in s: p = start + (1 - start) S(s) with
    S(s) = s^3 (10 - 15 s + 6 s^2), which is flat at both ends, where a quantile has no slope."""
    from numpy.polynomial.legendre import leggauss  # here: who only names statistics waits for no arrays

    nodes, weights = leggauss(NODES)
    s = (1 + nodes) / 2
    levels = start + (1 - start) * s**3 * (10 - 15 * s + 6 * s**2)
    return tuple(zip(levels.tolist(), (15 * weights * (s * (1 - s)) ** 2).tolist(), strict=True))


STATISTICS = (
    Statistic(
        name="quantile",
        meaning="the quantile of the error",
        headline="P{q}{of}",
        sentence="in {q} % of {shots}, {error} is at most",
        by_quantile=True,
    ),
    Statistic(
        name="mean",
        meaning="the mean of the error",
        headline="mean{of}",
        sentence="on average over {shots}, {error} is",
        reads=(),
        of_law=lambda law: law.mean_norm_mm,
        of_trials=lambda trials, quantile, limit: trials.mean(),
        mixture=lambda quantile: from_quantile(0.0),
        convex=True,
    ),
    Statistic(
        name="cvar",
        meaning="the mean of the errors beyond the quantile (conditional value at risk): never less than the quantile, "
        "so that what keeps the limit keeps it for the quantile too",
        headline="mean of the worst {rest} %{of}",
        sentence="in the worst {rest} % of {shots}, {error} is on average",
        of_law=lambda law: law.cvar_mm,
        of_trials=lambda trials, quantile, limit: trials.cvar(quantile),
        trusted_as=lambda quantile: min(1 - (1 - quantile) / 5, HIGHEST),
        mixture=from_quantile,
        implies="P{q}, which is never above that mean, keeps it too",
        convex=True,
    ),
    Statistic(
        name="probability",
        meaning="the probability of an error beyond the limit, which limit_probability limits",
        headline="probability{of} beyond {beyond}",
        sentence="of {shots}, {error} is beyond {beyond} in a share of",
        needs=("limit_probability",),
        reads=(),
        unit="of 1",
        by_quantile=True,
        of_law=lambda law: law.exceedance,
        of_trials=lambda trials, quantile, limit: trials.exceedance(limit),
    ),
    Statistic(
        name="max_of_n",
        meaning="the quantile of the largest error of n independent shots",
        headline="P{q}{of}, largest of {n} shots",
        sentence="in {q} % of series of {n} {own}, the largest value of {error} is at most",
        needs=("n",),
        by_quantile=True,
    ),
)
STATISTIC = {row.name: row for row in STATISTICS}
if TYPE_CHECKING:
    StatisticName = str
else:
    StatisticName = Literal[tuple(STATISTIC)]


def pooled_quantile(quantile: float, limit_probability: float | None, n: int | None) -> float:
    """The quantile of one shot's error that is asked for: of the largest of n shots the n-th root, of a probability
    what it leaves."""
    if limit_probability is not None:
        return 1 - limit_probability
    return quantile if n is None else float(quantile ** (1 / n))


def write_text(text: str, quantile: float, n: int | None, beyond: str, *, error: str = "", shots: str = "shots") -> str:
    """A text of a row; quantile: that of one shot."""
    percent, own = 100 * quantile ** (n or 1), shots.removeprefix("their ")
    of = f" of {error}" if error else ""
    return text.format(
        q=f"{percent:.6g}", rest=f"{100 - percent:.6g}", n=n, beyond=beyond, of=of, error=error, shots=shots, own=own
    )
