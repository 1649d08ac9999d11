"""Refusals of what a gate judges by."""

from __future__ import annotations

from tailstack.errors import TailstackError


class GateError(TailstackError):
    """The policy, the waivers or the baseline cannot be read, or breaks a rule."""

    slug = "invalid-policy"
    title = "The policy, waivers or baseline cannot be used"
    exit_code = 2
