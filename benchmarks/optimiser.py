"""The optimiser's search against peers on the same problem, and the whole of an optimisation.

Twelve fiducials in a box and six rotational half-widths: layout and half-widths of least ``sum 1/h`` with the closed
form of P95 within its limit, spacing in space and in both images, and clearance from the target's image.  The peers
work on the same model, as fast as floats go: they see the gains that the score runs, with closed form and rules
compiled beside them (``placement_model.py``).  Each is handed what serves it best:

- SLSQP (SciPy) moves layout and half-widths together, scaled as ours, with forward differences taken in compiled code.
  It starts again and again from uniformly random layouts, with the cheapest half-widths there where there are any;
- the same with what a user would write: the quantile by the library's own functions, differences by SciPy;
- differential evolution (SciPy) moves the layout alone: the cheapest half-widths follow from it, so six dimensions
  and the limit drop out.  Breaking a rule costs more than anything that keeps them, and more the more it breaks.  The
  first members keep all rules; a converged population starts again.  Its settings did best of 13 that were tried;
- random search draws layouts that keep every rule, fiducial by fiducial, and takes the cheapest half-widths.

Times are process CPU seconds.  An answer counts only if :func:`is_feasible` says so, which goes through the score's
linear model and NumPy instead of the kernels here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize

from bench import ROOT, Figure, Findings, watch_load
from optimise_scenes import oracle_problem
from placement_model import (
    Answer,
    Task,
    constraints,
    evaluate,
    evaluate_all,
    is_feasible,
    quantile_mm,
    random_layout,
    rules,
    slopes,
    task_of,
)
from tailstack import load_design, optimise
from tailstack.geometry.arrays import Array
from tailstack.optimisation import PlacementProblem
from tailstack.optimisation.search import search
from tailstack.optimisation.terms import terms_of

DEMO = ROOT / "examples" / "demo.yaml"


MEMBERS = 40
STRATEGY = {"strategy": "currenttobest1bin", "mutation": (0.3, 0.8), "recombination": 0.7}


def least_cost(answers: list[Answer], seconds: float) -> float:
    """Of the answers found by then; inf if there were none."""
    return min((answer.cost for answer in answers if answer.seconds <= seconds), default=np.inf)


def time_to(answers: list[Answer], cost: float) -> float:
    """CPU seconds to an answer that costs no more; inf if there is none."""
    return min((answer.seconds for answer in answers if answer.cost <= cost), default=np.inf)


def _drawn(task: Task, seed: int) -> Array:
    """(N, 3) mm: a random layout that keeps every rule."""
    return random_layout(seed, task.count, task.low_mm, task.high_mm, task.scene)


def slsqp(task: Task, seed: int, seconds: float) -> list[Answer]:
    """Multistarted from uniformly random layouts, everything compiled."""
    args = (task.low_mm, task.high_mm, task.scene)
    return _multistart(task, seed, seconds, {"fun": constraints, "jac": slopes, "args": args})


def slsqp_on_library(task: Task, seed: int, seconds: float) -> list[Answer]:
    """The same with the quantile by the library's functions and SciPy's differences."""
    (demand,) = task.problem.demands
    term = terms_of(task.problem, demand)

    def fun(x: Array) -> Array:
        layout, half_width = _parts(task, x)
        quantile = quantile_mm(task.problem, term, layout, half_width)
        kept = rules(layout, task.scene[0], task.scene[1], *task.scene[10:])
        return np.append(2 * np.log(demand.requirement.limit / quantile), kept)

    return _multistart(task, seed, seconds, {"fun": fun})


def _parts(task: Task, x: Array) -> tuple[Array, Array]:
    """Layout (N, 3) mm and half-widths (K,) rad of SLSQP's variables."""
    scaled = x[: 3 * task.count].reshape(-1, 3)
    layout = (task.low_mm + task.high_mm) / 2 + (task.high_mm - task.low_mm) / 2 * scaled
    return layout, np.exp(x[3 * task.count :])


def _multistart(task: Task, seed: int, seconds: float, held: dict[str, Any]) -> list[Answer]:
    began = time.process_time()
    rng = np.random.default_rng(seed)
    low, high = np.log(task.problem.lower), np.log(task.problem.upper)
    split = 3 * task.count
    bounds = Bounds(np.concatenate([-np.ones(split), low]), np.concatenate([np.ones(split), high]))

    def log_cost(x: Array) -> tuple[float, Array]:
        each = np.exp(-x[split:])
        return float(np.log(each.sum())), np.concatenate([np.zeros(split), -each / each.sum()])

    def stop(_: Array) -> None:
        if time.process_time() - began > seconds:
            raise StopIteration

    answers: list[Answer] = []
    while time.process_time() - began < seconds:
        x = np.concatenate([rng.uniform(-1, 1, split), low])
        x[split:] = np.log(evaluate(_parts(task, x)[0], task.scene)[1])
        found = minimize(
            log_cost, x, jac=True, bounds=bounds, constraints=[{"type": "ineq"} | held], method="SLSQP", callback=stop,
            options={"maxiter": 300, "ftol": 1e-8},
        )  # fmt: skip
        layout, half_width = _parts(task, found.x)
        answers.append(Answer(time.process_time() - began, float((1 / half_width).sum()), layout, half_width))
    return answers


