"""The kinds of jobs: how each looks at what is recorded, and how it computes one unit.

Nothing heavy is imported here: a kind names its functions and they are loaded when first used, so that the command
line, the store and an API process can know the kinds without loading a solver.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

from .task import UnitResult


@dataclass(frozen=True, slots=True)
class More:
    """These units are needed, in any order and side by side; then the job is looked at again."""

    specs: tuple[bytes, ...]  # canonical JSON, none of them recorded yet and none twice
    remaining: int = 0  # units expected after these, as far as is known
    note: str = ""  # what they do, in words


@dataclass(frozen=True, slots=True)
class Done:
    """The job's document, JSON as published."""

    answer: bytes


Step = More | Done


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of job.

    ``advance`` is a pure function of the request and of every unit recorded so far: it is asked again after every
    round, and after a kill, and says the same each time.  ``compute`` is a pure function of the request and a spec
    that ``advance`` asked for.  Both raise TailstackError for a request that is refused, or ``Refused`` (in
    ``requests``) where it is not about ``/design``.
    """

    name: str
    answer: str  # name of the published schema of the answer
    home: str  # module of this package that holds ``advance`` and ``compute``

    def advance(self, request: dict[str, Any], results: tuple[UnitResult, ...]) -> Step:
        step: Step = _home(self.home).advance(request, results)
        return step

    def compute(self, request: dict[str, Any], spec: dict[str, Any]) -> bytes:
        result: bytes = _home(self.home).compute(request, spec)
        return result


@cache
def _home(name: str) -> Any:
    return import_module(f"{__package__}.{name}")


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("verification", "verification", "verification"),
        Kind("optimisation", "optimisation", "optimisation"),
        Kind("sweep", "sweep", "sweep"),
        Kind("gate", "gate", "gate"),
        Kind("report", "report", "report"),
        Kind("comparison", "comparison", "comparison"),
    )
}
