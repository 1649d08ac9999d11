"""A design compiled and its geometry checked, with every refusal placed in the user's document."""

from __future__ import annotations

from ..errors import IllPosedError
from ..estimation.checks import examine
from ..results import Finding, ViewCheck
from ..system import System
from .compile import compile_design
from .loading import Design
from .refusals import place


def check_design(design: Design) -> tuple[System, tuple[Finding, ...], tuple[ViewCheck, ...]]:
    """Compile and check: the system, remarks on its geometry, and what each view sees.

    Raises DesignError and IllPosedError with the file, line and column of the section they are about.
    """
    system = compile_design(design)
    try:
        findings, views = examine(system)
    except IllPosedError as error:
        source = design.source.placed()
        raise IllPosedError([place(problem, source) for problem in error.problems]) from None
    return system, findings, views
