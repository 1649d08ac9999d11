"""What rules find in one design: in its error, its layout, and the tolerances that a process has to hold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import dist
from typing import get_args

from tailstack.cures import ask_label
from tailstack.design import Design
from tailstack.design.document import Interface
from tailstack.fields import INTERFACES
from tailstack.geometry.camera import ROUNDING_PX
from tailstack.measures import MEASURE
from tailstack.results import ERRORS, Score, headline_of
from tailstack.results.digits import at_least, at_most, count_decimals, in_percent, length, number
from tailstack.results.verdicts import UNBOUNDED, assumed_sentence, name_all
from tailstack.statistic import STATISTIC
from tailstack.system import ROTATIONS, TRANSLATIONS
from tailstack.tolerances import Tolerances
from tailstack.verdict import say_why_open

from ..rendering.sentences import error_of, leading_bias_mm, sources_of, trust_sentence
from .case import Case, LimitComparison, bound_yield
from .policy import GatePolicy, Implausible, Process
from .reading import Remark

WEAKNESSES = ("flat-structure", "weak-resection", "small-parallax")  # findings of a score
IMPLAUSIBLE = get_args(Implausible)
MOST_PAIRS = 10


def find_failures(case: Case, rule: str) -> list[Remark]:
    """Rules p95, cvar, exceedance and per-unit-yield: limits that are surely missed."""
    return [
        _make_remark(case, comparison, "")
        for comparison in case.comparisons
        if comparison.number.rule == rule and comparison.number.status == "fail"
    ]


def find_open_questions(case: Case) -> Iterator[Remark]:
    """Rule inconclusive: limits that an interval holds."""
    for comparison in case.comparisons:
        if comparison.number.status == "inconclusive":
            hint = comparison.number.open_because
            if (check := case.verification) is not None:
                hint = hint or f"open after {check.trials:,} trials; the policy's verification.max_trials allows more"
            elif hint != UNBOUNDED:
                hint = f"{say_why_open(comparison.number)}; gate with --mode auto or verify"
            yield _make_remark(case, comparison, hint)


def find_first_order_gaps(case: Case) -> Iterator[Remark]:
    """Rule first-order-gap: first order is too far from Monte Carlo, or is calibrated to be."""
    allowed = case.rules.first_order_gap.max_percent
    trust = case.score.validity
    if case.verification is None:
        percent = trust.expected_error_percent
        if percent is not None and percent <= allowed:
            return
        message = f"{trust_sentence(trust)}; {allowed:g} % are allowed"
        yield Remark("/views", message, percent, allowed, unbounded=percent is None)
        return
    for index, target in enumerate(case.verification.targets):
        low, high = (target.first_order_p95_mm / end for end in reversed(target.p95_interval_mm))
        if low <= 1 + allowed / 100 and high >= 1 - allowed / 100:
            continue
        percent = 100 * abs(target.first_order_ratio - 1)
        way = "below" if target.first_order_ratio < 1 else "above"
        message = (
            f"target {target.name}: the estimated P95 is {number(percent, 2)} % {way} the simulated one; {allowed:g} % "
            "are allowed"
        )
        yield Remark(point_at_target(case, index), message, percent, allowed, target.name)


def find_assumed_values(case: Case) -> list[Remark]:
    """Rule assumed-values: how many values of the design nobody stated, and where."""
    assumed, most = case.score.provenance.assumed, case.rules.assumed_values.max_count
    if len(assumed) <= most:
        return []
    allowed = f"; {most} are accepted" if most else ""
    message = f"the verdict rests on {assumed_sentence(assumed)}{allowed}"
    return [Remark("/assumed", message, len(assumed), most or None)]


def _make_remark(case: Case, comparison: LimitComparison, hint: str) -> Remark:
    number = comparison.number
    message = f"{number.requirement}, target {number.target}: {_describe_number(comparison)}"
    if hint:
        message += f"; {hint}"
    elif share := name_largest_share(case.score, number.target, comparison.requirement.error):
        message += f"; the largest share is {share}"
    bound: float | None = None  # to first order only the status of a yield is known
    if number.min_yield is None:
        bound = number.interval[1]
    elif case.verification is not None:
        bound = bound_yield(number.judged_value)
    return Remark(
        _point_at_limit(case, comparison), message, number.judged_value, number.judged_limit, number.target,
        bound=bound, about=number.rule, unbounded=bound is None,
    )  # fmt: skip


def _describe_number(comparison: LimitComparison) -> str:
    number, requirement = comparison.number, comparison.requirement
    low, high = number.interval
    decimals = count_decimals(number.limit, error_of(number.value, (low, high)))
    ends = f"(between {length(low, decimals)} and {'an unknown end' if high is None else length(high, decimals)})"
    value_text = f"{length(number.value, decimals)} {number.unit} {ends}"
    quantile = f"P{100 * requirement.quantile:g}"
    if number.yield_fraction is not None and number.min_yield is not None:
        value = headline_of(requirement.quantile, number.min_yield, ERRORS[requirement.error], risk=number.risk)
        good = (
            f"{in_percent(number.yield_fraction, 2)} of {name_all(number.risk)} are good, "
            f"{100 * number.min_yield:g} % required"
        )
        return f"{value} is {value_text}, limit {number.limit:g} {number.unit}: {good}"
    if number.rule == "exceedance":
        asked = f"more than {100 * (1 - requirement.quantile):g} % of shots may miss by over {number.limit:g} mm"
        return f"{asked}: {quantile} is {value_text}"
    what = number.write(STATISTIC[number.statistic].headline, ERRORS[requirement.error])
    if number.rule == "cvar":
        what = f"the mean of the worst 5 % (CVaR95) of {ERRORS[requirement.error]}"
    return f"{what} is {value_text}, limit {number.limit:g} {number.unit}"


def _point_at_limit(case: Case, comparison: LimitComparison) -> str:
    """The limit in the design; for a limit of the policy, the target that misses it."""
    if comparison.requirement.origin == "design":
        names = [requirement.name for requirement in case.design.document.requirements]
        number, field = comparison.number, MEASURE[comparison.number.error].limit_field
        field = "min_yield" if number.min_yield is not None else "limit_probability" if number.beyond else field
        return f"/requirements/{names.index(comparison.requirement.name)}/{field}"
    return point_at_target(case, [target.name for target in case.score.targets].index(comparison.number.target))


def point_at_target(case: Case, index: int) -> str:
    """The document's target that the compiled target ``index`` belongs to; regions expand to several."""
    name = case.score.targets[index].name
    for place, target in enumerate(case.design.document.targets):
        if target.name == name or (target.region is not None and name.startswith(f"{target.name}[")):
            return f"/targets/{place}"
    return "/targets"


