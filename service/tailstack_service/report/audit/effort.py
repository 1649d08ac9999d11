"""How much a record asks to be computed again: a stranger's word, so it is held to a limit before anything runs."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import Any

from tailstack.design import Design, compile_design
from tailstack.errors import LimitError, Problem
from tailstack.verification import MAX_TRIALS, SHOTS, UNITS

from ...problems import RequestError
from ..records import Reproduction

OTHERWISE = "or --fast: without Monte Carlo and optimiser"


@dataclass(frozen=True, slots=True)
class Effort:
    """The most that an audit computes: trials of all checks together, starts of the optimiser."""

    trials: int = 100_000_000
    starts: int = 256


def check_effort(kind: str, record: Any, designs: tuple[Design, ...], most: Effort) -> None:
    """Raises LimitError for a record that asks for more, RequestError for one that cannot be what its axes make.

    designs: all that the record is of; of each, the units that its requirements take are counted too.
    """
    at, trials = _trials(kind, record)
    units = UNITS * SHOTS * sum(_per_unit(design) for design in designs)
    if kind == "sweep":
        units *= _points(record) if record.check == "verification" else 0
    if trials and trials + units > most.trials:
        also = f", {units:,} of them for requirements on each unit" if units else ""
        detail = (
            f"up to {trials + units:,} trials would be drawn to verify this{also}; at most {most.trials:,} are drawn "
            "unless you say otherwise"
        )
        raise LimitError(Problem(at, "too-many", detail, f"add --max-trials {trials + units}, {OTHERWISE}"))
    at, starts = _starts(kind, record)
    if starts > most.starts:
        detail = f"the optimiser would be started {starts:,} times; at most {most.starts:,} unless you say otherwise"
        raise LimitError(Problem(at, "too-many", detail, f"add --starts {starts}, {OTHERWISE}"))


def _trials(kind: str, record: Any) -> tuple[str, int]:
    """Where a record says how many are drawn, and the most that it can come to."""
    if kind == "report":
        return _asked("/reproduction", record.reproduction)
    if kind == "comparison":
        at, trials = _asked("/first/reproduction", record.first.reproduction)
        return at, 2 * trials
    if kind == "verification":
        fixed = record.precision_requested is None or record.method == "radial"
        return ("/trials", record.trials) if fixed else ("/max_trials", record.max_trials or MAX_TRIALS)
    if kind == "sweep":
        points = _points(record)
        if record.check == "verification":
            at = "/max_trials" if record.trials is None else "/trials"
            return at, points * (record.trials or record.max_trials or MAX_TRIALS)
    return "", 0


def _asked(at: str, made: Reproduction) -> tuple[str, int]:
    if "verification" not in made.parts:
        return at, 0
    if made.trials is not None:
        return f"{at}/trials", made.trials
    return f"{at}/max_trials", made.max_trials or MAX_TRIALS


def _points(record: Any) -> int:
    made = prod(len(axis.values) for axis in record.axes)
    if made != len(record.points):
        detail = f"its axes make {made:,} points, the record holds {len(record.points):,}"
        raise RequestError(Problem("/points", "bad-result", detail, "give a file that tailstack sweep wrote"))
    return made


def _starts(kind: str, record: Any) -> tuple[str, int]:
    if kind == "optimisation":
        return "/certificate/starts", record.certificate.starts
    if kind == "report" and "optimisation" in record.reproduction.parts:
        return "/reproduction/starts", record.reproduction.starts or 0
    return "", 0


def _per_unit(design: Design) -> int:
    """Targets that requirements on each unit are judged at, once for each requirement."""
    return sum(len(entry.targets) for entry in compile_design(design).requirements if entry.risk == "per_unit")
