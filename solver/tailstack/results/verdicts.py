"""What every answer shares: remarks, checks of requirements, the verdict, visibility, where an answer came from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Literal, NamedTuple, TypeVar

from ..laws import Drawn, level_of
from ..measures import MEASURE, MeasureName
from ..statistic import STATISTIC, StatisticName, write_text
from .digits import decimals_of, in_percent, length
from .tables import IN_DETAIL, PAPER, TERMINAL, Column, On, Table, tabulate

Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]
Interval = tuple[float, float]

Severity = Literal["error", "warning", "note"]
P95 = 0.95  # the quantile that is shown everywhere
STATED = ("requirement-failed", "requirement-inconclusive")  # rules of findings that repeat the verdict
# Why a mean of all shots is open, in some of which too few fiducials are left.
UNBOUNDED = (
    "shots that leave too few fiducials for an answer give it no upper end, however many are drawn; limit a quantile, "
    "or the probability of an error"
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One remark about the design, with the number it rests on."""

    rule: str
    """Stable id of the rule, kebab-case."""
    severity: Severity
    """error: the design should not be used so; warning: it should be looked at; note: it is worth knowing."""
    message: str
    """The remark, in a sentence."""
    pointer: str = ""
    """JSON pointer (RFC 6901) into the design document; empty for the whole."""
    value: float | None = None
    """The number that the remark rests on, in the unit that the message says; null without one."""
    limit: float | None = None
    """What that number was held against, in the same unit; null without one."""


@dataclass(frozen=True, slots=True)
class Check:
    """One requirement at one target: a value, its interval, and the limit that the interval is held against.

    The status is read off the interval alone: ``pass`` if its upper end is within the limit, so if the margin is not
    negative; ``fail`` if its lower end is beyond.  The yield stands beside: it is at least what is required just where
    the value is within the limit.
    """

    requirement: str
    """Name of the requirement."""
    target: str
    """Name of the target, or of one sample of a region (zone[3]); of a measure that joins several, its site."""
    error: MeasureName
    """Which measure is limited: tcp (error at the tool), localisation (of the target, in con)."""
    risk: str
    """pooled: over installations and shots together; per_unit, per_mounting: of each unit, each mounting, by itself."""
    quantile: float
    """Quantile of the error's norm that is limited, 0.95 for P95; of max_of_n that of one shot, of probability what it
    leaves to 1."""
    value: float
    """What decides. pooled: the statistic; per_unit: what `min_yield` of units keep their own quantile within;
    per_mounting: of mountings."""
    interval: tuple[float, float | None]
    """Its ends. Monte Carlo: confidence interval; first order: calibrated error of the linearisation. A null upper end:
    not known, as first order is not valid."""
    limit: float
    """Limit of the requirement."""
    yield_fraction: float | None
    """Fraction of units, or of mountings, whose own quantile is within the limit; null for pooled."""
    min_yield: float | None
    """Fraction of units, or of mountings, that must keep the limit; null for pooled."""
    status: Literal["pass", "fail", "inconclusive"]
    """pass: the upper end of the interval is within the limit; fail: the lower end is beyond; otherwise inconclusive.
    """
    headline: str = ""
    """What the value is, in words: "P95 that 90 % of units keep"."""
    margin: float | None = None
    """Limit less the upper end of the interval: not negative just where the status is pass. Null where that end is not
    known."""
    missed: bool = False
    """Whether shots that miss fiducials, as often as the design says, are in the value."""
    open_because: str = ""
    """Why the upper end is not known although first order holds for shots that miss no fiducial, or there is none;
    empty otherwise."""
    unit: str = ""
    """Unit of value, interval, limit and margin: mm, unless the measure has another."""
    words: str = ""
    """What people call the measure."""
    statistic: StatisticName = "quantile"
    """What of the error is limited: quantile, mean, cvar, probability or max_of_n."""
    n: int | None = None
    """max_of_n: number of shots of which the largest error is limited; otherwise null."""
    beyond: float | None = None
    """probability: the error beyond which shots are counted, in the unit of the measure; otherwise null."""
    ids: tuple[str, ...] = ()
    """What the requirement is called in a system of requirements, as the design says."""

    def __post_init__(self) -> None:
        high = self.interval[1]
        object.__setattr__(self, "unit", STATISTIC[self.statistic].unit or MEASURE[self.error].unit)
        object.__setattr__(self, "words", MEASURE[self.error].words)
        object.__setattr__(self, "headline", self.name_value())
        object.__setattr__(self, "margin", None if high is None else self.limit - high)

    def name_value(self, of: str = "") -> str:
        """What the value is, in words; ``of`` what, if that is named."""
        text = self.write(STATISTIC[self.statistic].headline, of)
        return headline_of(self.quantile, self.min_yield, of, missed=self.missed, risk=self.risk, statistic=text)

    def write(self, text: str, error: str = "", shots: str = "shots") -> str:
        """A text of the statistic's row."""
        beyond = "" if self.beyond is None else f"{self.beyond:g} {MEASURE[self.error].unit}"
        return write_text(text, self.quantile, self.n, beyond, error=error, shots=shots)

    @property
    def upper(self) -> float:
        """Upper end of the interval, infinite where there is none."""
        high = self.interval[1]
        return inf if high is None else high


