"""The reference placement problem as arrays, with compiled kernels for its model, and a judge of answers without them.

The kernels run on the gains that the score runs; the closed form of P95, the rules of the layout and the cheapest
half-widths of a layout are written out for just this problem: one target, no bias, uniform half-widths priced 1/h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import ndtri

from tailstack.geometry.arrays import Array
from tailstack.optimisation import PlacementProblem
from tailstack.optimisation.exact_law import closed_form_mm, image_parts
from tailstack.optimisation.problem import Choice, apply_choice, present_choice
from tailstack.optimisation.regions import BoxRegion
from tailstack.optimisation.terms import DemandTerms, pivot_shift_of, terms_of
from tailstack.propagation.linear import linearise
from tailstack.propagation.noise import Estimation, eliminate_for, gains_after, room_for, room_for_gains
from tailstack.system import Law

FEASIBLE = 1e-6  # relative (mm on the box): by how much an answer may miss a limit or a rule
PIXEL = 1e-3  # likewise in the images


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """The problem as arrays; ``scene`` is what every kernel below takes."""

    problem: PlacementProblem
    low_mm: Array  # (3,) of the box
    high_mm: Array
    scene: tuple[Array | float, ...]

    @property
    def count(self) -> int:
        return len(self.problem.system.fiducials_mm)


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A layout with half-widths, and when it was found."""

    seconds: float
    cost: float
    fiducials_mm: Array  # (N, 3)
    half_width: Array  # (K,) rad


def task_of(problem: PlacementProblem) -> Task:
    """For one quantile without bias, uniform half-widths priced 1/h, one box whose whole volume is in every image."""
    (demand,) = problem.demands
    term = terms_of(problem, demand)
    estimator = problem.estimation
    box = problem.places[0].region
    assert isinstance(box, BoxRegion)
    assert all(source.law is Law.UNIFORM and source.free is not None for source in term.sources)
    assert not term.bias_mm.any()
    assert not problem.system.manufacturing_std_mm.any()
    grid = np.array(np.meshgrid(*zip(box.low_mm, box.high_mm, strict=True))).reshape(3, -1).T
    assert all(margins[2] >= 0 for margins in _margins(problem, grid))
    limits = (
        demand.requirement.limit, float(ndtri(demand.requirement.quantile)), problem.min_spacing_mm,
        problem.min_projected_spacing_px, problem.target_clearance_px,
    )  # fmt: skip
    scene = (
        np.ascontiguousarray(estimator.projections), term.reconstructed_mm[0], np.array(term.to_error),
        *np.ascontiguousarray(estimator.imaging.estimation.noise.T), np.ascontiguousarray(term.free_gain.T),
        problem.lower, problem.upper, *limits,
    )  # fmt: skip
    return Task(problem, np.array(box.low_mm), np.array(box.high_mm), scene)


def _margins(problem: PlacementProblem, points: Array) -> list[tuple[float, float, float]]:
    """Per view: least distance between images less its bound, of an image from the target's, and from the edge, px."""
    (demand,) = problem.demands
    found = []
    first, second = np.triu_indices(len(points), 1)
    for view in problem.system.views:
        seen = np.vstack([points, demand.targets[0].position_mm]) @ view.projection[:, :3].T + view.projection[:, 3]
        images, target = (seen[:, :2] / seen[:, 2:])[:-1], seen[-1, :2] / seen[-1, 2]
        edge = np.array(view.image_size_px) - 1 - problem.image_margin_px
        found.append((
            float(np.linalg.norm(images[first] - images[second], axis=1).min()) - problem.min_projected_spacing_px,
            float(np.linalg.norm(images - target, axis=1).min()) - problem.target_clearance_px,
            float(min((images - problem.image_margin_px).min(), (edge - images).min())),
        ))  # fmt: skip
    return found


def is_feasible(task: Task, answer: Answer) -> bool:
    """Whether an answer keeps every rule and its closed form, by the score's linear model, is within the limit."""
    problem, layout, half_width = task.problem, answer.fiducials_mm, answer.half_width
    (demand,) = problem.demands
    quantile = quantile_mm(problem, terms_of(problem, demand), layout, half_width)
    first, second = np.triu_indices(len(layout), 1)
    apart = np.linalg.norm(layout[first] - layout[second], axis=1).min()
    low, high = problem.lower, problem.upper
    return bool(
        (layout >= task.low_mm - FEASIBLE).all()
        and (layout <= task.high_mm + FEASIBLE).all()
        and (half_width >= low * (1 - FEASIBLE)).all()
        and (half_width <= high * (1 + FEASIBLE)).all()
        and apart >= problem.min_spacing_mm * (1 - FEASIBLE)
        and min(min(margins) for margins in _margins(problem, layout)) >= -PIXEL
        and quantile <= demand.requirement.limit * (1 + FEASIBLE)
        and abs(problem.cost(half_width) / answer.cost - 1) <= FEASIBLE
    )


