"""Refusals as documents: RFC 9457 problems, the same over HTTP and on the command line.

The catalogue says once what each class of refusal means and what cures it; ``/v1/problems/{slug}`` serves it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tailstack.errors import (
    DesignError,
    IllPosedError,
    InfeasibleError,
    KernelError,
    LimitError,
    MissingExtraError,
    NotConvergedError,
    OutOfRangeError,
    Problem,
    SourcesChangedError,
    TailstackError,
)

from .environment import FolderError, variable


class StoreError(TailstackError):
    """The database cannot be used as it is: missing, of another version, damaged, not reachable with this URL."""

    slug = "store-error"
    title = "The database cannot be used"
    exit_code = 3


class DamagedStore(StoreError):
    """Something that was stored is no longer what was stored."""

    title = "What was stored is damaged"


class BadDatabaseUrl(StoreError):
    """What was given as the address of a database is none."""

    exit_code = 2


class StoreUnavailable(TailstackError):
    """The database is restarting, locked or out of reach; nothing is wrong with the request, ask again.

    What was being written is either recorded or it is not.  Every function of the store may be called again after this.
    """

    slug = "store-unavailable"
    title = "The database does not answer at the moment"
    exit_code = 3


class IdempotencyConflict(TailstackError):
    """The same Idempotency-Key came with another request."""

    slug = "idempotency-conflict"
    title = "This Idempotency-Key belongs to another request"
    exit_code = 2


class QueueFull(TailstackError):
    """A tenant has as many unfinished jobs as it may have."""

    slug = "queue-full"
    title = "Too many unfinished jobs"
    exit_code = 3


class UnitLost(TailstackError):
    """A unit took too many computing processes with it, or never came to an end."""

    slug = "unit-lost"
    title = "A part of the job could not be computed"
    exit_code = 3


class PdfUnavailable(TailstackError):
    """The libraries that write PDF are not installed here."""

    slug = "pdf-unavailable"
    title = "PDF cannot be written here"
    exit_code = 3


class RequestError(TailstackError):
    """The request around the design is wrong: an option, a setting, a flag."""

    slug = "invalid-request"
    title = "The request is not valid"
    exit_code = 2


class SettingsError(RequestError):
    """What an operator set cannot be, in the environment or by a flag."""

    title = "The settings are not valid"


class MalformedError(TailstackError):
    """The body cannot be read as the format it claims to be."""

    slug = "malformed-document"
    title = "The document cannot be read"
    exit_code = 2


class RefusedAt(TailstackError):
    """A refusal whose pointers lead into all that was sent, with the slug, title and exit code of the error it places.

    It can be sent from one process to another, and is not placed a second time.
    """

    def __init__(self, problems: Sequence[Problem], slug: str, title: str, exit_code: int) -> None:
        super().__init__(tuple(problems))
        self.slug, self.title, self.exit_code = slug, title, exit_code

    @classmethod
    def place(cls, error: TailstackError, at: str = "") -> RefusedAt:
        """``at``: pointer to what the error is about; its own pointers start there."""
        if isinstance(error, cls):
            return error
        problems = [
            replace(each, pointer=at + each.pointer, fix=tuple(edit._replace(path=at + edit.path) for edit in each.fix))
            for each in error.problems
        ]
        return cls(problems, error.slug, error.title, error.exit_code)


class TransportError(TailstackError):
    """A refusal by HTTP itself, before any document is looked at."""

    def __init__(self, slug: str, problem: Problem, headers: dict[str, str] | None = None) -> None:
        super().__init__(problem)
        self.slug = slug
        self.title = CATALOGUE[slug].title
        self.headers = headers or {}


@dataclass(frozen=True, slots=True)
class ProblemType:
    """One class of refusal: what it means and what to do about it."""

    slug: str
    """Last part of the problem's type."""
    title: str
    """What it is, the same for every occurrence."""
    status: int
    """HTTP status that it comes with."""
    meaning: str
    """What it means."""
    cure: str
    """What to do about it."""


def _of(error: type[TailstackError], status: int, meaning: str, cure: str) -> ProblemType:
    return ProblemType(error.slug, error.title, status, meaning, cure)