BREACHES_MM = (0.0, 2.0, 4.0, 6.0)  # beyond the corridor: where grades B to E of Gertzbein and Robbins begin


@dataclass(frozen=True, slots=True)
class Breach:
    """How often an end of a trajectory is out of its corridor by more than so much."""

    beyond_mm: float
    """How far beyond the corridor, mm: 0, 2, 4, 6, where grades B to E of Gertzbein and Robbins begin."""
    probability: float
    """Probability, of 1; of trials, their share."""
    interval: Interval
    """Interval of 95 %: of an estimate what the sampling of its law leaves, of trials Clopper and Pearson's."""


@dataclass(frozen=True, slots=True)
class MeasureShare:
    """What one contributor makes of a measure."""

    name: str
    """Source of error, as a contributor of the budget is called."""
    label: str
    """What people call it."""
    drawn: str
    """It takes a new value once per unit, mounting or shot."""
    variance_share: float
    """Share of the trace of the measure's covariance, 0 to 1."""


@dataclass(frozen=True, slots=True)
class MeasureResult:
    """A measure made of the errors at targets, at one of its sites; its numbers are in `unit`."""

    measure: str
    """Name of the measure, as a requirement names it."""
    site: str
    """Where it is read: which targets it joins."""
    words: str
    """What people call it."""
    unit: str
    """Unit of its numbers."""
    known: float
    """Size of its known part; of what counts on one side, with its sign."""
    mean: float
    """Mean."""
    p95: float
    """95 % quantile, pooled over installations and shots."""
    p95_interval: Interval | None
    """Confidence interval of `p95`, by order statistics; null of an estimate."""
    cvar95: float
    """Mean of the worst 5 %."""
    limit: float | None
    """Tightest limit that the design sets for it here; null without one."""
    exceedance_probability: float | None
    """Probability that it is beyond `limit`; null without a limit."""
    breaches: tuple[Breach, ...] = ()
    """Of a trajectory in a corridor."""
    ppk: float | None = None
    """Process performance index (limit - |mean|) / (3 std), of one number with its sign; null of a vector, or without a
    limit. It stands beside the probability and decides nothing."""
    shares: tuple[MeasureShare, ...] = ()
    """Of its contributors, the largest first, in shots that miss no fiducial; empty without a requirement, and of
    trials."""


MISSED = "missed fiducials included"  # of what is over all shots of a design that says how often they are missed
ERRORS = {name: measure.words for name, measure in MEASURE.items()}  # as people say it


def name_all(risk: str) -> str:
    """What is read by itself, many of them: installed units, mountings."""
    return (level_of(risk) or Drawn.UNIT).all_of_them


def _plural(risk: str) -> str:
    return (level_of(risk) or Drawn.UNIT).plural


