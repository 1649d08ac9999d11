"""Rules about the baseline: is the design worse than it was, or asked for less?"""

from __future__ import annotations

from dataclasses import dataclass
from math import dist

from .case import Case, Remark
from .records import GatedDesign, GateRequirement, GateTarget
from .requirement_rules import target_pointer
from .requirements import at, in_words, pointer_of

# Two machines differ in the last digits of a first-order score; a rise of less is no rise.
ROUNDING_PERCENT = 1e-6
ROUNDING = 1e-9  # of limits, relative
SAME_PLACE_MM = 1e-6
_WEIGHTS = ("off", "note", "warning", "error")
_KINDS = {"p95": "quantile", "exceedance": "quantile"}  # an exceedance is a quantile against a limit


def regressions(case: Case) -> list[Remark]:
    """regression"""
    base = case.baseline
    if base is None:
        return []
    before = {target.name: target for target in base.targets}
    remarks = []
    for index, score in enumerate(case.score.targets):
        was = before.get(score.name)
        pointer = target_pointer(case, index)
        if was is None:
            continue
        head, then, basis = _compared(case, index, was, base)
        percent = 100 * (head / then - 1) if then > 0 else (0.0 if head == 0 else float("inf"))
        if percent > case.max_regression_percent + ROUNDING_PERCENT:
            message = (
                f"target {score.name}: P95 ({basis}) rose from {then:.4g} to {head:.4g} mm"
                + (f", by {percent:.3g} %" if then > 0 else "")
                + f"; {case.max_regression_percent:g} % are allowed"
            )
            value = percent if then > 0 else None
            remarks.append(Remark(pointer, message, value, case.max_regression_percent, score.name))
    return remarks


def _compared(case: Case, index: int, was: GateTarget, base: GatedDesign) -> tuple[float, float, str]:
    """P95 now and then.

    First order has no chance in it, so a difference is the design's.  Where it is not to be trusted Monte Carlo is
    compared, if both drew as many trials of the same seed.
    """
    now, trust = case.verification, case.score.validity.expected_error_percent
    trusted = trust is not None and trust <= case.rules.first_order_gap.max_percent
    if not trusted and now is not None and was.p95_mm is not None and base.trials == now.trials:
        return now.targets[index].p95_mm, was.p95_mm, "Monte Carlo"
    return case.score.targets[index].p95_mm, was.first_order_p95_mm, "first order"


# --- what was asked for ---------------------------------------------------------------------------


def relaxed_limits(case: Case) -> list[Remark]:
    """limit-relaxed: what the baseline held the design to, and nothing holds it to now"""
    base = case.baseline
    if base is None:
        return []
    names = {target.name for target in case.targets}
    remarks = _lost_targets(case, base)
    for asked in _asked_before(base):
        left = tuple(name for name in asked.targets if name in names and not _still_asked(case, asked, name))
        if left:
            remarks.append(_relaxed(case, asked, left))
    return remarks


@dataclass(frozen=True, slots=True)
class _Asked:
    """A requirement of the baseline; None where an old record does not say."""

    name: str
    origin: str | None
    kind: str
    severity: str | None
    error: str | None
    quantile: float | None
    limit_mm: float | None
    min_yield: float | None
    confidence: float | None
    targets: tuple[str, ...]
    words: str


def _asked_before(base: GatedDesign) -> list[_Asked]:
    """What was judged then: from the record of requirements, or from the numbers of a record that has none."""
    if base.requirements:
        return [
            _Asked(
                entry.name, entry.origin, _KINDS.get(entry.rule, entry.rule), entry.severity, entry.error,
                entry.quantile, entry.limit_mm, entry.min_yield, entry.confidence, entry.targets, in_words(entry),
            )
            for entry in base.requirements
            if entry.severity != "off"
        ]  # fmt: skip
    found: dict[tuple[str, str], _Asked] = {}
    for number in base.numbers:
        key = (number.rule, number.requirement)
        limit, required = (None, number.limit) if number.unit == "fraction" else (number.limit, None)
        words = f"{100 * required:g} % of installed units" if required is not None else f"{number.limit:g} mm"
        earlier = found[key].targets if key in found else ()
        found[key] = _Asked(
            number.requirement, None, _KINDS.get(number.rule, number.rule), None, None, None, limit, required, None,
            (*earlier, number.target), words,
        )  # fmt: skip
    return list(found.values())


def _still_asked(case: Case, asked: _Asked, target: str) -> bool:
    """Whether some requirement, whatever it is called, asks for as much at the target."""
    return any(
        target in entry.targets and _KINDS.get(entry.rule, entry.rule) == asked.kind and not _less(entry, asked)
        for entry in case.requirements
    )


