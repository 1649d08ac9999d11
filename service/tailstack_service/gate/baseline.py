"""An earlier gate to compare with: which design it was, and whether that is worse now or asked for less."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from math import dist, isfinite
from typing import Any

from pydantic import BaseModel, ValidationError

from tailstack.design import Design
from tailstack.design.reading import shown
from tailstack.design.refusals import escape, place, refuse
from tailstack.errors import Problem

from .case import Case, Remark, describe_requirement, name_targets, point_at_requirement
from .design_rules import point_at_target
from .reading import LIMITS, GateError, GateInput, Given, add_prefix, hash_content, read_data
from .records import GatedDesign, GateRecord, GateRequirement, GateSection, GateTarget


@dataclass(frozen=True, slots=True, eq=False)
class GateBaseline(GateInput):
    """An earlier gate, to compare with."""

    record: GateRecord


def read_baseline(given: Given, *, name: str = "baseline", prefix: str = "") -> GateBaseline:
    """The record of an earlier gate from a path, text or data.  Raises GateError."""
    from ..documents import from_plain

    hint = "write one with: tailstack gate DESIGN... --format json=baseline.json"
    source = read_data(given, "tailstack/gate/1", prefix, hint)
    try:
        record: GateRecord = from_plain("gate", source.data)
    except ValidationError as error:
        raise GateError(add_prefix(refuse(error, source, LIMITS, BaseModel).problems, prefix)) from None
    problem = _find_bad_number(source.data, record.seed)
    if problem is None and not any(design.targets for design in record.designs):
        detail = f"nothing was judged by this gate (verdict: {record.verdict}): it has no numbers to compare with"
        problem = Problem("/designs", "no-numbers", detail, hint)
    if problem is not None:
        raise GateError(add_prefix((place(problem, source),), prefix))
    return GateBaseline(source, source.file or name, hash_content(source.data), record)


def _find_bad_number(data: Any, seed: int) -> Problem | None:
    """A number that no record holds, if there is one: a baseline is written by tailstack, but read from anywhere."""
    if not 0 <= seed < 2**63:
        return Problem("/seed", "out-of-range", f"a seed is a whole number from 0 to {2**63 - 1}; got {shown(seed)}")
    open_ends: list[tuple[str, Any]] = [("", data)]
    while open_ends:
        pointer, item = open_ends.pop()
        if isinstance(item, float) and not isfinite(item):
            return Problem(pointer, "not-finite", "the number is too large")
        if pointer.endswith("p95_mm") and item is not None and (not isinstance(item, int | float) or item < 0):
            return Problem(pointer, "wrong-type", f"expected a number of 0 or more; got {shown(item)}")
        children = item.items() if isinstance(item, dict) else enumerate(item) if isinstance(item, list) else ()
        open_ends += [(f"{pointer}/{escape(step)}", child) for step, child in children]
    return None


# --- which design it was ---

# A name is what its author writes; these are what is made.  Requirements are left out: they are what is compared.
SECTIONS = ("views", "interfaces", "targets", "transforms", "execution")
FEWEST_ALIKE = 3  # sections that have to be the same where the fiducials are not


def hash_sections(design: Design) -> tuple[GateSection, ...]:
    """The sections that a design states, by the hash of their content, defaults filled in; of the fiducials where they
    are, whatever they are called and whatever file they stand in."""
    document = design.document
    data = document.model_dump(mode="json", by_alias=True, include=set(SECTIONS) & document.model_fields_set)
    content = {"fiducials": [list(position) for position in design.fiducials.positions_mm], **data}
    return tuple(GateSection(name, hash_content(content[name])) for name in ("fiducials", *SECTIONS) if name in content)


def find_earlier(
    designs: Sequence[GatedDesign],
    file: str,
    name: str,
    sha256: str,
    sections: Collection[GateSection],
    present: Collection[str],
) -> GatedDesign | None:
    """The design of a baseline that this one was: of that file; or, of those whose file is not ``present`` any more,
    the only one of that content, of the most sections in common (fiducials, or three), or of that name."""
    same_file = [entry for entry in designs if entry.file == file and entry.targets]
    gone = [entry for entry in designs if entry.file not in present and entry.targets]
    found: tuple[Callable[[], list[GatedDesign]], ...] = (
        lambda: same_file,
        lambda: [entry for entry in gone if entry.sha256 == sha256],
        lambda: _choose_most_alike(gone, sections),
        lambda: [entry for entry in gone if entry.name == name],
    )
    return next((entries[0] for find in found if len(entries := find()) == 1), None)


def _choose_most_alike(designs: Sequence[GatedDesign], sections: Collection[GateSection]) -> list[GatedDesign]:
    alike = {entry.file: set(sections) & set(entry.sections) for entry in designs}
    near = [
        entry
        for entry in designs
        if len(alike[entry.file]) >= FEWEST_ALIKE or any(one.name == "fiducials" for one in alike[entry.file])
    ]
    most = max((len(alike[entry.file]) for entry in near), default=0)
    return [entry for entry in near if len(alike[entry.file]) == most]


# --- is it worse ---

# Two machines differ in the last digits of a first-order score; a rise of less is no rise.
ROUNDING_PERCENT = 1e-6
ROUNDING = 1e-9  # of limits, relative
SAME_PLACE_MM = 1e-6
_WEIGHTS = ("off", "note", "warning", "error")
_KINDS = {"p95": "quantile", "exceedance": "quantile"}  # an exceedance is a quantile against a limit


def find_regressions(case: Case) -> list[Remark]:
    """regression"""
    base = case.baseline
    if base is None:
        return []
    before = {target.name: target for target in base.targets}
    remarks = []
    for index, score in enumerate(case.score.targets):
        was = before.get(score.name)
        pointer = point_at_target(case, index)
        if was is None:
            continue
        head, then, basis = _choose_basis(case, index, was, base)
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


def _choose_basis(case: Case, index: int, was: GateTarget, base: GatedDesign) -> tuple[float, float, str]:
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


def find_relaxed_limits(case: Case) -> list[Remark]:
    """limit-relaxed: what the baseline held the design to, and nothing holds it to now"""
    base = case.baseline
    if base is None:
        return []
    names = {target.name for target in case.targets}
    remarks = _find_lost_targets(case, base)
    for asked in _list_demands(base):
        left = tuple(name for name in asked.targets if name in names and not _demands_as_much(case, asked, name))
        if left:
            remarks.append(_describe_relaxed(case, asked, left))
    return remarks


@dataclass(frozen=True, slots=True)
class _Demand:
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


def _list_demands(base: GatedDesign) -> list[_Demand]:
    """What was judged then: from the record of requirements, or from the numbers of a record that has none."""
    if base.requirements:
        return [
            _Demand(
                entry.name, entry.origin, _KINDS.get(entry.rule, entry.rule), entry.severity, entry.error,
                entry.quantile, entry.limit_mm, entry.min_yield, entry.confidence, entry.targets,
                describe_requirement(entry),
            )
            for entry in base.requirements
            if entry.severity != "off"
        ]  # fmt: skip
    found: dict[tuple[str, str], _Demand] = {}
    for number in base.numbers:
        key = (number.rule, number.requirement)
        limit, required = (None, number.limit) if number.unit == "fraction" else (number.limit, None)
        words = f"{100 * required:g} % of installed units" if required is not None else f"{number.limit:g} mm"
        earlier = found[key].targets if key in found else ()
        found[key] = _Demand(
            number.requirement, None, _KINDS.get(number.rule, number.rule), None, None, None, limit, required, None,
            (*earlier, number.target), words,
        )  # fmt: skip
    return list(found.values())


def _demands_as_much(case: Case, asked: _Demand, target: str) -> bool:
    """Whether some requirement, whatever it is called, asks for as much at the target."""
    return any(
        target in entry.targets and _KINDS.get(entry.rule, entry.rule) == asked.kind and not _list_less(entry, asked)
        for entry in case.requirements
    )


def _list_less(entry: GateRequirement, asked: _Demand) -> list[tuple[str, str]]:
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


def _describe_relaxed(case: Case, asked: _Demand, targets: tuple[str, ...]) -> Remark:
    """What became of a requirement that is not asked for as it was."""
    begin = f"{asked.name} ({asked.words} in the baseline)"
    namesake = next(
        (entry for entry in case.requirements if entry.name == asked.name and asked.origin in (None, entry.origin)),
        None,
    )
    if namesake is None:
        return Remark(_point_at_requirements(case), f"{begin}: the requirement went {name_targets(targets)}")
    pointer = point_at_requirement(case.design, namesake)
    if _KINDS.get(namesake.rule, namesake.rule) != asked.kind:
        return Remark(pointer, f"{begin}: it is judged under {namesake.rule} now, which asks for something else")
    changes = _list_less(namesake, asked)
    if missing := [name for name in targets if name not in namesake.targets]:
        changes.append(("targets", f"it is not asked for any more {name_targets(missing)}"))
    field = next((field for field, _ in changes if field), "")
    values = (namesake.limit_mm, asked.limit_mm) if field == "limit_mm" else (None, None)
    message = f"{begin}: {'; '.join(words for _, words in changes)}"
    return Remark(point_at_requirement(case.design, namesake, field), message, *values)


def _find_lost_targets(case: Case, base: GatedDesign) -> list[Remark]:
    """Targets that went, and targets that are somewhere else: the error there is not the one that was limited."""
    now = {target.name: target for target in case.targets}
    remarks = []
    if gone := [target.name for target in base.targets if target.name not in now]:
        remarks.append(
            Remark("/targets", f"the design had more targets in the baseline: it has no error {name_targets(gone)}")
        )
    moved = []
    for target in base.targets:
        then, here = target.position_mm, now[target.name].position_mm if target.name in now else None
        if then is not None and here is not None and dist(then, here) > SAME_PLACE_MM:
            moved.append((target.name, dist(then, here)))
    if moved:
        farthest = max(distance for _, distance in moved)
        index = [target.name for target in case.targets].index(moved[0][0])
        message = (
            f"not where the baseline had it, by up to {farthest:.4g} mm, {name_targets(name for name, _ in moved)}"
        )
        remarks.append(Remark(point_at_target(case, index), f"{message}: limits are kept somewhere else"))
    return remarks


def _point_at_requirements(case: Case) -> str:
    return "/requirements" if case.design.document.requirements else ""


# --- what there was to compare with ---------------------------------------------------------------


def find_not_compared(case: Case) -> list[Remark]:
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
            remarks.append(Remark(point_at_target(case, index), message, note=True))
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
