"""What a worker has in its hands: claims and their computations, shared by the threads of the worker."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from dataclasses import dataclass

from ..store.claims import Claim
from ..work.task import Outcome


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A claim and its computation."""

    claim: Claim
    future: Future[Outcome]


def key_of(claim: Claim) -> str:
    """Unique among all claims there ever were."""
    return f"{claim.job_id}-{claim.index}-{claim.generation}-{claim.token}"


class Hands:
    """The claims held, by key."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: dict[str, Held] = {}

    def __len__(self) -> int:
        return len(self._held)

    def take(self, held: Held) -> None:
        with self._lock:
            self._held[key_of(held.claim)] = held

    def drop(self, claim: Claim) -> Held | None:
        """Let go of a claim; None if it was not held any more."""
        with self._lock:
            return self._held.pop(key_of(claim), None)

    def holds(self, claim: Claim) -> bool:
        return key_of(claim) in self._held

    def all(self) -> list[Held]:
        with self._lock:
            return list(self._held.values())
