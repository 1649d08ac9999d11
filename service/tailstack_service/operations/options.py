"""Options beside a design: known fields only, nothing converted, each with its meaning and bounds."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from tailstack.cures import ask_label
from tailstack.errors import LimitError, Problem
from tailstack.fields import Record
from tailstack.montecarlo import FINEST_PRECISION, MAX_TRIALS

from ..console.flags import Flag, list_options, read_flags
from ..environment import variable
from ..problems import RequestError
from .effort import Size, score_seconds, size_of

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..settings import Settings

Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
Count = Annotated[int, Field(ge=1)]
MostTrials = Annotated[
    int,
    Field(
        ge=100,
        description="Without trials: stop after so many, whatever the precision by then. It sets when the precision is "
        "looked at, so the intervals.",
    ),
]


class Options(Record):
    """The options of an operation; this one has none."""

    exclusive: ClassVar[tuple[str, ...]] = ()  # of these, one at most
    flags: ClassVar[Mapping[str, Flag]] = {}  # of options that are inherited, in place of what stands beside them

    @classmethod
    def of_flags(cls, arguments: argparse.Namespace) -> Self:
        """As they were typed.  Raises RequestError, which calls an option by its flag."""
        from .request import read_options

        spelling = {option.name: option.spelling for option in list_options(cls)}
        try:
            return read_options(cls, read_flags(cls, arguments), ())
        except RequestError as error:
            flagged = [(problem, spelling.get(problem.pointer.split("/", 2)[1])) for problem in error.problems]
            raise RequestError(
                [replace(p, pointer="", detail=f"{flag}: {p.detail}") if flag else p for p, flag in flagged]
            ) from None

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        """Those that a record was computed with: its fields of the same names, but for ``others``.

        None: it does not state all of them.  Raises RequestError for what no option can be.
        """
        from .request import read_options

        names = cls.model_fields.keys() - others.keys()
        if not all(hasattr(record, name) for name in names):
            return None
        stated = {name: getattr(record, name) for name in names} | others
        return read_options(cls, {k: list(v) if isinstance(v, tuple) else v for k, v in stated.items()}, ())

    def keep(self, *designs: Design) -> dict[str, Any]:
        """As a job keeps them."""
        return dict(self.model_dump())

    def seconds(self, sizes: Iterable[Size]) -> float:
        """Expected for designs of these sizes, until they are answered or a job: a score takes more than a check."""
        return score_seconds(sizes, losses=False)


class CheckOptions(Options):
    """How much a Monte Carlo check samples."""

    exclusive = ("trials", "precision")

    trials: Count | None = None
    """Number of trials. Either this or precision; neither: the solver's own precision."""
    precision: Annotated[float, Field(ge=FINEST_PRECISION, lt=1)] | None = None
    """Half-width of the confidence interval of P95, relative, at which sampling stops."""
    max_trials: MostTrials = MAX_TRIALS
    seed: Seed = 0
    """Seed; one seed is one answer, whatever workers and threads."""

    @model_validator(mode="after")
    def _one_size(self) -> CheckOptions:
        if self.trials is not None and self.precision is not None:
            raise PydanticCustomError("one-of", "give trials or precision; both arrived", {"at": "/precision"})
        return self


TRIAL_BYTES = 0.85  # some, that a job records of a trial at a target: the largest norms of its parts
READ_BYTES = 2.5  # of memory for each where they are put together: as they come, unpacked, joined (0.5, measured)
WARM_BYTES = 350e6  # of memory that a warm process has, as its limit counts


def within_trials(trials: int | None, max_trials: int, settings: Settings, designs: Sequence[Design]) -> None:
    """Refuse a check that may draw more than the operator allows, or than its parts can be put together of.

    The limit never ends a check: where the precision is looked at is part of the answer, and an operator's number would
    move it.  Raises LimitError.
    """
    within(trials, "max_trials", settings, "/trials")
    if trials is None and max_trials > settings.max_trials:
        most = settings.max_trials
        detail = f"at most {most} trials are drawn for a check; up to {max_trials} may be drawn for this one"
        hint = f"send max_trials: {most}, or trials; or start the service with a higher {variable('max_trials')}"
        raise LimitError(Problem("/max_trials", "too-many", detail, hint))
    drawn, at = (max_trials, "/max_trials") if trials is None else (trials, "/trials")
    targets = max(size_of(design).targets for design in designs)
    norm_bytes = TRIAL_BYTES * drawn * targets
    if settings.max_process_bytes and READ_BYTES * norm_bytes > settings.max_process_bytes - WARM_BYTES:
        most = int((settings.max_process_bytes - WARM_BYTES) / (READ_BYTES * TRIAL_BYTES * targets))
        at_each = "a target" if targets == 1 else f"{targets} targets"
        detail = f"{norm_bytes / 1e9:.1f} GB of norms would be kept of {drawn} trials at {at_each}; "
        detail += f"a computing process here can put together those of {max(most, 0)}"
        hint = (
            f"ask for fewer, run tailstack verify, or start the service with a higher {variable('max_process_bytes')}"
        )
        raise LimitError(Problem(at, "too-many", detail, hint))


def refuse_unknown_target(name: str | None, names: Sequence[str], pointer: str = "") -> None:
    """Raises RequestError for a target that the design does not have; None: no target was named."""
    if name is not None and name not in names:
        detail = f"no target is called {name!r}; there are {', '.join(names[:20])}"
        raise RequestError(Problem(pointer, "unknown-target", detail, ask_label(name, names)))


def within(value: int | None, setting: str, settings: Settings, pointer: str) -> None:
    """Refuse a count above its limit.  Raises LimitError that states the limit, what arrived and the setting."""
    limit = getattr(settings, setting)
    if value is not None and value > limit:
        detail = f"at most {limit} {pointer.strip('/').rpartition('/')[2]} are accepted; got {value}"
        hint = f"ask for fewer, or start the service with a higher {variable(setting)}"
        raise LimitError(Problem(pointer, "too-many", detail, hint))
