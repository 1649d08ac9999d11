"""The answer of a score."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, isclose
from typing import Any, Literal, NamedTuple, Protocol

from tailstack.fields import INTERFACES

from .digits import decimals_of, length
from .outline import Bar, Bars, Frame, Outline, checks_frame, frame, measures_frames, row_of, verdict_sentence
from .record import Result
from .tables import EVERYWHERE, IN_DETAIL, PAPER, Cell, Column, On, Row, Table, fill, tabulate
from .verdicts import Matrix3, MeasureResult, Provenance, Vector3, Verdict, ViewCheck

MOST_BARS, SHOTS = 12, 50
How = Literal["perfect", "least", "bound", "found"]


@dataclass(frozen=True, slots=True)
class Bounds:
    """The quantile under ever weaker assumptions on the law of the error."""

    gaussian: float
    """95 % quantile if the error were Gaussian with this mean and covariance, mm.  No bound: under uniform or
    triangular laws beside a bias the quantile may be larger, by 1 % and more."""
    unimodal: float
    """Upper bound of it for any law that is symmetric and unimodal about its mean, mm."""
    moments: float
    """Upper bound of it for any law with this mean and covariance, mm."""


@dataclass(frozen=True, slots=True)
class Contributor:
    """One line of the budget."""

    name: str
    """Source of error: fiducial_noise:VIEW, target_noise:VIEW, fiducial_manufacturing, structure_connector,
    connector_flange, hand_eye, execution, or an effect that the design declares (motion:VIEW, temperature, ...)."""
    component: str
    """Its component: rx ... tz, repeatability.x, load.x, the name of a locator, or all for the source as a whole;
    rx+ty where components are correlated; known for what does not vary."""
    law: str
    """Declared law: normal, uniform, triangular or bounded; mixed for a line of several; known for what does not vary.
    """
    half_width: float | None
    """Half-width of the tolerance (a standard deviation where one is given), in `unit`; null for a line of several."""
    unit: str
    """Unit of half-width and standard deviation: deg, mm, px, N or K; empty for a line of several."""
    std: float | None
    """Standard deviation, in `unit`; null where the law has none."""
    sensitivity_mm_per_unit: float | None
    """Length of the error at the tool for one unit, mm per `unit`; null for a line of several."""
    variance_share: float
    """Share of the trace of the covariance, 0 to 1."""
    dp95_per_unit: float | None
    """Slope of P95 by the half-width (of noise: by its standard deviation), mm per `unit`; null where there is none."""
    p95_without_mm: float
    """P95 with this contributor removed, mm."""
    label: str = ""
    """What people call the source: the label that the design gives an interface, otherwise its name or words for it."""
    localisation_share: float = 0.0
    """Share of the trace of the covariance of the localisation error, 0 to 1: that before connector_flange, hand_eye
    and execution, which have none."""
    drawn: str | None = None
    """It takes a new value once per unit, mounting or shot; null for what does not vary, and in older records."""

    @property
    def slope(self) -> float:
        """That of P95 by the half-width, mm per ``unit``; 0 where there is none."""
        return self.dp95_per_unit or 0.0

    @property
    def is_deviation(self) -> bool:
        """Whether what stands as its half-width is one standard deviation."""
        return bool(self.half_width) and isclose(self.half_width or 0.0, self.std or 0.0)

    @property
    def unit_in_words(self) -> str:
        """Unit of the half-width, marked where it is a standard deviation."""
        return f"σ {self.unit}" if self.is_deviation else self.unit


@dataclass(frozen=True, slots=True)
class PerUnit:
    """The second reading of risk: the installation is drawn once per unit and stays."""

    limit_mm: float | None
    """Limit of the tightest requirement on each unit, mm; without one, the target's."""
    yield_fraction: float | None
    """Fraction of units whose own quantile over shots meets the limit; null without a limit."""
    yield_standard_error: float | None
    """Standard error of that fraction; null without a limit."""
    p95_of_units_mm: float
    """95 % quantile over units of each unit's own P95, mm."""
    p95_of_units_standard_error_mm: float
    """Standard error of it, mm."""
    quantile: float = 0.95
    """Quantile over a unit's own shots: that of the requirement."""
    units_fraction: float = 0.95
    """Fraction of units that must keep it: the requirement's min_yield."""
    value_mm: float | None = None
    """What this fraction of units keep their own quantile within, mm; null where it was not computed."""
    standard_error_mm: float | None = None
    """Standard error of it, mm; null where it was not computed."""


