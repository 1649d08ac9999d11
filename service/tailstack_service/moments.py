"""Moments as people and programs read them."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import lru_cache


def moment(seconds: float) -> str:
    """Epoch seconds as RFC 3339, UTC, to the millisecond: ``2026-01-31T12:00:00.123Z``."""
    whole, micro = divmod(round(1e6 * seconds), 1_000_000)
    return f"{_second(whole)}.{micro // 1000:03d}Z"


@lru_cache(maxsize=64)  # many lines of a log are of one second
def _second(seconds: int) -> str:
    return datetime.fromtimestamp(seconds, UTC).replace(tzinfo=None).isoformat(timespec="seconds")
