"""Two designs side by side: both reported alike with one seed, then what sets them apart."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import isfinite
from typing import Any, Literal

from tailstack.design import Design, compile_design, load_design
from tailstack.errors import Problem, escape
from tailstack.geometry.arrays import Array
from tailstack.montecarlo.simulate import Progress
from tailstack.results import Score, Verification
from tailstack.results.digits import in_percent, length
from tailstack.results.score import single_lines
from tailstack.results.verdicts import check_sentence, decisive_check, urgency
from tailstack.studies.sections import SECTIONS, SectionEstimate, estimate_by_sections, take_quantile
from tailstack.units import unit_label
from tailstack.verification import PreparedDesign, Sampling, prepare, verify_prepared

from ..problems import RequestError
from .assembling import ReportContents, assemble, draw_norms, drawing_options
from .records import (
    Change,
    Comparison,
    ComparisonHeadline,
    Difference,
    Report,
    comparison_decimals,
    decided_difference,
    difference_decimals,
)

MOST_COMPARED = 2**18  # trials of each design
FEWEST = 64 * SECTIONS  # trials: below, the P95 of a section hangs on three of them
MOST_TARGETS = 24  # largest P95 first: a region may have hundreds
CONFIDENCE = 0.95
SAME = 1e-12  # mm: what differs by less is the same
PARTS = ("score", "verification")
Pair = tuple[Verification, Verification]
Names = tuple[str, str] | None


def compute_comparison(
    first: Design, second: Design, options: ReportContents, *, progress: Progress | None = None
) -> Comparison:
    """Both designs reported with the same options, and their differences.  Raises TailstackError."""
    check_parts(options)
    _list_common_targets([[target.name for target in compile_design(design).targets] for design in (first, second)])
    sampled = "verification" in options.parts
    ready = (prepare(first, sampled=sampled), prepare(second, sampled=sampled))
    checks: tuple[Verification | None, Verification | None] = (None, None)
    if sampled:

        def draw_pair(how: Sampling) -> Pair:
            return verify_prepared(ready[0], how, progress=progress), verify_prepared(ready[1], how, progress=progress)

        checks = verify_alike(ready, options, draw_pair)
    reports = [assemble(design, options, check, None) for design, check in zip((first, second), checks, strict=True)]
    return compare(reports[0], reports[1], options)


def verify_alike(
    ready: tuple[PreparedDesign, PreparedDesign], options: ReportContents, draw: Callable[[Sampling], Pair]
) -> Pair:
    """The checks of both designs, with the same trials: where one stops sooner it is drawn on, so that the P95 of each
    is one number, and the difference that of the two.

    ``draw`` checks both; checks that are asked for again have the same trials and more.
    """
    at_least = 0
    while True:
        sampling = Sampling(
            options.trials, options.precision, options.seed, "plain", options.max_trials, at_least=at_least
        )
        pair = draw(sampling)
        most = max(check.trials for check in pair)
        # bounded components may be drawn at several vertices, and a check tells only the most trials of all of them
        single = all(len(prepared.plans) == 1 for prepared in ready)
        if most == at_least or options.trials is not None or (single and pair[0].trials == pair[1].trials):
            return pair
        at_least = most


def check_parts(options: ReportContents) -> None:
    """Raises RequestError for what two designs are not compared by."""
    if set(options.parts) - set(PARTS):
        detail = f"two designs are compared by {' and '.join(PARTS)}; got {', '.join(options.parts)}"
        hint = "optimise them by themselves and compare what comes out"
        raise RequestError(Problem("/parts", "unknown-value", detail, hint))


def compare(first: Report, second: Report, options: ReportContents) -> Comparison:
    """The comparison of two reports that were computed with these options; trials are drawn again and paired.

    P95 and its difference are those of the checks.  The interval is that of the first MOST_COMPARED trials where the
    checks drew more: wider than theirs would be.
    """
    named = [{target.name for target in report.score.targets} for report in (first, second)]
    worst = sorted(second.score.targets, key=lambda target: target.p95_mm, reverse=True)
    shared = _list_common_targets([sorted(named[0]), [target.name for target in worst]])[:MOST_TARGETS]
    count = _common_trials(first.verification, second.verification)
    differences = tuple(_first_order(first, second, name) for name in shared)
    if count:
        differences = _draw_both(first, second, shared, options.seed, count)
    changes, left_out = changes_of(first.design, second.design)
    title = second.title if first.title == second.title else f"{second.title} against {first.title}"
    if options.names:
        title += f": {options.names[0]} against {options.names[1]}"
    return Comparison(
        schema="tailstack/comparison/1",
        title=title,
        headline=_headline(first, second, differences, options.names),
        differences=differences,
        compared_trials=count or None,
        sections=SECTIONS if count else None,
        only_first=tuple(sorted(named[0] - named[1])),
        only_second=tuple(sorted(named[1] - named[0])),
        changes=changes,
        changes_left_out=left_out,
        first=_told_apart(first, options, "first"),
        second=_told_apart(second, options, "second"),
        names=options.names,
    )


def _list_common_targets(names: list[list[str]]) -> list[str]:
    """Targets of the second design that the first has as well, in the second's order.  Raises RequestError."""
    shared = [name for name in names[1] if name in names[0]]
    if not shared:
        first, second = (", ".join(some[:5]) for some in names)
        detail = f"the two designs have no target of the same name: the first has {first}, the second {second}"
        raise RequestError(Problem("/targets", "no-common-target", detail, "give the targets the same names"))
    return shared