@dataclass(frozen=True, slots=True)
class SecondOrder:
    """Correction of the TCP error by the Hessian of the chain; see its own range of validity."""

    status: Literal["applied", "refused", "not requested"]
    """applied, refused where it does not hold, or not requested."""
    reason: str
    """Why it was refused, or what it rests on."""
    mean_shift_mm: Vector3 | None = None
    """What it adds to the mean of the TCP error x, y, z in tcp, mm; null unless applied."""
    std_mm: Vector3 | None = None
    """Standard deviations with it along x, y, z in tcp, mm; null unless applied."""
    p95_mm: float | None = None
    """95 % quantile of the TCP error's norm with it, mm; null unless applied."""


@dataclass(frozen=True, slots=True)
class MetricScore:
    """First-order result for one error metric at one target."""

    frame: str
    """Frame of bias and covariance: con (connector) or tcp (tool centre point)."""
    bias_mm: Vector3
    """Mean error vector x, y, z in `frame`, mm."""
    covariance_mm2: Matrix3
    """Covariance of the error, rows and columns x, y, z in `frame`, mm²."""
    std_mm: Vector3
    """Standard deviations of the error along x, y, z in `frame`, mm."""
    mean_norm_mm: float
    """Mean of the error's norm, mm."""
    p95_mm: float
    """95 % quantile of the error's norm under the declared laws, pooled over installations and shots, mm; of all shots,
    where the design says how often fiducials are missed, as are bias, covariance, mean and exceedance."""
    law: str
    """The law that the quantile was computed with, in words."""
    law_error_mm: float
    """Numerical error of the quantile itself, mm; it says nothing of the linearisation."""
    bounds_mm: Bounds
    """The quantile if the law were Gaussian, and upper bounds of it if less is assumed of the law, mm."""
    cvar95_mm: float
    """Mean of the worst 5 % of the error's norm, mm."""
    limit_mm: float | None
    """Tightest limit that the design sets for this error here, mm; null without one."""
    exceedance_probability: float | None
    """Probability that the error's norm is beyond `limit_mm`; null without a limit."""


@dataclass(frozen=True)
class AtTarget:
    """Where a result for one target is read; without slots, so that what is read there can be the other base."""

    name: str
    """Name of the target, or of one sample of a region (zone[3])."""
    frame: str
    """Frame of the TCP error: tcp."""


@dataclass(frozen=True, slots=True)
class TargetScore(MetricScore, AtTarget):
    """``bias_mm`` ... ``bounds_mm`` are the TCP error; ``localisation`` is the same before connector_flange."""

    localisation: MetricScore
    """The same of the localisation error: of the triangulated target in con, before connector_flange."""
    block_diagonal_p95_mm: float
    """Gaussian P95 with the covariance between views dropped (Eq 16 of the paper), mm: compare bounds_mm.gaussian."""
    contributors: tuple[Contributor, ...]
    """The budget: what each source of error contributes."""
    worst_vertex: tuple[str, ...]
    """Bounded components at those ends of their ranges that are worst together: structure_connector.rz=+0.10 deg."""
    per_unit: PerUnit
    """The second reading of risk: the installation is drawn once per unit and stays."""
    second_order: SecondOrder
    """Correction by the second derivatives of the chain."""
    extrapolation: float
    """Distance of the target from the fiducials' centroid over their RMS radius."""
    budget_p95_mm: float
    """P95 that the budget is of, mm: that of shots in which no fiducial is missed."""
    position_tcp_mm: Vector3 | None = None
    """Where the target lies in tcp at the executed pose, mm: by a tool's tip near the origin. null: an older record."""


