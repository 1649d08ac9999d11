"""What an operation is: its options, how long it takes, and one record.

From that follow the verb, the route, the schema, the job, the report and its audit.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

from pydantic import BaseModel, Field, model_validator
from pydantic_core import PydanticCustomError

from tailstack.cures import ask_label
from tailstack.errors import LimitError, Problem
from tailstack.fields import Record
from tailstack.montecarlo import FINEST_PRECISION, MAX_TRIALS, MOST_TRIALS

from ..console.command_line import PASS, Answer
from ..console.flags import Flag, list_options, read_flags
from ..environment import variable
from ..problems import RequestError
from ..processes.task import Estimated, RawRequest

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..rendering.document import Document
    from ..settings import Settings
    from .request import Request

# --- options beside a design: known fields only, nothing converted, each with its meaning and bounds --

Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]


def _hide_maximum(schema: dict[str, Any]) -> None:
    """Of what no service ever computed, the document of the released one did not say that it is refused."""
    del schema["maximum"]


Trials = Annotated[int, Field(ge=1, le=MOST_TRIALS, json_schema_extra=_hide_maximum)]
Starts = Annotated[int, Field(ge=1, le=10_000, json_schema_extra=_hide_maximum)]
MostTrials = Annotated[
    int,
    Field(
        ge=100,
        le=MOST_TRIALS,
        json_schema_extra=_hide_maximum,
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

    trials: Trials | None = None
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


# --- what an operator allows --------------------------------------------------------------------------

TRIAL_BYTES = 0.85  # some, that a job records of a trial at a target: the largest norms of its parts
READ_BYTES = 2.5  # of memory for each where they are put together: as they come, unpacked, joined (0.5, measured)
WARM_BYTES = 350e6  # of memory that a warm process has, as its limit counts


def within_trials(request: Request, settings: Settings) -> None:
    """Refuse a check that may draw more than the operator allows, or than its parts can be put together of.

    The limit never ends a check: where the precision is looked at is part of the answer, and an operator's number would
    move it.  Raises LimitError.
    """
    trials, max_trials = request.options.trials, request.options.max_trials
    within(trials, "max_trials", settings, "/trials")
    if trials is None and max_trials > settings.max_trials:
        most = settings.max_trials
        detail = f"at most {most} trials are drawn for a check; up to {max_trials} may be drawn for this one"
        hint = f"send max_trials: {most}, or trials; or start the service with a higher {variable('max_trials')}"
        raise LimitError(Problem("/max_trials", "too-many", detail, hint))
    drawn, at = (max_trials, "/max_trials") if trials is None else (trials, "/trials")
    targets = max(size_of(design).targets for design in request.designs)
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


# --- how long a computation takes ---------------------------------------------------------------------

# Reading is known from the bytes that came, the rest from what was read.  Nothing that a caller writes makes it
# shorter: a body is as long as it is, and sizes are those of the designs as they were read, by the process that read
# them.  The figures were measured on one core of a virtual machine (AMD EPYC, AVX-512).  They need not be right, only
# tell what takes milliseconds from what takes seconds.
LONG = 60.0  # seconds, of what nobody can say before it is done
# s for reading and checking a byte.  Honest JSON takes 0.3e-6, YAML 1.2e-6; what is wrong everywhere, ten times that
BYTE_SECONDS = {"json": 0.5e-6, "yaml": 1.5e-6, "text/csv": 5e-6, "text/plain": 5e-6, "application/x-ndjson": 5e-6}
TEXT_BYTE_SECONDS = 5e-6  # of JSON that holds documents as texts, which are read as YAML


class Size(NamedTuple):
    """What a design holds."""

    fiducials: int
    views: int
    targets: int  # with regions expanded
    judged: int = 0  # targets of all requirements together: of each the losses of fiducials are looked for; 0: of none
    missed: int = 0  # fiducials that are missed with a probability: the law of every loss of them is put together, too

    def losses(self, among: int) -> int:
        """Ways to lose none, one or two of so many of the fiducials, as far as they are looked at."""
        from tailstack.losses import PAIRS_UP_TO

        return 1 + among + (among * (among - 1) // 2 if self.fiducials <= PAIRS_UP_TO else 0)


def reading_seconds(sent: RawRequest) -> float:
    """For reading and checking what was sent.  Of what is packed nobody knows before it is unpacked."""
    rate = BYTE_SECONDS.get(sent.form)
    return LONG if rate is None else rate * len(sent.body)


def text_reading_seconds(sent: RawRequest) -> float:
    """The same for bodies that hold documents as texts."""
    return max(reading_seconds(sent), TEXT_BYTE_SECONDS * len(sent.body))


def size_of(design: Design) -> Size:
    """What a design holds."""
    from tailstack.design.compile import loss_probabilities
    from tailstack.design.consistency import expand_target

    document = design.document
    samples = {target.name: len(expand_target(target)) for target in document.targets}
    targets = sum(samples.values())
    judged = sum(
        targets if item.targets == "all" else sum(samples.get(name, 1) for name in item.targets)
        for item in document.requirements
    )
    count = len(design.fiducials.labels)
    missed = sum(map(bool, loss_probabilities(document.fiducials, count)))
    return Size(count, len(document.views), targets, judged or targets, missed)


GAIN_SECONDS = 1e-7  # of one fiducial in one view, with one loss, at one target
LAW_SECONDS = 7e-4  # of one exact law with a loss
MISSED_SECONDS = 4e-3  # of one loss at one target: its own validity, and its law in the mixtures of both errors
ASKED = 3  # such laws for each requirement and target, until the worst loss is known: one to ten


def score_seconds(sizes: Iterable[Size], *, second_order: bool = False, losses: bool = True) -> float:
    """Of one core, for scores of designs of these sizes."""
    seconds = 0.0
    for size in sizes:
        fiducials, views, targets, judged, missed = size
        seconds += 0.004 + 0.0005 * fiducials + 0.0035 * targets * (1 + fiducials * views / 200)
        if losses and judged:
            seconds += GAIN_SECONDS * targets * size.losses(fiducials) * views * fiducials
            seconds += LAW_SECONDS * judged * ASKED
        if missed:
            seconds += MISSED_SECONDS * targets * size.losses(missed)
        if second_order:
            seconds += 2e-5 * (targets * fiducials * views) ** 2
    return seconds


# --- a call -------------------------------------------------------------------------------------------

Progress = Callable[[float, float], None]  # done, of how much


@dataclass(frozen=True, slots=True)
class Call:
    """One call of an operation: everything is read and checked."""

    designs: tuple[Design, ...]
    options: Any  # of the operation's class of options
    threads: int | None = None  # None: as many as there are cores; the answer does not depend on it
    progress: Progress | None = None
    typed: bool = False  # on the command line: an option that is a file is its name

    @property
    def design(self) -> Design:
        """The only design."""
        (design,) = self.designs
        return design

    def arguments(self) -> dict[str, Any]:
        """The options by their names; what is absent is left to a function's own defaults."""
        return dict(self.options.model_dump(exclude_none=True))


