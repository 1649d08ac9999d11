"""What a study cannot be asked."""

from __future__ import annotations

from ..errors import TailstackError


class StudyError(TailstackError):
    """An axis, a target or a number of trials that cannot be."""

    slug = "invalid-request"
    title = "The request is not valid"
    exit_code = 2