@dataclass(frozen=True, slots=True)
class Validity:
    """How far to trust the linearisation: nu and what it was calibrated to mean."""

    nu: float
    """Validity number: how large what linearising leaves out is, against what it keeps."""
    status: Literal["good to 1 %", "good to 5 %", "good to 20 %", "not valid"]
    """What the number was calibrated to mean for P95: within so much of the full chain's in at least 95 of 100 designs
    that it is said of."""
    expected_error_percent: float | None
    """Relative error of P95 that at least 95 of 100 designs with this status keep, %; null where first order is not
    valid."""
    statement: str
    """The same as a sentence."""
    nu_depth: float
    """Standard deviation of the relative error of the target's depth, the largest over the views; nu is the largest of
    five such numbers."""
    nu_crossing: float
    """The same of the firmness with which the rays cross."""
    nu_disagreement: float
    """What the views' disagreement moves the point by, over what first order does: standard deviations."""
    nu_gap: float
    """The smallest singular value of the rows of triangulation, which noise makes, over the next one."""
    layout_class: str
    """What decides whether the thresholds were calibrated for a design: views, fiducials, form of triangulation."""
    calibrated: bool
    """Whether they were. If not, first order is not valid, and only Monte Carlo decides a limit."""
    nu_turns: float = 0.0
    """What first order leaves out because mounts turn, over the whole error: root mean squares. P95 errs by some 0.7 of
    its square."""
    nu_bias: float = 0.0
    """What errs in its first power: the relative change of P95 by a known error along the lever of mounts that turn, or
    beside errors by the images that grow with it, or a known relative error of images, growth or believed intrinsics,
    whichever is largest."""
    nu_range: float = 0.0
    """What slopes at the point that noise leads to, instead of those at the target, move the point by, over what first
    order does: standard deviations, over the root of 3. Of a point that rays fix badly it is the relative error of the
    distance along them."""


@dataclass(frozen=True, slots=True)
class Loss:
    """The worst of all ways to lose some fiducials."""

    lost: tuple[str, ...]
    """Labels of the fiducials that are lost."""
    target: str
    """Target at which the error is then largest."""
    value: float | None
    """The quantile of what is limited there without them, in its unit; null where nothing can be estimated any more."""
    reason: str = ""
    """Why nothing can be estimated any more; empty otherwise."""

    def keeps(self, limit: float) -> bool:
        """Whether this limit is kept all the same."""
        return self.value is not None and self.value <= limit


@dataclass(frozen=True, slots=True)
class Mixture:
    """A quantile over shots in each of which fiducials are lost at random, as often as the design says, in all views at
    once and independently of one another; over all units together.
    """

    quantile: float
    """Fraction of shots within the value: that of the requirement, otherwise 0.95."""
    value: float | None
    """The quantile of what is limited over shots with and without losses, in its unit, what is not accounted for beyond
    it; null where that alone is more than the quantile leaves."""
    target: str
    """Target at which it is largest."""
    smallest_loss_probability: float
    """Smallest probability of a fiducial to be lost in a shot."""
    largest_loss_probability: float
    """Largest probability of a fiducial to be lost in a shot."""
    probability_of_none: float
    """Probability of a shot in which no fiducial is lost."""
    probability_unaccounted: float
    """Probability of a shot in which more are lost than was evaluated (two; one with more than 30 fiducials), or in
    which what is left determines nothing: each counts as beyond every limit."""


@dataclass(frozen=True, slots=True)
class Losses:
    """What the loss of fiducials in all views does to one requirement, or to P95 where the design has none."""

    requirement: str
    """Name of the requirement; empty where the design has none and P95 of the error at the tool is meant."""
    limit: float | None
    """Its limit, in `unit`; null where the design has none."""
    value: float
    """What it limits, with all fiducials and at the worst of its targets, in `unit`."""
    single: Loss
    """The worst loss of one."""
    double: Loss | None
    """The worst loss of two; null where there are too many fiducials to try every pair."""
    mixture: Mixture | None = None
    """What it comes to over shots with and without losses; null where the design states no probability of a loss."""
    unit: str = "mm"
    """Unit of limit and values."""

    def keeps(self, lost: int) -> bool | None:
        """Whether the limit is kept whichever fiducials are lost, so many at once; None where that is not known."""
        worst = self.single if lost == 1 else self.double
        if worst is None or self.limit is None:
            return None
        return worst.keeps(self.limit)


@dataclass(frozen=True, slots=True)
class SlipReliability:
    """What becomes of a slip of one fiducial's image in one view: a test of its residuals at the level of 0.1 % notices
    it in 80 % of cases, or it does not.
    """

    view: str
    """Name of the view."""
    fiducial: str
    """Label of the fiducial."""
    slip_px: float | None
    """Smallest slip that is noticed whatever its direction, px; null where a slip in some direction never is."""
    effect_mm: float | None
    """Largest error at the tool that a slip does which is not noticed, mm; null where there is no bound."""
    target: str
    """Target at which it does."""