# --- over HTTP: answered at once, or a job -------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class JobRequest:
    """A request that was checked and can become a job."""

    kind: str  # name of the operation
    content: bytes  # canonical JSON: designs and options
    design_name: str
    bare_design: bool = False  # the body was the design itself, so pointers of refusals start inside it


@dataclass(frozen=True, slots=True)
class Pieces:
    """What could be a job, answered at once: its units one after the other, as they are computed.

    Each is computed from what was sent, so that a table never passes through the process that answers.
    """

    form: str  # in which it is answered, if nothing else is asked for
    seconds: float  # expected, of all units
    unit_seconds: float  # and of one
    specs: tuple[bytes, ...]  # of the units


@dataclass(frozen=True, slots=True)
class Reception:
    """What a request came to: its answer, or a job."""

    answer: bytes | None = None
    job: JobRequest | None = None
    pieces: Pieces | None = None  # instead of the job, if nobody asks for one
    terms: Mapping[str, Any] | None = None  # by which it was judged, for the audit log
    designs: tuple[tuple[str, bytes], ...] = ()  # SHA-256 and JSON of those that later requests may name


# --- computed again from its record: report --verify ----------------------------------------------------


@dataclass(frozen=True, slots=True)
class Repetition:
    """What is to be computed again: a record, and the designs that it holds or that are given beside it."""

    record: Any
    designs: tuple[Design, ...]
    fast: bool  # without Monte Carlo and optimiser
    progress: Progress | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Again:
    """A record computed anew, and what of it was taken as it is recorded."""

    record: Any
    trusted: str = ""  # in words; empty: nothing