def headline_of(
    quantile: float,
    min_yield: float | None,
    of: str = "",
    *,
    missed: bool = False,
    risk: str = "per_unit",
    statistic: str = "",
) -> str:
    """What a requirement limits: P95, or P95 that 90 % of units keep; ``of`` what, if that is named; missed: of all
    shots, those that miss fiducials among them; risk: of what, where a yield is required; statistic: in words, if it
    is no quantile."""
    named = statistic or write_text(STATISTIC["quantile"].headline, quantile, None, "", error=of)
    units = "" if min_yield is None else f" that {100 * min_yield:.6g} % of {_plural(risk)} keep"
    return f"{named}{units}" + (f" ({MISSED})" if missed else "")


@dataclass(frozen=True, slots=True)
class Verdict:
    """``pass`` only when the upper end of every check's interval is within its limit."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    """Of all checks together: the worst of them. No requirement: nothing was to be held."""
    basis: str
    """What the checks rest on: first order or Monte Carlo; with "missed fiducials included" where the design says how
    often fiducials are missed, and the checks are of all shots."""
    checks: tuple[Check, ...]
    """Every requirement at every target that it names."""
    findings: tuple[Finding, ...]
    """Remarks about the design, requirements that are not held among them."""


@dataclass(frozen=True, slots=True)
class ViewCheck:
    """Visibility of the fiducials in one view, at the biased geometry."""

    view: str
    """Name of the view."""
    checked: bool
    """false: the size of the image is not stated, so that only depths and distances were looked at."""
    depth_range_mm: Interval
    """Smallest and largest depth of a fiducial in front of the source, along the principal ray, mm."""
    outside: tuple[str, ...]
    """Labels of fiducials whose image lies outside the detector."""
    smallest_margin_px: float | None
    """Smallest distance of a fiducial's image from the image's edge, px, negative outside; null where the size is not
    stated."""
    closest_pair: tuple[str, str]
    """Labels of the two fiducials whose images are closest, counted from the distance that they need."""
    closest_pair_px: float
    """Distance of their images, px."""
    closest_pair_needs_px: float = 10.0
    """Distance that these two need to be told apart, px: half of both shadows and 3 px where the design gives the
    diameter of the fiducials, otherwise 10."""


@dataclass(frozen=True, slots=True)
class TitleBlock:
    """Under which number a design is kept, and who answers for it; a text is empty where the design does not say."""

    number: str = ""
    """Number of the document."""
    revision: str = ""
    """Its revision."""
    date: str | None = None
    """Day of the revision, ISO 8601; null where the design does not say."""
    author: str = ""
    """Who made it."""
    checker: str = ""
    """Who checked it."""
    approver: str = ""
    """Who releases it."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """Which design, by which version, under which model, and what is not included."""

    design_name: str
    """Name of the design."""
    design_sha256: str | None
    """SHA-256 of the design's canonical content, fiducials included; null where it could not be had."""
    tailstack_version: str
    """Version of the solver."""
    reading: str
    """Reading of the structure's installation error: physical (the structure moves, its images too) or eq18 (only the
    coordinates that the estimator assumes)."""
    rotation_form: str
    """How small rotations act: full matrices or the small-angle form."""
    triangulation: str
    """How the target's rays are met: normalised (linear, in the fiducials' frame), published (linear, in connector mm),
    weighted (linear, each view by how well its noise lets it know the target) or reprojection (least squares)."""
    notes: tuple[str, ...]
    """What was done to the design's numbers on the way, and what it leaves open."""
    not_included: tuple[str, ...]
    """Errors that no number here includes."""
    estimator: str = "dlt"
    """What each view is estimated as: dlt, reprojection (eleven unknowns), pose or pose_with_prior."""
    sources_sha256: str | None = None
    """SHA-256 of the solver's sources, which tells apart two codes of one version; null in records of before."""
    assumed: tuple[str, ...] = ()
    """What nobody stated: a JSON pointer (RFC 6901) into the design document for each assumed value."""
    document: TitleBlock | None = None
    """The design's title block; null where it has none."""


# --- what nobody stated, in words -------------------------------------------------------------------------