@dataclass(frozen=True, slots=True)
class Lever:
    """One thing that can be changed, and the best that a requirement comes to by it alone."""

    requirement: str
    """Name of the requirement; empty where the design has none and P95 of the error at the tool is meant."""
    name: str
    """A source of error (all views together), image_noise, bias, placement, view (one more), or together: all that the
    design's optimise section frees."""
    label: str
    """What people call it; of together also what then has most of the mean square."""
    value: float
    """What is limited at best, at the worst target, in the requirement's unit."""
    how: How
    """perfect: without it; least: at the smallest half-widths that optimise allows; bound: no change of it does better;
    found: the best of a search within what optimise allows."""


@dataclass(frozen=True, slots=True)
class FiftyShots:
    """Fifty shots that stand for all: quantiles in the middles of fifty equal parts of a law over units and shots."""

    of: str
    """Which measure, and where: what the requirement that decides limits."""
    unit: str
    """Unit of values and limit."""
    values: tuple[float | None, ...]
    """Quantiles of order 0.01, 0.03, ... 0.99, each order met to 2e-4; null: such a shot has no answer."""
    limit: float
    """Limit, or the error beyond which shots are counted."""
    exceedance_probability: float
    """Probability of a shot beyond the limit; fifty times it, rounded, of the values are beyond."""


@dataclass(frozen=True, slots=True)
class FiducialWorth:
    """What one fiducial does to the value that decides; without a requirement that is the largest P95 at the tool."""

    fiducial: str
    """Its label."""
    slope: Vector3 | None
    """What the value, in its unit, changes by for each mm along x, y and z of con; null where that is not known."""
    value_without: float | None
    """The value, in its unit, where this one is found in no view; null where the others give no answer."""
    why: str = ""
    """Why something is not known; empty: everything is."""


@dataclass(frozen=True, slots=True)
class TargetCovariance:
    """What the errors at two targets have in common, to first order, of shots that miss no fiducial.

    Row: x, y, z of the error at the first; column: of that at the second.
    """

    first: str
    """Name of a target."""
    second: str
    """Name of one behind it."""
    tcp_mm2: Matrix3
    """Of the errors at the tool, both in tcp, mm^2."""
    localisation_mm2: Matrix3
    """Of the errors of the located targets, both in con, mm^2."""


@dataclass(frozen=True, slots=True, repr=False)
class Score(Result):
    """First order: bias, covariance, tail and budget at every target."""

    schema: Literal["tailstack/score/1"]
    targets: tuple[TargetScore, ...]
    """One entry for each target and each sample of a region; fewer where only some were asked for."""
    validity: Validity
    """How far the linearisation can be trusted."""
    views: tuple[ViewCheck, ...]
    """Visibility of the fiducials in each view."""
    verdict: Verdict
    """Requirements held against first order."""
    provenance: Provenance
    losses: tuple[Losses, ...] = ()
    """What becomes of each requirement when one or two fiducials are lost; empty where that was not asked for."""
    reliability: tuple[SlipReliability, ...] = ()
    """For each view and fiducial the smallest slip of its image that its residuals give away, the largest effect first;
    empty where that was not asked for."""
    measures: tuple[MeasureResult, ...] = ()
    """Measures made of the errors at targets, each wherever it is read; empty where there are none."""
    levers: tuple[Lever, ...] = ()
    """What each thing that can be changed leads to by itself, of each requirement the one that leads furthest first;
    none of a corridor, and none where fiducials are missed or losses were not asked for."""
    fifty_shots: FiftyShots | None = None
    """Fifty shots of what decides; null where nothing is limited, or they were not asked for."""
    fiducials: tuple[FiducialWorth, ...] = ()
    """What each fiducial does to the value that decides; empty where that was not asked for."""
    covariances: tuple[TargetCovariance, ...] = ()
    """Of every two targets; empty where there is one, or they were not asked for."""

    @property
    def worst_target(self) -> TargetScore:
        """The target with the largest P95 at the tool."""
        return max(self.targets, key=lambda target: target.p95_mm)

    @property
    def decimals(self) -> int:
        """Decimals of its lengths."""
        return decimals_of(self.verdict.checks, max((target.p95_mm for target in self.targets), default=1.0))

    def outline(self) -> Outline:
        """Errors at the targets and the budget of the worst of them."""
        worst, decimals = self.worst_target, self.decimals
        lines = single_lines(worst.contributors)
        shares = [Bar(source_name(line), 100 * line.variance_share) for line in lines if line.variance_share > 0]
        rest = sum(bar.value for bar in shares[MOST_BARS:])
        more = [Bar(f"{len(shares) - MOST_BARS} more", rest)] if len(shares) > MOST_BARS else []
        limit = "" if worst.limit_mm is None else f", limit {worst.limit_mm:g} mm"
        budget = [row_of(line, target=target.name) for target in self.targets for line in target.contributors]
        return Outline(
            "Score, an estimate",
            self.provenance.design_name,
            self.verdict.status,
            verdict_sentence(self.verdict, self.provenance),
            (
                frame(TargetScore, "targets", self.targets, targets_table(self)),
                *measures_frames(self.measures),
                checks_frame(self.verdict),
                Frame("budget", tuple(budget), shown=budget_table(worst, decimals)),
            ),
            Bars(
                f"Budget at target {worst.name}: P95 {length(worst.p95_mm, decimals)} mm{limit}",
                "share of the variance, %",
                (*shares[:MOST_BARS], *more),
            ),
            self.verdict.findings,
        )


