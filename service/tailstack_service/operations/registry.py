"""All operations.  A new one is a module with its ``OPERATION``, and one line here."""

from __future__ import annotations

from . import (
    comparison,
    conversion,
    gate,
    optimisation,
    report,
    score,
    study_comparison,
    study_coupling,
    study_linearity,
    study_paper,
    sweep,
    validation,
    verification,
)
from .operation import Operation

OPERATIONS: dict[str, Operation] = {
    module.OPERATION.name: module.OPERATION
    for module in (
        validation,
        score,
        verification,
        optimisation,
        sweep,
        study_paper,
        study_linearity,
        study_coupling,
        study_comparison,
        gate,
        report,
        comparison,
        conversion,
    )
}

# Verbs that are families: their members are operations whose verbs begin with them
FAMILIES = {"study": "studies: the paper's tables, reach of first order, coupling, measurements"}
