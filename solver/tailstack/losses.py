"""Leave-one-out and leave-two-out analysis of a score: the worst loss of one fiducial and of two, by name.

A fiducial that is lost is missing in every view, as if it had never been there.  What that does to the gains of all
that acts through the images follows from weights of 0 (``propagation.noise``), for every loss and target at once in one
kernel; the rest of the law is the same with every loss.  Pearson's closed form ranks the losses; its error is known
(``tail.approximation``), so that the exact law is asked only where a loss may be the worst: the answer is that of
scoring each remaining structure by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from .contributors import ErrorLaw, error_law, law_of
from .errors import IllPosedError
from .estimation.checks import examine
from .estimation.missed import leave_answers
from .estimation.resection import project
from .geometry.arrays import Array, frozen
from .laws import BOUNDED
from .measures import MEASURE, POINTS
from .propagation.linear import (
    Chain,
    ErrorModel,
    LinearModel,
    chain_of,
    join,
    linearise_all,
    linearise_at,
    models_of,
    shift_together,
)
from .propagation.noise import LossGains, gains_of_images, lose
from .propagation.validity import QUANTILES, validity
from .results import Interval, Loss, Mixture
from .results.verdicts import P95
from .system import System, Way
from .tail.approximation import Ranking, Rest, columns_in_cumulants, rank_losses
from .tail.bounded import worst_case
from .tail.declared import SAMPLED_METHOD, LawQuantile, LinearLaw, MixedLaw, OneSidedLaw, find_radius, law_quantile

PAIRS_UP_TO = 30  # fiducials; beyond, trying every pair would take longer than the score itself
# By which Pearson's form may rank a loss too low: a P95 by up to 1.3 %, 1.2 % more where laws are uniform; further out
# in the tail by more.
MARGIN, MARGIN_BEYOND_P95 = 0.025, 0.06
SLOPE = 0.1  # by which it may rank a loss too low beside another, per relative difference of the covariances
ALIKE = 1e-9  # losses whose cumulants differ by less are one by symmetry
WORSE = 10.0  # only a loss that multiplies the quantile by so much may leave a structure that determines nothing
HIGHEST = QUANTILES[-1][0]  # order of the quantiles up to which something is known of first order
BEYOND = np.log1p(-np.array([level for level, _ in reversed(QUANTILES)]))  # ascending
TIMES = np.array([times for _, times in reversed(QUANTILES)])
ROUNDING_MM = 1e-9  # differences below it are none: coordinates of some 1000 mm carry 1e-13 mm, their gains more


def subsets(count: int, lost: int) -> Array:
    """(S, N) 0 of what is lost and 1 of what is kept, for every way to lose so many of N fiducials."""
    every = np.array(list(combinations(range(count), lost)), dtype=np.intp)
    masks = np.ones((len(every), count))
    np.put_along_axis(masks, every, 0.0, axis=1)
    return masks


def without_fiducials(system: System, lost: Sequence[str]) -> System:
    """The system as if these fiducials had never been seen."""
    if not lost:
        return system
    scene = system.scene(np.zeros((0, 3)), project)
    rest = [i for i, label in enumerate(system.fiducial_labels) if label not in lost]
    labels = tuple(system.fiducial_labels[i] for i in rest)
    views = tuple(
        view if view.sees is None else replace(view, sees=tuple(label for label in view.sees if label not in lost))
        for view in system.views
    )
    return replace(
        system,
        fiducial_labels=labels,
        fiducials_mm=frozen(system.fiducials_mm[rest]),
        manufacturing_half_width_mm=frozen(system.manufacturing_half_width_mm[rest]),
        views=views,
        effects=tuple(effect.with_pivot_in(scene) for effect in system.effects),
        loss_probability=tuple(system.loss_probability[i] for i in rest) if system.loss_probability else (),
    )


@dataclass(frozen=True, eq=False)
class Shots:
    """A measure at a site over all shots, those in which fiducials are missed among them, as far as first order tells.

    Where the quantile of a simulation lies follows from what was calibrated of each structure that may be left.  With
    an error of a fraction d in P95, t(q) d at the quantile of order q (``QUANTILES``, between them by log(1 - q)), so
    much of its shots is surely within r as first order has within r / (1 + t d), and at most what it has within
    r (1 + t d).  A structure of which nothing is known, and more losses than are looked at, may be all beyond, or all
    within.
    """

    law: MixedLaw  # of every pattern of losses that was looked at and leaves an answer
    errors: Array  # (S,) of first order in the P95 of each, a fraction; inf: not known
    unexamined: float  # probability of patterns that were not looked at

    @property
    def beyond_limits(self) -> float:
        """Probability of a shot that counts as beyond every limit."""
        return max(1.0 - float(self.law.weights.sum()), 0.0)

    @lru_cache(maxsize=16)  # noqa: B019
    def bound(self, p: float) -> float:
        """The quantile, mm; infinite where more shots than it leaves count as beyond every limit."""
        return self.law.quantile(p)

    @property
    def open_words(self) -> str:
        """Which shots first order cannot tell of."""
        refused = max(self.beyond_limits - self.unexamined, 0.0)
        unknown = float(self.law.weights[~np.isfinite(self.errors)].sum())
        parts = (
            (self.unexamined, "miss more fiducials than are looked at"),
            (refused, "leave too few for an answer"),
            (unknown, "leave a structure that first order does not hold for"),
        )
        return ", ".join(f"{100 * share:.2g} % of shots {words}" for share, words in parts if share > 0)

    def why_open(self, p: float) -> str:
        """Why a quantile has no upper end; empty: it has one."""
        if self.interval(p)[1] < inf:
            return ""
        return self.open_words or f"first order is not calibrated for P{100 * p:g}"

    def value(self, p: float) -> float:
        """The quantile, mm; where it is infinite, that of shots with an answer that was looked at."""
        bound = self.bound(p)
        return bound if bound < inf else self.law.given_answer.quantile(p)

    @lru_cache(maxsize=16)  # noqa: B019
    def interval(self, p: float) -> Interval:
        """Where the quantile of a simulation lies, mm."""
        known, weights = np.isfinite(self.errors), self.law.weights
        errors = np.where(known, self.errors, 0.0)
        sure, open_ = np.where(known, weights, 0.0), float(weights[~known].sum()) + self.unexamined
        if p > HIGHEST or float(sure.sum()) + open_ <= p:  # nothing is known, or there is no such quantile
            return 0.0, inf

        def within(radii: Array) -> Array:
            return self.law.probabilities(radii)

        def least(r: float) -> float:
            times = _times(within(np.full(len(weights), r)))
            return float(sure @ np.minimum(within(r / (1 + times * errors)), HIGHEST))

        def most(r: float) -> float:
            times = _times(within(r * (1 + TIMES[0] * errors)))
            there = within(r * (1 + times * errors))
            return float(sure @ np.where(there > HIGHEST, 1.0, there)) + open_

        start = self.value(p)
        high = find_radius(least, p, start) if HIGHEST * float(sure.sum()) > p else inf
        return find_radius(most, p, start), high


def _times(levels: Array) -> Array:
    """How many times the error in P95 first order may err in quantiles of these orders."""
    return np.asarray(np.interp(np.log1p(-np.minimum(levels, HIGHEST)), BEYOND, TIMES))


def probability_of_none(loss_probability: Sequence[float]) -> float:
    """Of a shot that misses no fiducial."""
    return float((1 - np.array(loss_probability)).prod())


class LossSearch:
    """The losses of one system, ranked for whatever is asked of its error."""

    def __init__(self, chain: Chain, models: dict[str, LinearModel]) -> None:
        self.chain, self.models = chain, models
        self.system = chain.system
        self.count = len(chain.system.fiducials_mm)
        self.metrics = {metric.key: metric for metric in chain.system.metrics}
        self.every = models_of(chain.system, models)
        self.place = {name: t for t, name in enumerate(models)}  # of each target in the arrays
        # In the arrays behind the targets: of what is made of the errors there, each vector by itself.
        derived = [each for each in self.metrics.values() if each.measure not in POINTS]
        vectors = [(*each.key, end) for each in derived for end in range(each.measure.vectors)]
        self.joined = {key: k for k, key in enumerate(vectors, len(models))}
        # Mixtures, and every requirement and error ask for the same ones.
        self._law = lru_cache(maxsize=None)(self._find_law)
        self._parts = lru_cache(maxsize=None)(self._find_parts)
        self._effects = lru_cache(maxsize=None)(self._find_effects)
        self._rest = lru_cache(maxsize=None)(self._find_rest)
        self._ranking = lru_cache(maxsize=None)(self._rank)
        self._refusal = lru_cache(maxsize=None)(self._find_refusal)
        self._error_of = lru_cache(maxsize=None)(self._find_error)
        self.shots = lru_cache(maxsize=None)(self._find_shots)  # of an error at a target, about a quantile
        self._chains: dict[bytes, Chain] = {}
        self._losses: dict[int, LossGains] = {}

    @cached_property
    def _std(self) -> Array:
        """(M,) of every source that acts through single images."""
        return np.concatenate([effect.sources.std for effect in self.chain.of_images])

    @cached_property
    def _moved_together(self) -> tuple[Array, Array]:
        """What moves images together at every target: (T, V, 2 N + 2, C) px, and at the flange, (T, 3, K + G) mm."""
        first = self.chain.mounts.first
        each = [shift_together(self.system, first, model.target) for model in self.models.values()]
        return np.stack([shifts for shifts, _ in each]), np.stack([at_flange for _, at_flange in each])

    def losses(self, lost: int) -> LossGains:
        """Of so many fiducials, at every target of the system."""
        if lost not in self._losses:
            masks, (shifts, at_flange) = subsets(self.count, lost), self._moved_together
            size, weights = (len(self.place) + len(self.joined), len(masks), 3), self.chain.weights * masks[:, None]
            gains = LossGains(masks, np.empty((*size, 3)), np.empty((*size, at_flange.shape[2])))
            aims = np.array([model.reconstructed_mm for model in self.models.values()])
            joints = np.zeros((len(self.joined), len(self.place), 3, 3))
            for j, (name, error, end) in enumerate(self.joined):
                for target, turn, _ in self._parts(name, error):
                    joints[j, self.place[target]] = turn[3 * end : 3 * end + 3]
            apart = np.concatenate([np.full(each.sources.count, each.of_target) for each in self.chain.of_images])
            lose(self.chain.imaging, aims, joints, apart, shifts, self._std, weights, gains[1:])
            self._losses[lost] = gains
        return self._losses[lost]

    def model_without(self, name: str, error: str, lost: Sequence[str]) -> ErrorModel:
        """The linear model of a measure at a site, these fiducials lost; its validity number is that of all."""
        mask = np.array([label not in lost for label in self.system.fiducial_labels], dtype=np.float64)
        rest, metric = replace(self.chain, weights=self.chain.weights * mask), self.metrics[name, error]
        wholes = [self.models[target] for target in metric.site.weights]
        return join({whole.site: linearise_at(rest, whole.target, whole) for whole in wholes}, *metric)

    def labels(self, mask: Array) -> tuple[str, ...]:
        return tuple(label for label, here in zip(self.system.fiducial_labels, mask, strict=True) if not here)

    def worst(self, lost: int, error: str, quantile: float, targets: Sequence[str]) -> Loss:
        """The worst loss of so many for a quantile of an error at the worst of these targets."""
        masks = self.losses(lost).kept
        fewest, left = self.system.estimator.traits.fewest_fiducials, masks @ self.chain.weights.T  # (S, V)
        if (left < fewest).any():
            s, v = np.argwhere(left < fewest)[0].tolist()
            own = f"view {self.system.views[v].name} is left with {int(left[s, v])} fiducials"
            reason = f"{own}; an estimate needs {fewest}"
            return Loss(self.labels(masks[s]), targets[0], None, reason)
        forms, cumulants, covariances = self._ranking(lost, error, quantile, tuple(targets))
        t, s = divmod(int(forms.argmax()), len(masks))
        whole = self._ranking(0, error, quantile, tuple(targets)).quantile
        for each in self._find_doubted(forms, whole):
            reason = self._refusal(masks[each].tobytes())
            if not (reason or forms[:, each].max() < inf):
                reason = "what is left does not determine the views"
            if reason:
                return Loss(self.labels(masks[each]), targets[int(forms[:, each].argmax())], None, reason)
        highest = forms * (1 + (MARGIN if quantile <= P95 else MARGIN_BEYOND_P95))  # what each loss may come to
        if MEASURE[error].vectors > 1:  # of two, each with half of what may be beyond
            halved = self._ranking(lost, error, 0.5 * (1 + quantile), tuple(targets)).quantile
            rooms = (self.metrics[name, error].site.room for name in targets)
            widest = max(0.0 if room is None else float(room.max()) for room in rooms)
            highest = halved + MARGIN_BEYOND_P95 * (halved + widest)
        shift = self._shift(error, quantile, tuple(targets))
        value, worst = 0.0, (t, s)
        while highest.max() > value:
            t, s = divmod(int(highest.argmax()), len(masks))
            law = self._solve(targets[t], error, quantile, masks[s])
            alike = (np.abs(cumulants[t] - cumulants[t, s]) <= ALIKE * np.abs(cumulants[t, s])).all(axis=1)
            highest[t, alike] = -inf
            found = law.quantile_mm + shift
            better = found > value * (1 + ALIKE)
            rows = slice(None) if better else slice(t, t + 1)  # beside which the form may err by less
            scale = max(float(np.abs(covariances[t, s]).max()), ROUNDING_MM**2)  # nothing may vary
            unlike = np.abs(covariances[rows] - covariances[t, s]).max(axis=(2, 3)) / scale
            near = forms[rows] * (found / forms[t, s]) * (1 + SLOPE * unlike)
            highest[rows] = np.minimum(highest[rows], near)
            if better:
                value, worst = found, (t, s)
            if law.method == SAMPLED_METHOD:  # it tells losses apart no better than the form does, and takes long
                break
        t, s = worst
        return Loss(self.labels(masks[s]), targets[t], value - shift)

    def _solve(self, name: str, error: str, quantile: float, mask: Array) -> LawQuantile:
        """The quantile of what is left, fiducials with a 0 in mask (N,) lost."""
        law, bounded = self._law_without(name, error, quantile, mask)
        return worst_case(law, bounded, quantile).quantile if bounded.any() else law_quantile(law, quantile)

    def mixture(self, error: str, quantile: float, targets: Sequence[str]) -> Mixture | None:
        """The quantile of an error over shots in each of which fiducials are lost at random, at the worst of these
        targets; None where the design states no probability."""
        probability = np.array(self.system.loss_probability)
        if not probability.size:
            return None
        shots = [self.shots(name, error, quantile) for name in targets]
        values = [each.bound(quantile) for each in shots]
        highest = int(np.argmax(values))
        return Mixture(
            quantile=quantile,
            value=values[highest] if values[highest] < inf else None,
            target=targets[highest],
            smallest_loss_probability=float(probability.min()),
            largest_loss_probability=float(probability.max()),
            probability_of_none=probability_of_none(self.system.loss_probability),
            probability_unaccounted=shots[highest].beyond_limits,
        )

    def law_of_simulation(self, name: str, error: str, quantile: float) -> MixedLaw:
        """The law of an error at a target over all shots of a simulation, as far as first order tells.

        Patterns of more losses than are looked at do not count as beyond, as they do in ``shots``, which is a bound:
        they are as if they were like the others.
        """
        masks, weights, examined = self._patterns
        return self._mix(name, error, quantile, masks, weights / examined)

    def law_of_shots(self, name: str, error: str, quantile: float) -> MixedLaw:
        """The same as ``shots`` have it: the first of its laws is that of no loss."""
        masks, weights, _ = self._patterns
        return self._mix(name, error, quantile, masks, weights)

    def _find_shots(self, name: str, error: str, quantile: float) -> Shots:
        masks, weights, examined = self._patterns
        targets = self.metrics[name, error].site.weights
        errors = np.array([max(self._error_of(target, mask.tobytes()) for target in targets) for mask in masks])
        return Shots(self._mix(name, error, quantile, masks, weights), errors, max(1.0 - examined, 0.0))

    def _find_error(self, name: str, mask: bytes) -> float:
        """Up to what fraction first order may err in P95 without fiducials that have a 0 in mask (N,); inf: not known.

        The rest is less redundant and worse conditioned: it is judged as a structure of its own.
        """
        if mask not in self._chains:
            lost = self.labels(np.frombuffer(mask))
            self._chains[mask] = chain_of(without_fiducials(self.system, lost)) if lost else self.chain
        chain = self._chains[mask]
        model = linearise_at(chain, self.models[name].target) if chain is not self.chain else self.models[name]
        percent = validity(model.nonlinearity, chain.system, model.turns).expected_error_percent
        return inf if percent is None else percent / 100

    def _mix(self, name: str, error: str, quantile: float, masks: Array, weights: Array) -> MixedLaw:
        laws = []
        for left in masks:
            law, bounded = self._law_without(name, error, quantile, left)
            laws.append(worst_case(law, bounded, quantile).law if bounded.any() else law)
        return MixedLaw(laws, weights, quantile)

    @cached_property
    def _patterns(self) -> tuple[Array, Array, float]:
        """Losses of none, one and two (of very many fiducials: one) that leave an answer: masks (S, N), and their
        probabilities (S,); then the probability of all that were examined, with or without an answer."""
        each = [self.losses(lost) for lost in range(3 if self.count <= PAIRS_UP_TO else 2)]
        masks = np.concatenate([gains.kept for gains in each])
        finite = [np.isfinite(gains.imaged).all((0, 2, 3)) & np.isfinite(gains.moved).all((0, 2, 3)) for gains in each]
        probability = np.array(self.system.loss_probability)
        weights = np.where(masks > 0, 1 - probability, probability).prod(axis=1)
        answered = (weights > 0) & np.concatenate(finite)
        answered[answered] = leave_answers(self.system, masks[answered] == 0)
        return masks[answered], weights[answered], float(weights.sum())

    def _find_doubted(self, forms: Array, whole: Array) -> list[int]:
        """Losses that may leave a structure which determines nothing, by Pearson's form (T, S) the worst first.

        whole (T, 1): that of all fiducials.  Where no image errs by chance, no quantile shows it: every loss may.
        """
        highest, exact = forms.max(axis=0), not self._std.any()
        doubted = np.full(forms.shape[1], exact) | ~(forms < np.maximum(WORSE * whole, ROUNDING_MM)).all(axis=0)
        return [int(s) for s in np.argsort(-highest, kind="stable") if doubted[s]]

    def _find_refusal(self, mask: bytes) -> str:
        """Why the structure without fiducials that have a 0 in mask (N,) is refused; empty: it is not."""
        try:
            examine(without_fiducials(self.system, self.labels(np.frombuffer(mask))))
        except IllPosedError as refusal:
            return refusal.problems[0].detail
        return ""

    def _find_law(self, name: str, error: str, quantile: float) -> ErrorLaw:
        return error_law(self.every[name, error], error, quantile)

    def _find_parts(self, name: str, error: str) -> list[tuple[str, Array, Array]]:
        """Of each target of a site its name, what a displacement of it in con does to the error (3, 3), and what moves
        images together does to that beyond the images (3, K + G); of two vectors 6 in place of the first 3."""
        parts = []
        for target, weights in self.metrics[name, error].site.weights.items():
            model, of_tcp, of_localisation = self.models[target], weights[:, :3], weights[:, 3:]
            beyond = of_tcp @ model.tcp_from_flange @ self._moved_together[1][self.place[target]]
            parts.append((target, of_tcp @ model.tcp_from_localisation + of_localisation, beyond))
        return parts

    def _frame(self, name: str, error: str, rows: slice) -> tuple[Array, Array]:
        """To the error's frame from that of ``LossGains`` (3, 3), and what moves images together does beyond them; of
        one vector."""
        _, turns, beyond = zip(*self._parts(name, error), strict=True)
        is_joined = (name, error, 0) in self.joined
        return np.eye(3) if is_joined else turns[0], np.sum(beyond, axis=0)[rows]

    def _law_without(self, name: str, error: str, quantile: float, mask: Array) -> tuple[LinearLaw, Array]:
        """The law at its bias, fiducials with a 0 in mask (N,) lost, and what its bounded sources do (3, q), mm."""
        columns, moved, count = [], [], self._std.size
        for target, turn, beyond in self._parts(name, error):
            aim, shifts = self.models[target].reconstructed_mm, self._moved_together[0][self.place[target]]
            left, _ = gains_of_images(self.chain.imaging, self.chain.weights * mask, aim, shifts)
            columns.append(turn @ left[:, :count])
            moved.append(turn @ left[:, count:] + beyond)
        model, every = self.every[name, error], self._law(name, error, quantile).columns
        ways, _ = self._effects(name, error)
        gain, together = every.gain.copy(), np.sum(moved, axis=0)
        gain[:, ways == Way.IMAGES] = columns[0] if len(columns) == 1 else self._join_columns(columns)
        shared = ways == Way.SHARED
        gain[:, shared] = together[:, : shared.sum()]
        every = every._replace(gain=gain)
        bounded = every.only((every.kinds == BOUNDED) & (every.half_width > 0))
        mean = model.bias_mm(error) - model.imaged_bias_mm(error) + together[:, shared.sum() :].sum(axis=1)
        return law_of(mean, every), bounded.gain * bounded.half_width

    def _join_columns(self, columns: Sequence[Array]) -> Array:
        """What several targets (3, M) have in common as sums, what each has of its own side by side, by effect."""
        ends = np.cumsum([effect.sources.count for effect in self.chain.of_images])[:-1]
        parts = zip(*(np.split(each, ends, axis=1) for each in columns), strict=True)
        pairs = zip(self.chain.of_images, parts, strict=True)
        return np.hstack([np.hstack(each) if effect.of_target else np.sum(each, axis=0) for effect, each in pairs])

    def _find_effects(self, name: str, error: str) -> tuple[NDArray[np.str_], NDArray[np.bool_]]:
        """(K,) of each source, in the order of the blocks, how its gains are found, and whether it is one of many."""
        every = [block.effect for block in self.every[name, error].blocks]
        counts = [effect.sources.count for effect in every]
        ways, grouped = [effect.way for effect in every], [effect.is_grouped for effect in every]
        return np.repeat(ways, counts), np.repeat(grouped, counts)

    def _find_rest(self, error: str, quantile: float, targets: tuple[str, ...], end: int) -> Rest:
        each = [self._find_rest_at(name, error, quantile, slice(3 * end, 3 * end + 3)) for name in targets]
        rest = Rest(*map(np.stack, zip(*each, strict=True)))
        return rest._replace(std=each[0].std, mean=rest.mean + self._shift(error, quantile, targets) * np.eye(3)[0])

    def _shift(self, error: str, quantile: float, targets: tuple[str, ...]) -> float:
        """By which a number that counts on one side is moved, so that its size ranks losses; of others 0."""
        if not MEASURE[error].side:
            return 0.0
        return max(OneSidedLaw(self._law(name, error, quantile).law, quantile, False).shift for name in targets)

    def _find_rest_at(self, name: str, error: str, quantile: float, rows: slice) -> Rest:
        """At one site, of one vector."""
        law, model = self._law(name, error, quantile), self.every[name, error]
        ways, grouped = self._effects(name, error)
        gain, std, half_width, kinds = law.columns.gain[rows], *law.columns[1:4]
        behind = ways == Way.LINK
        uneven = law.columns.wide & ~grouped
        scaled = gain[:, behind] * std[behind]
        return Rest(
            *self._frame(name, error, rows),
            std[ways == Way.SHARED],
            (law.worst.mean_mm - model.imaged_bias_mm(error))[rows],
            scaled @ scaled.T,
            *columns_in_cumulants(gain[:, uneven] * half_width[uneven], kinds[uneven]),
        )

    def _rank(self, lost: int, error: str, quantile: float, targets: tuple[str, ...]) -> Ranking:
        """Of two vectors the longer's quantile, less the room that it has in any case, and the cumulants and
        covariances of both side by side."""
        losses, each, size = self.losses(lost), [], (len(targets), self.losses(lost).kept.shape[0])
        for end in range(MEASURE[error].vectors):
            which = [self.joined.get((name, error, end), self.place.get(name, 0)) for name in targets]
            ranking = Ranking(np.empty(size), np.empty((*size, 3)), np.empty((*size, 3, 3)))
            rest = self._rest(error, quantile, targets, end)
            rank_losses(losses.imaged[which], losses.moved[which], rest, float(ndtri(quantile)), ranking)
            rooms = [None if MEASURE[error].side else self.metrics[name, error].site.room for name in targets]
            spare = [0.0 if room is None else room[3 * end : 3 * end + 2].min() for room in rooms]
            each.append(ranking._replace(quantile=np.maximum(ranking.quantile - np.array(spare)[:, None], 0.0)))
        if len(each) == 1:
            return each[0]
        first, last = each
        return Ranking(
            np.maximum(first.quantile, last.quantile),
            np.concatenate([first.cumulants, last.cumulants], axis=2),
            np.concatenate([first.covariance, last.covariance], axis=2),
        )


def search_losses(system: System) -> LossSearch | None:
    """The losses of a system in some of whose shots fiducials are missed; None: in none."""
    if not system.loss_probability:
        return None
    chain = chain_of(system)
    return LossSearch(chain, linearise_all(chain))
