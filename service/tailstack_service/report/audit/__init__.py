"""Is a report what it says?  Its hash, its pages and its numbers are made again and compared."""

from __future__ import annotations

from .auditing import audit
from .effort import Effort
from .findings import Audit

__all__ = ["Audit", "Effort", "audit"]
