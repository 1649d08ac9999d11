"""How good any layout could be: a lower bound of a quantile over every layout of the envelope, proven to first order.

An estimate that is exact where images are has, whatever its law, a covariance of at least the inverse of the
information that the images hold (Gauss and Markov).  With the target and the unknowns of all views as one vector t,

    F = F0 + sum over beads of J(x)' R(x)^-1 J(x),     S >= M^-1,     a' M a = least z' F z of z whose target part is a

so for any z of that kind, chosen well or badly, ``a' M a <= U = z' F0 z + sum over beads of most phi_z(x)``,
phi_z(x) = z' J' R^-1 J z: no layout knows more than U along a.  F0: the target's own images.  Of beads that are kept
apart at most one lies in a cell narrower than that, so the N largest cells count; else N times the largest.

*From directions to a covariance.*  h(a) = largest sqrt(a' M a) over all layouts is a norm, at most 1 at each
``v = a / sqrt U``; so it is on the triangles between neighbours of a net of them, and their planes f . x = 1 cut off no
more.  A symmetric L with ``f' L f <= 1`` for each of them is therefore below every layout's S.

*From a covariance to the quantile.*  What is independent of a sum of normal, uniform and triangular laws only moves
mass out of a ball about its centre (Anderson 1955), and so does a larger normal part: the exact quantile of the law
with L in place of S, and without what cannot be bounded, is a lower bound.  A known bias b that no layout moves is kept
at another level: ``P(|b + X + Y| <= r) <= (1 + P(|b + X| <= r)^2) / 2`` for log-concave symmetric X and any symmetric Y
(Prekopa), so ``r_p`` with Y is at least ``r_q`` without, q = sqrt(2 p - 1).  What L leaves of the images, uniform
manufacturing errors too, has a mean square that no layout is below, and that raises the quantile (``chance_bound``).

*In floating point.*  z, L and the net are floats that need not be the best ones; what has to hold is enclosed: phi over
a cell by its Taylor polynomial with every remainder bounded, and rounding by the sums of absolute values
(``docs/certificate.md``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from math import inf, isfinite, sqrt
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..contributors import Columns, law_of, value_of
from ..errors import IllPosedError
from ..geometry.arrays import Array, frozen
from ..geometry.rotation import rigid_transform, skew
from ..laws import KIND
from ..results import GlobalBound
from ..results.digits import at_most, number
from ..system import Law, Place
from ..tail.declared import SAMPLED_METHOD, LinearLaw, law_quantile, mixture_gradient
from .chance_bound import raise_quantile
from .enclosure import Forms, ViewTurns, enclose
from .exact_law import evaluate_demand, quantiles_of
from .mixture import MixedParts, information_by_rows, mix, told_by_rows, whiten_rows
from .problem import Choice, PlacementProblem
from .regions import GRID_MM, BoxRegion, Cylinder, Shape, bounding_box, contains, distinct
from .surface import NearSurface
from .terms import DemandTerms

FREQUENCY = 6  # of the net of directions: 4 n^2 + 2 of them, half of them opposite
NARROWER = 0.99  # of the spacing: how wide a cell is from corner to corner
MOST_CELLS, MOST_NUMBERS = 20_000, 2e7  # of all regions, and of the slopes there: beyond, cells are wider
WITHOUT_SPACING = 12  # cells along an axis where beads are not kept apart
EIGHT = np.array(list(product((-1.0, 1.0), repeat=3)))  # (8, 3) corners of a cell, and centres of its parts
ROUNDS, AGAIN, UPDATES = 14, 9, 2  # layouts added for the first direction, and for each next; updates of their shares
MIXED, IMPROVED = 40, 3  # the same of one mixture for all directions
MEAN_ERROR = 1e-6  # relative, of a mean over a law
WEIGHED = 100  # updates of the weights of candidates
SAID = 5  # digits of the bound, rounded down: as many as every machine agrees on
THIN, THICKER = 1e-4, 0.1  # of the net's covariance along some direction, and how much of that is taken
INSIDE, INSIDE_ERROR = 1 - 1e-9, 1e-11  # how far L stays within its planes, and how far these may be rounded
REACH_MM, REACH_PX = 100.0, 500.0  # sizes of a layout and of its images, for unknowns of about one size
LAST_BARRIER, WORST_CONDITION = 1e-5, 1e12
SAMPLED = "the quantile of so many laws that are not normal is sampled"


class AlikeBeads(NamedTuple):
    """Beads that are alike: each, followed by its copies, anywhere in one region."""

    number: int
    region: Shape
    copies: tuple[Array, ...]  # (4, 4) each: from con to where the estimator takes a copy to be
    sees: NDArray[np.bool_]  # (copies, V) whether a view's estimate uses it
    made_mm: Array  # (copies, 3, 3) by which unit normal errors of a copy are multiplied; 0: they are not counted


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """What images can tell of one target: projections, slopes of views, noise."""

    projections: Array  # (V, 3, 4), images from that of the target
    tangents: tuple[Array, ...]  # (D_v, 3, 4) each: changes of a projection that the estimator seeks
    sizes: tuple[Array, ...]  # the same of their absolute terms
    whiten: Array  # (2, V, 2, 2): of fiducials and target, 1/px
    target_mm: Array  # (3,) as the estimator sees it
    beads: tuple[AlikeBeads, ...]
    spacing_mm: float  # between any two
    turns: ViewTurns  # what else views may look at

    @property
    def unknowns(self) -> int:
        """D: of the target and of all views."""
        return 3 + sum(len(each) for each in self.tangents)

    def changes(self, z: Array) -> Iterator[tuple[Array, Array]]:
        """For each view, what unknowns z (K, D) do to its projection, (K, 3, 4), and the sum of the absolute terms."""
        first = 3
        for tangents, sizes in zip(self.tangents, self.sizes, strict=True):
            own = z[:, first : first + len(tangents)]
            yield np.einsum("kd,dab->kab", own, tangents), np.einsum("kd,dab->kab", np.abs(own), sizes)
            first += len(tangents)


class NoBound(ValueError):
    """A hypothesis of the bound does not hold: which, in a sentence."""


class QuantileBound(NamedTuple):
    """What no layout within the envelope undercuts."""

    value_mm: float
    bias_in_words: str  # what became of what is known; empty where nothing is
    counts_made: bool = False  # whether manufacturing errors that are not normal are counted, by their mean square


class ImagesBound(NamedTuple):
    """What the images of no layout leave less than."""

    net: Net
    least: Callable[[Array], float]  # mm^2 that ``trace(weight S)`` is not below, weight (3, 3), whatever the laws
    remark: str = ""  # how it was found, as sentences; may be empty


class Looks(Protocol):
    """Which way views may look."""

    @property
    def words(self) -> str:
        """What a bound holds for beside tolerances and pivots."""

    def bound_images(self, problem: PlacementProblem, term: DemandTerms, half_width: Array) -> ImagesBound:
        """Of one demand, for half-widths (K,) about these.  Raises NoBound."""


@dataclass(frozen=True, slots=True)
class AsTheyLook:
    """Views that stay."""

    words: str

    def bound_images(self, problem: PlacementProblem, term: DemandTerms, half_width: Array) -> ImagesBound:
        net = net_of(problem, term)
        return ImagesBound(net, lambda weight: least_mean_square(*every_law_in(problem, term), weight))


AS_THEY_LOOK = AsTheyLook("views")


def bound_quantile(
    bound: ImagesBound, problem: PlacementProblem, term: DemandTerms, half_width: Array
) -> QuantileBound:
    """Proven to first order: at these half-widths (K,) no layout within the envelope has a smaller quantile.

    bound: of what images leave.  Raises NoBound, with the reason.
    """
    requirement, bias, moved = term.demand.requirement, term.bias_mm, is_bias_moved(problem)
    images = fit_images(bound.net, term, half_width)
    if term.demand.is_nested:
        return _bound_units(term, half_width, images, moved)
    law = law_with(term, half_width, images)
    if (value := value_of(requirement)) is None:

        def known(weight: Array) -> float:
            return bound.least(term.to_error.T @ weight @ term.to_error) - float((weight * images).sum())

        return _bound_pooled(law, requirement.quantile, bias, moved, known)
    sure_quantile(law, requirement.quantile)  # where that is sampled, so is the mean
    # A mean of |e|, over all shots or the worst of them, is convex: what is independent of it only adds (Jensen).
    law = law if moved else replace(law, mean=bias)
    return QuantileBound(value(law) * (1 - MEAN_ERROR), ", without the known bias" if moved else "")


def _bound_pooled(
    law: LinearLaw, p: float, bias: Array, moved: bool, known: Callable[[Array], float] | None = None
) -> QuantileBound:
    """Of the quantile of a law about 0, with a bias (3,) mm and whatever is independent besides; known: of what is in
    any case, the least mean square (``chance_bound``)."""
    bare_mm = least_mm = least_quantile(law, p)
    if known is not None:
        least_mm = raise_quantile(law, p, bare_mm, known, spread_directions(FREQUENCY))
    if bias.any() and not moved and p > 0.5:
        level = p if not law.columns.any() else sqrt(2 * p - 1)
        with_bias = least_quantile(replace(law, mean=bias), level)
        if with_bias > least_mm:
            at = "" if level == p else f", computed at P{100 * level:.2f} so that it holds with the known bias"
            return QuantileBound(with_bias, at)
    return QuantileBound(least_mm, ", without the known bias" if bias.any() or moved else "", least_mm > bare_mm)


def _bound_units(term: DemandTerms, half_width: Array, images: Array, moved: bool) -> QuantileBound:
    """Of what a fraction of units (or of mountings) keep their own quantile within.

    The shots of a unit have a normal part that is no narrower in any direction than a round one, so a unit that is
    further off than where that one's quantile is r has a larger one (Ehrhard); and a fraction is that far off by what
    units hold.
    """
    p, columns = term.demand.requirement.quantile, columns_with(term, half_width)
    held = np.array([source.held for source in term.sources], dtype=bool)
    shots = law_of(np.zeros(3), columns.only(~held))
    shots = replace(shots, covariance=shots.covariance + images)
    far = _bound_pooled(
        law_of(np.zeros(3), columns.only(held)), term.demand.fraction, term.bias_mm, moved or bool(term.at_ends)
    )
    round_mm2 = np.linalg.eigvalsh(shots.covariance)[0] * INSIDE * np.eye(3)
    about = replace(shots, mean=np.array([far.value_mm, 0.0, 0.0]), covariance=round_mm2, columns=shots.columns * 0.0)
    return far._replace(value_mm=max(least_quantile(about, p), least_quantile(shots, p)))


def fit_images(net: Net, term: DemandTerms, half_width: Array) -> Array:
    """(3, 3) mm^2 in the frame of the error, below what the images add at any layout: the L that the law at
    half-widths (K,) feels most."""
    return _fit_images(net, term, tuple(half_width.tolist()))


@lru_cache(maxsize=16)
def _fit_images(net: Net, term: DemandTerms, widths: tuple[float, ...]) -> Array:
    half_width = np.array(widths)
    to_error, least = term.to_error, net.metric
    for _ in range(2):  # which L is best depends on the law that it makes
        slopes = slopes_by_images(term, half_width, to_error @ least @ to_error.T)
        least = thicken(net, fit_below(net, to_error.T @ slopes @ to_error))
    return frozen(np.asarray(to_error @ least @ to_error.T))


def thicken(net: Net, least: Array) -> Array:
    """L (3, 3) mm^2 below the covariance of every layout, with some of the net's own where it has nearly no extent in a
    direction: a law that lies in a plane has no chances in space (``raise_quantile``)."""
    root = np.linalg.inv(np.linalg.cholesky(net.metric))
    if np.linalg.eigvalsh(root @ least @ root.T)[0] > THIN:
        return least
    round_mm2 = net.metric * INSIDE / np.einsum("fa,ab,fb->f", net.planes, net.metric, net.planes).max()
    return (1 - THICKER) * least + THICKER * np.asarray(round_mm2)


def slopes_by_images(term: DemandTerms, half_width: Array, images: Array) -> Array:
    """(3, 3) 1/mm: how what is limited feels the covariance images (3, 3) mm^2."""
    law, requirement = law_with(term, half_width, images), term.demand.requirement
    return mixture_gradient(law, quantiles_of(law, requirement), requirement.quantile).by_covariance


def net_of(problem: PlacementProblem, term: DemandTerms) -> Net:
    """Of all that a problem leaves free, for one demand.  Raises NoBound, with the reason."""
    if reason := why_none(problem, term):
        raise NoBound(reason)
    return net_about(problem, tuple(term.reconstructed_mm[0].tolist()), counts_manufacturing(problem, term))


@lru_cache(maxsize=8)
def net_about(problem: PlacementProblem, target_mm: tuple[float, ...], made: bool) -> Net:
    """That of every demand at one target."""
    return find_net(information_about(problem, np.array(target_mm), made))


def certify_layout(
    problem: PlacementProblem, terms: Sequence[DemandTerms], choice: Choice, looks: Looks = AS_THEY_LOOK
) -> GlobalBound:
    """How far the quantile nearest to its limit is from the best that any layout could reach at the half-widths of a
    choice, and at the smallest of those that are free, whichever way views may look; or why that is not known."""
    reasons = [why_none(problem, term) for term in terms]
    each = [(value_at(problem, term, choice), term) for term, no in zip(terms, reasons, strict=True) if not no]
    value, term = max(each, key=lambda pair: pair[0] / pair[1].demand.requirement.limit, default=(inf, terms[0]))
    demand, limit = term.demand, term.demand.requirement.limit
    reached = value if isfinite(value) else None
    told = GlobalBound(demand.requirement.name, demand.site.name, limit, reached, None, None, None, (), "")
    try:
        known = looks.bound_images(problem, term, choice.half_width)
        bound = bound_quantile(known, problem, term, choice.half_width)
        at_least = bound_quantile(known, problem, term, problem.lower) if problem.half_widths else None
        images = None if reached is None else _gap_of_images(known, problem, term, choice)
    except NoBound as reason:
        return replace(told, statement=f"No bound: {reason}.")
    names, least = left_out(problem, term, bound.counts_made), float(at_most(bound.value_mm, SAID))
    tightest = None if at_least is None else float(at_most(at_least.value_mm, SAID))
    gap = None if reached is None else 100 * (reached / least - 1)
    own = "" if gap is None else f"; this one has {value:.4g} mm ({number(gap, 2)} % more)"
    rest = f" Left out: {', '.join(names)}, which can only add." if names else ""
    if images is not None:
        above = number(images, 2)
        own += f"; the root mean square of what comes through its images is at most {above} % above the least"
    if least > limit:
        smallest = "" if tightest is None else f" with every free half-width at its smallest ({tightest:g} mm)"
        if tightest is not None:
            smallest = (", nor" if tightest > limit else "; it may") + smallest
        rest = f" So none keeps the limit of {limit:g} mm{smallest}.{rest}"
    statement = (
        f"To first order, no layout of {len(problem.system.fiducial_labels)} fiducials within what was asked for has, "
        f"at these tolerances, pivots and {looks.words}, {demand.text} below {least:g} mm{bound.bias_in_words}{own}. "
        f"Proven.{rest}{known.remark}"
    )
    return replace(
        told,
        lower_bound_mm=least,
        tightest_bound_mm=tightest,
        gap_percent=gap,
        images_gap_percent=images,
        left_out=names,
        statement=statement,
    )


def value_at(problem: PlacementProblem, term: DemandTerms, choice: Choice) -> float:
    """mm; infinite where the layout has no answer."""
    try:
        return evaluate_demand(problem, term, choice).exact_mm
    except IllPosedError:
        return inf


def _gap_of_images(bound: ImagesBound, problem: PlacementProblem, term: DemandTerms, choice: Choice) -> float:
    """How far the root mean square of what comes through the images of a layout is above the least of any, %, as what
    is limited feels it; covariances are bounded whatever the laws are."""
    images = evaluate_demand(problem, term, choice).images
    covariance = images.noise + images.made
    felt = slopes_by_images(term, choice.half_width, covariance)
    least = bound.least(term.to_error.T @ felt @ term.to_error)
    return float(100 * (sqrt((felt * covariance).sum() / least) - 1))


@lru_cache(maxsize=4)
def every_law_in(problem: PlacementProblem, term: DemandTerms) -> tuple[Information, tuple[Cells, ...]]:
    """What images can tell, with manufacturing errors of any law, and the cells of all fiducials."""
    information = information_of(problem, term, every_law=True)
    return information, cells_in(information)


def why_none(problem: PlacementProblem, term: DemandTerms) -> str:
    """Which hypothesis fails, as far as that is seen at once; empty where none does."""
    system, demand = problem.system, term.demand
    if not problem.places:
        return "no fiducial is free: nothing is left to the layout"
    if problem.pivots:
        return "pivots are free, and with them what acts behind the images"
    if not demand.is_point or demand.lost:
        return "only an error at a target with all fiducials is bounded"
    if demand.requirement.quantile <= 0.5 and (term.bias_mm.any() or is_bias_moved(problem)):
        return "a quantile of at most P50 is not bounded about a known bias"
    if not all(view.fiducial_noise_px > 0 and view.target_noise_px > 0 for view in system.views):
        return "images without noise can tell anything"
    return ""


def left_out(problem: PlacementProblem, term: DemandTerms, counts_made: bool = False) -> tuple[str, ...]:
    """Labels of what the bound does not count, and which can only add to it; counts_made: manufacturing errors
    are counted, by their mean square."""
    system, made = problem.system, counts_made or counts_manufacturing(problem, term)
    effects = [each for each in system.errors_of_points if not each.of_target and not made]
    names = [each.words for each in effects if not each.acts_at(Place.IMAGES)]
    names += [each.words for each in (*system.believed_errors, *system.shared_image_errors) if each is not None]
    bounded = [source.contributor for source in term.sources if source.law is Law.BOUNDED]
    return tuple(dict.fromkeys((*names, *(f"bounded components of {name}" for name in bounded))))


def counts_manufacturing(problem: PlacementProblem, term: DemandTerms) -> bool:
    """Whether manufacturing errors are part of the normal covariance that is bounded; a unit holds them."""
    return problem.system.manufacturing_law is Law.NORMAL and not term.demand.is_nested


def is_bias_moved(problem: PlacementProblem) -> bool:
    """Whether part of the known bias comes through the images, and depends on the layout."""
    system = problem.system
    moving = any(effect.known.any() for effect in system.shared_image_errors)
    return moving or any(error is not None and error.known.any() for error in system.believed_errors)


def columns_with(term: DemandTerms, half_width: Array) -> Columns:
    """Of what acts outside the images, at half-widths (K,); what is bounded has no law, and at its worse end adds."""
    widths = np.array([each.size_at(half_width) for each in term.sources])
    gains, per_width, kinds, drawn = _fixed_of(term)
    return Columns(gains, per_width * widths, widths, kinds, drawn)


@lru_cache(maxsize=64)
def _fixed_of(term: DemandTerms) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
    """What no half-width changes of the columns of a demand."""
    per_width = np.array([each.std_per_half_width for each in term.sources])
    kinds = np.array([KIND[each.law] for each in term.sources], dtype=np.int64)
    return np.ascontiguousarray(term.gains.base.T), per_width, kinds, np.zeros(len(kinds), dtype=np.int64)


def law_with(term: DemandTerms, half_width: Array, images: Array) -> LinearLaw:
    """The law about 0 of what acts outside the images, with the covariance images (3, 3) mm^2 in their place."""
    law = law_of(np.zeros(3), columns_with(term, half_width))
    return replace(law, covariance=law.covariance + images)


def sure_quantile(law: LinearLaw, p: float) -> float:
    """Less what it may be too large by.  Raises NoBound where it is sampled."""
    found = law_quantile(law, p)
    if found.method == SAMPLED_METHOD:
        raise NoBound(SAMPLED)
    return found.quantile_mm - found.error_mm


def least_quantile(law: LinearLaw, p: float) -> float:
    """The same; of a law that would be sampled that of its longest component, which is never more."""
    try:
        return sure_quantile(law, p)
    except NoBound:
        along = np.zeros((3, 3))
        along[0] = np.linalg.eigh(law.total_covariance)[1][:, 2]
        covariance = along @ law.covariance @ along.T
        line = replace(law, mean=along @ law.mean, covariance=covariance, columns=along @ law.columns)
        return sure_quantile(line, p)


def information_of(problem: PlacementProblem, term: DemandTerms, every_law: bool = False) -> Information:
    """Of the images of the target of a demand and of all fiducials, wherever they may be; with manufacturing errors of
    ``every_law``, or of those that a quantile is bounded with."""
    return information_about(problem, term.reconstructed_mm[0], every_law or counts_manufacturing(problem, term))


def information_about(problem: PlacementProblem, target: Array, with_made: bool) -> Information:
    """The same of a target (3,) mm as the estimator sees it, with manufacturing errors or without."""
    system, estimation = problem.system, problem.estimation
    turn, shift = estimation.assumed_turn, estimation.assumed_shift_mm
    noise = estimation.imaging.estimation
    whiten = np.linalg.inv(np.stack([noise.noise_of(kind) for kind in (0, 1)]))
    projections = estimation.projections.copy()
    images = np.einsum("vab,b->va", projections, np.append(target, 1.0))
    projections[:, :2] -= (images[:, :2] / images[:, 2:])[:, :, None] * projections[:, 2:]
    places = {i: place for place in problem.places for i in place.fiducials[:1]}
    copied = {i for place in problem.places for i in place.fiducials[1:]}
    assume = rigid_transform(turn, shift)
    copies = [np.eye(4), *(rigid_transform(copy.rotation, copy.shift_mm) for copy in problem.symmetry)]
    groups: dict[tuple[object, ...], AlikeBeads] = {}
    shapes: tuple[Shape, ...] = ()
    for i, position in enumerate(system.fiducials_mm):
        if i in copied:
            continue
        place = places.get(i)
        region = BoxRegion(position, position) if place is None else place.region
        each = (i,) if place is None else place.fiducials
        std = system.manufacturing_std_mm[list(each)] * with_made
        made = np.stack([turn * axis for axis in std])
        sees = system.sees[:, list(each)].T > 0
        maps = tuple(assume @ copies[k] for k in range(len(each)))
        shapes, which = distinct([*shapes, region])
        key = which[-1], sees.tobytes(), made.tobytes()
        number = groups[key].number + 1 if key in groups else 1
        groups[key] = AlikeBeads(number, region, maps, sees, made)
    known = system.estimator.believes_intrinsics
    tangents, sizes = zip(*(_tangents(known, each, target) for each in projections), strict=True)
    beads, turns = tuple(groups.values()), still(len(projections))
    return Information(projections, tangents, sizes, whiten, target, beads, problem.min_spacing_mm, turns)


def still(views: int) -> ViewTurns:
    """So many views that look where they do."""
    nothing = np.zeros(0, dtype=np.int64)
    return ViewTurns(np.zeros((0, 3, 4)), np.zeros((0, 3, 3)), nothing, np.zeros(views), np.zeros((views, 3)))


def turns_from(turns: ViewTurns, place: Array) -> ViewTurns:
    """The same in the coordinates of points that are at ``place @ (x, 1)``, (4, 4) an isometry."""
    back, whole = np.linalg.inv(place), np.zeros((len(turns.ways), 4, 4))
    whole[:, :3] = turns.ways
    pivots = turns.pivots_mm @ back[:3, :3].T + back[:3, 3]
    return turns._replace(ways=np.ascontiguousarray((back @ whole @ place)[:, :3]), pivots_mm=pivots)


def _tangents(knows_intrinsics: bool, projection: Array, origin_mm: Array) -> tuple[Array, Array]:
    """(D, 3, 4) changes of a projection (3, 4) that an estimator seeks, of a size that suits, and of absolute terms.

    With the intrinsics known a turn about the origin and a shift; otherwise all but what only scales it.
    """
    local = np.eye(4)
    local[:3] = np.column_stack([np.eye(3), -origin_mm]) / REACH_MM
    if knows_intrinsics:
        moves = np.zeros((6, 4, 4))
        moves[:3, :3] = np.stack([skew(axis) for axis in np.eye(3)]) @ local[:3]
        moves[3:, :3, 3] = np.eye(3)
        return projection @ moves, np.abs(projection) @ np.abs(moves)
    depth = float(projection[2] @ np.append(origin_mm, 1.0))
    scale = depth * np.array([1.0, 1.0, 1 / REACH_PX])
    basis = (np.eye(3)[:, None, :, None] * scale[:, None, None, None] * local[None, :, None, :]).reshape(12, 3, 4)
    coefficients = (np.linalg.solve(local.T, projection.T).T / scale[:, None]).ravel()
    across = np.linalg.svd(coefficients[None])[2][1:]
    tangents = np.einsum("da,abc->dbc", across, basis)
    return tangents, np.abs(tangents)


def forms_of(information: Information, kind: int, place: Array, sees: NDArray[np.bool_], z: Array) -> Forms:
    """What unknowns z (K, D) do to the images of a point ``place @ (x, 1)`` in the views that see it; kind: 0 of a
    fiducial, 1 of the target."""
    quadratic, size, depth, moved, moved_size, view = [], [], [], [], [], []
    for v, (change, sizes) in enumerate(information.changes(z)):
        if not sees[v]:
            continue
        head, head_size = information.projections[v] @ place, np.abs(information.projections[v]) @ np.abs(place)
        change, sizes = change @ place, sizes @ np.abs(place)
        turned, turned_size = information.projections[v][:, :3], np.abs(information.projections[v][:, :3])
        for weights in information.whiten[kind, v]:
            both, heavy = np.append(weights, 0.0), np.abs(np.append(weights, 0.0))
            form = _outer(both @ change, head[2]) - _outer(change[:, 2], both @ head)
            quadratic.append((form + np.swapaxes(form, 1, 2)) / 2)
            form = _outer(heavy @ sizes, head_size[2]) + _outer(sizes[:, 2], heavy @ head_size)
            size.append((form + np.swapaxes(form, 1, 2)) / 2)
            depth.append(head[2])
            moved.append(_outer(both @ turned, head[2]) - _outer(turned[2], both @ head))
            moved_size.append(_outer(heavy @ turned_size, head_size[2]) + _outer(turned_size[2], heavy @ head_size))
            view.append(v)
    return Forms(*(np.array(each) for each in (quadratic, size, depth, moved, moved_size, view)))


def _outer(first: Array, second: Array) -> Array:
    """(..., 4) and (4,) -> (..., 4, 4); of scalars (n,) along another axis (n, 4)."""
    return np.asarray(first[..., None] * second)


class Slopes(NamedTuple):
    """Whitened slopes of images by the unknowns, at points."""

    unknowns: Array  # (n, R, D)
    moved: Array  # (n, R, 3) by a displacement of the point, mm


def slopes_at(information: Information, kind: int, place: Array, sees: NDArray[np.bool_], points: Array) -> Slopes:
    """At points (n, 3)."""
    forms = forms_of(information, kind, place, sees, np.eye(information.unknowns))
    y = np.column_stack([points, np.ones(len(points))])
    square = ((y @ forms.depth.T) ** 2)[:, :, None]
    squares = (y[:, :, None] * y[:, None]).reshape(-1, 16)
    along = (squares @ forms.quadratic.reshape(-1, 16).T).reshape(len(y), *forms.quadratic.shape[:2])
    return Slopes(along / square, np.einsum("na,rja->nrj", y, forms.moved) / square)


class Cells(NamedTuple):
    """Where beads that are alike may be, in parts."""

    beads: AlikeBeads
    places: tuple[Array, ...]  # (4, 4) of each copy, from coordinates about the middle of the box
    centres: Array  # (n, 3) about that
    half: Array  # (3,) of a cell
    reach: Array  # (3,) of the box
    apart: bool  # whether at most one bead is in a cell
    slopes: Array  # (n, R, D) of all copies, whitened by what moves the point too, at the corners furthest out

    @property
    def evenly(self) -> Array:
        """(D, D) information of beads spread evenly over the cells."""
        return information_by_rows(self.slopes, np.full(len(self.slopes), self.beads.number / len(self.slopes)))

    def told_along(self, z: Array) -> Array:
        """(n, K) about how much a bead in each cell tells along unknowns z (K, D), in floats."""
        return told_by_rows(self.slopes, np.ascontiguousarray(z.T))

    def fullest(self, values: Array) -> NDArray[np.int64]:
        """(fullest_count, K) the cells with the largest of values (n, K), where beads know most."""
        return np.argpartition(values, -self.fullest_count, axis=0)[-self.fullest_count :]

    def most(self, values: Array) -> Array:
        """(K,): the largest sum over the beads of values (n, K) of the cells that they are in."""
        return np.asarray(self.in_each * np.take_along_axis(values, self.fullest(values), axis=0).sum(axis=0))

    @property
    def blocks(self) -> tuple[NDArray[np.int64], Array, Array]:
        """(n,) the block of each cell, two or fewer along each axis; (B, 3) centres of the blocks; (3,) half the extent
        that covers each."""
        places = [np.unique(along.round(9), return_inverse=True)[1] // 2 for along in self.centres.T]
        owner = np.unique(np.stack(places), axis=1, return_inverse=True)[1].ravel()
        low, high = np.full((owner.max() + 1, 3), np.inf), np.full((owner.max() + 1, 3), -np.inf)
        np.minimum.at(low, owner, self.centres)
        np.maximum.at(high, owner, self.centres)
        return owner, (low + high) / 2, ((high - low).max(axis=0) / 2 + self.half) * (1 + 1e-12)

    @property
    def fullest_count(self) -> int:
        """In how many cells beads are where they know most."""
        return min(self.beads.number, len(self.centres)) if self.apart else 1

    @property
    def in_each(self) -> int:
        """How many beads are in each of these."""
        return 1 if self.apart else self.beads.number


def cells_of(information: Information, beads: AlikeBeads) -> Cells:
    """The region of beads in cells of one size: those that it reaches into."""
    middle, reach = _box_of(beads.region)
    wide, groups, rows = np.count_nonzero(reach), len(information.beads), 2 * beads.sees.size
    most = min(MOST_CELLS, MOST_NUMBERS / (rows * information.unknowns)) / groups
    counts, apart = np.full(3, min(WITHOUT_SPACING, int(most ** (1 / 3)))), False
    if information.spacing_mm > GRID_MM and wide:
        edge = NARROWER * (information.spacing_mm - 2 * GRID_MM) / sqrt(wide)
        finer = np.ceil(2 * reach / edge)
        if finer.clip(1).prod() <= most:
            counts, apart = finer, True
    counts = np.where(reach > 0, counts, 1).astype(int)
    half = reach / counts
    centres = (_keep_centres if isinstance(beads.region, NearSurface) else _centres_in)(beads.region, *counts.tolist())
    places = tuple(copy @ rigid_transform(np.eye(3), middle) for copy in beads.copies)
    slopes, outermost = [], centres + half * np.sign(centres)  # where most cells have their most
    for place, sees, made in zip(places, beads.sees, beads.made_mm, strict=True):
        own = slopes_at(information, 0, place, sees, outermost)
        if made.any():
            whiten_rows(own.unknowns, own.moved @ made)
        slopes.append(own.unknowns)
    return Cells(beads, places, centres, half * (1 + 1e-12), reach * (1 + 1e-12), apart, np.concatenate(slopes, axis=1))


def _box_of(region: Shape) -> tuple[Array, Array]:
    """(3,) the middle of the box about a region, and (3,) how far it reaches from there, 0 where it is flat."""
    low, high = bounding_box(region)
    return (low + high) / 2, ((high - low) / 2 + GRID_MM) * (high > low)


def _centres_in(region: Shape, *counts: int) -> Array:
    """(n, 3) about the middle of its box: of the cells, so many along each axis, that some of a region may be in."""
    middle, reach = _box_of(region)
    half = reach / counts
    axes = [half[k] * (2 * np.arange(counts[k]) + 1 - counts[k]) for k in range(3)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return frozen(centres[_reaches(region, centres + middle, float(np.linalg.norm(half)) + GRID_MM)])


# The distances from a surface take longer than all else of a bound, and each bound, gap and picture asks for the same
_keep_centres = lru_cache(maxsize=4)(_centres_in)


def cells_in(information: Information) -> tuple[Cells, ...]:
    """Of all fiducials."""
    return tuple(cells_of(information, beads) for beads in information.beads)


def _reaches(region: Shape, points: Array, within_mm: float) -> NDArray[np.bool_]:
    """(n,) whether some of a region may be so near to points (n, 3): never no where some is."""
    if isinstance(region, NearSurface):
        return np.asarray(region.mesh.nearest(points).distance_mm <= region.most_mm + within_mm)
    whole = replace(region, towards=None) if isinstance(region, Cylinder) else region
    return contains(whole, points, within_mm)


def most_known(information: Information, cells: tuple[Cells, ...], z: Array, together: bool = False) -> Array:
    """(K,) U: no layout has more information than that along the first three of unknowns z (K, D), rounded up; (1,)
    along all of them ``together``.  Wherever views look, each sum is convex in that: the most is at a corner.  Raises
    NoBound."""
    total, corners = known_from_target(information, z), 1 << len(information.turns.of_view)
    total = total.reshape(len(z), -1).sum(axis=0) if together else total
    for each in cells:
        total = total + each.most(_enclose_cells(information, each, z, together))
    if not isfinite(total.max()):
        raise NoBound("where fiducials may be reaches the source of a view")
    return np.asarray(total.reshape(-1, corners).max(axis=1) * (1 + 1e-12))


def _enclose_cells(information: Information, cells: Cells, z: Array, together: bool) -> Array:
    """(n, K 2^P) at most what a bead tells along z anywhere in each cell, at each corner of what turns the views;
    (n, 2^P) along all of them ``together``.

    Blocks of cells are enclosed first, then the cells of those that may be among the fullest, then their eight parts;
    the fullest are enclosed in parts in any case.
    """
    beads = cells.beads
    forms = [forms_of(information, 0, place, sees, z) for place, sees in zip(cells.places, beads.sees, strict=True)]
    turns = [turns_from(information.turns, place) for place in cells.places]
    owner, blocks, wide = cells.blocks
    told = cells.told_along(z)
    told = told.sum(axis=1, keepdims=True) if together else told
    least = np.partition(told, -cells.fullest_count, axis=0)[-cells.fullest_count][:, None]

    def most_in(centres: Array, along: NDArray[np.int64], half: Array) -> Array:
        """(n, 2^P) in parts about centres (n, 3) with half their extents (3,), along z (n,)."""
        if together:
            along, centres = np.tile(np.arange(len(z)), len(centres)), centres.repeat(len(z), axis=0)
        reach, nowhere = cells.reach + half, np.zeros((len(centres), 3))
        each = [
            enclose(form, turn, made, centres, along, half, reach, nowhere)
            for form, turn, made in zip(forms, turns, beads.made_mm, strict=True)
        ]
        corners = sum(each[1:], each[0])
        return np.asarray(corners.reshape(-1, len(z) if together else 1, *corners.shape[1:]).sum(axis=1).max(axis=2))

    columns = np.arange(told.shape[1])
    values = most_in(blocks.repeat(len(columns), axis=0), np.tile(columns, len(blocks)), wide)
    values = values.reshape(len(blocks), len(columns), -1)[owner]
    finer = np.full(values.shape, 2)  # how often a cell may be enclosed again
    while True:
        for parts, half in ((np.zeros((1, 3)), cells.half), (EIGHT / 2, cells.half / 2 * (1 + 1e-12))):
            at, along = np.nonzero((values >= least).any(axis=2) & (finer[:, :, 0] == 2 - (len(parts) > 1)))
            within = cells.centres[at][:, None] + cells.half * parts
            most = most_in(within.reshape(-1, 3), along.repeat(len(parts)), half)
            most = most.reshape(-1, len(parts), values.shape[2]).max(axis=1)
            # Of two convex bounds one or the other is convex in where views look, and not the less at each corner
            less = most.sum(axis=1, keepdims=True) < values[at, along].sum(axis=1, keepdims=True)
            values[at, along] = np.where(less, most, values[at, along])
            finer[at, along] -= 1
        flat = values.reshape(len(values), -1)
        top = cells.fullest(flat)
        if not np.take_along_axis(finer.reshape(flat.shape), top, axis=0).any():
            return flat
        least = np.take_along_axis(flat, top, axis=0).min(axis=0).reshape(len(columns), -1)


def known_from_target(information: Information, z: Array) -> Array:
    """(K 2^P,) z' F0 z: what the images of the target itself tell, whatever the layout, at each corner of what turns
    the views, rounded up."""
    everywhere = np.ones(len(information.projections), dtype=bool)
    place = rigid_transform(np.eye(3), information.target_mm)
    forms, turns = forms_of(information, 1, place, everywhere, z), turns_from(information.turns, place)
    flat, points, displaced = np.zeros(3), np.zeros((len(z), 3)), np.ascontiguousarray(-z[:, :3])
    told = enclose(forms, turns, np.zeros((3, 3)), points, np.arange(len(z)), flat, flat, displaced)
    return np.asarray(told.max(axis=2).ravel())


def choose_unknowns(parts: MixedParts, directions: Array) -> Array:
    """z (K, D), of target part ``directions`` (K, 3), with nearly the least U: those of the layouts' mixture that knows
    most along each (``mixture``).

    In floats: a bad choice only makes the bound worse.
    """
    found = mix(parts, directions[:, None], True, ROUNDS, AGAIN, UPDATES).z[:, 0]
    return np.concatenate([directions, found[:, 3:]], axis=1)


def parts_of(information: Information, cells: Sequence[Cells]) -> MixedParts:
    """What a mixture of layouts is made of."""
    base, rows = target_information(information), max(group.slopes.shape[1] for group in cells)
    slopes = np.zeros((rows, information.unknowns, sum(len(group.centres) for group in cells)))
    first = np.cumsum([0, *(len(group.centres) for group in cells)])
    for group, begin, end in zip(cells, first, first[1:], strict=False):
        slopes[: group.slopes.shape[1], :, begin:end] = group.slopes.transpose(1, 2, 0)
    kept, in_each = np.array([(group.fullest_count, group.in_each) for group in cells]).T.copy()
    return MixedParts(slopes, first, kept, in_each, base, even_information(information, cells))


def least_mean_square(information: Information, cells: tuple[Cells, ...], weight: Array) -> float:
    """mm^2 that ``trace(weight S)`` of no layout is below, S (3, 3) its covariance, whatever the laws; weight (3, 3).

    For any z_k, and a_k with ``weight = sum of a_k a_k'``, it is at least ``(sum of a_k . z_k)^2`` over what is known
    along all z_k together (Cauchy and Schwarz).  Those of a mixture of layouts for which it is nearly least are taken.
    """
    aims = root_of(weight)
    z, _ = mix_layouts(information, cells, aims)
    return float((aims.T * z[:, :3]).sum() ** 2 / most_known(information, cells, z, together=True)[0]) * INSIDE


def root_of(weight: Array) -> Array:
    """(3, 3): its columns a_k make up a weight (3, 3), the sum of ``a_k a_k'``."""
    sizes, axes = np.linalg.eigh(weight)
    return np.asarray(axes * np.sqrt(np.maximum(sizes, 0.0)))


