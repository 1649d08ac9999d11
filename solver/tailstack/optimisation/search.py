"""The search: solve from every start, polish the best, or say what stands in the way.

A solve starts, at a given layout, from half-widths that use up what the limits leave.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, count, islice
from math import exp, inf, isnan, log
from queue import SimpleQueue

import numpy as np
from scipy.optimize import brentq, linear_sum_assignment
from scipy.spatial.distance import cdist

from ..errors import NotConvergedError, Problem
from ..geometry.arrays import Array
from ..kernels.process import usable_cores
from ..results import LocalOptimum
from .exact_law import Correction, Evaluation, correction_at, evaluate_demand, leading_demands, no_correction
from .explain import explain_infeasible, refuse_geometry, relax_rules
from .global_bound import weigh_candidates
from .matching import take_nearest
from .present import bring_inside
from .problem import SMOOTH_MM, Homes, PlacementProblem, least_half_widths, present_choice, width_bounds
from .program import Parameters, Point, Program, build_program, solve
from .regions import bounding_box
from .starts import clip_to_regions, starting_layouts
from .terms import DemandTerms, every_terms, is_singular

POLISHED = 3  # best explored points that are solved to full precision
ATTEMPTS = 8  # starts asked for the smallest quantile before a limit is called out of reach
STEERING = 6  # demands whose error the starting layouts are improved for
LEADING = 0.97  # of the largest quantile over its limit: a demand that near may bind
MANY_DEMANDS = 3  # beyond this only those that bind somewhere enter the programme
REACHED = 0.9  # of how far a fiducial may move, where a start would have it further
UNMOVED_MM = 10 * SMOOTH_MM  # a way that short is given up: from there on the smooth price is as steep as the true one
POLL_SECONDS = 0.1  # how soon a wish to stop is noticed
NEAR = 0.05  # in logarithm: a design as good as that is worth a search from where it stands
TINY = 1e-7  # in logarithm: what one solve and another differ by
ROUNDING = 1e-3  # of a rule: what rounding positions to a micrometre may break of it
SAME = 2.5e-4  # relative: explored objectives are known to about that

Progress = Callable[[str, int, int, float | None], None]  # stage, done, total, least objective so far
Stop = Callable[[], bool]
Points = Generator[Point, None, None]


@dataclass(frozen=True, slots=True)
class Control:
    """How many threads work, who is told how far it is, and who may end it early."""

    threads: int | None = None  # None: one for each core
    progress: Progress | None = None
    stop: Stop | None = None

    def report(self, stage: str, done: int, total: int, least: float | None) -> None:
        if self.progress is not None:
            self.progress(stage, done, total, least)

    def stops(self) -> bool:
        return self.stop is not None and self.stop()

    def for_part(self, position: int, searches: int) -> Control:
        """For one of several searches: its progress as part of theirs."""

        def report(stage: str, done: int, total: int, least: float | None) -> None:
            self.report(stage, position * total + done, searches * total, least)

        return replace(self, progress=report)


ALONE = Control()  # nobody is told, and nobody ends it


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """A point and the parameters it was solved with."""

    point: Point
    parameters: Parameters


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What the starts found: the programme, the best points first, and how the starts ended."""

    program: Program
    iterates: tuple[Iterate, ...]
    terms: tuple[DemandTerms, ...]  # of every demand, also those outside the programme
    starts: int
    converged: int
    optima: tuple[LocalOptimum, ...]  # ascending
    stopped: str

    @property
    def fiducials(self) -> int:
        """How many there are."""
        return len(self.program.problem.system.fiducial_labels)

    @property
    def best_objective(self) -> float:
        """By the closed form, as people read it."""
        return objective_for_people(self.program, self.iterates[0].point.objective)


@dataclass(frozen=True, slots=True, eq=False)
class PreparedSearch:
    """A search before its starts are solved.  Solving one depends on nothing but this and its number."""

    program: Program
    terms: tuple[DemandTerms, ...]  # of every demand, also those outside the programme
    starts: Starts
    ends: dict[int, Iterate]  # that are known already
    present: Array | None = None  # variables of the design as it stands, brought inside; start 0 has its layout
    enough: float = -inf  # the objective, as people read it, that ends the search


