"""What was found, as sentences for whoever reads a result first: a command's opening lines and a report's first page.

The words are an engineer's; the method's own (first order, covariance, quantile) stand in ``--details``, in a report's
chapter on the method, and in the pages about it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

from tailstack.laws import level_of
from tailstack.results.digits import (
    ESTIMATE,
    at_least,
    at_most,
    count_decimals,
    decimals_of,
    in_percent,
    length,
    percent,
    saving,
)
from tailstack.results.score import MetricScore, group, single_lines, source_name, tenth_of, with_width
from tailstack.results.verdicts import UNBOUNDED, checks_sentence, decisive_check, headline_of, name_basis, rest_of
from tailstack.results.verification import MetricEstimate, TargetEstimate

from .text import spell_count

if TYPE_CHECKING:
    from tailstack.results import (
        Check,
        Contributor,
        Losses,
        Mixture,
        Provenance,
        Score,
        TargetScore,
        Validity,
        Verdict,
        Verification,
        ViewCheck,
    )

    ToldError = TargetScore | TargetEstimate | MetricScore | MetricEstimate


def largest_sentence(target: str, p95_mm: float, interval_mm: tuple[float, float | None]) -> str:
    """What is said where the design states no requirement."""
    low, high = interval_mm
    decimals = count_decimals(p95_mm, error_of(p95_mm, interval_mm))
    ends = "no upper end is known" if high is None else f"between {length(low, decimals)} and {length(high, decimals)}"
    return (
        f"No requirement is stated. In 95 % of shots, the error at the tool (target {target}) is at most "
        f"{length(p95_mm, decimals)} mm (P95; {ends})."
    )


def estimate_interval(score: Score, p95_mm: float) -> tuple[float, float | None]:
    """Where the P95 of a simulation is to be expected."""
    error = score.validity.expected_error_percent
    return (0.0, None) if error is None else (p95_mm / (1 + error / 100), p95_mm * (1 + error / 100))


def error_of(value_mm: float, interval_mm: tuple[float, float | None]) -> float:
    """Relative error of a value, by its interval."""
    low, high = interval_mm
    return ESTIMATE if high is None or value_mm <= 0 else (high - low) / 2 / value_mm


def losses_sentence(line: Losses, checks: Sequence[Check]) -> str:
    """What a requirement comes to without the fiducials whose loss is worst; its quantile is that of its checks."""
    check = next((check for check in checks if check.requirement == line.requirement), None)
    quantile, least = (0.95, None) if check is None else (check.quantile, check.min_yield)
    risk = "pooled" if check is None else check.risk
    what = headline_of(quantile, least, line.requirement or "the error at the tool", risk=risk)
    decimals = decimals_of(checks, line.value)
    clauses = [f"{what} is {length(line.value, decimals)} {line.unit} with all of them"]
    for worst in (line.single, line.double):
        if worst is None:
            clauses.append("every pair was not tried, there are too many")
            continue
        lost = " and ".join(worst.lost)
        if worst.value is None:
            clauses.append(f"without {lost} nothing can be estimated: {worst.reason}")
            continue
        limit = line.limit
        broken = limit is not None and line.value <= limit < worst.value
        beyond = f", beyond the limit of {limit:g} {line.unit}" if broken else ""
        worst_of = f"the worst {'one' if len(worst.lost) == 1 else 'two'} to lose"
        clauses.append(f"without {lost}, {worst_of}, {length(worst.value, decimals)} {line.unit}{beyond}")
    if line.mixture is not None:
        pooled = "" if risk == "pooled" else "of all units together, which is another quantity: "
        clauses.append(pooled + mixture_sentence(line.mixture, None if pooled else line.limit, line, decimals))
    return "; ".join(clauses) + "."


def mixture_sentence(mixture: Mixture, limit: float | None, line: Losses, decimals: int) -> str:
    """What shots come to in which fiducials are missed as often as the design says."""
    low, high = (100 * p for p in (mixture.smallest_loss_probability, mixture.largest_loss_probability))
    often = f"{high:g} %" if low == high else f"{low:g} to {high:g} %"
    quantile = f"{100 * mixture.quantile:g} %"
    if mixture.value is None:
        bound = f"there is no bound that {quantile} of all shots keep"
    else:
        broken = limit is not None and line.value <= limit < mixture.value
        beyond = f", beyond the limit of {limit:g} {line.unit}" if broken else ""
        bound = f"{quantile} of all shots are within {length(mixture.value, decimals)} {line.unit}{beyond}"
    none, rest = percent(mixture.probability_of_none, 2), percent(mixture.probability_unaccounted, 4)
    return (
        f"with each bead missed in {often} of shots, {bound} (estimate; all beads are there in {none} % of shots, and "
        f"{rest} %, with more missed than were enumerated or too few left, are counted as failures)"
    )


def views_sentence(views: Sequence[ViewCheck]) -> str:
    """What is wrong with what the views see, or that nothing is; the closest pair of fiducials."""
    parts = []
    for view in views:
        name = view.view
        if view.outside:
            outside = spell_count(len(view.outside), "fiducial")
            parts.append(f"{name}: {outside} outside the image ({', '.join(view.outside)})")
        elif not view.checked:
            parts.append(f"{name}: whether all are in the image is not known, its size is not stated")
    clear = [view for view in views if view.checked and not view.outside]
    if clear:
        nearest = min(clear, key=lambda view: view.smallest_margin_px or 0.0)
        which = "every view" if len(clear) == len(views) else ", ".join(view.view for view in clear)
        margin = f"the nearest to its border by {nearest.smallest_margin_px:.0f} px"
        parts.append(f"{which}: all fiducials are in the image, {margin}")
    if views:
        tight = min(views, key=lambda view: view.closest_pair_px - view.closest_pair_needs_px)
        pair = " and ".join(tight.closest_pair)
        merged = tight.closest_pair_px < tight.closest_pair_needs_px
        needs = f"; to be told apart they need {at_least(tight.closest_pair_needs_px, 3)} px" if merged else ""
        parts.append(f"closest images: {pair} in {tight.view}, {at_most(tight.closest_pair_px, 3)} px apart{needs}")
    return "; ".join(parts) + "." if parts else ""


def trust_sentence(validity: Validity) -> str:
    """How far the estimate can be trusted, and what to do where it cannot."""
    if validity.expected_error_percent is not None:
        good = f"the estimate is within {validity.expected_error_percent:g} % of what a simulation gives"
        if validity.expected_error_percent <= 1:
            return good
        return f"{good}; where it errs it is mostly too small: check it with `tailstack verify`"
    if not validity.calibrated:
        return (
            f"how good the estimate is for such a design ({validity.layout_class.rpartition(', ')[0]}) is not known: "
            "only a simulation decides, run `tailstack verify`"
        )
    return (
        "the estimate does not hold for this layout and may be far too small: do not use it, run `tailstack verify`, "
        "which simulates"
    )


LOOSE = 0.05  # an estimate that is off by less, or by less than was said, is gone by; the page has the same


def holds(score: Score, verification: Verification) -> bool:
    """Whether a simulation leaves standing what rests on the estimate: budget, slack, what a step would save."""
    said = (score.validity.expected_error_percent or 0.0) / 100
    return abs(verification.first_order_ratio - 1) <= max(LOOSE, said) + verification.precision_of_p95


def dominant_sentence(source: ErrorSource, target: TargetScore, error: str, decimals: int) -> str:
    """The largest source of error, and what it costs."""
    share = in_percent(source.share)
    if error != "tcp":
        return (
            f"The largest source of error of the located target {target.name} is {source.name}: {share} of its "
            "variance. What acts after the target is located (connector_flange, hand-eye, robot) does not count."
        )
    return (
        f"The largest source of error is {source.name}: {share} of the variance; were it perfect, P95 at {target.name} "
        f"would be {length(source.line.p95_without_mm, decimals)} instead of "
        f"{length(target.budget_p95_mm, decimals)} mm, by estimate."
    )


def error_at(target: TargetScore | TargetEstimate, error: str) -> ToldError | None:
    """What is told of an error at a target: of the two that every target has; None of any other measure."""
    return {"tcp": target, "localisation": target.localisation}.get(error)


def leading_bias_mm(target: TargetScore, error: str) -> float | None:
    """Size of the known part of an error at a target, mm; None where more of the error varies, or it is not told."""
    metric = error_at(target, error)
    bias = 0.0 if metric is None else hypot(*metric.bias_mm)
    return bias if metric is not None and bias > hypot(*metric.std_mm) else None


def bias_sentence(target: TargetScore, error: str, decimals: int) -> str:
    """That most of an error at a target is known and the same each time; "" where it is not."""
    bias = leading_bias_mm(target, error)
    if bias is None:
        return ""
    return (
        f"Most of the error at {target.name} is a known bias of {bias:.{decimals}f} mm, the same in every shot: "
        "correct for it before any tolerance."
    )


NO_ERROR_MM = 50.0  # beyond it no tolerance is to blame: as far as a structure is wide


def margin_sentence(check: Check, sources: Sequence[ErrorSource], decimals: int) -> str:
    """How much is left to the limit or missing, and which step brings most."""
    what, spare = check.headline, check.margin
    if check.unit == "mm" and check.value is not None and check.value > NO_ERROR_MM:
        most = f"; most of it comes from {sources[0].name}" if sources else ""
        return (
            f"{what} is {check.value:.0f} mm, which is no error of positioning any more{most}. A unit, a sign or a "
            "pivot in the design is off: look at that before any tolerance."
        )
    if spare is None:
        return f"How far {what} is from its limit is not known: {check.open_because or 'it takes a simulation'}."
    if spare >= 0:
        share = in_percent(spare / check.limit)
        first = f"{what} has at least {length(spare, decimals)} {check.unit} to spare ({share} of the limit)"
    else:
        share = f" ({in_percent(-spare / check.value)})" if check.value else ""  # none of the shots drawn may be beyond
        first = f"{what} has to come down by {length(-spare, decimals)} {check.unit}{share} to pass for certain"
    if check.error != "tcp" or not sources:  # the budget's slopes are of the error at the tool
        return first + "."
    pooled = "" if check.min_yield is None else " over all units"
    if sources[0].tenth_mm is None and sources[0].share > 0:  # of a seat as drawn: its fit is no half-width
        part = sources[0].largest
        without = f"P95{pooled} would be {length(part.p95_without_mm, decimals)} mm"
        share = in_percent(part.variance_share)
        return f"{first}; {share} of the variance is of {budget_line(part)}: without, {without}."
    best = max(sources, key=lambda source: source.tenth_mm or 0.0)
    if best.tenth_mm is None:
        return first + "."
    return f"{first}; {best.name}, tighter by a tenth, lowers P95{pooled} by {saving(best.tenth_mm, decimals)} mm."


def decision_sentence(verdict: Verdict, optimised: Sequence[str] | None = None) -> str:
    """What is kept, the check that decides, and what to do where it is missed or open; "" without a requirement.

    optimised: of a design that the optimiser made, the requirements that it was not asked to keep.
    """
    decisive = decisive_check(verdict.checks)
    if decisive is None:
        return ""
    following = _next_step(decisive, verdict.basis, optimised)
    return " ".join(part for part in (checks_sentence(verdict.checks), following) if part)


def _next_step(check: Check, basis: str, optimised: Sequence[str] | None) -> str:
    """What to do where a requirement is missed or open."""
    if check.status == "fail" and optimised is not None:
        if check.requirement in optimised:
            return f"It was not asked for: leave `optimise.requirement` out, or name {check.requirement} there."
        return "The simulation has the last word: give the optimiser more freedom, or change the limit."
    if check.status == "fail":
        needs = "once a section `optimise` says what may change"  # of which a record knows nothing
        return f"`tailstack optimise` looks for the cheapest design that keeps it, {needs}."
    if check.status == "pass":
        return ""
    if check.open_because == UNBOUNDED:
        return f"No simulation can show that it is kept: {UNBOUNDED}."
    if basis.startswith("first order"):
        return "Run `tailstack verify`, which simulates, to decide."
    if check.open_because:
        return f"{check.open_because[0].upper()}{check.open_because[1:]}."
    if (level := level_of(check.risk)) is not None:
        return f"The number of {level.plural} drawn is fixed: change the limit or the design."
    return "Simulate more shots to decide: a tighter --precision or more --trials."


def ending_of(verdict: Verdict, provenance: Provenance) -> str:
    """The last line of every answer."""
    status = ", ".join(filter(None, (verdict.status, rest_of(provenance.assumed))))
    return f"verdict: {status} ({name_basis(verdict.basis)})"


LOCATED = (
    "as located: the error of the target found in the X-ray images, before flange, hand-eye and robot add theirs; "
    "P95: 95 % of shots are within it"
)


@dataclass(frozen=True, slots=True)
class ErrorSource:
    """A source of error as a whole: what is bought, made and mounted as one thing, with all its components."""

    line: Contributor  # of the whole source
    share: float  # of the variance of the error that is asked about
    tenth_mm: float | None  # by how much P95 falls where all of it is tighter by a tenth, first order
    largest: Contributor  # its component with most of the variance, or the source where it has none

    @property
    def name(self) -> str:
        """In words, with its half-width where one number says it."""
        return budget_line(self.line)


def shares_of(target: TargetScore, error: str) -> list[tuple[Contributor, float]]:
    """Single lines with their shares of the variance of ``error``, largest share first; of the localisation error those
    that act on it, of a measure that no budget is of none.
    """
    lines = single_lines(target.contributors)
    if error == "tcp":
        return [(line, line.variance_share) for line in lines]
    if error_at(target, error) is None:
        return []
    shares = [(line, line.localisation_share) for line in lines if line.localisation_share > 0]
    return sorted(shares, key=lambda pair: pair[1], reverse=True)


def sources_of(target: TargetScore, error: str) -> list[ErrorSource]:
    """Whole sources with their shares of the variance of ``error``, largest share first; of what has no budget none."""
    shares: dict[tuple[str, bool], float] = {}
    for line, share in shares_of(target, error):
        key = (line.name, line.law == "known")
        shares[key] = shares.get(key, 0.0) + share
    sources = []
    for total, components in group(target.contributors):
        if (key := (total.name, total.law == "known")) in shares:
            share = total.variance_share if error == "tcp" else shares[key]
            parts = components or [total]
            sources.append(ErrorSource(with_width(total, components), share, tenth_of(parts), parts[0]))
    return sorted(sources, key=lambda source: source.share, reverse=True)


def budget_line(line: Contributor) -> str:
    """A line of the budget in words, with its half-width."""
    sign = "σ" if line.is_deviation else "±"
    width = "" if line.half_width is None else f" ({sign} {line.half_width:.3g} {line.unit})"
    return source_name(line) + width


def units_sentence(target: TargetScore, decimals: int | None = None) -> str:
    """What most installed units keep in their own shots, and how many of them keep the limit."""
    unit = target.per_unit
    value = unit.p95_of_units_mm if unit.value_mm is None else unit.value_mm
    decimals = count_decimals(unit.limit_mm or value) if decimals is None else decimals
    shots = f"{100 * unit.quantile:.6g} % of their own shots"
    statement = f"{100 * unit.units_fraction:.6g} % of installed units keep {shots} within {length(value, decimals)} mm"
    if unit.yield_fraction is None or unit.limit_mm is None:
        return statement + "."
    return f"{statement}; {in_percent(unit.yield_fraction, 1)} of units keep them within {unit.limit_mm:g} mm."
