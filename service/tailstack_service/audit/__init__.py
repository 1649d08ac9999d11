"""Is a report what it says?  Its hash, its pages and its numbers are made again and compared."""

from __future__ import annotations

from .findings import Audit
from .verify import Effort, audit

__all__ = ["Audit", "Effort", "audit"]