CATALOGUE: dict[str, ProblemType] = {
    entry.slug: entry
    for entry in (
        _of(
            DesignError,
            422,
            "The document was read, but it breaks a rule of design documents: a type, a unit, a name, a range.",
            "Mend the field that each error points at; GET /v1/schemas/design is the rule book.",
        ),
        _of(
            IllPosedError,
            422,
            "The document is well formed, but its geometry leaves something undetermined: coplanar or too few "
            "fiducials, a fiducial outside a view, locators that leave a motion free.",
            "The detail names the direction that is not determined and what would determine it.",
        ),
        _of(
            OutOfRangeError,
            422,
            "A method was asked for outside the range in which its result means anything.",
            "Use the method that the hint names, usually the Monte Carlo check.",
        ),
        _of(
            NotConvergedError,
            422,
            "A numerical method stopped before its own test of convergence passed, so no number is returned.",
            "Follow the hint: more trials, more starts, another seed, or less extreme tolerances.",
        ),
        _of(
            InfeasibleError,
            422,
            "No design within the freedom that `optimise` gives meets its requirement.",
            "Widen the box or the bounds, loosen the limit, or tighten what the optimiser may not touch.",
        ),
        _of(
            LimitError,
            422,
            "The request is larger than a stated limit (413 when it is the body itself).",
            "Ask for less, or start the service with a higher limit; the hint names the setting.",
        ),
        _of(
            RequestError,
            422,
            "An option beside the design is unknown, of the wrong type or out of range.",
            "Mend the field that each error points at; /openapi.json lists the options of every operation.",
        ),
        _of(
            MalformedError,
            400,
            "The body is not JSON (or YAML), not UTF-8, empty, or holds the same field twice.",
            "Check the body with `python -m json.tool`, and that it is sent whole.",
        ),
        ProblemType(
            "invalid-policy",
            "The policy, waivers or baseline cannot be used",
            422,
            "What a gate judges by breaks a rule of its document: a field, a limit, a date, a rule that is not there.",
            "Mend the field that each error points at; GET /v1/schemas/policy and /v1/schemas/waivers have the rules.",
        ),
        ProblemType(
            "unsupported-media-type",
            "The content type is not accepted here",
            415,
            "The body is of a type that this operation does not read.",
            "Send Content-Type: application/json (or application/yaml where the operation takes it), not compressed.",
        ),
        ProblemType(
            "not-found",
            "There is nothing at this address",
            404,
            "No operation or document has this path.",
            "GET /openapi.json lists every path.",
        ),
        ProblemType(
            "unknown-design",
            "The design is not known here",
            404,
            "A request named a design by its SHA-256, and none with that hash is kept for whoever asks: it was never "
            "sent whole, too many were sent since (TAILSTACK_MAX_KEPT_DESIGNS), or too long ago (TAILSTACK_KEEP_DAYS).",
            "Send the design whole, in the field design; its hash can be used from then on.",
        ),
        ProblemType(
            "method-not-allowed",
            "This address does not answer to this method",
            405,
            "The path exists, but not for this HTTP method.",
            "The Allow header lists the methods that it answers to.",
        ),
        ProblemType(
            "body-timeout",
            "The body did not arrive in time",
            408,
            "The connection stayed silent, or sent too slowly, before the body was complete.",
            "Send the request again.",
        ),
        ProblemType(
            "busy",
            "All places to compute or to wait are taken",
            503,
            "The service bounds how much it computes at once, how much may wait, and how many event streams are open.",
            "Send the request again after the time in the Retry-After header.",
        ),
        ProblemType(
            "warming-up",
            "The service has just been started",
            503,
            "The numerical kernels are being compiled: a minute at the first start on a machine, later seconds.",
            "Send the request again after the time in Retry-After; GET /health/ready answers 200 once they are there.",
        ),
        ProblemType(
            "stopping",
            "The service is stopping",
            503,
            "The service was told to stop while this request was being computed.",
            "Send the request again once the service is back.",
        ),
        ProblemType(
            "unauthenticated",
            "The service does not know who asks",
            401,
            "No credential arrived, or it is unknown, revoked, expired or not meant for this service.",
            "Send Authorization: Bearer <API key or JSON Web Token>; tailstack keys create makes API keys.",
        ),
        ProblemType(
            "forbidden",
            "This is not allowed to whoever asks",
            403,
            "The credential lacks the scope that the operation needs, or a browser sent the request from another site.",
            "Ask an operator for a key with the scope that the detail names.",
        ),
        ProblemType(
            "wrong-host",
            "The request is addressed to another host",
            421,
            "Without authentication the service answers only requests whose Host header names this machine, so that no "
            "web page can reach it under a name of its own.",
            "Use 127.0.0.1 or localhost, or add the name to TAILSTACK_ALLOWED_HOSTS.",
        ),
        ProblemType(
            "cpu-budget",
            "The CPU time of this hour is used up",
            429,
            "The operator gave each tenant a number of CPU seconds an hour, and the jobs of the last hour took them.",
            "Send the request again after the time in Retry-After.",
        ),
        ProblemType(
            "too-many-streams",
            "Too many event streams of one tenant are open",
            429,
            "The operator gave each tenant a share of the places for event streams and waits, and all of it is taken.",
            "Close a stream, or ask for the job's record instead; a place may be free after the time in Retry-After.",
        ),
        ProblemType(
            "not-finished",
            "The job has no result yet",
            409,
            "The job is queued or running.",
            "Ask again after the time in Retry-After, or follow /v1/jobs/{id}/events.",
        ),
        ProblemType(
            "finished",
            "The job has already ended",
            409,
            "A job that succeeded or failed cannot be cancelled.",
            "Read its record: GET /v1/jobs/{id}.",
        ),
        ProblemType(
            "cancelled",
            "The job was cancelled",
            409,
            "Somebody cancelled the job before it ended; it has no result.",
            "Send the request again if the answer is wanted after all.",
        ),
        _of(
            FolderError,
            501,
            "The process has no home and no folder for temporary files that it could write into.",
            "An operator has to act: set the variable that the hint names.",
        ),
        ProblemType(
            "pdf-unavailable",
            "PDF cannot be written here",
            501,
            "The libraries that write PDF, or a font to write with, are not installed where the service runs.",
            "Install what the detail names, or take format=html and print it.",
        ),
        _of(
            MissingExtraError,
            501,
            "tailstack is installed in parts, and the one that this needs is not installed where the service runs.",
            "An operator has to act: the hint is the command that installs it; the extra all has every part.",
        ),
        _of(
            QueueFull,
            429,
            "The service bounds how many jobs of one tenant may wait or run.",
            "Wait for jobs to finish, cancel some, or send the request again after the time in Retry-After.",
        ),
        _of(
            IdempotencyConflict,
            422,
            "A key stands for one request; the same key arrived with another body or for another operation.",
            "Use a new key for a new request, or send the very same body again to get its job.",
        ),
        _of(
            UnitLost,
            500,
            "The process that computed one part of the job ended again and again without an answer, or no attempt was "
            "finished. The job was given up so that it does not hold up others.",
            "Report it with the job id; a smaller request may pass (memory is the usual reason).",
        ),
        _of(
            StoreUnavailable,
            503,
            "Jobs and results are kept in a database that could not be reached. Nothing that was accepted is lost.",
            "Send the request again after the time in Retry-After; the Idempotency-Key makes that safe.",
        ),
        _of(
            StoreError,
            503,
            "The database is there, but not as this version of the service needs it: no job can be accepted or read. "
            "Or something that it holds is no longer what was stored: that result is not shown, and its job fails.",
            "An operator has to act: tailstack db check says what is wrong, tailstack db migrate brings it up to date. "
            "A damaged result is computed again when its request is sent again.",
        ),
        _of(
            KernelError,
            503,
            "numba's settings (NUMBA_CPU_NAME, NUMBA_CPU_FEATURES, NUMBA_DISABLE_JIT) rule out the compiled kernels on "
            "the processor that was to run them.",
            "An operator has to act: unset what the detail names where the service or its workers are started.",
        ),
        _of(
            SourcesChangedError,
            503,
            "The files of tailstack were replaced while a process of it was running, and it does not compute with some "
            "of the old ones and some of the new.",
            "An operator has to act: start the service and its workers again.",
        ),
        ProblemType(
            "internal-error",
            "Something went wrong inside the service",
            500,
            "A defect. The service log holds the cause under the request's id.",
            "Report it with the request id and the design.",
        ),
    )
}