def _told_apart(report: Report, options: ReportContents, which: str) -> Report:
    """The report with commands that name the design it is of."""
    stated = " --parts score" if report.verification is None else drawing_options(options)
    commands = ("tailstack report --verify THIS_FILE", f"tailstack report first.yaml second.yaml{stated}")
    made = replace(report.reproduction, commands=commands, statement=f"{which}.yaml is the design below.")
    return replace(report, reproduction=made)


def _common_trials(first: Verification | None, second: Verification | None) -> int:
    """Trials that both checks drew and that make whole sections; 0: too few, or nothing was drawn."""
    if first is None or second is None:
        return 0
    count = min(first.trials, second.trials, MOST_COMPARED) // SECTIONS * SECTIONS
    return count if count >= FEWEST else 0


def _first_order(first: Report, second: Report, name: str) -> Difference:
    a, b = (_p95_at(report.score, name) for report in (first, second))
    return Difference(name, "first order", a, b, b - a, None, None, "computed")


def _draw_both(first: Report, second: Report, names: list[str], seed: int, count: int) -> tuple[Difference, ...]:
    ready = [prepare(load_design(report.design, allow_files=False)) for report in (first, second)]
    differences = []
    for name in names:
        a, b = (draw_norms(prepared, name, seed, count) for prepared in ready)
        apart = estimate_difference(a, b, 0.95, CONFIDENCE)
        if not isfinite(apart.interval[1]):
            detail = f"so many shots have no answer at target {name} that some thirty-seconds of them have no P95"
            hint = "compare the designs by their scores (--parts score), or use more fiducials"
            raise RequestError(Problem("/fiducials/loss_probability", "no-bound", detail, hint))
        was, now = (_p95_at(report.verification, name) for report in (first, second))
        low, high = (now - was + (end - apart.value) for end in apart.interval)
        conclusion: Literal["smaller", "larger", "not decided"] = (
            "smaller" if high < -SAME else "larger" if low > SAME else "not decided"
        )
        differences.append(Difference(name, "Monte Carlo", was, now, now - was, (low, high), CONFIDENCE, conclusion))
    return tuple(differences)


def estimate_difference(first: Array, second: Array, quantile: float, confidence: float) -> SectionEstimate:
    """Second minus first, at a quantile of two samples (n,) in which trial k of both has the same random numbers.

    Raises ValueError for samples of different sizes, or fewer than FEWEST trials.
    """
    if first.shape != second.shape or first.ndim != 1:
        raise ValueError(f"paired samples have one length; got {first.shape} and {second.shape}")
    if len(first) < FEWEST:
        raise ValueError(f"a paired difference takes at least {FEWEST} trials; got {len(first)}")

    def subtract(part: slice) -> float:
        return take_quantile(second[part], quantile) - take_quantile(first[part], quantile)

    return estimate_by_sections(subtract, len(first), confidence)


def _p95_at(found: Score | Verification | None, name: str) -> float:
    assert found is not None
    return next(target.p95_mm for target in found.targets if target.name == name)


def _headline(first: Report, second: Report, differences: tuple[Difference, ...], names: Names) -> ComparisonHeadline:
    """What the second design comes to, named, then what sets it apart from the first."""
    shown = decided_difference(second, differences)
    called = names or ("the first design", "the second design")
    told = [words if names else words.capitalize() for words in called]
    judged = _describe_verdict(told[1], second)
    difference = difference_sentence(shown, comparison_decimals(first, second), called[1])
    also = [judged_first] if (judged_first := _describe_verdict(told[0], first)) else []
    return ComparisonHeadline(
        status=second.headline.status,
        sentence=f"{judged} {difference}".strip(),
        matters=tuple([*also, *_budget(first, second, shown.target, names)][:3]),
    )


def _describe_verdict(which: str, report: Report) -> str:
    """What fails, or is open; of a design that passes, what is nearest to its limit.  "" without a requirement."""
    checks = (report.verification or report.score).verdict.checks
    decisive = decisive_check(checks)
    if decisive is None:
        return ""
    sentence = check_sentence(decisive, which)
    word = {"fail": "misses", "inconclusive": "may miss"}
    others: dict[str, list[str]] = {}
    for name in dict.fromkeys(check.requirement for check in checks if check.requirement != decisive.requirement):
        worst = min((check for check in checks if check.requirement == name), key=urgency)
        others.setdefault(worst.status, []).append(name)
    more = " and ".join(f"{word[key]} {', '.join(others[key])}" for key in word if key in others)
    sentence = sentence if decisive.status != "inconclusive" else f"{which}: {sentence[:1].lower()}{sentence[1:]}"
    return f"{sentence} It also {more}." if more else sentence


