"""Refusals of the store."""

from __future__ import annotations

from tailstack.errors import TailstackError


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
