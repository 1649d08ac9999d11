"""What a computing process does: a unit of a job, or a call of the API, from what was sent to what is answered.

Each function stands alone and takes and gives plain values: it is called in another process, which may be killed at any
moment.  Nothing here knows of requests, connections or databases.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tailstack.design import load_design
from tailstack.errors import MissingExtraError, TailstackError
from tailstack.extras import name_missing_extra

from ..documents import to_json
from ..problems import RefusedAt, memory_error, problem_document
from ..processes.task import ADVANCE, Estimated, Outcome, RawRequest, Task, UnitResult
from .batch import read_sent
from .content import canonical
from .example import EXAMPLE_DESIGN
from .operation import Call, JobRequest, Operation, Reception, size_of
from .registry import OPERATIONS
from .request import DesignReferenceUnresolved, Request
from .units.parts import compute_whole, plan_whole

if TYPE_CHECKING:
    from ..settings import Settings
    from ..tables import Format


# --- a unit of a job --------------------------------------------------------------------------------------


def plan(kind: str, request: dict[str, Any], results: tuple[UnitResult, ...]) -> Outcome:
    """More units, or the record, by what is recorded so far.

    A pure function: it is asked again after every round, and after a kill, and says the same each time.  Raises
    TailstackError for a request that is refused, ``RefusedAt`` where pointers are not of ``/design`` or the options.
    """
    if not OPERATIONS[kind].cut:
        return plan_whole(results)
    outcome: Outcome = _units(kind).plan(request, results)
    return outcome


def compute(kind: str, request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """The result of a unit that ``plan`` asked for; a pure function, which raises what ``plan`` raises."""
    if not OPERATIONS[kind].cut:
        return compute_whole(OPERATIONS[kind], request)
    result: bytes = _units(kind).compute(request, spec)
    return result


def _units(kind: str) -> Any:
    """The module that cuts an operation into units."""
    return import_module(f"{__package__}.units.{kind}")


def perform(task: Task) -> Outcome:
    """Compute a unit, or look at what a job has recorded and say what comes next.

    A refusal of the request is an outcome.  Anything else that is raised is a defect, and goes to the caller.
    """
    begun = time.process_time()
    try:
        with name_missing_extra():
            request = json.loads(task.request)
            if task.spec == ADVANCE:
                outcome = plan(task.kind, request, task.results)
            else:
                outcome = Outcome(result=compute(task.kind, request, json.loads(task.spec)))
    except TailstackError as error:
        at = "" if error.slug == "invalid-request" else "/design"  # "": of options, or of a table
        outcome = _refusal(RefusedAt.place(error, at))
    except MemoryError:
        outcome = _refusal(memory_error())
    return replace(outcome, cpu_seconds=time.process_time() - begun)


def _refusal(error: TailstackError) -> Outcome:
    return Outcome(problem=to_json(problem_document(error, instance="")))


# --- a call of the API ------------------------------------------------------------------------------------


def perform_call(call: Callable[[], Any]) -> Any:
    """What the call returns, or why it cannot: RefusedAt or DesignReferenceUnresolved, as a value.

    Any other exception is a defect, and the process tells of it.
    """
    try:
        with name_missing_extra():
            result = call()
        if isinstance(result, Estimated):
            return Estimated(result.seconds, partial(perform_call, result.compute))
        return result
    except TailstackError as error:
        return RefusedAt.place(error)
    except DesignReferenceUnresolved as unresolved:
        return unresolved
    except MemoryError:
        return RefusedAt.place(memory_error())


def receive(name: str, sent: RawRequest, settings: Settings) -> Reception | Estimated:
    """What a request to an operation comes to when it was read; then its answer, or a job.

    Raises RefusedAt, RequestError, LimitError, MalformedError, DesignReferenceUnresolved.
    """
    operation = OPERATIONS[name]
    if operation.body is not None:
        return operation.body.receive(sent, settings)
    request = operation.read(sent, settings)
    return Estimated(
        request.options.seconds(map(size_of, request.designs)), partial(_complete, operation, request, settings)
    )


def _complete(operation: Operation, request: Request, settings: Settings) -> Reception:
    if operation.immediate:
        try:
            answer = to_json(operation.run(Call(request.designs, request.options)))
        except TailstackError as error:
            raise request.place(error) from None
        return Reception(answer=answer, designs=() if request.patched else request.nameable)
    operation.check(request, settings)
    options = request.options.keep(*request.designs)
    titles = " against ".join(design.name for design in reversed(request.designs)) or operation.summary
    content = canonical({**request.data, **options})
    return Reception(job=JobRequest(operation.name, content, titles, request.bare_design), designs=request.nameable)


def compute_piece(sent: RawRequest, settings: Settings, spec: bytes, form: Format, *, first: bool) -> bytes:
    """Some rows of a table, as a piece of its answer in some format; ``first``: with what comes before all of them."""
    from .units.batch import encode

    request = read_sent(sent, settings).content
    return encode(request, compute("batch", request, json.loads(spec)), form, first=first)


def compute_unit(sent: RawRequest, settings: Settings, spec: bytes) -> bytes:
    """Some rows of a table, as a unit of a job."""
    return compute("batch", read_sent(sent, settings).content, json.loads(spec))


def join_units(sent: RawRequest, settings: Settings, results: tuple[UnitResult, ...]) -> bytes:
    """The record of a table, from all its units."""
    answer = plan("batch", read_sent(sent, settings).content, results).answer
    assert answer is not None
    return answer


# --- what is loaded and compiled before anybody waits ---------------------------------------------------


def check_once() -> None:
    """The smallest Monte Carlo check there is, as a job would do it: what it loads and compiles is there for others."""
    options = {"trials": 1_000, "precision": None, "seed": 0, "method": "plain", "max_trials": 1_000}
    request = canonical({"design": EXAMPLE_DESIGN, **options})
    units: tuple[UnitResult, ...] = ()
    while more := perform(Task("verification", request, ADVANCE, units)).more:
        results = [(spec, perform(Task("verification", request, spec)).result or b"") for spec in more]
        units += tuple(UnitResult(len(units) + k, *pair) for k, pair in enumerate(results))


def warm_up() -> None:
    """Load or compile every kernel that a request can need: no request waits for it."""
    from tailstack.batch import score_batch
    from tailstack.kernels.calls import calls_for
    from tailstack.scoring import score

    for call in calls_for(("score", "batch")):
        call.compile()
    design = load_design(EXAMPLE_DESIGN)
    to_json(score(design, second_order=True))
    score_batch(design, {"/views/0/fiducial_noise_px": [0.5]})
    with suppress(MissingExtraError):
        from tailstack.optimisation import allocate, influence

        influence(design)
        allocate(design)