def difference_sentence(difference: Difference, decimals: int, second: str = "the second design") -> str:
    """The difference at one target in words; decimals: of P95; second: what the second design is called."""
    fine = difference_decimals(difference, decimals)
    first_mm, apart_mm = difference.first_p95_mm, abs(difference.difference_mm)
    share = f" ({in_percent(apart_mm / first_mm, 1)})" if first_mm > 0 else ""
    ends = f"; P95 goes from {length(first_mm, decimals)} to {length(difference.second_p95_mm, decimals)} mm"
    size = f"{apart_mm:.{fine}f} mm{share}"
    if difference.interval_mm is None or difference.confidence is None:
        word = "smaller" if difference.difference_mm < 0 else "larger"
        return f"By estimate, P95 at {difference.target} is {size} {word} with {second}{ends}."
    low, high = difference.interval_mm
    within = f"({in_percent(difference.confidence)} interval {low:+.{fine}f} to {high:+.{fine}f} mm)".replace("-", "−")
    if difference.conclusion == "not decided":
        return f"No difference of P95 at {difference.target} is shown {within}{ends}."
    return f"P95 at {difference.target} is {size} {difference.conclusion} with {second} {within}{ends}."


def _budget(first: Report, second: Report, target: str, names: Names) -> list[str]:
    """The contributor whose variance changed most."""
    before, after = (_variances(report, target) for report in (first, second))
    moved = {name: after.get(name, 0.0) - before.get(name, 0.0) for name in {**before, **after}}
    name = max(moved, key=lambda key: (abs(moved[key]), key), default="")
    if not moved or abs(moved[name]) <= SAME:
        return []
    way = "less" if moved[name] < 0 else "more"
    label = _label(second, name) or _label(first, name)
    was, now = (values.get(name, 0.0) ** 0.5 for values in (before, after))
    decimals = comparison_decimals(first, second)
    told = names or ("the first", "the second design")
    return [
        f"What changed most is {label}: {way} spread at {target}, {length(was, decimals)} mm in {told[0]} and "
        f"{length(now, decimals)} mm in {told[1]} (standard deviation, estimate)."
    ]


def _label(report: Report, contributor: str) -> str:
    """What a design calls a contributor; "" where its budget has no line of it."""
    lines = (line for target in report.score.targets for line in target.contributors)
    return next((line.label for line in lines if line.name == contributor), "")


def _variances(report: Report, name: str) -> dict[str, float]:
    """mm^2 by contributor at a target."""
    target = next(entry for entry in report.score.targets if entry.name == name)
    total = sum(target.covariance_mm2[k][k] for k in range(3))
    variances: dict[str, float] = {}
    for line in single_lines(target.contributors):
        variances[line.name] = variances.get(line.name, 0.0) + line.variance_share * total
    return variances


# --- what differs between the documents ----------------------------------------------------------------------
# Field by field; elements of lists are told by their names, if they have any.

MOST = 500
SAYINGS = ("name", "label", "component")  # what tells an element of a list from the others
LONGEST = 400  # characters of a value
APART = ("schema", "review")


def changes_of(first: Any, second: Any) -> tuple[tuple[Change, ...], int]:
    """Fields that differ, in the order of the second document, at most MOST of them; and how many are left out."""
    told = [{key: value for key, value in document.items() if key not in APART} for document in (first, second)]
    changes = list(_changes(told[0], told[1], "", "", ""))
    return tuple(changes[:MOST]), max(len(changes) - MOST, 0)


def _changes(first: Any, second: Any, old: str, new: str, name: str) -> Iterator[Change]:
    before, after = _parts(first), _parts(second)
    if before is None or after is None or type(first) is not type(second):
        if first != second:
            yield Change(new, name.strip(), unit_label(new), "changed", _value(first), _value(second))
        return
    for key, step in after.items():
        at, called = f"{new}/{escape(str(step))}", f"{name} {key}"
        if key in before:
            yield from _changes(first[before[key]], second[step], f"{old}/{escape(str(before[key]))}", at, called)
        elif second[step] is not None:
            yield Change(at, called.strip(), unit_label(at), "added", None, _value(second[step]))
    for key, step in before.items():
        if key not in after and first[step] is not None:
            at = f"{old}/{escape(str(step))}"
            yield Change(at, f"{name} {key}".strip(), unit_label(at), "removed", _value(first[step]), None)


def _parts(node: Any) -> dict[str, Any] | None:
    """Keys of a mapping, or places in a list of mappings, by what tells them; None of a value: a position, a matrix."""
    if isinstance(node, dict):
        return {key: key for key in node}
    return _describe(node) if isinstance(node, list) and all(isinstance(item, dict) for item in node) else None


def _describe(items: list[Any]) -> dict[str, int]:
    """Places by what tells an element: its name, if all have one and no two the same, or else its number."""
    for saying in SAYINGS:
        names = [item.get(saying) for item in items]
        if all(isinstance(name, str) and name for name in names) and len(set(names)) == len(names):
            return {str(name): place for place, name in enumerate(names)}
    return {str(place): place for place in range(len(items))}


def _value(node: Any) -> str:
    text = json.dumps(node, ensure_ascii=False, separators=(", ", ": "))  # noqa: TID251 - words in a table
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