def evolution(task: Task, seed: int, seconds: float) -> list[Answer]:
    """Differential evolution of the layout, started again when a population has converged."""
    began = time.process_time()
    answers: list[Answer] = []
    bounds = list(zip(np.tile(task.low_mm, task.count), np.tile(task.high_mm, task.count), strict=True))

    def costs(population: Array) -> Array:
        layouts = np.ascontiguousarray(population.T).reshape(-1, task.count, 3)
        found = evaluate_all(layouts, task.scene)
        best = int(found.argmin())
        if found[best] < 1e6 and (not answers or found[best] < answers[-1].cost):
            half_width = evaluate(layouts[best], task.scene)[1]
            answers.append(Answer(time.process_time() - began, float(found[best]), layouts[best].copy(), half_width))
        return found

    def over(*_: object, **__: object) -> bool:
        return time.process_time() - began >= seconds

    rng = np.random.default_rng(seed)
    while not over():
        layouts = [_drawn(task, int(rng.integers(2**31))).ravel() for _ in range(MEMBERS)]
        differential_evolution(
            costs, bounds, maxiter=1_000_000, init=np.array(layouts), vectorized=True, updating="deferred",
            polish=False, callback=over, rng=rng, **STRATEGY,
        )  # fmt: skip
    return answers


def random_search(task: Task, seed: int, seconds: float) -> list[Answer]:
    """Random layouts that keep every rule, the cheapest kept."""
    began = time.process_time()
    answers: list[Answer] = []
    for number in range(seed * 10**7, (seed + 1) * 10**7):
        if time.process_time() - began >= seconds:
            break
        layout = _drawn(task, number)
        cost, half_width = evaluate(layout, task.scene)
        if cost < 1e6 and (not answers or cost < answers[-1].cost):
            answers.append(Answer(time.process_time() - began, float(cost), layout, half_width))
    return answers


PEERS: dict[str, Callable[[Task, int, float], list[Answer]]] = {
    "SLSQP, compiled": slsqp,
    "SLSQP on the library": slsqp_on_library,
    "differential evolution": evolution,
    "random search": random_search,
}


def optimiser() -> Findings:
    """The reference problem of 12 fiducials by the closed form: our 16 starts, and each peer for as long.

    One thread each, CPU time; our search is run again before each peer, with another seed.
    """
    problem = oracle_problem(12)
    task = task_of(problem)
    run_search(problem, seed=0)
    for peer in PEERS.values():
        peer(task, 1, 0.01)  # compiled
    ours: list[list[Answer]] = []
    answers: dict[str, list[Answer]] = {}
    with watch_load() as load:
        for seed, (name, peer) in enumerate(PEERS.items()):
            ours.append(run_search(problem, seed))
            found = peer(task, seed, ours[-1][-1].seconds)
            answers[name] = [answer for answer in found if is_feasible(task, answer)]
    if not all(is_feasible(task, run[-1]) for run in ours):
        raise RuntimeError("an answer of our own breaks a rule")
    seconds, cost = median(run[-1].seconds for run in ours), median(run[-1].cost for run in ours)
    best = min(least_cost(found, np.inf) for found in answers.values())
    figures = [
        Figure("cost, median of the seeds", cost),
        Figure("worst seed above the best by any peer", _percent(max(run[-1].cost for run in ours), best), "%"),
        Figure("CPU time, one thread", seconds, "s"),
        Figure("to within 1 % of that cost", median(time_to(run, 1.01 * cost) for run in ours), "s"),
    ]
    for name, found in answers.items():
        figures.append(Figure(f"{name}: above ours", _percent(least_cost(found, np.inf), cost), "%"))
        figures.append(Figure(f"{name}: to within 1 % of ours (inf: never)", time_to(found, 1.01 * cost), "s"))
    design, began = load_design(DEMO), time.perf_counter()
    result = optimise(design, starts=16)
    figures.append(Figure("optimise the demo, 16 starts, verified, wall", time.perf_counter() - began, "s"))
    figures.append(Figure("starts of it that converged", result.certificate.converged_starts))
    return Findings([_percent(cost, best)], load.foreign, figures)


def _percent(cost: float, reference: float) -> float:
    """How far a cost is above a reference."""
    return 100 * (cost / reference - 1)


def run_search(problem: PlacementProblem, seed: int) -> list[Answer]:
    """When each start of a search was done, and last of all the polished best."""
    began = time.process_time()
    steps: list[tuple[float, float]] = []

    def note(_stage: str, _done: int, _total: int, least: float | None) -> None:
        steps.append((time.process_time() - began, np.inf if least is None else least))

    found = search(problem, starts=16, seed=seed, threads=1, progress=note)
    seconds = time.process_time() - began
    best = found.program.split(found.iterates[0].point.x)
    # The layouts of single starts are not told: only the last answer is complete, and judged.
    on_the_way = [Answer(at, least, best.fiducials_mm, best.half_width) for at, least in steps]
    return [*on_the_way, Answer(seconds, problem.cost(best.half_width), best.fiducials_mm, best.half_width)]