def mix_layouts(
    information: Information, cells: Sequence[Cells], aims: Array, rounds: int = MIXED
) -> tuple[Array, list[Array]]:
    """Of the mixture of layouts with nearly the least mean square along aims (3, A), a column for each: z (A, D), for
    which no layout is far below, and (n,) of each group of cells how many fiducials it has there.

    With weights w of the cells in the place of fiducials, ``F = F0 + sum of w J' R^-1 J``, that mean square is convex
    in w: the best weights are the best of all.  They are those of layouts, each the best where the mixture of those
    before knows least, whose shares are then improved (Newton, with a barrier).  rounds: so many
    are added.
    """
    parts = parts_of(information, cells)
    mixed = mix(parts, np.ascontiguousarray(aims.T)[None], False, rounds, 0, IMPROVED)
    held = [mixed.shares[0] * group.beads.number / len(group.centres) * np.ones(len(group.centres)) for group in cells]
    for share, layout in zip(mixed.shares[1:], mixed.cells, strict=True):
        for group, own, begin in zip(cells, held, parts.first, strict=False):
            there = layout[(begin <= layout) & (layout < begin + len(own))] - begin
            own[there] += share * group.in_each
    return mixed.z[0], held


def weigh_candidates(problem: PlacementProblem, term: DemandTerms, pools: Sequence[Array]) -> list[Array]:
    """(C,) weights of the candidates (C, G, 3), assumed, of each region in the mixture that has the least mean square
    of an error.  In floats: bad ones only make worse starts."""
    information = information_of(problem, term)
    _, which = distinct(place.region for place in problem.places)
    numbers, sees = np.bincount(which), information.beads[0].sees[0]
    each = [np.concatenate([slopes_at(information, 0, np.eye(4), sees, part).unknowns for part in parts], axis=1)
            for parts in (np.swapaxes(pool, 0, 1) for pool in pools)]  # fmt: skip
    weights = [np.full(len(slopes), 1 / len(slopes)) for slopes in each]
    base, aims = target_information(information), np.zeros((information.unknowns, 3))
    aims[:3] = term.to_error.T
    for _ in range(WEIGHED):
        told = (n * np.einsum("c,crd,cre->de", w, s, s) for n, w, s in zip(numbers, weights, each, strict=True))
        z = np.linalg.solve(base + sum(told), aims)
        known = [((slopes @ z) ** 2).sum(axis=(1, 2)) for slopes in each]
        weights = [np.maximum(w * own / (w @ own), 1e-99) for w, own in zip(weights, known, strict=True)]
    return weights


