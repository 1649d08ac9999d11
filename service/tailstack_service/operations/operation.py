"""What an operation is.  From one record follow the verb, the route, the schema, the job, the report and its audit."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from ..console.command_line import PASS, Answer
from ..console.flags import list_options
from ..processes.task import Estimated, RawRequest
from .effort import reading_seconds
from .options import Options

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..rendering.blocks import Document
    from ..settings import Settings
    from .request import Request

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


def check_nothing(request: Request, settings: Settings) -> None:
    """The options and a design that can be read are all that is asked for."""


def receive_alone(call: Call) -> Any:
    """What is asked for by a body of its own (``Body.receive``) has no call."""
    raise NotImplementedError("this operation is received with its own body, not as designs and options")


def pass_always(record: Any) -> int:
    """The exit code of what judges nothing."""
    return PASS


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
    check: Callable[[Request, Settings], None] = check_nothing  # raises RefusedAt, RequestError, LimitError
    body: Body | None = None  # None: the designs, and the options beside them or in the query

    # What becomes of its record
    document: Callable[..., Document] | None = None  # its report; the SHA-256 of the record stands in it
    exit_code: Callable[[Any], int] = pass_always
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