def _less(entry: GateRequirement, asked: _Asked) -> list[tuple[str, str]]:
    """In what a requirement asks for less: field of the document and words."""
    found: list[tuple[str, str]] = []
    if asked.error not in (None, entry.error):
        found.append(("error", f"it is about the {entry.error} error, and was about the {asked.error} error"))
    if asked.limit_mm is not None and entry.limit_mm > asked.limit_mm * (1 + ROUNDING):
        found.append(("limit_mm", f"limit raised from {asked.limit_mm:g} to {entry.limit_mm:g} mm"))
    if asked.quantile is not None and entry.quantile < asked.quantile - ROUNDING:
        found.append(("quantile", f"quantile lowered from {asked.quantile:g} to {entry.quantile:g}"))
    if asked.min_yield is not None and (entry.min_yield or 0.0) < asked.min_yield - ROUNDING:
        found.append(("min_yield", f"yield lowered from {asked.min_yield:g} to {entry.min_yield or 0.0:g}"))
    if asked.confidence is not None and entry.confidence < asked.confidence - ROUNDING:
        found.append(("confidence", f"confidence lowered from {asked.confidence:g} to {entry.confidence:g}"))
    weight = _WEIGHTS.index(asked.severity or "note")
    if _WEIGHTS.index(entry.severity) < weight:
        found.append(("", f"rule {entry.rule} counts as {entry.severity}, and counted as {asked.severity or 'more'}"))
    return found


def _relaxed(case: Case, asked: _Asked, targets: tuple[str, ...]) -> Remark:
    """What became of a requirement that is not asked for as it was."""
    begin = f"{asked.name} ({asked.words} in the baseline)"
    namesake = next(
        (entry for entry in case.requirements if entry.name == asked.name and asked.origin in (None, entry.origin)),
        None,
    )
    if namesake is None:
        return Remark(_requirements(case), f"{begin}: the requirement went {at(targets)}")
    pointer = pointer_of(case.design, namesake)
    if _KINDS.get(namesake.rule, namesake.rule) != asked.kind:
        return Remark(pointer, f"{begin}: it is judged under {namesake.rule} now, which asks for something else")
    changes = _less(namesake, asked)
    if missing := [name for name in targets if name not in namesake.targets]:
        changes.append(("targets", f"it is not asked for any more {at(missing)}"))
    field = next((field for field, _ in changes if field), "")
    values = (namesake.limit_mm, asked.limit_mm) if field == "limit_mm" else (None, None)
    message = f"{begin}: {'; '.join(words for _, words in changes)}"
    return Remark(pointer_of(case.design, namesake, field), message, *values)


def _lost_targets(case: Case, base: GatedDesign) -> list[Remark]:
    """Targets that went, and targets that are somewhere else: the error there is not the one that was limited."""
    now = {target.name: target for target in case.targets}
    remarks = []
    if gone := [target.name for target in base.targets if target.name not in now]:
        remarks.append(Remark("/targets", f"the design had more targets in the baseline: it has no error {at(gone)}"))
    moved = []
    for target in base.targets:
        then, here = target.position_mm, now[target.name].position_mm if target.name in now else None
        if then is not None and here is not None and dist(then, here) > SAME_PLACE_MM:
            moved.append((target.name, dist(then, here)))
    if moved:
        farthest = max(distance for _, distance in moved)
        index = [target.name for target in case.targets].index(moved[0][0])
        message = f"not where the baseline had it, by up to {farthest:.4g} mm, {at(name for name, _ in moved)}"
        remarks.append(Remark(target_pointer(case, index), f"{message}: limits are kept somewhere else"))
    return remarks


def _requirements(case: Case) -> str:
    return "/requirements" if case.design.document.requirements else ""


# --- what there was to compare with ---------------------------------------------------------------


def not_compared(case: Case) -> list[Remark]:
    """not-compared"""
    base = case.baseline
    if not case.compared:
        return []
    if base is None:
        message = "the baseline has no design of this file, content or name: nothing was compared"
        return [Remark("", message, note=True)]
    before = {target.name for target in base.targets}
    remarks = []
    for index, score in enumerate(case.score.targets):
        if score.name not in before:
            message = f"target {score.name}: the baseline has no number for it, nothing was compared"
            remarks.append(Remark(target_pointer(case, index), message, note=True))
    if all(target.position_mm is None for target in base.targets):
        message = (
            "the baseline does not say what the design was asked for: limits are compared as far as its numbers know "
            "them, quantiles, confidence and places of targets are not; write a new baseline"
        )
        remarks.append(Remark("", message))
    if base.file != case.file:
        message = f"compared with {base.file} of the baseline, whose file is gone and which is most alike"
        remarks.append(Remark("", message, note=True))
    return remarks