class NamedLine(Protocol):
    """What is said of one line of a budget, wherever it stands."""

    @property
    def label(self) -> str: ...
    @property
    def component(self) -> str: ...


def source_name(line: NamedLine) -> str:
    """A line of the budget as people call it: the label of its source and the component."""
    return line.label if line.component in ("all", "known") else f"{line.label} {line.component}"


def single_lines(contributors: Sequence[Contributor]) -> list[Contributor]:
    """Lines that do not overlap: components, and contributors without any; largest share first."""
    counts = Counter(entry.name for entry in contributors)
    own = [entry for entry in contributors if entry.component != "all" or counts[entry.name] == 1]
    return sorted(own, key=lambda entry: entry.variance_share, reverse=True)


# --- tables ---------------------------------------------------------------------------------------------------

LOCATED = "as located"  # the row below a target: the error as found in the images


def axes(word: str, decimals: int, on: On) -> tuple[Column, Column, Column]:
    """Three columns of a vector of a metric: ``bias_mm`` or ``std_mm``."""
    field = f"{word.lower()}_mm"

    def component(k: int) -> Column:
        title = f"{word} {'xyz'[k]}"
        brief = f"{title.lower()}\nmm"
        return Column(title, "mm", "fixed", decimals, on, brief, of=lambda row: getattr(row[1], field)[k])

    return component(0), component(1), component(2)


def norm_columns(decimals: int, *between: Column) -> tuple[Column, ...]:
    """What the error's size comes to; ``between`` stands behind P95."""
    return (
        Column("Mean |e|", "mm", "fixed", decimals, brief="mean\nmm", of=lambda row: row[1].mean_norm_mm),
        Column("P95", "mm", "fixed", decimals, brief="P95\nmm", of=lambda row: row[1].p95_mm),
        *between,
        Column("CVaR95", "mm", "fixed", decimals, brief="mean of worst\n5 %, mm", of=lambda row: row[1].cvar95_mm),
    )


def bias_columns(decimals: int) -> tuple[Column, ...]:
    """What is known of the error: its size where there is little room, otherwise by axis."""
    size = Column("|bias|", "mm", "fixed", decimals, On.DETAIL, of=lambda row: hypot(*row[1].bias_mm))
    return (size, *axes("Bias", decimals, PAPER), *axes("Std", decimals, IN_DETAIL))


def say_place(metric: Any) -> str | None:
    """Where a target lies in tcp, in a cell; None of what is located of it."""
    place: Vector3 | None = getattr(metric, "position_tcp_mm", None)
    return place and ", ".join(f"{each:.4g}" for each in place)


TARGET = Column("Target", brief="error at the tool,\nby target", of=lambda row: row[0])


