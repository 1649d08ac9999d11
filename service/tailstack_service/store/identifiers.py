"""Job ids: 48 bits of time and 80 random bits as 26 characters, sorted by time (the ULID layout)."""

from __future__ import annotations

import re
import secrets

ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"  # Crockford's, in small letters
_JOB_ID = re.compile(f"[0-7][{ALPHABET}]{{25}}")


def new_job_id(now: float) -> str:
    """An id made at ``now`` (epoch seconds)."""
    number = (int(now * 1000) & ((1 << 48) - 1)) << 80 | secrets.randbits(80)
    return "".join(ALPHABET[number >> shift & 31] for shift in range(125, -1, -5))


def is_job_id(text: str) -> bool:
    """Whether a text that came from outside can be an id; the rest never reaches the database."""
    return _JOB_ID.fullmatch(text) is not None


def storable(text: str) -> str:
    """The text without what a database cannot keep: NUL (PostgreSQL) and lone surrogates (both)."""
    return text.replace("\0", "\ufffd").encode("utf-8", "replace").decode()


def storable_json(text: str) -> str:
    """The same JSON for a database: lone surrogates, which neither can keep, as the escapes that read back as them."""
    return text.encode("utf-8", "backslashreplace").decode()
