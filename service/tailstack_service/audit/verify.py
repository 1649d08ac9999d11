"""Is a report what it says?  Its hash, its pages and its numbers are made again and compared."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import isclose
from typing import Any

from tailstack import __version__
from tailstack.design import Design, compile_design, load_design
from tailstack.design.refusals import escape
from tailstack.errors import LimitError, Problem
from tailstack.verification import SHOTS, UNITS

from ..documents import plain
from ..operations.operation import HeldDesign, Progress, Repetition
from ..operations.reading import ReadResult
from ..operations.registry import OPERATIONS
from ..problems import RequestError
from .findings import DIFFERENT, SAME, Audit, AuditCheck
from .holding import read_report
from .pages import pages_question

MOST = 8  # differing numbers that are listed
OTHERWISE = "or --fast: without Monte Carlo and optimiser"


@dataclass(frozen=True, slots=True)
class Effort:
    """The most that an audit computes: trials of all checks together, starts of the optimiser."""

    trials: int = 100_000_000
    starts: int = 256


def audit(
    content: bytes, file: str, given: Design | None = None, *, fast: bool = False, most: Effort | None = None,
    progress: Progress | None = None,
) -> Audit:  # fmt: skip
    """Everything that can be compared of a report or result.

    given: the design of a record that does not hold its own.  fast: Monte Carlo and optimiser are not run again.
    most: what computing again may take; default ``Effort()``.  Raises RequestError for what cannot be read or lacks
    its design, LimitError for what asks for more than that, TailstackError where computing fails.
    """
    report_file = read_report(content, file)
    result = report_file.result
    operation = OPERATIONS[result.kind]
    holds = operation.hold(result.record)
    designs = tuple(load_design(each.data, allow_files=False) for each in holds)
    if not fast:
        _check_effort(result, (*(() if given is None else (given,)), *designs), most or Effort())
    questions = [AuditCheck("record", SAME, f"SHA-256 {hashlib.sha256(result.body).hexdigest()}")]
    questions += [_design_question(*pair) for pair in zip(holds, designs, strict=True) if pair[0].stated_sha256]
    # Of a comparison the second design's; a record of several designs states the version itself
    origin = result.record.second if result.kind == "comparison" else result.record
    provenance = getattr(origin, "provenance", origin)
    written_by = provenance.tailstack_version
    questions.append(pages_question(report_file, written_by, file))
    if designs and given is not None:
        detail = "the record holds its design: none is to be given"
        raise RequestError(Problem("", "unused-option", detail, "leave the second file out"))
    if not designs and operation.designs and given is not None:
        stated, designs = getattr(provenance, "design_sha256", given.sha256), (given,)
        if stated != given.sha256:
            detail = f"this is another design: its SHA-256 is {given.sha256}, the record is of {stated}"
            hint = "give the design that the record was computed from"
            raise RequestError(Problem("", "another-design", detail, hint))
    questions += _number_questions(result, designs, fast, progress, written_by)
    title = getattr(result.record, "title", None) or getattr(provenance, "design_name", result.kind)
    return Audit(file, str(title), result.record.schema, written_by, tuple(questions))


def _design_question(each: HeldDesign, design: Design) -> AuditCheck:
    if design.sha256 == each.stated_sha256:
        return AuditCheck(each.name, SAME, f"SHA-256 {design.sha256}")
    detail = f"its SHA-256 is {design.sha256}; the record says {each.stated_sha256}"
    return AuditCheck(each.name, DIFFERENT, detail)


# --- the numbers, computed again ------------------------------------------------------------------------


def _number_questions(
    result: ReadResult, designs: tuple[Design, ...], fast: bool, progress: Progress | None, written_by: str
) -> list[AuditCheck]:
    """Raises RequestError where the design is missing that the numbers are computed from."""
    operation = OPERATIONS[result.kind]
    can_repeat = operation.can_repeat(result.record)
    if fast and not (can_repeat and designs):
        return [AuditCheck("numbers", "trusted", "not computed again: the record does not hold its design")]
    if not can_repeat:
        detail = f"the numbers of a {result.kind} are computed again by tailstack {operation.verb}, from what it was of"
        raise RequestError(Problem("", "not-recomputed", detail, "add --fast: hash and pages only"))
    if not designs:
        detail = f"a {result.kind} does not hold its design, so its numbers cannot be computed again"
        hint = "tailstack report --verify FILE DESIGN, or --fast: hash and pages only"
        raise RequestError(Problem("", "missing-design", detail, hint))
    again = operation.compute_again(Repetition(result.record, designs, fast, progress))
    questions = [_compare(result.record, plain(again.record), written_by)]
    if again.trusted:
        questions.append(AuditCheck("taken on trust", "trusted", f"{again.trusted} (--fast)"))
    return questions


def _compare(recorded: Any, computed: Any, written_by: str) -> AuditCheck:
    every = list(values(plain(recorded), computed))
    pairs = [pair for pair in every if not _is_version(pair)]
    apart = [pair for pair in pairs if not pair.close]
    exact = sum(pair.same for pair in pairs)
    if not apart:
        digits = "to the last digit" if exact == len(pairs) else f"{exact:,} to the last digit, all to {CLOSE:g}"
        return AuditCheck("numbers", SAME, f"{len(pairs):,} values computed again: the same, {digits}")
    other = ""
    if written_by != __version__:
        other = f" (by tailstack {__version__}, which is not the one that wrote them)"
    elif any(_is_version(pair) and not pair.same and pair.recorded is not None for pair in every):
        other = f" (by other sources of tailstack {__version__} than those that wrote them)"
    listed = [pair.words for pair in apart[:MOST]]
    more = [f"... and {len(apart) - MOST} more"] if len(apart) > MOST else []
    words = f"{len(apart):,} of {len(pairs):,} values are not what is computed again{other}"
    return AuditCheck("numbers", DIFFERENT, words, (*listed, *more))


def _is_version(pair: Value) -> bool:
    """The code that computes is another one by nature."""
    return pair.pointer.endswith(("/provenance/tailstack_version", "/provenance/sources_sha256"))


def _check_effort(result: ReadResult, designs: tuple[Design, ...], most: Effort) -> None:
    """How much a record asks to be computed again is a stranger's word: it is held to a limit before anything runs.

    designs: all that the record is of; of each, the units that its requirements take are counted too.  Raises
    LimitError for a record that asks for more, RequestError for one that cannot be.
    """
    demand = OPERATIONS[result.kind].demand(result.record)
    units = UNITS * SHOTS * demand.checks * sum(_per_unit(design) for design in designs)
    if demand.trials and demand.trials + units > most.trials:
        also = f", {units:,} of them for requirements on each unit" if units else ""
        detail = (
            f"up to {demand.trials + units:,} trials would be drawn to verify this{also}; at most {most.trials:,} are "
            "drawn unless you say otherwise"
        )
        hint = f"add --max-trials {demand.trials + units}, {OTHERWISE}"
        raise LimitError(Problem(demand.trials_at, "too-many", detail, hint))
    if demand.starts > most.starts:
        detail = (
            f"the optimiser would be started {demand.starts:,} times; at most {most.starts:,} unless you say otherwise"
        )
        raise LimitError(Problem(demand.starts_at, "too-many", detail, f"add --starts {demand.starts}, {OTHERWISE}"))


def _per_unit(design: Design) -> int:
    """Targets that requirements on each unit, or each mounting, are judged at, once for each requirement."""
    return sum(len(entry.targets) for entry in compile_design(design).requirements if entry.risk != "pooled")


# --- two records, value by value ------------------------------------------------------------------------

CLOSE = 1e-9  # relative: what another processor may leave of the last digits of first order
NONE = 1e-12  # of numbers about zero
ABSENT = "(absent)"


@dataclass(frozen=True, slots=True)
class Value:
    """A value of a record, and of the record that was computed anew."""

    pointer: str
    recorded: Any
    computed: Any

    @property
    def same(self) -> bool:
        """To the last digit."""
        return type(self.recorded) is type(self.computed) and self.recorded == self.computed

    @property
    def close(self) -> bool:
        """The same up to the last digits of a number."""
        pair = (self.recorded, self.computed)
        if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in pair):
            return self.same
        return isclose(*pair, rel_tol=CLOSE, abs_tol=NONE)

    @property
    def words(self) -> str:
        return f"{self.pointer}: recorded {_short(self.recorded)}, computed {_short(self.computed)}"


def _short(value: Any) -> str:
    text = repr(value) if not isinstance(value, str) or value != ABSENT else value
    return text if len(text) <= 90 else f"{text[:89]}…"


def values(recorded: Any, computed: Any, at: str = "") -> Iterator[Value]:
    """Every value of either, from plain data."""
    if isinstance(recorded, dict) and isinstance(computed, dict):
        for key in dict.fromkeys([*computed, *recorded]):
            yield from values(recorded.get(key, ABSENT), computed.get(key, ABSENT), f"{at}/{escape(key)}")
    elif isinstance(recorded, list | tuple) and isinstance(computed, list | tuple):
        if len(recorded) != len(computed):
            yield Value(at, f"{len(recorded)} entries", f"{len(computed)} entries")
        for index, pair in enumerate(zip(recorded, computed, strict=False)):
            yield from values(*pair, f"{at}/{index}")
    else:
        yield Value(at, recorded, computed)