def pair_rows(targets: Sequence[Any], columns: Sequence[Column]) -> tuple[Row, ...]:
    """Each target and, below it, what is located of it; largest P95 first."""
    rows = []
    for target in sorted(targets, key=lambda entry: entry.p95_mm, reverse=True):
        rows += [fill(columns, (target.name, target)), fill(columns, (LOCATED, target.localisation), 1)]
    return tuple(rows)


def targets_table(score: Score) -> Table:
    """First order: error at the tool, and as localised before the second interface; largest P95 first."""
    decimals = score.decimals
    placed = [f"{each.name} ({at})" for each in score.targets if (at := say_place(each))]
    places = f" At the executed pose, in tcp, mm: {'; '.join(placed[:5] + ['...'] * (len(placed) > 5))}."
    columns = (
        TARGET,
        Column("Frame", on=IN_DETAIL, of=lambda row: row[1].frame),
        Column("At, in tcp", "mm", on=On.DETAIL | On.SHEET, brief="at, in tcp\nmm", of=lambda row: say_place(row[1])),
        *bias_columns(decimals),
        *norm_columns(decimals),
        Column("Limit", "mm", "stated", decimals, brief="limit\nmm", of=lambda row: row[1].limit_mm),
        Column(
            "Beyond limit", "%", "percent", 2, brief="over the\nlimit, %",
            of=lambda row: row[1].exceedance_probability,
        ),
    )  # fmt: skip
    return Table(
        "Targets", "Estimate: the error at each target, in the frame named", columns,
        pair_rows(score.targets, columns),
        "Bias and standard deviation by axis of the frame; P95 and CVaR95 (the mean of the worst 5 %) of the "
        "error's size, bias included. As located: the target as found in the images, before flange and robot."
        + places * bool(placed),
    )  # fmt: skip


class BudgetLine(NamedTuple):
    """What a row of a budget is about."""

    line: Contributor
    label: str
    parts: Sequence[Contributor] = ()  # components of a whole contributor

    @property
    def width(self) -> tuple[float | None, str]:
        """Half-width and unit."""
        whole = with_width(self.line, self.parts)
        return whole.half_width, whole.unit_in_words


BUDGET_NOTE = (
    "Half-width, standard deviation and sensitivity are per component in the unit named (marked σ: the half-width is "
    "one standard deviation, as that of image noise); dP95/dh is what one unit of it changes P95 by. A line of a whole "
    "contributor sums up the components below it, and has a half-width where all of them have the same. Drawn per: "
    "how often a source takes a new value."
)
SMALL = {On.PLAIN | On.NOTEBOOK: 5e-3, On.DETAIL: 5e-4}  # share of the variance below which components are summed up


def budget_columns(decimals: int) -> tuple[Column, ...]:
    """Every column of a budget."""
    return (
        Column("Contributor", brief="source of error", of=lambda row: row.label),
        Column("Law", on=IN_DETAIL, of=lambda row: row.line.law),
        Column("Half-width", "unit", "given", brief="±\nor σ", of=lambda row: row.width[0]),
        Column("Unit", kind="unit", brief="unit\n", of=lambda row: row.width[1]),
        Column("Std", "unit", "significant", on=IN_DETAIL, of=lambda row: row.line.std),
        Column("Sensitivity", "mm/unit", "significant", on=IN_DETAIL, of=lambda row: row.line.sensitivity_mm_per_unit),
        Column(
            "Share of variance", "%", "percent", 1, brief="variance\nshare, %", bar=True,
            of=lambda row: row.line.variance_share,
        ),
        Column("dP95/dh", "mm/unit", "significant", on=IN_DETAIL, of=lambda row: row.line.dp95_per_unit),
        Column(
            "P95 without", "mm", "fixed", decimals, brief="P95 without\nit, mm",
            of=lambda row: row.line.p95_without_mm,
        ),
        Column(
            "A tenth tighter saves", "mm", "saving", decimals, On.PLAIN | On.NOTEBOOK | On.SHEET,
            "a tenth tighter\nsaves, mm", of=lambda row: tenth_of(row.parts or (row.line,)),
        ),
        Column("Drawn per", on=IN_DETAIL, of=lambda row: row.line.drawn),
    )  # fmt: skip


