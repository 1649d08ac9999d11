"""All operations, in the order in which they are listed.  A new one is a module, and one line here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .operation import Operation

# The verb of each, by its name, which is also that of its module (study_views for study-views)
VERB_OF = {
    "validation": "validate",
    "score": "score",
    "batch": "score",
    "layout": "layout",
    "verification": "verify",
    "optimisation": "optimise",
    "allocation": "allocate",
    "sweep": "sweep",
    "study-linearity": "study linearity",
    "study-coupling": "study coupling",
    "study-estimators": "study estimators",
    "study-views": "study views",
    "study-placement": "study placement",
    "study-workspace": "study workspace",
    "study-comparison": "study compare",
    "gate": "gate",
    "report": "report",
    "comparison": "report",
    "sheet": "report",
    "conversion": "convert",
}

ELSEWHERE = {"conversion": "tailstack_service.integrations.conversion"}  # modules that are not in this package

# Verbs that are families: their members are operations whose verbs begin with them
FAMILIES = {"study": "studies: reach of the estimate, coupling, estimators, views, placement, poses, measurements"}


class _Registry(Mapping[str, "Operation"]):
    """The operations by name.  Each is loaded when it is asked for: a verb does not wait for the others."""

    def __getitem__(self, name: str) -> Operation:
        if name not in VERB_OF:
            raise KeyError(name)
        module = ELSEWHERE.get(name, f"{__package__}.{name.replace('-', '_')}")
        operation: Operation = import_module(module).OPERATION
        return operation

    def __iter__(self) -> Iterator[str]:
        return iter(VERB_OF)

    def __len__(self) -> int:
        return len(VERB_OF)


OPERATIONS = _Registry()


def operations_of(verb: str) -> tuple[Operation, ...]:
    """Those whose verb this is, or whose family."""
    return tuple(OPERATIONS[name] for name, full in VERB_OF.items() if verb in (full, full.partition(" ")[0]))
