"""Refusals as documents: RFC 9457 problems, the same over HTTP and on the command line.

``problems.json`` says once what each class of refusal means and what cures it; ``/v1/problems/{slug}`` serves it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tailstack.errors import LimitError, Problem, TailstackError

from .environment import variable


class StoreError(TailstackError, slug="store-error", title="The database cannot be used"):
    """The database cannot be used as it is: missing, of another version, damaged, not reachable with this URL."""


class DamagedStore(StoreError, title="What was stored is damaged"):
    """Something that was stored is no longer what was stored."""


class BadDatabaseUrl(StoreError, exit_code=2):
    """What was given as the address of a database is none."""


class StoreUnavailable(TailstackError, slug="store-unavailable", title="The database does not answer at the moment"):
    """The database is restarting, locked or out of reach; nothing is wrong with the request, ask again.

    What was being written is either recorded or it is not.  Every function of the store may be called again after this.
    """


class IdempotencyConflict(
    TailstackError, slug="idempotency-conflict", title="This Idempotency-Key belongs to another request", exit_code=2
):
    """The same Idempotency-Key came with another request."""


class QueueFull(TailstackError, slug="queue-full", title="Too many unfinished jobs"):
    """A tenant has as many unfinished jobs as it may have."""


class UnitLost(TailstackError, slug="unit-lost", title="A part of the job could not be computed"):
    """A unit took too many computing processes with it, or never came to an end."""


class PdfUnavailable(TailstackError, slug="pdf-unavailable", title="PDF cannot be written here"):
    """The libraries that write PDF are not installed here."""


class OutputError(TailstackError, slug="cannot-write", title="An output cannot be written"):
    """A file, a stream or the standard output does not take what was to be written."""


class RequestError(TailstackError, slug="invalid-request", title="The request is not valid", exit_code=2):
    """The request around the design is wrong: an option, a setting, a flag."""


class SettingsError(RequestError, title="The settings are not valid"):
    """What an operator set cannot be, in the environment or by a flag."""


class MalformedError(TailstackError, slug="malformed-document", title="The document cannot be read", exit_code=2):
    """The body cannot be read as the format it claims to be."""


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
    """A refusal by HTTP itself, before any document is looked at; ``code``: where it is not the slug."""

    def __init__(
        self, slug: str, detail: str, hint: str = "", headers: dict[str, str] | None = None, *, code: str = "",
        pointer: str = "",
    ) -> None:  # fmt: skip
        super().__init__(Problem(pointer, code or slug, detail, hint))
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


_TABLE: list[dict[str, Any]] = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
CATALOGUE = {
    entry["slug"]: ProblemType(**{"title": TailstackError.titles.get(entry["slug"]), **entry}) for entry in _TABLE
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