def budget_table(
    target: TargetScore, decimals: int = 3, name: str = "Budget", more: Sequence[Column] = (), note: str = ""
) -> Table:
    """Every contributor and component: tolerance, sensitivity, share, marginal P95, P95 without.

    more: columns beside these, of :class:`BudgetLine`; note: what is said of them.
    """
    columns, rows = (*budget_columns(decimals), *more), []
    for total, parts in group(target.contributors):
        rows.append(fill(columns, BudgetLine(total, heading_of(total), parts)))
        # a bounded component has no variance, but it moves the quantile
        random = [part for part in parts if part.law != "bounded"]
        left = {place: [part for part in random if part.variance_share < least] for place, least in SMALL.items()}
        for part in parts:
            on = EVERYWHERE
            for place, small in left.items():
                on &= ~place if part in small else EVERYWHERE
            rows.append(fill(columns, BudgetLine(part, part.component), 1, on))
        rows += [_sum_up(columns, small, SMALL[place], place) for place, small in left.items() if small]
    caption = f"Budget at target {target.name} (estimate, P95 {length(target.budget_p95_mm, decimals)} mm)"
    return Table(name, caption, columns, tuple(rows), BUDGET_NOTE + note)


def _sum_up(columns: Sequence[Column], small: Sequence[Contributor], least: float, on: On) -> Row:
    """The row that stands for small components: how many, and their share."""
    share = sum(part.variance_share for part in small)
    cells: list[Cell] = [share if column.bar else "" for column in columns]
    cells[0] = f"{len(small)} more, < {100 * least:g} % each"
    return Row(tuple(cells), 1, on)


def group(contributors: Sequence[Contributor]) -> list[tuple[Contributor, list[Contributor]]]:
    """(line of the whole contributor, its components), both by falling share of the variance."""
    names = dict.fromkeys((entry.name, entry.law == "known") for entry in contributors)  # what is known stands alone
    groups = []
    for each in names:
        lines = [entry for entry in contributors if (entry.name, entry.law == "known") == each]
        total = next((entry for entry in lines if entry.component == "all"), None)
        parts = sorted((e for e in lines if e is not total), key=lambda e: e.variance_share, reverse=True)
        groups += [(entry, []) for entry in parts] if total is None else [(total, parts)]
    return sorted(groups, key=lambda group: group[0].variance_share, reverse=True)


def heading_of(total: Contributor) -> str:
    """A source as people call it; an interface by its name in the design document and by its label there."""
    return f"{total.name}: {total.label}" if total.name in INTERFACES and total.label != total.name else total.label


def tenth_of(lines: Sequence[Contributor]) -> float | None:
    """By how much P95 falls, mm, where these components are tighter by a tenth; None: none of them can be, or one has
    no half-width of its own, as the fit of a pin, and would be left out.
    """
    slopes = [line.dp95_per_unit for line in lines]
    if None in slopes or not any(line.half_width for line in lines):
        return None
    return sum(line.slope * (line.half_width or 0.0) / 10 for line in lines)


def with_width(line: Contributor, components: Sequence[Contributor]) -> Contributor:
    """A whole source with the half-width of its components, where they have one and the same."""
    alike = len({(part.half_width, part.unit, part.is_deviation) for part in components}) == 1
    if line.half_width is not None or not alike:
        return line
    return replace(line, half_width=components[0].half_width, unit=components[0].unit, std=components[0].std)


def views_table(views: Sequence[ViewCheck]) -> Table:
    """What each view sees of the fiducials."""
    columns = (
        Column("View", of=lambda view: view.view),
        Column(
            "Outside", brief="outside\nthe image",
            of=lambda view: (", ".join(view.outside) or "none") if view.checked else "image size not stated",
        ),
        Column("Closest pair", brief="closest\npair", of=lambda view: " – ".join(view.closest_pair)),
        Column("Their distance", "px", "fixed", 1, brief="distance\npx", of=lambda view: view.closest_pair_px),
        Column(
            "Margin to border", "px", "fixed", 1, brief="margin to\nborder, px",
            of=lambda view: view.smallest_margin_px,
        ),
        Column("Depth from", "mm", "fixed", 1, brief="depth\nfrom, mm", of=lambda view: view.depth_range_mm[0]),
        Column("Depth to", "mm", "fixed", 1, brief="to\nmm", of=lambda view: view.depth_range_mm[1]),
    )  # fmt: skip
    caption = "What each view sees of the fiducials, at the biased geometry without noise"
    return tabulate("Views", caption, columns, views)