def search(
    problem: PlacementProblem,
    *,
    starts: int = 8,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
    stop: Stop | None = None,
    enough: float = -inf,
) -> Search:
    """Solve from every start, or until an objective is enough, and rank the optima (by the closed form).

    Raises InfeasibleError, and NotConvergedError when it was stopped before anything converged.
    """
    control = Control(threads, progress, stop)
    prepared = prepare_search(problem, starts=starts, seed=seed, control=control, enough=enough)
    return _solve_prepared(prepared, control)


def prepare_search(
    problem: PlacementProblem, *, starts: int = 8, seed: int = 0, control: Control = ALONE, enough: float = -inf
) -> PreparedSearch:
    """The programme of a problem and where it is to be solved from; where a bound tells what is ``enough``, every
    second layout is drawn from its weights.  Raises InfeasibleError."""
    terms = every_terms(problem)
    far = farthest(problem, terms)
    weigh = partial(weigh_candidates, problem, far[0]) if enough > -inf else None
    layouts = starting_layouts(problem, far, starts, seed, weigh)
    if problem.stay is not None:
        layouts = map(partial(_within_reach, problem, problem.stay), layouts)
    active, first = terms, list(islice(layouts, 3 if len(terms) > MANY_DEMANDS else 1))
    if len(terms) > MANY_DEMANDS:
        # At half-widths that use up the limit, not at the smallest: a lever may lead where noise does not.
        here = present_choice(problem)
        choices = [replace(here, fiducials_mm=layout) for layout in first if not is_singular(problem.system, layout)]
        leading = leading_demands(problem, terms, choices, LEADING)
        active = tuple(term for k, term in enumerate(terms) if k in leading) or terms
    total = starts if problem.places else 1
    lanes = min(usable_cores() if control.threads is None else control.threads, total)
    program = build_program(problem, active, lanes)
    control.report("programme", 1, 1, None)
    prepared = PreparedSearch(program, terms, *_lead(Starts(program, chain(first, layouts), total)), enough=enough)
    if is_singular(problem.system, first[0]):
        return prepared
    return replace(prepared, present=program.join(bring_inside(problem, present_choice(problem))))


def _within_reach(problem: PlacementProblem, homes: Homes, layout: Array) -> Array:
    """A layout (N, 3), each place taken by the nearest, with what is further than it may move pulled back, within its
    region."""
    layout = take_nearest(problem, layout)
    ways = np.nan_to_num(layout - homes.home_mm)
    lengths = np.linalg.norm(ways, axis=1, keepdims=True)
    over = np.maximum(lengths / (REACHED * homes.at_most_mm), 1.0) - 1.0
    return clip_to_regions(problem, layout - ways * over / (1.0 + over)) if over.any() else layout


def hold_unmoved(search: Search) -> Search:
    """The best point with every fiducial that only the roundness of the price has moved held in its place, the others
    solved for again; each place is taken by whichever fiducial is nearest."""
    program, homes = search.program, search.program.problem.stay
    if homes is None or not homes.cost_per_mm:
        return search
    item, problem = search.iterates[0], program.problem
    choice = program.split(item.point.x)
    layout = take_nearest(problem, choice.fiducials_mm)
    near = np.linalg.norm(np.nan_to_num(layout - homes.home_mm, nan=inf), axis=1) <= UNMOVED_MM
    x = program.join(replace(choice, fiducials_mm=np.where(near[:, None], homes.home_mm, layout)), item.point.x[-1])
    still = [g for g, place in enumerate(problem.places) if near[list(place.fiducials)].all()]
    held = {3 * g + k: float(x[3 * g + k]) for g in still for k in range(3)}
    program = replace(program, held=held)
    point = solve(program, x, item.parameters)
    if not point.solved:
        return search
    point = solve(program, point.x, item.parameters, warm=point)
    return replace(search, program=program, iterates=(Iterate(point, item.parameters), *search.iterates[1:]))


def explore(program: Program, terms: tuple[DemandTerms, ...], layouts: list[Array]) -> Search:
    """Solve from given layouts."""
    return _solve_prepared(PreparedSearch(program, terms, *_lead(Starts(program, layouts, len(layouts)))), ALONE)


def _solve_prepared(prepared: PreparedSearch, control: Control) -> Search:
    return conclude_search(prepared, _solve_all(prepared.program, prepared.starts, control.stop), control)


