"""A view at a price: the best design with it and the best without it, both verified, and the cheaper of the two."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

from ..design import Design, load_design
from ..design.optimise_document import AddedView
from ..errors import NotConvergedError, Problem, TailstackError
from ..results import Optimisation, Relaxation, ViewOffer
from ..results.digits import at_most
from .cost_bound import take_smallest
from .reporting import find_p95_mm
from .search import Control
from .views import MOST_SOLVED, find_view

STOPPED = NotConvergedError(Problem("/optimise/views", "stopped", "the search was stopped on request before that"))


class OptimiseViews(Protocol):
    """The optimiser of a design whose views may be aimed: one control follows that, and one the rest."""

    def __call__(self, each: Design, aims: Control, rest: Control, added: AddedView | None = None) -> Optimisation: ...


def weigh_offer(design: Design, added: AddedView, optimise: OptimiseViews, control: Control) -> Optimisation:
    """The cheaper of both designs, the price counted; that without the view where they cost the same.

    Raises what refuses the design without the view, and with it, where there is neither.
    """
    first, second = (control.for_part(part, 2) for part in (0, 1))
    first.report("view", 0, MOST_SOLVED, None)
    without = _attempt(lambda: optimise(design, first, replace(control, progress=None)))
    with_view: Optimisation | TailstackError = STOPPED
    if not control.stops():
        with_view = _attempt(lambda: optimise(add_view(design, added), second, control, added))
    if not isinstance(with_view, TailstackError):
        return _choose(design, added, without, with_view, stopped=control.stops())
    if isinstance(without, TailstackError):
        raise _refuse(design, without, with_view)
    words = f"{added.add} is left out: no design with it was found. {_reason(with_view)}."
    return _record(without, ViewOffer(
        view=added.add, like=added.like, price=added.price, added=False, cost_without=without.cost_after,
        cost_with=None, worth=None, beam_direction=None, up_direction=None, source_isocentre_mm=None,
        p95_without_mm=find_p95_mm(design), p95_with_mm=None, sentence=words,
    ))  # fmt: skip


def add_view(design: Design, added: AddedView) -> Design:
    """The design with the view written into it, aimed like its model, and free as far as its entry says.

    Raises DesignError, LimitError.
    """
    data = design.source.data
    free: dict[str, Any] = {"view": added.add, "cone_deg": added.cone_deg}
    if added.source_isocentre_mm is not None:
        free["source_isocentre_mm"] = list(added.source_isocentre_mm)
    entries = [free if "add" in entry else entry for entry in data["optimise"]["views"]]
    model = data["views"][find_view(design, added.like)[0]]
    written = {**data, "views": [*data["views"], {**model, "name": added.add}]}
    written["optimise"] = {**data["optimise"], "views": entries}
    return load_design(written, base_directory=design.source.directory)


def _attempt(optimise: Callable[[], Optimisation]) -> Optimisation | TailstackError:
    try:
        return optimise()
    except TailstackError as refusal:
        return refusal


def _choose(
    design: Design, added: AddedView, without: Optimisation | TailstackError, with_view: Optimisation, *, stopped: bool
) -> Optimisation:
    """The cheaper of the two, or the only one; what the view does to the design as it stood beside that."""
    view = find_view(load_design(with_view.design), added.add)[1]
    p95_mm, p95_with_mm = find_p95_mm(design), _find_p95_with(design, added, with_view)
    assert with_view.aimed is not None  # what was added is free
    aim = next(each for each in with_view.aimed.views if each.view == added.add)
    cost_without = worth = None
    if isinstance(without, TailstackError):
        words = f"{added.add} is added, whatever its price: there is no design without it. {_reason(without)}. "
        words += f"With it the design costs {with_view.cost_after:.5g}, and {added.price:.5g} for the view"
    else:
        cost_without = without.cost_after
        worth = cost_without - with_view.cost_after
        words = f"{added.add} is {'added' if worth > added.price else 'left out'}: with it the design costs "
        words += f"{with_view.cost_after:.5g}, without it {cost_without:.5g}, so it is "
        pays = f"a price of up to {at_most(worth, 5)}" if worth > 0 else "no price by what was found"
        words += f"worth {pays}; it costs {added.price:.5g}"
    if p95_mm is not None and p95_with_mm is not None:
        words += f". In the design as it stood it takes P95 from {p95_mm:.4g} to {p95_with_mm:.4g} mm"
    if stopped:
        words += ". The search with it was stopped on request: a longer one may find more"
    offer = ViewOffer(
        view=added.add, like=added.like, price=added.price, added=worth is None or worth > added.price,
        cost_without=cost_without, cost_with=with_view.cost_after, worth=worth, beam_direction=aim.beam_direction,
        up_direction=view.up_direction, source_isocentre_mm=aim.source_isocentre_mm, p95_without_mm=p95_mm,
        p95_with_mm=p95_with_mm, sentence=f"{words}.",
    )  # fmt: skip
    if isinstance(without, TailstackError) or offer.added:
        exact = None if with_view.cost_exact_law is None else with_view.cost_exact_law + added.price
        chosen = replace(with_view, cost_after=with_view.cost_after + added.price, cost_exact_law=exact)
    else:
        chosen = without
    cheapest = None if isinstance(without, TailstackError) else without.certificate.cheapest
    bound = _bound_both(added, chosen.cost_after, cheapest, with_view.certificate.cheapest)
    return _record(replace(chosen, certificate=replace(chosen.certificate, cheapest=bound)), offer)


def _bound_both(added: AddedView, cost: float, without: Relaxation | None, with_view: Relaxation | None) -> Relaxation:
    """What no design undercuts, with the view or without it, the price counted; compared with a cost."""
    if with_view is not None and with_view.lower_bound is not None:
        with_view = replace(with_view, lower_bound=with_view.lower_bound + added.price)
    kinds = {f"without {added.add}": without, f"with {added.add}, its price of {added.price:g} not counted": with_view}
    return take_smallest(kinds, cost, f"with {added.add} for {added.price:g} or without it")


def _find_p95_with(design: Design, added: AddedView, optimisation: Optimisation) -> float | None:
    """Of the design as it stood, mm, with the view of the new one; None where that hides something of it."""
    views: Any = optimisation.design["views"]
    try:
        return find_p95_mm(add_view(design, added).with_value("/views", [*design.source.data["views"], views[-1]]))
    except TailstackError:
        return None


def _record(optimisation: Optimisation, offer: ViewOffer) -> Optimisation:
    objective = f"{optimisation.objective}, the view {offer.view} for {offer.price:g} if it pays"
    return replace(optimisation, objective=objective, view_offer=offer)


def _refuse(design: Design, without: TailstackError, with_view: TailstackError) -> TailstackError:
    """What was said of both designs; where the search was stopped, that."""
    for each in (without, with_view):
        if each.problems[0].code == "stopped":
            return each
    assert design.document.optimise is not None
    entry = next(k for k, each in enumerate(design.document.optimise.views or ()) if isinstance(each, AddedView))
    detail = f"nor is there one with the view: {_first_sentence(with_view)}"
    with_it = Problem(f"/optimise/views/{entry}", with_view.problems[0].code, detail)
    return type(without)([*without.problems, with_it])


def _reason(refusal: TailstackError) -> str:
    """With a capital and without its full stop."""
    detail = _first_sentence(refusal)
    return detail[:1].upper() + detail[1:]


def _first_sentence(refusal: TailstackError) -> str:
    return refusal.problems[0].detail.rstrip(".").partition(". ")[0]