def name_largest_share(score: Score, target: str, error: str) -> str:
    """The source with the largest share of an error's variance at a target, in words; "" when nothing varies."""
    judged = next((entry for entry in score.targets if entry.name == target), None)
    if judged is not None and (bias := leading_bias_mm(judged, error)) is not None:
        return f"a known bias of {bias:.{score.decimals}f} mm, which no tolerance takes away"
    sources = [] if judged is None else sources_of(judged, error)
    if not sources or sources[0].share <= 0:
        return ""
    return f"{sources[0].name}, {in_percent(sources[0].share)} of the variance"


def find_weaknesses(case: Case) -> list[Remark]:
    """Rule conditioning: the layout barely determines the answer."""
    return [
        Remark(finding.pointer, finding.message, finding.value, finding.limit)
        for finding in case.score.verdict.findings
        if finding.rule in WEAKNESSES
    ]


def find_implausible_values(case: Case) -> list[Remark]:
    """Rule plausibility: what a score remarks as hardly ever meant."""
    rule = case.rules.plausibility
    return [
        Remark(
            finding.pointer,
            f"{finding.rule}: {finding.message}",
            note=rule.remarks is not None and finding.rule not in rule.remarks,
        )
        for finding in case.score.verdict.findings
        if finding.rule in IMPLAUSIBLE
    ]


def find_close_fiducials(case: Case) -> list[Remark]:
    """Rule fiducial-spacing: the closest pairs of fiducials, and how many more there are."""
    least = case.rules.fiducial_spacing.min_mm
    if least is None:
        return []
    fiducials = case.design.fiducials
    points = list(zip(fiducials.labels, fiducials.positions_mm, strict=True))
    pairs = [
        (dist(here, there), first, second, k)
        for k, (second, there) in enumerate(points)
        for first, here in points[:k]
        if dist(here, there) < least
    ]
    remarks = [
        Remark(
            point_at_fiducial(case.design, index),
            f"{first} and {second} are {distance:.4g} mm apart, at least {least:g} mm are required",
            distance,
            least,
        )
        for distance, first, second, index in sorted(pairs)[:MOST_PAIRS]
    ]
    if (more := len(pairs) - len(remarks)) > 0:
        pointer = "/fiducials/points" if case.design.document.fiducials.points else "/fiducials/file"
        words = f"{more} more pair{'s are' if more > 1 else ' is'} closer than {least:g} mm"
        # no waiver has to cover it: what accepts the closest pairs accepts these
        remarks.append(Remark(pointer, f"{words}; told are the {MOST_PAIRS} closest", note=True))
    return remarks