def rest_of(assumed: Sequence[str]) -> str:
    """What a verdict rests on besides the design: "on 22 assumed values"; "" where everything is stated."""
    return f"on {len(assumed)} assumed value{'' if len(assumed) == 1 else 's'}" if assumed else ""


def assumed_sentence(assumed: Sequence[str]) -> str:
    """How many values nobody stated, and in which sections of the design; "" where everything is stated."""
    if not assumed:
        return ""
    sections = Counter(pointer.split("/")[1] for pointer in assumed)
    listed = ", ".join(f"{count} in {name}" for name, count in sections.items())
    return f"{len(assumed)} value{'' if len(assumed) == 1 else 's'} that nobody stated ({listed})"


# --- what decides, in words -------------------------------------------------------------------------------

_ORDER = {"fail": 0, "inconclusive": 1, "pass": 2}
_Checked = TypeVar("_Checked", bound=Check)


def urgency(check: Check) -> tuple[int, float]:
    """Sorts checks: failures before open questions before the rest, then by value over limit, largest first."""
    return _ORDER[check.status], -check.value / check.limit


def decisive_check(checks: Sequence[Check]) -> Check | None:
    """The check that the verdict rests on: the worst status, then the largest value over its limit."""
    return min(checks, key=urgency, default=None)


def decided_by(checks: Sequence[_Checked]) -> list[tuple[_Checked, int]]:
    """For each requirement the check that decides it, and at how many targets it is checked; failures first."""
    names = dict.fromkeys(check.requirement for check in checks)
    own = [[check for check in checks if check.requirement == name] for name in names]
    return sorted(((min(each, key=urgency), len(each)) for each in own), key=lambda entry: urgency(entry[0]))


MOST_NAMED = 6  # requirements in a sentence


def checks_sentence(checks: Sequence[Check]) -> str:
    """How many requirements are kept, which are not, and the one that decides with its numbers; "" without any."""
    decided = [check for check, _ in decided_by(checks)]
    if not decided:
        return ""
    first = decided[0]
    if len(decided) == 1:
        return check_sentence(first)
    passed = sum(check.status == "pass" for check in decided)
    count = f"The design keeps {passed} of {len(decided)} requirements"
    if passed == len(decided):
        return f"{count}; nearest to its limit is {_describe(first)}."
    named = [
        f"{verb} {_list_names([check.requirement for check in decided if check.status == status])}"
        for verb, status in (("misses", "fail"), ("leaves open", "inconclusive"), ("keeps", "pass"))
        if any(check.status == status for check in decided)
    ]
    return f"{count} ({', '.join(named)}). What decides is {_describe(first)}."


def _list_names(names: Sequence[str]) -> str:
    if len(names) > MOST_NAMED:
        return f"{', '.join(names[:MOST_NAMED])} and {len(names) - MOST_NAMED} more"
    return " and ".join((", ".join(names[:-1]), names[-1]) if len(names) > 1 else names)


def check_sentence(check: Check, who: str = "The design") -> str:
    """A requirement at the target that decides it: kept, missed or open, with its numbers."""
    begin = {"pass": f"{who} keeps", "fail": f"{who} misses", "inconclusive": "Undecided for"}[check.status]
    return f"{begin} {_describe(check)}."


def _describe(check: Check) -> str:
    """A requirement's name and numbers."""
    decimals = decimals_of((check,))
    shots = "shots" if check.min_yield is None else "their own shots"
    units_of = "" if check.min_yield is None else f"in {100 * check.min_yield:.6g} % of {name_all(check.risk)}, "
    shots += f", {MISSED}" if check.missed else ""
    what = check.write(STATISTIC[check.statistic].sentence, f"{ERRORS[check.error]} (target {check.target})", shots)
    name = check.write(STATISTIC[check.statistic].headline)
    low, high = check.interval
    ends = "no upper end is known" if high is None else f"between {length(low, decimals)} and {length(high, decimals)}"
    limit = f"the limit of {check.limit:g} {check.unit}"
    held = {"pass": f"within {limit}", "fail": f"above {limit}", "inconclusive": f"and {limit} lies in between"}
    where = f"so whether it keeps {limit} is open" if high is None else held[check.status]
    implied = check.write(STATISTIC[check.statistic].implies)
    units = f"; {implied}" if implied and check.status == "pass" else ""
    if check.yield_fraction is not None:
        units = f"; {in_percent(check.yield_fraction, 1)} of {_plural(check.risk)} keep it"
    return (
        f"{check.requirement}: {units_of}{what} "
        f"{length(check.value, decimals)} {check.unit} ({name}; {ends}), {where}{units}"
    )