def solve_start(prepared: PreparedSearch, start: Start) -> Point:
    """Where one start ends, on the first lane."""
    return solve(prepared.program, start.x, start.parameters)


def conclude_search(prepared: PreparedSearch, points: Points, control: Control) -> Search:
    """What the ends of the starts come to, given in their order; the best are polished.

    Raises InfeasibleError, NotConvergedError when none converged, or when stopped before one did.
    """
    program, starts, ends = prepared.program, prepared.starts, dict(prepared.ends)
    stopped, cut = "", False
    with closing(points):  # what is still being solved is over before anything else is
        for k, (point, start) in enumerate(zip(points, starts, strict=False)):
            if point.solved and (k not in ends or point.objective < ends[k].point.objective):
                ends[k] = Iterate(point, start.parameters)
            least = min((objective_for_people(program, end.point.objective) for end in ends.values()), default=None)
            control.report("start", k + 1, starts.total, least)
            if control.stops() and k + 1 < starts.total:
                stopped, cut = f"stopped on request after {k + 1} of {starts.total} starts", True
                break
            if least is not None and least <= prepared.enough and k + 1 < starts.total:
                stopped = f"near enough to what no layout undercuts after {k + 1} of {starts.total} starts"
                break
    if not ends and cut:
        detail = f"{stopped}: none had converged"
        raise NotConvergedError(Problem("/optimise", "stopped", detail, "let it run longer"))
    own = _near_present(prepared)
    if own is not None and own.point.objective < min((e.point.objective for e in ends.values()), default=inf) + NEAR:
        point = solve(program, own.point.x, own.parameters, warm=own.point)
        if 0 not in ends or (point.solved and point.objective < ends[0].point.objective - TINY):
            ends[0] = Iterate(point, own.parameters) if point.solved else own
    if not ends:
        last = _search_from_least(program, list(starts))
        ends[next(k for k, start in enumerate(starts) if start.parameters is last.parameters)] = last
    solved = sorted(ends.values(), key=lambda item: item.point.objective)
    polished = []
    for item in solved[:POLISHED]:
        point = solve(program, item.point.x, item.parameters, warm=item.point)
        polished.append(Iterate(point, item.parameters))
        least = objective_for_people(program, solved[0].point.objective)
        control.report("polish", len(polished), min(POLISHED, len(solved)), least)
    best = sorted((item for item in polished if item.point.solved), key=lambda item: item.point.objective) or solved
    return Search(
        program=program,
        iterates=tuple(best),
        terms=prepared.terms,
        starts=starts.total,
        converged=len(ends),
        optima=local_optima(program, ends),
        stopped=stopped or f"all {starts.total} starts were solved",
    )


def _near_present(prepared: PreparedSearch) -> Iterate | None:
    """The design as it stands, brought inside, where it is in reach of the programme: its rules are kept, and its
    quantiles nearly."""
    if prepared.present is None:
        return None
    program, parameters = prepared.program, prepared.starts[0].parameters
    x = prepared.present.copy()
    objective, values = (part.full().ravel() for part in program.constraints(x, parameters.vector(program, "main")))
    reached, quantiles = float(objective[0]), len(program.terms)
    if program.problem.objective == "quantile":
        x[-1] = reached = float(values[:quantiles].max())
        values[:quantiles] -= reached
    lower, upper = np.array([(row.lower, row.upper) for row in program.rows]).T
    slack = np.full(len(values), ROUNDING)
    slack[:quantiles] = NEAR
    if not ((values >= lower - slack) & (values <= upper + slack)).all():
        return None
    nothing = Point(x, np.zeros(len(values)), np.zeros(len(x)), reached, solved=True, iterations=0)
    return Iterate(nothing, parameters)