def find_fatal_losses(case: Case) -> Iterator[Remark]:
    """Rule survives-loss: limits that are not kept when fiducials are lost."""
    for line in case.score.losses:
        tried = (line.single, line.double)[: case.rules.survives_loss.lost or 0]
        if line.limit is None or not tried:
            continue
        broken = [worst for worst in tried if worst is None or not worst.keeps(line.limit)]
        if not broken:
            continue
        worst = broken[-1]
        pointer = _point_at_requirement(case, line.requirement)
        if worst is None:
            message = (
                f"{line.requirement}: with so many fiducials no pair was tried, so that nobody knows what a loss does"
            )
            yield Remark(pointer, message, limit=line.limit, unbounded=True)
            continue
        lost = " and ".join(worst.lost)
        comes_to = worst.reason or f"{worst.value:.4g} {line.unit}, limit {line.limit:g} {line.unit}"
        message = f"{line.requirement}: {line.value:.4g} {line.unit} with all fiducials; without {lost}: {comes_to}"
        yield Remark(pointer, message, worst.value, line.limit, worst.target, unbounded=worst.value is None)


def find_unseen_slips(case: Case) -> list[Remark]:
    """Rule reliability: the fiducial whose slip does most before it is noticed."""
    most = case.rules.reliability.max_effect_mm
    if most is None or not case.score.reliability:
        return []
    worst = case.score.reliability[0]
    where = f"view {worst.view}: a slip of {worst.fiducial}"
    pointer = point_at_fiducial(case.design, case.design.fiducials.labels.index(worst.fiducial))
    if worst.effect_mm is None:
        return [Remark(pointer, f"{where} is never noticed in some direction", limit=most, unbounded=True)]
    if worst.effect_mm <= most:
        return []
    message = (
        f"{where} is noticed from {worst.slip_px:.3g} px and moves the tool by up to {worst.effect_mm:.4g} mm until "
        f"then; {most:g} mm are allowed"
    )
    return [Remark(pointer, message, worst.effect_mm, most, worst.target)]


def _point_at_requirement(case: Case, name: str) -> str:
    """The limit of a requirement of the design; for one of the policy, the targets."""
    for index, requirement in enumerate(case.design.document.requirements):
        if requirement.name == name:
            return f"/requirements/{index}/{MEASURE[requirement.error].limit_field}"
    return "/targets"


def find_narrow_margins(case: Case) -> Iterator[Remark]:
    """Rule visibility: fiducials are imaged too near the border, or a view's image size is not stated."""
    least = case.rules.visibility.min_margin_px
    for index, view in enumerate(case.score.views):
        if not view.checked:
            message = f"the image size of view {view.view} is not stated: the field of view was not checked"
            yield Remark(f"/views/{index}", message, unbounded=True)
        elif view.smallest_margin_px is not None and view.smallest_margin_px < least:
            message = (
                f"view {view.view}: a fiducial is imaged {view.smallest_margin_px:.1f} px from the border, at least "
                f"{least:g} px are required"
            )
            yield Remark(f"/views/{index}", message, view.smallest_margin_px, least)


def find_close_images(case: Case) -> Iterator[Remark]:
    """Rule overlap: images of two fiducials may not be told apart."""
    labels, sized = case.design.fiducials.labels, case.design.document.fiducials.diameter_mm is not None
    for view in case.score.views:
        asked, needed = case.rules.overlap.min_px, view.closest_pair_needs_px if sized else 0.0
        least = max(asked, needed)
        if view.closest_pair_px < max(asked - ROUNDING_PX, needed) and view.closest_pair[1] in labels:
            message = (
                f"view {view.view}: the images of {' and '.join(view.closest_pair)} are "
                f"{at_most(view.closest_pair_px, 3)} px apart, at least {at_least(least, 3)} px are required to tell "
                "them apart"
            )
            pointer = point_at_fiducial(case.design, labels.index(view.closest_pair[1]))
            yield Remark(pointer, message, view.closest_pair_px, least)


def find_tight_tolerances(case: Case) -> Iterator[Remark]:
    """Rule process-capability: half-widths that are smaller than their process can hold."""
    for process in case.rules.process_capability.processes:
        for tolerance in list_tolerances(case.design):
            least = process.min_half_width_deg if tolerance.unit == "deg" else process.min_half_width_mm
            if least is None or tolerance.half_width >= least:
                continue
            if any(fnmatchcase(tolerance.name, pattern) for pattern in process.tolerances):
                width = f"a half-width of {tolerance.half_width:g} {tolerance.unit}"
                what = width if tolerance.stated else "not stated, so it does not vary: that"
                message = (
                    f"{tolerance.name}: {what} is tighter than {process.name} can hold ({least:g} {tolerance.unit})"
                )
                yield Remark(tolerance.pointer, message, tolerance.half_width, least)


def point_at_fiducial(design: Design, index: int) -> str:
    return f"/fiducials/points/{index}/position_mm" if design.document.fiducials.points else "/fiducials/file"