def target_information(information: Information) -> Array:
    """F0 (D, D): of the target's images, in floats."""
    own = target_slopes(information)
    slopes = own.unknowns[0]
    slopes[:, :3] += own.moved[0]
    return np.asarray(slopes.T @ slopes)


def target_slopes(information: Information) -> Slopes:
    """Of the images of the target, n = 1."""
    everywhere = np.ones(len(information.projections), dtype=bool)
    return slopes_at(information, 1, rigid_transform(np.eye(3), information.target_mm), everywhere, np.zeros((1, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class Net:
    """Planes that no layout's ellipsoid of directions, ``a' M a <= 1``, lies within: see the module."""

    planes: Array  # (F, 3) f
    metric: Array  # (3, 3) mm^2: the covariance of one mixture of layouts, which tells sizes


def find_net(information: Information) -> Net:
    """The net of directions, each with a bound of what any layout knows along it.  Raises NoBound."""
    cells = cells_in(information)
    parts = parts_of(information, cells)
    metric = covariance_in(parts.evenly)
    points, faces = spread_directions(FREQUENCY)
    directions = points @ np.linalg.cholesky(metric).T
    known = most_known(information, cells, choose_unknowns(parts, directions))
    return net_through(directions, faces, known, metric)


def even_information(information: Information, cells: Sequence[Cells]) -> Array:
    """(D, D), in floats: of the target's images and of fiducials spread evenly over their cells."""
    return np.asarray(target_information(information) + sum(group.evenly for group in cells))


def covariance_in(information: Array) -> Array:
    """(3, 3) mm^2 of a target that is known as well as that (D, D) says.  Raises NoBound."""
    if np.linalg.cond(information[3:, 3:]) > WORST_CONDITION:
        raise NoBound("fiducials where they may be leave what the views' estimates seek open")
    along = np.linalg.solve(information[3:, 3:], information[3:, :3])
    covariance = np.linalg.inv(information[:3, :3] - information[:3, 3:] @ along)
    return np.asarray((covariance + covariance.T) / 2)


def net_through(directions: Array, faces: NDArray[np.int64], known: Array, metric: Array) -> Net:
    """The net of directions (n, 3), along which any layout knows at most ``known`` (n,), with the triangles (F, 3) of
    :func:`spread_directions`.  Raises NoBound."""
    vertices = directions / np.sqrt(known)[:, None]
    signed = np.concatenate([vertices, -vertices])
    planes = np.linalg.solve(signed[faces], np.ones((len(faces), 3, 1)))[..., 0]
    if np.abs(np.einsum("fva,fa->fv", signed[faces], planes) - 1).max() > INSIDE_ERROR:
        raise NoBound("the directions are too unlike one another for rounding")
    return Net(planes, metric)


@lru_cache(maxsize=4)
def spread_directions(frequency: int) -> tuple[Array, NDArray[np.int64]]:
    """Directions (n, 3) and triangles (F, 3) between them and their opposites, n + i that of i: an octahedron whose
    faces are divided by the frequency.  Half of the triangles are given; the others are their opposites."""
    every = product(range(-frequency, frequency + 1), repeat=3)
    half = [point for point in every if sum(map(abs, point)) == frequency and point > (0, 0, 0)]
    places = {point: k for k, point in enumerate(half)}

    def place(point: tuple[int, ...]) -> int:
        opposite = tuple(-x for x in point)
        return places[point] if point in places else len(half) + places[opposite]

    faces = []
    for signs in ((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)):
        for i in range(frequency):
            for j in range(frequency - i):
                for corners in (((0, 0), (1, 0), (0, 1)), ((1, 0), (1, 1), (0, 1))):
                    each = [(i + a, j + b, frequency - i - j - a - b) for a, b in corners]
                    if min(min(point) for point in each) >= 0:
                        faces.append([place(tuple(s * x for s, x in zip(signs, point, strict=True))) for point in each])
    points = np.array(half, dtype=float)
    return frozen(points / np.linalg.norm(points, axis=1, keepdims=True)), frozen(faces, np.int64)


def fit_below(net: Net, weight: Array) -> Array:
    """L (3, 3) mm^2 with nearly the largest ``trace(weight L)`` of those below the covariance of every layout: by
    Newton's method with a logarithmic barrier, and scaled to keep every plane."""
    root = np.linalg.cholesky(net.metric)
    planes = net.planes @ root
    scale = float(np.einsum("fa,fa->f", planes, planes).max())
    planes = planes / sqrt(scale)
    upper = np.triu_indices(3)
    basis = np.zeros((6, 3, 3))
    for k, (i, j) in enumerate(zip(*upper, strict=True)):
        basis[k, i, j] = basis[k, j, i] = 1.0
    felt = np.einsum("fa,kab,fb->fk", planes, basis, planes)
    aim = np.einsum("ab,kab->k", root.T @ weight @ root, basis)
    aim = aim / np.abs(aim).max()
    x = np.einsum("kab,ab->k", basis, np.eye(3) / 2) / np.einsum("kab,kab->k", basis, basis)
    barrier = 1.0

    while barrier > LAST_BARRIER:
        for _ in range(60):
            room = 1 - felt @ x
            inverse = np.linalg.inv(np.einsum("k,kab->ab", x, basis))
            turned = np.einsum("ab,kbc->kac", inverse, basis)
            gradient = -aim / barrier + (felt / room[:, None]).sum(axis=0) - np.trace(turned, axis1=1, axis2=2)
            hessian = (felt / room[:, None]).T @ (felt / room[:, None]) + np.einsum("kab,lba->kl", turned, turned)
            step = np.linalg.solve(hessian, gradient)
            if (falls := float(gradient @ step)) < 1e-9:
                break
            x = x - step / (1 + sqrt(falls))  # this far such a barrier lets one go (Nesterov and Nemirovskii 1994)
        barrier /= 5
    found = root @ np.einsum("k,kab->ab", x, basis) @ root.T / scale
    found = (found + found.T) / 2
    return np.asarray(found * INSIDE / np.einsum("fa,ab,fb->f", net.planes, found, net.planes).max())
