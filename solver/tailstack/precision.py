"""How finely a check may be asked for: the relative half-width of the interval of P95."""

from __future__ import annotations

PRECISION = 0.005  # when nothing else is asked for
FINEST_PRECISION = 1e-4  # what is finer takes billions of trials
