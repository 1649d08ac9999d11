"""Everything that can stop an answer, as exceptions whose text is the message a person reads.

A :class:`Problem` points into the user's own document (JSON pointer, and line and column when the
document came from a file).  The service renders the same record as an RFC 9457 problem, the command
line as text; neither adds to what is said here.
"""

from __future__ import annotations

import copyreg
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, NamedTuple


def escape(step: str | int) -> str:
    """One reference token of an RFC 6901 pointer."""
    return str(step).replace("~", "~0").replace("/", "~1")


def write_pointer(steps: Iterable[str | int]) -> str:
    """The RFC 6901 pointer of the place that these steps lead to."""
    return "".join("/" + escape(step) for step in steps)


def read_pointer(pointer: str) -> list[str]:
    """The steps of an RFC 6901 pointer, numbers of elements as texts."""
    return [token.replace("~1", "/").replace("~0", "~") for token in pointer.split("/")[1:]]


class Edit(NamedTuple):
    """One step of a JSON Patch (RFC 6902) of the user's document."""

    op: Literal["add", "remove", "replace"]
    path: str  # RFC 6901 pointer
    value: Any = None  # of what is added or put in place


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, where, and what to do about it."""

    pointer: str  # RFC 6901 pointer into the user's document; "" is the whole document
    code: str  # stable, kebab-case, e.g. "unknown-field"
    detail: str  # which rule, and what arrived
    hint: str = ""  # what to do next
    file: str | None = None
    line: int | None = None  # 1-based
    column: int | None = None  # 1-based
    fix: tuple[Edit, ...] = field(default=(), compare=False)  # carries the hint out; empty: a person has to choose

    def __str__(self) -> str:
        place = self.pointer or "(document)"
        if self.file is not None:
            place = f"{self.file}:{self.line}:{self.column or 1}: {place}" if self.line else f"{self.file}: {place}"
        return f"{place}: {self.detail}" + (f" — {self.hint}" if self.hint else "")


class TailstackError(Exception):
    """An answer was refused; ``problems`` say why.  ``slug`` names the class of refusal in URLs."""

    slug = "error"
    title = "The request could not be answered"
    exit_code = 3
    titles: ClassVar[dict[str, str]] = {}  # by slug, of the first class that has it

    def __init_subclass__(
        cls, *, slug: str | None = None, title: str | None = None, exit_code: int | None = None
    ) -> None:
        """What is not said is that of the class that it extends."""
        for name, stated in (("slug", slug), ("title", title), ("exit_code", exit_code)):
            if stated is not None:
                setattr(cls, name, stated)
        TailstackError.titles.setdefault(cls.slug, cls.title)

    def __init__(self, problems: Problem | tuple[Problem, ...] | list[Problem]) -> None:
        self.problems: tuple[Problem, ...] = (problems,) if isinstance(problems, Problem) else tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> Any:
        """Through pickle and copy as it is, not made anew from its text, whatever the arguments of its class are."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class DesignError(TailstackError, slug="invalid-design", title="The design document is not valid", exit_code=2):
    """The document does not follow the rules of a design (types, units, names, limits)."""


class StepError(DesignError, title="The STEP file cannot be used"):
    """A STEP file contradicts itself, or does not hold what is asked for."""


class IllPosedError(TailstackError, slug="ill-posed-geometry", title="The geometry does not determine the answer"):
    """The document is well formed, but its geometry does not determine the answer."""


class OutOfRangeError(TailstackError, slug="method-out-of-range", title="The method does not hold here"):
    """A method was asked for outside the range in which its result means anything."""


class NotConvergedError(TailstackError, slug="not-converged", title="The computation did not converge"):
    """A numerical method stopped before its own test of convergence passed."""


class InfeasibleError(
    TailstackError, slug="infeasible", title="No design within the given freedom meets the requirement", exit_code=1
):
    """No design in the space that was given meets the requirement."""


class LimitError(TailstackError, slug="limit-exceeded", title="The request is larger than a stated limit", exit_code=2):
    """The request is larger than a stated limit."""


class KernelError(TailstackError, slug="kernels-unusable", title="The compiled kernels cannot run here", exit_code=2):
    """numba's settings do not let the compiled kernels run on this processor."""


class SourcesChangedError(
    TailstackError, slug="sources-changed", title="The installation changed under a running process"
):
    """The package's files were replaced while this process was running."""


class MissingExtraError(
    TailstackError, slug="missing-extra", title="A part of tailstack is not installed", exit_code=2
):
    """A package that an extra of tailstack brings is needed, and not installed."""


class StudyError(TailstackError, slug="invalid-request", title="The request is not valid", exit_code=2):
    """An axis, a target or a number of trials that cannot be."""


def describe_refusal(error: TailstackError) -> str:
    """Why a design could not be computed, in a line."""
    first = error.problems[0]
    more = f" (and {len(error.problems) - 1} more)" if len(error.problems) > 1 else ""
    return f"{first.pointer or '(document)'}: {first.detail}{more}"
