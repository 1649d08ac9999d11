"""An audit from end to end: read strictly, hash, render again, compute again."""

from __future__ import annotations

import hashlib
from typing import Any

from tailstack import __version__
from tailstack.design import Design, load_design
from tailstack.montecarlo.simulate import Progress

from ...documents import plain
from ..reading import ReadResult
from .comparing import CLOSE, Value, values
from .effort import Effort, check_effort
from .findings import DIFFERENT, SAME, Audit, Question
from .holding import held
from .pages import pages_question
from .recomputing import again

MOST = 8  # differing numbers that are told


def audit(
    content: bytes, file: str, given: Design | None = None, *, fast: bool = False, most: Effort | None = None,
    progress: Progress | None = None,
) -> Audit:  # fmt: skip
    """Everything that can be compared of a report or result.

    given: the design of a record that does not hold its own.  fast: Monte Carlo and optimiser are not run again.
    most: what computing again may take; default ``Effort()``.  Raises RequestError for what cannot be read or lacks
    its design, LimitError for what asks for more than that, TailstackError where computing fails.
    """
    found = held(content, file)
    result = found.result
    if not fast:
        check_effort(result.kind, result.record, _held_designs(result, given), most or Effort())
    questions = [_hash_question(result)]
    questions += [_design_question(*entry) for entry in _designs(result)]
    written_by = _provenance(result).tailstack_version
    questions.append(pages_question(found, written_by, file))
    anew = again(result.kind, result.record, given, fast=fast, progress=progress)
    if anew is None:
        questions.append(Question("numbers", "trusted", "not computed again: the record does not hold its design"))
    else:
        questions.append(_numbers_question(result.record, anew.record, written_by))
        if anew.trusted:
            questions.append(Question("taken on trust", "trusted", f"{anew.trusted} (--fast)"))
    title = getattr(result.record, "title", None) or getattr(_provenance(result), "design_name", result.kind)
    return Audit(file, str(title), result.record.schema, written_by, tuple(questions))


def _held_designs(result: ReadResult, given: Design | None) -> tuple[Design, ...]:
    """The designs that numbers are computed of, so far as they are there."""
    record = result.record
    data = [record.first.design, record.second.design] if result.kind == "comparison" else []
    data += [record.design] if result.kind == "report" else []
    return tuple(load_design(each, allow_files=False) for each in data) + (() if given is None else (given,))


def _provenance(result: ReadResult) -> Any:
    return result.record.second.provenance if result.kind == "comparison" else result.record.provenance


def _hash_question(result: ReadResult) -> Question:
    return Question("record", SAME, f"SHA-256 {hashlib.sha256(result.body).hexdigest()}")


def _designs(result: ReadResult) -> list[tuple[str, dict[str, object], str | None]]:
    """Each design that the record holds, and the hash that it states of it."""
    record = result.record
    if result.kind == "report":
        return [("design", record.design, record.provenance.design_sha256)]
    if result.kind == "comparison":
        pair = (("first design", record.first), ("second design", record.second))
        return [(name, report.design, report.provenance.design_sha256) for name, report in pair]
    if result.kind == "optimisation":
        return [("new design", record.design, record.provenance.design_sha256)]
    return []


def _design_question(name: str, data: dict[str, object], stated: str | None) -> Question:
    sha256 = load_design(data, allow_files=False).sha256
    if sha256 == stated:
        return Question(name, SAME, f"SHA-256 {sha256}")
    return Question(name, DIFFERENT, f"its SHA-256 is {sha256}; the record says {stated}")


def _numbers_question(recorded: Any, computed: Any, written_by: str) -> Question:
    pairs = list(values(plain(recorded), computed))
    apart = [pair for pair in pairs if not pair.close and not _version(pair)]
    exact = sum(pair.same for pair in pairs)
    if not apart:
        digits = "to the last digit" if exact == len(pairs) else f"{exact:,} to the last digit, all to {CLOSE:g}"
        return Question("numbers", SAME, f"{len(pairs):,} values computed again: the same, {digits}")
    other = "" if written_by == __version__ else f" (by tailstack {__version__}, which is not the one that wrote them)"
    told = [pair.words for pair in apart[:MOST]]
    more = [f"... and {len(apart) - MOST} more"] if len(apart) > MOST else []
    words = f"{len(apart):,} of {len(pairs):,} values are not what is computed again{other}"
    return Question("numbers", DIFFERENT, words, (*told, *more))


def _version(pair: Value) -> bool:
    """The version that computes is another one by nature."""
    return pair.pointer.endswith("/provenance/tailstack_version")
