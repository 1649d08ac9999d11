"""All operations, in the order in which they are listed.  A new one is a module, and one line here."""

# ruff: noqa: F401, I001
from __future__ import annotations

from .operation import Operation

from .validation import OPERATION as VALIDATION
from .score import OPERATION as SCORE
from .layout import OPERATION as LAYOUT
from .verification import OPERATION as VERIFICATION
from .optimisation import OPERATION as OPTIMISATION
from .sweep import OPERATION as SWEEP
from .study_paper import OPERATION as STUDY_PAPER
from .study_linearity import OPERATION as STUDY_LINEARITY
from .study_coupling import OPERATION as STUDY_COUPLING
from .study_comparison import OPERATION as STUDY_COMPARISON
from .gate import OPERATION as GATE
from .report import OPERATION as REPORT
from .comparison import OPERATION as COMPARISON
from .conversion import OPERATION as CONVERSION

OPERATIONS: dict[str, Operation] = {
    operation.name: operation for operation in tuple(globals().values()) if isinstance(operation, Operation)
}

# Verbs that are families: their members are operations whose verbs begin with them
FAMILIES = {"study": "studies: the paper's tables, reach of first order, coupling, measurements"}
