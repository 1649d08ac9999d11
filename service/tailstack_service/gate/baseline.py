"""An earlier gate to compare with: which design it was, and whether that is worse now or asked for less."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from math import dist, inf, isfinite
from typing import Any

from pydantic import BaseModel, ValidationError

from tailstack.design import Design
from tailstack.design.reading import show
from tailstack.design.refusals import place, refuse
from tailstack.errors import Problem, escape
from tailstack.measures import MEASURE
from tailstack.version import __version__

from .case import Case, describe_requirement, name_targets, point_at_requirement
from .design_rules import point_at_target
from .file_names import normalise
from .reading import LIMITS, GateError, GateInput, Given, Remark, add_prefix, hash_content, read_data
from .records import GatedDesign, GateRecord, GateRequirement, GateSection, GateTarget

# A name is what its author writes; these are what is made.  Requirements are left out: they are what is compared.
SECTIONS = ("views", "interfaces", "targets", "transforms", "execution")
FEWEST_ALIKE = 3  # sections that have to be the same where the fiducials are not
# Two machines differ in the last digits of a first-order score; a rise of less is no rise.
ROUNDING_PERCENT = 1e-6
ROUNDING = 1e-9  # of limits, relative
SAME_PLACE_MM = 1e-6
MOST_FILES = 3  # named in one message
_WEIGHTS = ("off", "note", "warning", "error")


@dataclass(frozen=True, slots=True, eq=False)
class GateBaseline(GateInput):
    """An earlier gate, to compare with."""

    record: GateRecord

    def find_earlier(self, names: Sequence[str], design: Design, present: Collection[str]) -> GatedDesign | None:
        """The design of the baseline that this one was.

        names: of its file, first as findings call it.

        That of its file; or, of those whose file is not ``present`` any more, the only one of its content, of the most
        sections in common (the fiducials, or three), of its name, or with a target of the same name.  Where one file
        went and one came, it is that one, whatever was changed: a limit is not got rid of by a rename.
        """
        designs = [entry for entry in self.record.designs if entry.targets]
        gone = [entry for entry in designs if entry.file not in present]
        came = set(present) - {entry.file for entry in self.record.designs}
        known = {normalise(name) for name in names}
        named = {target.name for target in design.document.targets}
        searches: tuple[Callable[[], list[GatedDesign]], ...] = (
            lambda: [entry for entry in designs if entry.file == names[0]],
            lambda: [entry for entry in gone if normalise(entry.file) in known],
            lambda: [entry for entry in gone if entry.sha256 == design.sha256],
            lambda: _choose_most_alike(gone, set(hash_sections(design))),
            lambda: [entry for entry in gone if entry.name == design.name],
            lambda: [entry for entry in gone if named & {target.name for target in entry.targets}],
            lambda: gone if len(came) == 1 else [],  # taken only if one went
        )
        return next((entries[0] for search in searches if len(entries := search()) == 1), None)


def read_baseline(given: Given, *, prefix: str = "") -> GateBaseline:
    """The record of an earlier gate from a path, text or data.  Raises GateError."""
    from ..documents import from_plain

    hint = "write one with: tailstack gate DESIGN... --format baseline=baseline.json"
    source = read_data(given, "tailstack/gate/1", prefix, hint)
    try:
        record: GateRecord = from_plain(GateRecord, source.data)
    except ValidationError as error:
        raise GateError(add_prefix(refuse(error, source, LIMITS, BaseModel).problems, prefix)) from None
    problem = _find_bad_number(source.data, record.seed)
    if problem is None and not any(design.targets for design in record.designs):
        detail = f"nothing was judged by this gate (verdict: {record.verdict}): it has no numbers to compare with"
        problem = Problem("/designs", "no-numbers", detail, hint)
    if problem is not None:
        raise GateError(add_prefix((place(problem, source),), prefix))
    return GateBaseline(source, source.file or "baseline", hash_content(source.data), record)


def _find_bad_number(data: Any, seed: int) -> Problem | None:
    """A number that no record holds, if there is one: a baseline is written by tailstack, but read from anywhere."""
    if not 0 <= seed < 2**63:
        return Problem("/seed", "out-of-range", f"a seed is a whole number from 0 to {2**63 - 1}; got {show(seed)}")
    open_ends: list[tuple[str, Any]] = [("", data)]
    while open_ends:
        pointer, item = open_ends.pop()
        if isinstance(item, float) and not isfinite(item):
            return Problem(pointer, "not-finite", "the number is too large")
        if pointer.endswith("p95_mm") and item is not None and (not isinstance(item, int | float) or item < 0):
            return Problem(pointer, "wrong-type", f"expected a number of 0 or more; got {show(item)}")
        children = item.items() if isinstance(item, dict) else enumerate(item) if isinstance(item, list) else ()
        open_ends += [(f"{pointer}/{escape(step)}", child) for step, child in children]
    return None


# --- which design it was ------------------------------------------------------------------------------


def hash_sections(design: Design) -> tuple[GateSection, ...]:
    """The sections that a design states, by the hash of their content, defaults filled in; of the fiducials where they
    are, whatever they are called and whatever file they stand in."""
    document = design.document
    data = document.model_dump(mode="json", by_alias=True, include=set(SECTIONS) & document.model_fields_set)
    content = {"fiducials": [list(position) for position in design.fiducials.positions_mm], **data}
    return tuple(GateSection(name, hash_content(content[name])) for name in ("fiducials", *SECTIONS) if name in content)


def _choose_most_alike(designs: Sequence[GatedDesign], sections: set[GateSection]) -> list[GatedDesign]:
    counts = {}
    for entry in designs:
        alike = sections & set(entry.sections)
        if len(alike) >= FEWEST_ALIKE or any(section.name == "fiducials" for section in alike):
            counts[entry.file] = len(alike)
    most = max(counts.values(), default=0)
    return [entry for entry in designs if counts.get(entry.file) == most]


# --- is it worse --------------------------------------------------------------------------------------


def find_regressions(case: Case) -> Iterator[Remark]:
    """Rule regression: P95 at a target rose by more than is allowed."""
    before = {target.name: target for target in case.baseline.targets} if case.baseline else {}
    allowed = case.max_regression_percent
    for index, target in enumerate(case.score.targets):
        if case.baseline is None or target.name not in before:
            continue
        head, then, basis = _choose_basis(case, index, before[target.name], case.baseline)
        percent = 100 * (head / then - 1) if then > 0 else (0.0 if head == 0 else inf)
        if percent > allowed + ROUNDING_PERCENT:
            rise = f", by {percent:.3g} %" if then > 0 else ""
            message = f"target {target.name}: P95 ({basis}) rose from {then:.4g} to {head:.4g} mm{rise}"
            value = percent if then > 0 else None
            message += f"; {allowed:g} % are allowed"
            yield Remark(point_at_target(case, index), message, value, allowed, target.name)


def _choose_basis(case: Case, index: int, was: GateTarget, base: GatedDesign) -> tuple[float, float, str]:
    """P95 now and then.

    First order has no chance in it, so a difference is the design's.  Where it is not to be trusted Monte Carlo is
    compared, if both drew as many trials of the same seed.
    """
    now, trust = case.verification, case.score.validity.expected_error_percent
    trusted = trust is not None and trust <= case.rules.first_order_gap.max_percent
    if not trusted and now is not None and was.p95_mm is not None and base.trials == now.trials:
        return now.targets[index].p95_mm, was.p95_mm, "Monte Carlo"
    return case.score.targets[index].p95_mm, was.first_order_p95_mm, "estimate"


# --- what was asked for -------------------------------------------------------------------------------


def find_relaxed_limits(case: Case) -> Iterator[Remark]:
    """Rule limit-relaxed: what the baseline held the design to, and nothing holds it to now."""
    base = case.baseline
    if base is None:
        return
    names = {target.name for target in case.targets}
    yield from _find_lost_targets(case, base)
    for demand in base.requirements:
        if demand.severity == "off":
            continue
        left = [name for name in demand.targets if name in names and not _is_met(case, demand, name)]
        if left:
            yield _describe_relaxed(case, demand, left)


def _kind_of(rule: str) -> str:
    return "quantile" if rule in ("p95", "exceedance") else rule  # an exceedance is a quantile against a limit


def _is_met(case: Case, demand: GateRequirement, target: str) -> bool:
    """Whether some requirement, whatever it is called, asks for as much at the target."""
    return any(
        target in entry.targets and _kind_of(entry.rule) == _kind_of(demand.rule) and not _list_less(entry, demand)
        for entry in case.requirements
    )


def _list_less(entry: GateRequirement, demand: GateRequirement) -> list[tuple[str, str]]:
    """In what a requirement asks for less: field of the document and words."""
    less: list[tuple[str, str]] = []
    if demand.error != entry.error:
        less.append(("error", f"it is about the {entry.error} error, and was about the {demand.error} error"))
    if demand.statistic != entry.statistic:
        less.append(("statistic", f"it limits the {entry.statistic}, and limited the {demand.statistic}"))
    if entry.limit > demand.limit * (1 + ROUNDING):
        field = MEASURE[entry.error].limit_field
        less.append((field, f"limit raised from {demand.limit:g} to {entry.limit:g} {entry.unit}"))
    if entry.quantile < demand.quantile - ROUNDING:
        less.append(("quantile", f"quantile lowered from {demand.quantile:g} to {entry.quantile:g}"))
    if None not in (demand.min_yield, entry.min_yield) and entry.risk != demand.risk:
        less.append(("risk", f"it is read {entry.risk}, and was read {demand.risk}"))
    if (entry.min_yield or 0.0) < (demand.min_yield or 0.0) - ROUNDING:
        less.append(("min_yield", f"yield lowered from {demand.min_yield:g} to {entry.min_yield or 0.0:g}"))
    if entry.confidence < demand.confidence - ROUNDING:
        less.append(("confidence", f"confidence lowered from {demand.confidence:g} to {entry.confidence:g}"))
    if _WEIGHTS.index(entry.severity) < _WEIGHTS.index(demand.severity):
        less.append(("", f"rule {entry.rule} counts as {entry.severity}, and counted as {demand.severity}"))
    return less


def _describe_relaxed(case: Case, demand: GateRequirement, targets: Sequence[str]) -> Remark:
    """What became of a requirement that is not asked for as it was."""
    begin = f"{demand.name} ({describe_requirement(demand)} in the baseline)"
    same = (demand.name, demand.origin)
    namesake = next((entry for entry in case.requirements if (entry.name, entry.origin) == same), None)
    pointer = point_at_requirement(case.design, namesake)
    if namesake is None:
        return Remark(pointer, f"{begin}: the requirement went {name_targets(targets)}")
    if _kind_of(namesake.rule) != _kind_of(demand.rule):
        return Remark(pointer, f"{begin}: it is judged under {namesake.rule} now, which asks for something else")
    changes = _list_less(namesake, demand)
    if missing := [name for name in targets if name not in namesake.targets]:
        changes.append(("targets", f"it is not asked for any more {name_targets(missing)}"))
    field = next((field for field, _ in changes if field), "")
    values = (namesake.limit, demand.limit) if field.startswith("limit_") else (None, None)
    message = f"{begin}: {'; '.join(words for _, words in changes)}"
    return Remark(point_at_requirement(case.design, namesake, field), message, *values)


def _find_lost_targets(case: Case, base: GatedDesign) -> Iterator[Remark]:
    """Targets that went, and targets that are somewhere else: the error there is not the one that was limited."""
    now = {target.name: target for target in case.targets}
    if gone := [target.name for target in base.targets if target.name not in now]:
        yield Remark("/targets", f"the design had more targets in the baseline: it has no error {name_targets(gone)}")
    moved = [
        (target.name, distance)
        for target in base.targets
        if target.name in now and (distance := dist(target.position_mm, now[target.name].position_mm)) > SAME_PLACE_MM
    ]
    if moved:
        names, distances = zip(*moved, strict=True)
        index = [target.name for target in case.targets].index(names[0])
        message = f"not where the baseline had it, by up to {max(distances):.4g} mm, {name_targets(names)}"
        yield Remark(point_at_target(case, index), f"{message}: limits are kept somewhere else")


# --- what there was to compare with -------------------------------------------------------------------


def find_not_compared(case: Case) -> Iterator[Remark]:
    """Rule not-compared, of one design: what the baseline has nothing to compare with."""
    base = case.baseline
    if not case.compared:
        return
    if base is None:
        message = "the baseline has no design of this file, content or name: nothing was compared"
        yield Remark("", message, note=True)
        return
    before = {target.name for target in base.targets}
    for index, score in enumerate(case.score.targets):
        if score.name not in before:
            message = f"target {score.name}: the baseline has no number for it, nothing was compared"
            yield Remark(point_at_target(case, index), message, note=True)
    if normalise(base.file) not in {normalise(name) for name in (case.file, *case.names, *case.earlier)}:
        message = f"compared with {base.file} of the baseline, whose file is gone and which is most alike"
        yield Remark("", message, note=True)


def find_missing_designs(
    baseline: GateBaseline, cases: Sequence[Case], present: Collection[str]
) -> Iterator[tuple[str, Remark]]:
    """Rule not-compared, of the baseline: designs whose files went and that no design here was; nobody judges them."""
    there = {*present, *(case.baseline.file for case in cases if case.baseline is not None)}
    every = baseline.record.designs
    left = [index for index, entry in enumerate(every) if entry.targets and entry.file not in there]
    if left:
        names = ", ".join(every[index].file for index in left[:MOST_FILES])
        more = f" and {len(left) - MOST_FILES} more" if len(left) > MOST_FILES else ""
        new = [case.file for case in cases if case.baseline is None]
        ending = f"changed beyond recognition and called {new[0]}" if new else "left out"
        message = f"{names}{more}: judged in the baseline and not here: removed, renamed to what the patterns do not "
        yield "not-compared", Remark(f"/designs/{left[0]}", f"{message}match, or {ending}")


def find_other_version(baseline: GateBaseline) -> Iterator[tuple[str, Remark]]:
    """Rule model-version: the baseline was computed by another version of tailstack."""
    version = baseline.record.provenance.tailstack_version
    if version != __version__:
        message = f"the baseline was computed by tailstack {version}, this is {__version__}: numbers may differ for "
        yield "model-version", Remark("/provenance/tailstack_version", f"{message}that reason; write a new baseline")