def _lead(starts: Starts) -> tuple[Starts, dict[int, Iterate]]:
    """Starts, and the end of the most promising one where it had to be led to the feasible set.

    When no start is feasible even with its half-widths at their smallest: is there anything to find?  The smallest
    quantile is asked for from the best layouts, before all starts fail.  Raises InfeasibleError.
    """
    program = starts.program
    if program.problem.objective == "quantile" or any(start.tightest_ratio <= 1 for start in starts):
        return starts, {}
    ranked = sorted(starts, key=lambda start: start.tightest_ratio)
    first = list(starts).index(ranked[0])
    least = least_quantile(program, ranked[:ATTEMPTS])
    if least.point.objective > 0:
        exact = evaluate_demands(program, least.point)
        if worst_ratio(exact) > 1:
            raise explain_infeasible(program, least.point)
        # The closed form refuses what the exact law accepts: search on with the one corrected to the other.
        choice, each = program.split(least.point.x), zip(program.terms, exact, strict=True)
        corrected = tuple(correction_at(program.problem, term, choice, item, None) for term, item in each)
        starts = starts.correct(corrected)
        least = replace(least, parameters=replace(least.parameters, corrections=corrected))
    end = Iterate(solve(program, least.point.x, least.parameters), least.parameters)
    return starts, {first: end} if end.point.solved else {}


def _search_from_least(program: Program, starts: Sequence[Start]) -> Iterate:
    """Where no start ended anywhere: from the smallest quantile attainable.  Raises what stands in the way."""
    ranked = sorted(starts, key=lambda start: start.tightest_ratio)
    least = least_quantile(program, ranked[:ATTEMPTS])
    if program.problem.objective != "quantile" and worst_ratio(evaluate_demands(program, least.point)) > 1:
        raise explain_infeasible(program, least.point)
    end = solve(program, least.point.x, least.parameters)
    if not end.solved:
        raise none_converged(len(starts))
    return Iterate(end, least.parameters)


def objective_for_people(program: Program, objective: float) -> float:
    """The cost, the factor, or the largest quantile over its limit, from the programme's logarithm."""
    return float(np.exp(objective / 2 if program.problem.objective == "quantile" else objective))


def _solve_all(program: Program, starts: Starts, stop: Stop | None) -> Points:
    """The starts solved side by side, in their order: what a start ends at does not depend on the threads.

    While they are solved the next are made, as many as there may be idle lanes: none where one thread does it all, and
    the first answer is there before the second start.
    """
    lanes: SimpleQueue[int] = SimpleQueue()
    for lane in range(len(program.explore)):
        lanes.put(lane)

    def solve_in_lane(start: Start) -> Point:
        lane = lanes.get()
        try:
            return solve(program, start.x, start.parameters, lane=lane)
        finally:
            lanes.put(lane)

    room = 2 * len(program.explore) - 1
    begun, remaining = deque[Future[Point]](), iter(starts)
    with ThreadPoolExecutor(len(program.explore), thread_name_prefix="tailstack-start") as pool:
        try:
            while True:
                for start in islice(remaining, room - len(begun)):
                    begun.append(pool.submit(solve_in_lane, start))
                if not begun:
                    return
                _wait(begun[0], begun, stop)
                if begun[0].cancelled():
                    return
                yield begun.popleft().result()
        finally:  # a caller that stops listening does not wait for the starts that have not begun
            for future in begun:
                future.cancel()


def _wait(future: Future[Point], futures: Iterable[Future[Point]], stop: Stop | None) -> None:
    """Until a start is solved; on a wish to stop, those that have not begun are dropped."""
    while stop is not None and not future.done():
        try:
            future.exception(timeout=POLL_SECONDS)
        except TimeoutError:
            if stop():
                for later in futures:
                    later.cancel()
                return


def farthest(problem: PlacementProblem, terms: tuple[DemandTerms, ...]) -> tuple[DemandTerms, ...]:
    """The demands at the targets farthest from where the fiducials may be: their noise is largest, they steer the
    starts."""
    centre = problem.system.fiducials_mm.mean(axis=0)
    if problem.places:
        centre = np.mean([bounding_box(place.region).mean(axis=0) for place in problem.places], axis=0)
    terms = tuple(term for term in terms if not term.demand.lost and term.demand.ends in problem.ends[:1])
    places = ([target.position_mm for target in term.demand.targets] for term in terms)
    apart = [-max(float(np.linalg.norm(place - centre)) for place in each) for each in places]
    return tuple(terms[k] for k in sorted(np.argsort(apart, kind="stable")[:STEERING]))