@dataclass(frozen=True, slots=True)
class HeldDesign:
    """A design inside a record, and the hash that the record states of it."""

    name: str
    data: dict[str, Any]
    stated_sha256: str | None


@dataclass(frozen=True, slots=True)
class Demand:
    """How much a record asks to be computed again, and the fields that say so."""

    trials: int = 0
    trials_at: str = ""
    starts: int = 0
    starts_at: str = ""
    checks: int = 1  # how often the units of per-unit requirements are drawn
    trusted: str = ""  # what is not drawn again without Monte Carlo, in words; then the record is believed

    @classmethod
    def of_cases(cls, trials: int, cases: int, trusted: str) -> Demand:
        """So many trials of each of so many cases; 0: nothing is drawn."""
        return cls(trials=trials * cases, trials_at="/trials", checks=0, trusted=trusted if trials else "")


# --- the operation itself -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LateImport:
    """A function or a class of a module that is not loaded before it is used; calling this calls the function."""

    module: str  # with leading dots: as imports in the modules of operations have it
    name: str

    def load(self) -> Any:
        """The function or the class itself."""
        return getattr(import_module(self.module, __package__), self.name)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self.load()(*arguments, **named)


def run_function(
    function: LateImport, *passed: str, arguments: Callable[[Call], dict[str, Any]] = Call.arguments
) -> Callable[[Call], Any]:
    """What an operation does that is one function of its designs and options; ``passed``: what of the call it takes,
    too."""
    return lambda call: function(*call.designs, **arguments(call), **{name: getattr(call, name) for name in passed})


@dataclass(frozen=True, slots=True)
class ExampleBody:
    """An example of a body that is a file: text."""

    name: str  # in the OpenAPI document
    summary: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """What is sent to an operation otherwise than as designs and options, and how it is received."""

    receive: Callable[[RawRequest, Settings], Reception | Estimated]
    query: Callable[[], Mapping[str, Any]] = dict  # JSON Schemas, by name, of what stands beside a body that is no JSON
    request: type[BaseModel] | None = None  # the model of a body in JSON; None: designs and options
    media: tuple[str, ...] = ()  # what it can be besides JSON and YAML
    samples: Mapping[str, ExampleBody] = field(default_factory=dict)  # of those
    hint: str = "options go into the body, beside the designs"  # about a query beside a JSON body
    at_once: str = ""  # when it is answered at once, although it can become a job
    kernels: bool = True  # it needs compiled kernels
    reading_seconds: Callable[[RawRequest], float] = reading_seconds  # expected, until it is read


@dataclass(frozen=True, slots=True)
class FigureFile:
    """A chart of a record that the command draws into a file, with ``--figure``."""

    words: str  # what it shows
    draw: LateImport  # of the record, and of the target where one is shown: SVG
    check: Callable[[Call], None] = lambda call: None  # before the work; raises RequestError for what cannot be drawn


@dataclass(frozen=True, slots=True)
class Csv:
    """A record as lines of CSV, with ``--csv``."""

    line: str  # what each is of
    write: LateImport  # of the record


@dataclass(frozen=True, slots=True)
class Command:
    """A verb that needs more than flags and a record."""

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], Answer]


