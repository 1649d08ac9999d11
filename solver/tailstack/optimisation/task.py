"""What a document asks the optimiser for: its problems, refused already where no search is needed to refuse them."""

from __future__ import annotations

from dataclasses import dataclass

from ..design import Design
from ..design.loading import locate_refusals
from ..results import Finding
from .contradictions import refuse_contradictions
from .explain import influence_of, refuse_incurable
from .problem import PlacementProblem
from .request import OptimiseRequest, list_counts, read_request, with_count


@dataclass(frozen=True, slots=True, eq=False)
class OptimisationTask:
    """What a document asks for."""

    request: OptimiseRequest
    seed: int
    starts: int
    gap: float | None  # to what no layout undercuts, at which a search ends; None: it does not
    counts: tuple[int, ...]  # numbers of fiducials to be tried
    problems: tuple[PlacementProblem, ...]  # one for each
    remarks: tuple[Finding, ...]  # what the free variables can and cannot do


def read_task(
    design: Design, *, seed: int | None = None, starts: int | None = None, gap: float | None = None
) -> OptimisationTask:
    """Read the ``optimise`` section of a design.  Raises DesignError, InfeasibleError."""
    with locate_refusals(design):
        request = read_request(design)
        section, counts = request.section, list_counts(request)
        problems = tuple(with_count(request, count) for count in counts)
        for problem in problems:
            refuse_contradictions(problem)
        refuse_incurable(request.problem)
        return OptimisationTask(
            request=request,
            seed=section.seed if seed is None else seed,
            starts=section.starts if starts is None else starts,
            gap=gap,
            counts=counts,
            problems=problems,
            remarks=influence_of(request.problem),
        )


def influence(design: Design) -> tuple[Finding, ...]:
    """What the free variables of a design can and cannot do, in milliseconds.  Raises DesignError."""
    with locate_refusals(design):
        problem = read_request(design).problem
        refuse_contradictions(problem)
        if not frees_views(design):  # what cannot be cured with the views as they are may be by other ones
            refuse_incurable(problem)
        return influence_of(problem)


def frees_views(design: Design) -> bool:
    """Whether views may be aimed otherwise."""
    section = design.document.optimise
    return section is not None and bool(section.views)
