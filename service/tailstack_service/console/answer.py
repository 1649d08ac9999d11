"""What a verb gives back, and how a verdict becomes an exit code."""

from __future__ import annotations

import errno
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tailstack.results import Verdict
    from tailstack.results.sweep import Sweep
    from tailstack.studies.linearity import StudyLinearity

PASS, FAIL, BAD_INPUT, NOT_EVALUATED, INCONCLUSIVE, INTERRUPTED = 0, 1, 2, 3, 4, 130
EXIT_CODE = {"pass": PASS, "no requirement": PASS, "fail": FAIL, "inconclusive": INCONCLUSIVE}


@dataclass(frozen=True, slots=True)
class Answer:
    """Text for stdout (bytes when it is JSON, which is UTF-8 whatever the terminal speaks) and the exit code."""

    body: str | bytes
    exit_code: int = PASS


def exit_code_of(verdict: Verdict) -> int:
    return EXIT_CODE[verdict.status]


def exit_code_of_points(record: Sweep | StudyLinearity) -> int:
    """Of a grid: it was evaluated if any of its points was."""
    return PASS if any(point.status == "ok" for point in record.points) else NOT_EVALUATED


def write_out(body: str | bytes) -> None:
    """An answer to stdout, its last line ended.  Raises OSError."""
    if sys.stdout is None:
        raise OSError(errno.EBADF, "it is closed")
    if isinstance(body, bytes):
        sys.stdout.flush()
        sys.stdout.buffer.write(body if body.endswith(b"\n") or not body else body + b"\n")
    else:
        sys.stdout.write(body)
    sys.stdout.flush()