def quantile_mm(problem: PlacementProblem, term: DemandTerms, layout: Array, half_width: Array) -> float:
    """The closed form by the score's linear model."""
    choice = Choice(layout, half_width, present_choice(problem).pivots_mm)
    images = image_parts(
        linearise(apply_choice(problem, choice), term.demand.targets[0]), term.demand.requirement.error
    )
    return closed_form_mm(term, images, half_width, pivot_shift_of(problem, choice), np.zeros(0))


@njit(cache=True, error_model="numpy")
def image_covariance(layout, projections, target, to_error, fiducial_px, target_px):
    """(3, 3) mm^2 of image noise in the frame of the error."""
    views, count = projections.shape[0], layout.shape[0]
    gains = room_for_gains(layout, np.zeros((views, 2, 2)))
    dlt = Estimation(0, 0, np.zeros((views, 3)), np.zeros((views, 2)), np.zeros((0, 2, 2, 2)))
    seen, eliminated = np.ones((views, count)), room_for(views, layout)
    eliminate_for(dlt, projections, layout, seen, eliminated)
    gains_after(eliminated, projections, layout, seen, dlt, target, gains)
    fiducial, aim = gains.fiducial, gains.target
    total = np.zeros((3, 3))
    for v in range(views):
        for r in range(3):
            for s in range(3):
                for c in range(2):
                    total[r, s] += target_px[v] ** 2 * aim[v, r, c] * aim[v, s, c]
                    for i in range(count):
                        total[r, s] += fiducial_px[v] ** 2 * fiducial[v, i, r, c] * fiducial[v, i, s, c]
    return to_error @ total @ to_error.T


@njit(cache=True, error_model="numpy")
def squared_quantile(noise, levers, half_width, normal):
    """Pearson's shifted chi-square on three cumulants, Wilson and Hilferty's cube; uniform sources."""
    s = noise.copy()
    for k in range(levers.shape[0]):
        for i in range(3):
            for j in range(3):
                s[i, j] += half_width[k] ** 2 / 3 * levers[k, i] * levers[k, j]
    c1, c2, c3 = 0.0, 0.0, 0.0
    for i in range(3):
        c1 += s[i, i]
        for j in range(3):
            c2 += s[i, j] ** 2
            for k in range(3):
                c3 += s[i, j] * s[j, k] * s[k, i]
    for k in range(levers.shape[0]):
        size, along = 0.0, 0.0
        for i in range(3):
            size += levers[k, i] ** 2
            for j in range(3):
                along += levers[k, i] * s[i, j] * levers[k, j]
        k4, k6 = -2 / 15 * half_width[k] ** 4, 16 / 63 * half_width[k] ** 6
        c2 += k4 / 2 * size**2
        c3 += (12 * k4 * size * along + k6 * size**3) / 8
    root = np.sqrt(c2)
    skew = c3 / (c2 * root)
    b = np.sqrt(2) / 3 * normal - skew * (2 / 9)
    return c1 + root * b * (3 + 3 * skew * b + (skew * b) ** 2)


@njit(cache=True, error_model="numpy")
def cheapest_half_widths(noise, levers, low, high, limit, normal):
    """(half-widths of least ``sum 1/h`` at the limit, squared quantile at the smallest ones).

    Stationarity is ``h_k^3 = const / (dr^2/d h_k^2)``.  The right-hand side hardly depends on h, so it is iterated, and
    each time the constant found that meets the limit (Newton in its square, where r^2 is nearly affine).
    """
    smallest = squared_quantile(noise, levers, low, normal)
    if not smallest < limit**2:
        return low.copy(), smallest
    if squared_quantile(noise, levers, high, normal) <= limit**2:
        return high.copy(), smallest
    count = levers.shape[0]
    shape = np.empty(count)
    for k in range(count):
        shape[k] = max((levers[k] ** 2).sum(), 1e-12) ** (-1 / 3)
    scale = 0.5 * limit / np.sqrt(((levers**2).sum(axis=1) * shape**2).max())
    before = half_width = low.copy()
    for _ in range(20):
        below, above = 0.0, np.inf
        for _ in range(60):
            half_width = np.minimum(np.maximum(scale * shape, low), high)
            over = squared_quantile(noise, levers, half_width, normal) - limit**2
            if abs(over) < 1e-12 * limit**2:
                break
            if over > 0:
                above = scale
            else:
                below = scale
            nearby = np.minimum(np.maximum(scale * (1 + 1e-6) * shape, low), high)
            slope = (squared_quantile(noise, levers, nearby, normal) - limit**2 - over) / (2e-6 * scale**2)
            squared = scale**2 - over / slope if slope > 0 else np.nan
            scale = np.sqrt(squared) if squared > 0 else np.nan
            if not (below < scale < above):
                scale = np.sqrt(max(below, 1e-9 * above) * above) if above < np.inf else 2 * below
        settled = (np.abs(half_width / before - 1) < 1e-6).all()
        before = half_width
        if settled:
            break
        for k in range(count):
            step = half_width.copy()
            step[k] *= 1 + 1e-5
            rise = squared_quantile(noise, levers, step, normal)
            step[k] = half_width[k] * (1 - 1e-5)
            rise -= squared_quantile(noise, levers, step, normal)
            shape[k] = max(rise / (4e-5 * half_width[k] ** 2), 1e-12) ** (-1 / 3)
    return half_width * (1 - 1e-9), smallest


