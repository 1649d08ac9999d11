"""Limits and addresses of the service: one frozen record, read once from ``TAILSTACK_*`` variables."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from tailstack.errors import Problem

from .problems import RequestError

PREFIX = "TAILSTACK_"


def _setting(default: Any, meaning: str, low: float, high: float) -> Any:
    return field(default=default, metadata={"meaning": meaning, "low": low, "high": high})


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class Settings:
    """Every bound that a request can meet.  Field ``max_trials`` is the variable ``TAILSTACK_MAX_TRIALS``."""

    max_body_bytes: int = _setting(1_000_000, "bytes of a request body", 1_000, 100_000_000)
    max_fiducials: int = _setting(200, "fiducials of a design", 6, 1000)
    max_targets: int = _setting(50, "targets of a design, regions expanded", 1, 200)
    max_views: int = _setting(8, "views of a design", 2, 16)
    max_trials: int = _setting(5_000_000, "trials of one verification", 100, 1_000_000_000)
    max_starts: int = _setting(32, "starts of one optimisation", 1, 256)
    max_seconds: float = _setting(60.0, "seconds of one computation", 0.1, 86_400)
    body_seconds: float = _setting(20.0, "seconds for a body to arrive", 0.1, 3_600)
    short_workers: int = _setting(2, "scores and validations computed at once", 1, 256)
    long_workers: int = _setting(max(1, _cores() // 2), "verifications computed at once", 1, 256)
    max_waiting: int = _setting(16, "computations of one kind that may wait", 0, 100_000)
    threads: int = _setting(_cores(), "threads of one verification", 1, 1024)

    def __post_init__(self) -> None:
        for entry in fields(self):
            value, low, high = getattr(self, entry.name), entry.metadata["low"], entry.metadata["high"]
            if not low <= value <= high:
                raise RequestError(
                    Problem(
                        "", "bad-setting", f"{variable(entry.name)} must lie between {low:g} and {high:g}; got {value}"
                    )
                )


def variable(name: str) -> str:
    """The environment variable of a setting."""
    return PREFIX + name.upper()


def settings_from(environment: Mapping[str, str]) -> Settings:
    """Settings from an environment.  Raises RequestError for a value that is not a number or out of range."""
    given: dict[str, Any] = {}
    for entry in fields(Settings):
        text = environment.get(variable(entry.name), "").strip()
        if not text:
            continue
        kind = float if entry.type == "float" else int
        try:
            given[entry.name] = kind(text)
        except ValueError:
            what = "a number" if kind is float else "a whole number"
            raise RequestError(
                Problem("", "bad-setting", f"{variable(entry.name)} must be {what}; got {text[:40]!r}")
            ) from None
    return Settings(**given)


def meanings() -> dict[str, tuple[Any, str]]:
    """Variable, its default and what it bounds, for help texts and documentation."""
    return {variable(entry.name): (entry.default, entry.metadata["meaning"]) for entry in fields(Settings)}