def local_optima(program: Program, ends: dict[int, Iterate]) -> tuple[LocalOptimum, ...]:
    """The distinct optima among the ends of the starts, ascending; objectives this close count as one."""
    optima: list[tuple[float, list[int], Array]] = []
    for k, end in sorted(ends.items(), key=lambda item: item[1].point.objective):
        value = objective_for_people(program, end.point.objective)
        if optima and value <= optima[-1][0] * (1 + SAME):
            optima[-1][1].append(k)
        else:
            optima.append((value, [k], program.split(end.point.x).fiducials_mm))
    reference = optima[0][2]
    return tuple(
        LocalOptimum(value, len(which), min(which), rms_distance_mm(layout, reference))
        for value, which, layout in optima
    )


def rms_distance_mm(layout: Array, reference: Array) -> float:
    """Root mean square distance of two sets of points (N, 3), matched one to one so that it is least."""
    squared = cdist(layout, reference, "sqeuclidean")
    return float(np.sqrt(squared[linear_sum_assignment(squared)].mean()))


def least_quantile(program: Program, starts: list[Start]) -> Iterate:
    """The smallest quantile attainable from some starts, every free half-width at its smallest.

    Raises InfeasibleError when not even the geometric constraints can be met.
    """
    points: list[Iterate] = []
    for start in starts:
        points.append(Iterate(solve(program, start.x, start.parameters, question="least"), start.parameters))
        if points[-1].point.solved and points[-1].point.objective < 0:  # within the limit: nothing is infeasible
            break
    solved = [item for item in points if item.point.solved]
    if not solved:
        if all(row.kind in ("quantile", "cost") for row in program.rows):
            raise none_converged(len(points))
        relaxed = relax_rules(program, [(item.point, item.parameters) for item in points])
        kept = solve(program, relaxed.x, relaxed.parameters, question="least") if relaxed.are_kept else None
        if kept is None or not kept.solved:
            raise refuse_geometry(program, relaxed)
        solved = [Iterate(kept, relaxed.parameters)]
    best = min(solved, key=lambda item: item.point.objective)
    polished = solve(program, best.point.x, best.parameters, question="least", warm=best.point)
    return Iterate(polished, best.parameters) if polished.solved else best


def none_converged(starts: int) -> NotConvergedError:
    """The solver failed, which says nothing about what can be met."""
    detail = f"none of {starts} starts converged: whether the limits can be met could not be found out"
    return NotConvergedError(Problem("/optimise", "none-converged", detail, "try more starts or another seed"))


def evaluate_demands(program: Program, point: Point) -> list[Evaluation]:
    """Exact quantiles of the programme's demands at a point."""
    choice = program.split(point.x)
    return [evaluate_demand(program.problem, term, choice) for term in program.terms]


def worst_ratio(evaluations: list[Evaluation]) -> float:
    """Largest quantile over its limit."""
    return max(item.exact_mm / item.limit for item in evaluations)


def with_demands(search: Search, point: Point, ratios: Array, least: float) -> Search:
    """The search again with every demand whose ratio to its aim is above ``least`` at a point, from the layouts it
    ended at."""
    inside = {term.demand.key for term in search.program.terms}
    each = zip(search.terms, ratios, strict=True)
    active = tuple(term for term, ratio in each if ratio > least * LEADING or term.demand.key in inside)
    program = build_program(search.program.problem, active, len(search.program.explore))
    program = replace(program, held=search.program.held)
    layouts = [search.program.split(p.x).fiducials_mm for p in (point, *(item.point for item in search.iterates[1:]))]
    return replace(search, program=program, iterates=explore(program, search.terms, layouts).iterates)


BELOW = 0.98  # of the limit: from inside, an interior-point solve takes a tenth of the iterations


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    x: Array
    parameters: Parameters
    tightest_ratio: float  # largest closed form over its limit with every free half-width at its smallest