@dataclass(frozen=True, slots=True)
class Tolerance:
    """One half-width of the document that a process has to hold."""

    name: str  # structure_connector.rx, fiducials.manufacturing, hand_eye.tx
    pointer: str
    half_width: float
    unit: str  # deg or mm
    stated: bool = True  # otherwise it does not vary: nothing is tighter


def list_tolerances(design: Design) -> list[Tolerance]:
    """Every half-width that somebody manufactures or adjusts, in the order of the document; one that is left out is 0,
    or a design would pass by leaving it out."""
    document = design.document
    manufacturing = document.fiducials.manufacturing
    if manufacturing is None:
        tolerances = [Tolerance("fiducials.manufacturing", "/fiducials", 0.0, "mm", stated=False)]
    else:
        widths = manufacturing.half_width_mm
        least = min(widths) if isinstance(widths, tuple) else widths
        tolerances = [Tolerance("fiducials.manufacturing", "/fiducials/manufacturing/half_width_mm", least, "mm")]
    for name in INTERFACES:
        interface: Interface | None = getattr(document.interfaces, name)
        if interface is None:
            tolerances += _list_components(Tolerances(), name, "/interfaces")
            continue
        at = f"/interfaces/{name}"
        if interface.tolerances is not None:
            tolerances += _list_components(interface.tolerances, name, f"{at}/tolerances")
        elif not interface.is_held:
            tolerances += _list_components(Tolerances(), name, at)
        tolerances += [
            Tolerance(f"{name}.{locator.name}", f"{at}/locators/{k}/half_width_mm", locator.half_width_mm, "mm")
            for k, locator in enumerate(interface.locators or ())
        ]
        tolerances += [
            Tolerance(
                f"{name}.{feature.name} {number.name}", f"{at}/features/{k}/{number.field}", number.half_width, "mm"
            )
            for k, feature in enumerate(interface.features or ())
            for number in feature.numbers()
        ]
    if document.execution.hand_eye is None:
        return [*tolerances, *_list_components(Tolerances(), "hand_eye", "/execution")]
    at = "/execution/hand_eye/tolerances"
    return [*tolerances, *_list_components(document.execution.hand_eye.tolerances, "hand_eye", at)]


def _list_components(tolerances: Tolerances, name: str, at: str) -> Iterator[Tolerance]:
    for component in (*ROTATIONS, *TRANSLATIONS):
        entry = tolerances.components[component]
        unit = "deg" if component.startswith("r") else "mm"
        if entry is None:
            yield Tolerance(f"{name}.{component}", at, 0.0, unit, stated=False)
        else:
            own = f"{component}/half_width_{unit}" if tolerances.covariance_deg_mm is None else "covariance_deg_mm"
            yield Tolerance(f"{name}.{component}", f"{at}/{own}", entry.width, unit)


def find_idle_processes(
    policy: GatePolicy, designs: Iterable[tuple[str | None, Design]]
) -> Iterator[tuple[str, Remark]]:
    """Rule process-unused: patterns of process-capability that judge no tolerance of any design held to them.

    A slip in a pattern would be a tolerance that nobody judges.  designs: each with its class.
    """
    groups: dict[str, tuple[list[Process], list[Design]]] = {}
    for design_class, design in designs:
        rule = policy.merge_rules(design_class).process_capability
        if rule.severity != "off":
            groups.setdefault(policy.point_at_processes(design_class), (rule.processes, []))[1].append(design)
    for pointer, (processes, members) in groups.items():
        tolerances = [tolerance for design in members for tolerance in list_tolerances(design)]
        for index, process in enumerate(processes):
            for place, pattern in enumerate(process.tolerances):
                if (message := _explain_idle(process, pattern, tolerances, len(members))) is not None:
                    yield "process-unused", Remark(f"{pointer}/{index}/tolerances/{place}", message)


def _explain_idle(process: Process, pattern: str, tolerances: list[Tolerance], designs: int) -> str | None:
    """Why a pattern judges nothing; None if it does."""
    least = {"deg": process.min_half_width_deg, "mm": process.min_half_width_mm}
    matched = [tolerance for tolerance in tolerances if fnmatchcase(tolerance.name, pattern)]
    if any(least[tolerance.unit] is not None for tolerance in matched):
        return None
    if matched:
        unit, words = matched[0].unit, "rotations" if matched[0].unit == "deg" else "lengths"
        return (
            f"process {process.name}: {pattern!r} matches only {words} ({matched[0].name}), and the process "
            f"states no min_half_width_{unit}: nothing is judged by it"
        )
    of = "the design" if designs == 1 else f"the {designs} designs"
    meant = ask_label(pattern, sorted({tolerance.name for tolerance in tolerances}))
    end = f"; {meant}" if meant else ""
    return f"process {process.name}: {pattern!r} matches no tolerance of {of} held to it{end}"