@dataclass(frozen=True, slots=True)
class ProblemEntry:
    """One thing that is wrong.  ``file``, ``line`` and ``column`` are null when the document came without a file."""

    pointer: str
    """JSON pointer (RFC 6901) into the document that was sent; empty for the whole, /NAME for a query parameter."""
    code: str
    """What kind of mistake it is, kebab-case."""
    detail: str
    """What is wrong, with what arrived."""
    hint: str
    """What to do; may be empty."""
    file: str | None
    """File that the document came from; null when it came without one."""
    line: int | None
    """Line in that file or text, from 1; null when it came without one."""
    column: int | None
    """Column in the line, from 1; null when it came without one."""


@dataclass(frozen=True, slots=True)
class ProblemDocument:
    """RFC 9457 problem details."""

    type: str
    """Path of the page that explains this class of problem."""
    title: str
    """What it is, the same for every occurrence."""
    status: int
    """HTTP status; on the command line, that of the same refusal over HTTP."""
    detail: str
    """The first of the errors, in a sentence."""
    instance: str
    """Path that was asked for, or the command."""
    request_id: str | None
    """Id of the request, in the service's log too; null on the command line."""
    errors: tuple[ProblemEntry, ...]
    """Everything that is wrong, each with its place."""


def problem_document(
    error: TailstackError, *, instance: str, request_id: str | None = None, status: int | None = None
) -> ProblemDocument:
    """The document of a refusal."""
    kind = CATALOGUE.get(error.slug)
    entries = tuple(ProblemEntry(p.pointer, p.code, p.detail, p.hint, p.file, p.line, p.column) for p in error.problems)
    first = entries[0].detail if entries else error.title
    more = f" (and {len(entries) - 1} more, see errors)" if len(entries) > 1 else ""
    return ProblemDocument(
        type=f"/v1/problems/{error.slug}",
        title=error.title,
        status=status if status is not None else (kind.status if kind else 422),
        detail=first + more,
        instance=instance,
        request_id=request_id,
        errors=entries,
    )


def memory_error() -> LimitError:
    """What is said of a request that would take more memory than a computing process may."""
    detail = "what was asked for needs more memory than a computing process may take"
    hint = f"ask for less, or start the service with a higher {variable('max_process_bytes')}"
    return LimitError(Problem("", "too-much-memory", detail, hint))