class Starts:
    """Starts at the layouts that determine the targets: the present one may not, and be optimised for that.  Where none
    does, at all.

    Each is made when it is first asked for: the first is solved before the layout of the second is looked for.
    """

    def __init__(self, program: Program, layouts: Iterable[Array], count: int, made: Sequence[Start] = ()) -> None:
        self.program = program
        self._count, self._passed_over = count, list[Array]()
        self._made, self._rest = list(made), map(partial(start_at, program), self._find_solid(layouts))

    @property
    def total(self) -> int:
        """How many there are, made or not, as far as the layouts are known."""
        return self._count - len(self._passed_over)

    def __getitem__(self, number: int) -> Start:
        """A start by its number, from 0.  Raises IndexError."""
        self._made.extend(islice(self._rest, max(number + 1 - len(self._made), 0)))
        return self._made[number]

    def __iter__(self) -> Iterator[Start]:
        for k in count():
            if k == len(self._made):
                self._made.extend(islice(self._rest, 1))
            if k == len(self._made):
                return
            yield self._made[k]

    def correct(self, corrections: tuple[Correction, ...]) -> Starts:
        """The same with the closed forms of the programme corrected."""
        made = [replace(start, parameters=replace(start.parameters, corrections=corrections)) for start in self]
        return Starts(self.program, (), len(made), made)

    def _find_solid(self, layouts: Iterable[Array]) -> Iterator[Array]:
        singular: list[Array] = []
        for layout in layouts:
            if is_singular(self.program.problem.system, layout):
                singular.append(layout)
            else:
                self._passed_over = singular
                yield layout
        if self._passed_over is not singular:
            yield from singular


def start_at(program: Program, layout: Array) -> Start:
    """Variables and parameters at a layout (N, 3), everything mechanical as it is."""
    problem, signs = program.problem, np.zeros((len(program.terms), 0))
    least = least_half_widths(problem, program.present_width)
    choice = program.split(program.join(replace(present_choice(problem), fiducials_mm=layout, half_width=least)))
    if program.terms[0].at_ends:
        signs = np.array([evaluate_demand(problem, term, choice).signs for term in program.terms])
    parameters = Parameters(
        np.log([term.demand.requirement.limit for term in program.terms]),
        signs,
        tuple(no_correction(problem, term) for term in program.terms),
        program.pieces_of(choice),
        program.off_surface(choice),
    )
    vector = parameters.vector(program, "main")

    def log_worst(half_width: Array) -> float:
        """Of the squared ratios; infinite where the layout has no answer."""
        x = program.join(replace(choice, half_width=half_width))
        worst = float(program.constraints(x, vector)[1].full()[: len(program.terms)].max())
        return inf if isnan(worst) else worst

    tightest = exp(log_worst(choice.half_width) / 2)
    if len(choice.half_width):
        choice = replace(choice, half_width=_half_widths(program, log_worst))
    return Start(program.join(choice), parameters, tightest)


def _half_widths(program: Program, log_worst: Callable[[Array], float]) -> Array:
    """(K,) in the proportions of the trace bound's optimum, scaled to meet the limits (or to spend the cost limit).

    Minimising ``sum w h^-n`` under ``sum |g|^2 h^2 <= const`` gives ``h ~ (n w / |g|^2)^(1 / (n + 2))``.
    """
    problem = program.problem
    low, high = problem.lower, problem.upper
    if problem.objective == "scaling":
        shape = program.present_width
        ends = np.exp(np.concatenate(width_bounds(problem, program.present_width)))
        low, high = shape * ends[0], shape * ends[1]
    else:
        lever = np.max([np.linalg.norm(term.free_gain, axis=0) for term in program.terms], axis=0)
        exponent = np.array([free.price.exponent for free in problem.half_widths])
        weight = np.array([free.price.weight for free in problem.half_widths])
        pull = exponent * weight / np.maximum(lever, 1e-12) ** 2
        shape = np.where(lever > 0, pull ** (1 / (exponent + 2)), np.inf)

    def excess(log_scale: float) -> float:
        half_width = np.clip(np.exp(log_scale) * shape, low, high)
        if problem.cost_limit is not None:
            return problem.cost_limit * 1.02 - problem.cost(half_width)
        return log_worst(half_width) - 2 * log(BELOW)

    return np.asarray(np.clip(np.exp(largest_within(excess, -40.0, 40.0, 1e-10)) * shape, low, high))


def largest_within(excess: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Largest argument in [low, high] at which a rising function is not above zero, to a tolerance; else ``low``."""

    def finite_or_above(argument: float) -> float:
        value = excess(argument)
        return value if value < inf else inf  # what is no number is beyond

    if finite_or_above(high) <= 0:
        return high
    if finite_or_above(low) > 0:
        return low
    return max(low, float(brentq(finite_or_above, low, high, xtol=tolerance)) - 2 * tolerance)