@njit(cache=True, error_model="numpy")
def rules(layout, projections, target, spacing_mm, spacing_px, clearance_px):
    """Squared distances over their bounds, less one: in space, in each image, and from the target's image; >= 0."""
    count, views = layout.shape[0], projections.shape[0]
    pairs = count * (count - 1) // 2
    found = np.empty(pairs * (1 + views) + count * views)
    at = 0
    for i in range(count):
        for j in range(i):
            found[at] = ((layout[i] - layout[j]) ** 2).sum() / spacing_mm**2 - 1
            at += 1
    images = np.empty((count + 1, 2))
    for v in range(views):
        for i in range(count + 1):
            point = layout[i] if i < count else target
            depth = projections[v, 2, 3]
            for k in range(3):
                depth += projections[v, 2, k] * point[k]
            for r in range(2):
                images[i, r] = projections[v, r, 3]
                for k in range(3):
                    images[i, r] += projections[v, r, k] * point[k]
                images[i, r] /= depth
        for i in range(count + 1):
            for j in range(i):
                least = spacing_px if i < count else clearance_px
                gap = (images[i, 0] - images[j, 0]) ** 2 + (images[i, 1] - images[j, 1]) ** 2
                found[at] = gap / least**2 - 1
                at += 1
    return found


@njit(cache=True, error_model="numpy")
def evaluate(layout, scene):
    """(cost, half-widths) of a layout: what it costs at best, or 1e6 and more where it cannot be used."""
    projections, target, to_error, fiducial_px, target_px, levers, low, high, limit, normal, mm, px, clear = scene
    broken = 0.0
    for value in rules(layout, projections, target, mm, px, clear):
        broken += max(0.0, -value)
    if broken > 0:
        return 1e9 * (1 + broken), low.copy()
    noise = image_covariance(layout, projections, target, to_error, fiducial_px, target_px)
    half_width, smallest = cheapest_half_widths(noise, levers, low, high, limit, normal)
    if not smallest < limit**2:
        return min(1e6 * smallest / limit**2, 1e9), low.copy()
    return (1 / half_width).sum(), half_width


@njit(cache=True, error_model="numpy")
def evaluate_all(layouts, scene):
    costs = np.empty(layouts.shape[0])
    for m in range(layouts.shape[0]):
        costs[m] = evaluate(layouts[m], scene)[0]
    return costs


@njit(cache=True, error_model="numpy")
def constraints(x, low_mm, high_mm, scene):
    """Of layout and logarithms of half-widths: log of limit over quantile, then the rules; >= 0."""
    projections, target, to_error, fiducial_px, target_px, levers, low, _, limit, normal, mm, px, clear = scene
    split = x.size - low.size
    layout = (low_mm + high_mm) / 2 + (high_mm - low_mm) / 2 * x[:split].copy().reshape((split // 3, 3))
    kept = rules(layout, projections, target, mm, px, clear)
    found = np.empty(1 + kept.size)
    noise = image_covariance(layout, projections, target, to_error, fiducial_px, target_px)
    found[0] = 2 * np.log(limit) - np.log(squared_quantile(noise, levers, np.exp(x[split:]), normal))
    found[1:] = kept
    return found


@njit(cache=True, error_model="numpy")
def slopes(x, low_mm, high_mm, scene):
    """(rows, variables) of :func:`constraints` by forward differences."""
    here = constraints(x, low_mm, high_mm, scene)
    found = np.empty((here.size, x.size))
    for k in range(x.size):
        moved = x.copy()
        moved[k] += 1e-7
        found[:, k] = (constraints(moved, low_mm, high_mm, scene) - here) / 1e-7
    return found


@njit(cache=True, error_model="numpy")
def random_layout(seed, count, low_mm, high_mm, scene):
    """Uniform in the box, fiducial by fiducial: drawn again where it breaks a rule with those before it."""
    projections, target, mm, px, clear = scene[0], scene[1], scene[10], scene[11], scene[12]
    np.random.seed(seed)
    layout = np.empty((count, 3))
    i = 0
    while i < count:
        for k in range(3):
            layout[i, k] = np.random.uniform(low_mm[k], high_mm[k])
        if rules(layout[: i + 1], projections, target, mm, px, clear).min() >= 0:
            i += 1
    return layout