# --- tables ---------------------------------------------------------------------------------------------------

BASIS = {"first order": "estimate", "Monte Carlo": "Monte Carlo"}  # what a verdict rests on, by its name in records
MARGIN_NOTE = "Margin: the limit less the upper end of the interval. A requirement passes where it is not negative."


def is_of_all_shots(verdict: Verdict) -> bool:
    """Whether shots that miss fiducials are among those that the checks are of, as the design says that some do."""
    return verdict.basis.endswith(MISSED)


def name_basis(basis: str) -> str:
    """What a number rests on: the estimate of a score, or a Monte Carlo simulation."""
    how, mark, more = basis.partition(", ")
    return BASIS.get(how, how) + mark + more


class Judged(NamedTuple):
    """What a row of a table of requirements is about."""

    check: Check
    basis: str
    targets: int = 1  # that are checked; this one decides


def what_is_limited(check: Check) -> str:
    """The quantile and of which error, in words."""
    return check.name_value(ERRORS[check.error])


def _limited_briefly(check: Check) -> str:
    units = "" if check.min_yield is None else f", {100 * check.min_yield:.6g} % of {_plural(check.risk)}"
    return f"{check.write(STATISTIC[check.statistic].headline)}{MEASURE[check.error].brief}{units}"


def check_columns(checks: Sequence[Check]) -> tuple[Column, ...]:
    """Every column of a table of requirements."""
    decimals, units = decimals_of(checks), {check.unit for check in checks}
    unit = units.pop() if len(units) == 1 else ""
    own = () if unit else (Column("Unit", of=lambda row: row.check.unit),)
    ids = Column("Ids", on=~On.PLAIN, of=lambda row: ", ".join(row.check.ids) or None)
    risks = {check.risk for check in checks} - {"pooled"}
    keepers = _plural(risks.pop()) if len(risks) == 1 else "kept"
    of_units: tuple[Column, ...] = (
        Column("Yield", "%", "percent", 2, IN_DETAIL, f"{keepers}\nwithin, %", of=lambda row: row.check.yield_fraction),
        Column("Required", "%", "percent", 2, PAPER, of=lambda row: row.check.min_yield),
    )
    return (
        Column("Requirement", brief="require-\nment", of=lambda row: row.check.requirement),
        Column(
            "Target",
            of=lambda row: row.check.target + (f" (worst of {row.targets})" if row.targets > 1 else ""),
        ),
        Column("What is limited", on=PAPER, of=lambda row: what_is_limited(row.check)),
        Column(
            "Limited", on=TERMINAL | On.NOTEBOOK, brief="what is\nlimited", of=lambda row: _limited_briefly(row.check)
        ),
        *((ids,) if any(check.ids for check in checks) else ()),
        *own,
        Column("Value", unit, "fixed", decimals, brief=f"value\n{unit}", of=lambda row: row.check.value),
        Column("From", unit, "fixed", decimals, brief=f"from\n{unit}", of=lambda row: row.check.interval[0]),
        Column("To", unit, "fixed", decimals, brief=f"to\n{unit}", of=lambda row: row.check.interval[1]),
        Column("Limit", unit, "stated", decimals, brief=f"limit\n{unit}", of=lambda row: row.check.limit),
        Column("Margin", unit, "signed", decimals, brief=f"to spare\n{unit}", of=lambda row: row.check.margin),
        *(of_units if any(check.min_yield is not None for check in checks) else ()),
        Column("Status", kind="status", of=lambda row: row.check.status),
    )