def receive_alone(call: Call) -> Any:
    """What is asked for by a body of its own (``Body.receive``) has no call."""
    raise NotImplementedError("this operation is received with its own body, not as designs and options")


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """One operation, written in one place.

    Whoever imports it gets by without the solver: ``run`` imports what it needs when it is called, ``document`` is a
    :class:`LateImport`, so that the command line and an API process know every operation and load none.
    """

    # What it is
    name: str  # of its record: tailstack/NAME/1; and the kind of its jobs
    verb: str  # what a person types after tailstack; "study views" is one of a family
    path: str  # of POST
    summary: str  # a phrase: beside the verb, and title of the route
    description: str  # sentences for whoever reads the interface
    title: str  # one line about the record, in the list of schemas
    options: type[Options]
    record: Callable[[], type]  # gives the frozen dataclass that is published
    example: Mapping[str, Any] = field(default_factory=dict)  # options beside the example design
    example_title: str = "Eight beads, two seats"

    # How it computes
    run: Callable[[Call], Any] = receive_alone  # gives the record; raises TailstackError
    designs: Mapping[str, str] = field(default_factory=lambda: {"design": "The design document."})  # field, meaning
    immediate: bool = False  # answered at once over HTTP: it takes milliseconds
    cut: bool = False  # its job is cut into units, by plan() and compute() of units/NAME.py; or is one unit, ``run``

    # How it is received over HTTP
    check: Callable[[Request, Settings], None] = lambda *_: None  # raises RefusedAt, RequestError, LimitError
    body: Body | None = None  # None: the designs, and the options beside them or in the query

    # What becomes of its record
    document: Callable[..., Document] | None = None  # its report; the SHA-256 of the record stands in it
    exit_code: Callable[[Any], int] = lambda record: PASS  # of what judges nothing
    hold: Callable[[Any], tuple[HeldDesign, ...]] = lambda record: ()
    demand: Callable[[Any], Demand] = lambda record: Demand()
    repeat: Callable[[Repetition], Again] | None = None  # None: by the options, where the record states all of them

    # How it is typed
    command: Command | None = None  # None: DESIGN, a flag for each option, and what follows
    threads: bool = False  # --threads
    figure: FigureFile | None = None  # --figure
    csv: Csv | None = None  # --csv
    target: bool = False  # --target: of which target the document and the figure are

    @property
    def yaml(self) -> bool:
        """Whether a body can be YAML: the design, with options in the query; without designs what a query describes."""
        if not self.designs:
            return self.body is not None and bool(self.body.query())
        typed = all(each.in_query for each in list_options(self.options) if each.field.is_required())
        return typed and tuple(self.designs) == ("design",)

    @property
    def answers(self) -> tuple[str, ...]:
        """Media types of an answer besides JSON, where Accept asks for them: a table comes back in any of its own."""
        return () if self.body is None or self.immediate else self.body.media

    def read(self, sent: RawRequest, settings: Settings) -> Request:
        """Designs and options of what was sent.  Raises what :func:`request.read_request` raises."""
        from .request import read_request

        return read_request(sent, self.options, tuple(self.designs), settings, yaml=self.yaml)

    def write(self, record: Any, *choice: Any) -> str:
        """The record as text for people, on the page that ``rendering.text.current()`` gives.

        choice: what of it, where its document can be of a part.
        """
        from ..rendering.document import document_text

        assert self.document is not None, self.name
        return document_text(self.document(record, "", *choice))

    def can_repeat(self, record: Any) -> bool:
        """Whether a record can be computed again from itself and its designs."""
        return self.repeat is not None or bool(self.designs and self.options.of_record(record))

    def compute_again(self, again: Repetition) -> Again:
        """The record anew; what is not drawn again is taken as it is recorded."""
        if self.repeat is not None:
            return self.repeat(again)
        if again.fast and (trusted := self.demand(again.record).trusted):
            return Again(again.record, trusted)
        options = self.options.of_record(again.record)
        return Again(self.run(Call(again.designs, options, progress=again.progress)))