def requirements_table(verdict: Verdict) -> Table | None:
    """Each requirement once, at the target that decides it; what fails and what is nearest to its limit first."""
    if not verdict.checks:
        return None
    rows = [Judged(check, verdict.basis, count) for check, count in decided_by(verdict.checks)]
    caption = f"Requirements, by {name_basis(verdict.basis)}"
    return tabulate("Requirements", caption, check_columns(verdict.checks), rows, MARGIN_NOTE)


def checks_table(*verdicts: Verdict, name: str = "Checks", of: str = "") -> Table:
    """Each requirement at each target, by each way it was judged; what fails and what is nearest to its limit first."""
    judged = [Judged(check, verdict.basis) for verdict in verdicts for check in verdict.checks]
    columns = list(check_columns([row.check for row in judged]))
    columns.insert(4, Column("By", on=PAPER, of=lambda row: name_basis(row.basis)))
    note = (
        "A requirement passes only if the upper end of the interval is within the limit, and fails only if the "
        f"lower end is beyond it. {MARGIN_NOTE} Estimate: the interval is how far a simulation may "
        "be from it."
    )
    rows = sorted(judged, key=lambda row: urgency(row.check))
    return tabulate(name, f"Requirements{of}", columns, rows, note)


def measures_table(measures: Sequence[MeasureResult]) -> Table:
    """Measures made of the errors at targets."""
    columns = (
        Column("Measure", of=lambda row: row.words),
        Column("At", of=lambda row: row.site),
        Column("Unit", of=lambda row: row.unit),
        Column("Known", "", "fixed", 3, of=lambda row: row.known),
        Column("Mean", "", "fixed", 3, of=lambda row: row.mean),
        Column("P95", "", "fixed", 3, of=lambda row: row.p95),
        Column("CVaR95", "", "fixed", 3, brief="mean of worst\n5 %", of=lambda row: row.cvar95),
        Column("Limit", "", "stated", 3, of=lambda row: row.limit),
        Column("Beyond limit", "%", "percent", 2, of=lambda row: row.exceedance_probability),
    )
    return tabulate("Measures", "What is made of the errors at the targets", columns, measures)


def shares_table(measures: Sequence[MeasureResult]) -> Table | None:
    """What is to blame for each measure that is limited, if any is."""
    columns = (
        Column("Measure", of=lambda row: row[0].words),
        Column("At", of=lambda row: row[0].site),
        Column("Contributor", of=lambda row: row[1].label),
        Column("Drawn per", of=lambda row: row[1].drawn),
        Column("Share of variance", "%", "percent", 1, of=lambda row: row[1].variance_share),
    )
    rows = [(each, share) for each in measures for share in each.shares if share.variance_share > 0]
    return tabulate("Shares", "What makes each measure that is limited", columns, rows) if rows else None


def breaches_table(measures: Sequence[MeasureResult]) -> Table:
    """How often trajectories are out of their corridors."""
    columns = (
        Column("Trajectory", of=lambda row: row[0].site),
        Column("Beyond the corridor by", "mm", "fixed", 0, of=lambda row: row[1].beyond_mm),
        Column("Of all shots", "%", "percent", 3, of=lambda row: row[1].probability),
        Column("From", "%", "percent", 3, of=lambda row: row[1].interval[0]),
        Column("To", "%", "percent", 3, of=lambda row: row[1].interval[1]),
    )
    note = "Beyond by more than 0, 2, 4 and 6 mm: grades B to E of Gertzbein and Robbins and worse."
    rows = [(each, breach) for each in measures for breach in each.breaches]
    return tabulate("Breaches", "How often a trajectory leaves its corridor", columns, rows, note)


def findings_table(findings: Sequence[Finding], *, name: str = "Findings", of: str = "") -> Table:
    """Remarks on the design."""
    columns = (
        Column("Severity", kind="status", of=lambda finding: finding.severity),
        Column("Rule", of=lambda finding: finding.rule),
        Column("Finding", of=lambda finding: finding.message),
        Column("At", of=lambda finding: finding.pointer),
    )
    return tabulate(name, f"Findings{of}", columns, findings)
