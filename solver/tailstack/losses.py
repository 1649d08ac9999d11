"""What becomes of a score when fiducials are lost: the worst of all losses of one and of two, by name.

A fiducial that is lost is missing in every view, as if it had never been there.  What that does to the covariance of
the error follows from the gains with weights of 0 (``propagation.noise``), for every loss at once in one kernel;
where fiducials also decide the mean, from the linear model of every loss.  Pearson's closed form on it ranks the
losses; its error is known (``tail.approximation``), so that the exact law is asked only where a loss may be the worst:
the answer is that of scoring each remaining structure by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import combinations
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from .arrays import Array, frozen
from .contributors import ErrorLaw, error_law
from .errors import IllPosedError
from .estimation.checks import examine, fewest_fiducials
from .propagation.linear import Chain, LinearModel, covariance, linearise_at
from .propagation.noise import square_gains
from .results import Loss, Mixture
from .system import Law, System
from .tail.approximation import pearson_square, square_cumulants
from .tail.declared import SAMPLED_METHOD, MixedLaw, law_quantile

PAIRS_UP_TO = 30  # fiducials; beyond, trying every pair would take longer than the score itself
# By which Pearson's form may rank a loss too low: a P95 by up to 1.3 %, 1.2 % more where laws are uniform; further out
# in the tail by more.
MARGIN, MARGIN_BEYOND_P95 = 0.025, 0.06
P95 = 0.95
SLOPE = 0.1  # by which it may rank a loss too low beside another, per relative difference of the covariances
ALIKE = 1e-9  # losses whose cumulants differ by less are one by symmetry
MODELS = 2048  # linear models without lost fiducials that are kept: those of 30 fiducials at four targets, 50 MB
WORSE = 10.0  # only a loss that multiplies the quantile by so much may leave a structure that determines nothing


def subsets(count: int, lost: int) -> Array:
    """(S, N) 0 of what is lost and 1 of what is kept, for every way to lose so many of N fiducials."""
    every = np.array(list(combinations(range(count), lost)), dtype=np.intp)
    kept = np.ones((len(every), count))
    np.put_along_axis(kept, every, 0.0, axis=1)
    return kept


def without_fiducials(system: System, lost: Sequence[str]) -> System:
    """The system as if these fiducials had never been there."""
    if not lost:
        return system
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
        loss_probability=tuple(system.loss_probability[i] for i in rest) if system.loss_probability else (),
    )


class Ranked(NamedTuple):
    """The worst loss, and the linear model without what is lost; None where that determines nothing."""

    loss: Loss
    model: LinearModel | None


class LossSearch:
    """The losses of one system, ranked for whatever is asked of its error."""

    def __init__(self, chain: Chain, models: dict[str, LinearModel]) -> None:
        self.chain, self.models = chain, models
        self.system = chain.system
        self.count = len(chain.points)
        self.names = list(models)
        # What moves all images of a view together has a known part: with the fiducials, the mean changes as well.
        self.mean_changes = bool(self.system.common_shifts) or any(error is not None for error in chain.intrinsics)
        self._images: dict[int, tuple[Array, Array]] = {}
        # Ranks, mixtures, and every requirement and error ask for the same ones.
        self._linearise = lru_cache(maxsize=MODELS)(self._linearise_without)

    def images(self, lost: int) -> tuple[Array, Array]:
        """The losses of so many, kept (S, N), and the covariances (T, S, 3, 3) mm^2 in con of what acts through the
        image of one fiducial or target at a time: noise and manufacturing errors."""
        if lost not in self._images:
            kept, chain = subsets(self.count, lost), self.chain
            squares = np.zeros((len(kept), len(self.names), 2 * len(chain.projections) + 3, 3, 3))
            square_gains(
                chain.projections,
                chain.points[None],
                chain.weights * kept[:, None],
                chain.estimation,
                chain.per_error,
                np.ascontiguousarray(chain.manufacturing_std_mm),
                np.array([model.reconstructed_mm for model in self.models.values()]),
                squares,
            )
            variances = np.append(chain.estimation.noise**2, np.ones(3))
            self._images[lost] = kept, np.einsum("g,stgjk->tsjk", variances, squares)
        return self._images[lost]

    def model_without(self, name: str, kept: Array) -> LinearModel:
        """The linear model at a target, fiducials with a 0 in kept (N,) lost; its validity number is that of all."""
        return self._linearise(name, kept.tobytes())

    def _linearise_without(self, name: str, kept: bytes) -> LinearModel:
        whole, rest = self.models[name], replace(self.chain, weights=self.chain.weights * np.frombuffer(kept))
        return linearise_at(rest, whole.target, whole.nonlinearity)

    def labels(self, kept: Array) -> tuple[str, ...]:
        return tuple(label for label, here in zip(self.system.fiducial_labels, kept, strict=True) if not here)

    def worst(self, lost: int, error: str, quantile: float, targets: Sequence[str]) -> Ranked:
        """The worst loss of so many for a quantile of an error at the worst of these targets."""
        kept, covariances = self.images(lost)
        fewest, left = fewest_fiducials(self.system), kept @ self.chain.weights.T  # (S, V)
        if (left < fewest).any():
            s, v = np.argwhere(left < fewest)[0].tolist()
            own = f"view {self.system.views[v].name} is left with {int(left[s, v])} fiducials"
            reason = f"{own}; an estimate needs {fewest}"
            return Ranked(Loss(self.labels(kept[s]), targets[0], None, reason), None)
        laws = [error_law(self.models[name], error, quantile) for name in targets]
        rows = [
            self._rank(kept, covariances[self.names.index(name)], name, law, quantile)
            for name, law in zip(targets, laws, strict=True)
        ]
        forms, cumulants, totals = (np.concatenate(part) for part in zip(*rows, strict=True))
        first = int(forms.argmax())
        which, s = divmod(first, len(kept))
        whole = self._form(laws[which], targets[which], laws[which].total_covariance, quantile)[0]
        if not forms[first] < WORSE * whole:
            reason = self._find_refusal(kept[s])
            if not (reason or forms[first] < inf):
                reason = "what is left does not determine the views"
            if reason:
                return Ranked(Loss(self.labels(kept[s]), targets[which], None, reason), None)
        margin = MARGIN if quantile <= P95 else MARGIN_BEYOND_P95
        highest = forms * (1 + margin)  # what each loss may come to
        best: Ranked | None = None
        while best is None or highest.max() > (best.loss.value_mm or 0.0):
            place = int(highest.argmax())
            which, s = divmod(place, len(kept))
            model = self.model_without(targets[which], kept[s])
            law = law_quantile(error_law(model, error, quantile).law, quantile)
            value = law.quantile_mm
            highest[place] = -inf
            highest[(np.abs(cumulants - cumulants[place]) <= ALIKE * np.abs(cumulants[place])).all(axis=1)] = -inf
            if best is None or value > (best.loss.value_mm or 0.0):
                best = Ranked(Loss(self.labels(kept[s]), targets[which], value), model)
                unlike = np.abs(totals - totals[place]).max(axis=(1, 2)) / np.abs(totals[place]).max()
                near = forms * (value / forms[place]) * (1 + SLOPE * unlike)
                highest = np.minimum(highest, near)
            if law.method == SAMPLED_METHOD:  # it tells losses apart no better than the form does, and takes long
                break
        return best

    def mixture(self, error: str, quantile: float, targets: Sequence[str]) -> Mixture | None:
        """The quantile of an error over shots in each of which fiducials are lost at random, at the worst of these
        targets; None where the design states no probability."""
        probability = np.array(self.system.loss_probability)
        if not probability.size:
            return None
        kept, weights, _ = self._patterns(error, quantile, targets)
        values = [self._mix(name, error, quantile, kept, weights).quantile(quantile) for name in targets]
        highest = int(np.argmax(values))
        return Mixture(
            quantile=quantile,
            value_mm=values[highest] if values[highest] < inf else None,
            target=targets[highest],
            smallest_loss_probability=float(probability.min()),
            largest_loss_probability=float(probability.max()),
            probability_of_none=float((1 - probability).prod()),
            probability_unaccounted=max(1.0 - float(weights.sum()), 0.0),
        )

    def law(self, name: str, error: str, quantile: float) -> MixedLaw:
        """The law of an error at a target over all shots of a simulation, as far as first order tells.

        Patterns of more losses than are looked at do not count as beyond, as they do in ``mixture``, which is a bound:
        they are as if they were like the others.
        """
        kept, weights, examined = self._patterns(error, quantile, (name,))
        return self._mix(name, error, quantile, kept, weights / examined)

    def _mix(self, name: str, error: str, quantile: float, kept: Array, weights: Array) -> MixedLaw:
        models = [self.model_without(name, left) for left in kept]
        return MixedLaw([error_law(model, error, quantile).law for model in models], weights)

    def _patterns(self, error: str, quantile: float, targets: Sequence[str]) -> tuple[Array, Array, float]:
        """Losses of none, one and two (of very many fiducials: one) that leave an answer: kept (S, N), and their
        probabilities (S,); then the probability of all that were examined, with or without an answer."""
        probability = np.array(self.system.loss_probability)
        each = [self.images(lost) for lost in range(3 if self.count <= PAIRS_UP_TO else 2)]
        kept = np.concatenate([images[0] for images in each])
        covariances = np.concatenate([images[1] for images in each], axis=1)
        weights = np.where(kept > 0, 1 - probability, probability).prod(axis=1)
        answered = (weights > 0) & self._find_answered(kept, covariances, error, quantile, targets)
        return kept[answered], weights[answered], float(weights.sum())

    def _find_answered(
        self, kept: Array, covariances: Array, error: str, quantile: float, targets: Sequence[str]
    ) -> NDArray[np.bool_]:
        """(S,) whether what is left still has an answer, refused as a structure without the lost ones would be."""
        answered = np.asarray((kept @ self.chain.weights.T).min(axis=1) >= fewest_fiducials(self.system))
        enough = np.flatnonzero(answered)
        for name in targets:
            law = error_law(self.models[name], error, quantile)
            forms, *_ = self._rank(kept[enough], covariances[self.names.index(name), enough], name, law, quantile)
            whole = self._form(law, name, law.total_covariance, quantile)[0]
            for s in enough[~(forms < WORSE * whole)]:
                answered[s] &= not self._find_refusal(kept[s])
            answered[enough[~(forms < inf)]] = False
        return answered

    def _find_refusal(self, kept: Array) -> str:
        """Why the structure without fiducials that have a 0 in kept (N,) is refused; empty: it is not."""
        try:
            examine(without_fiducials(self.system, self.labels(kept)))
        except IllPosedError as refusal:
            return refusal.problems[0].detail
        return ""

    def _rank(
        self, kept: Array, covariances: Array, name: str, law: ErrorLaw, quantile: float
    ) -> tuple[Array, Array, Array]:
        """Pearson's quantile (S,), mm, of each loss at a target, the cumulants (S, 3) and covariances (S, 3, 3)."""
        model = self.models[name]
        if self.mean_changes:
            every = [self.model_without(name, left) for left in kept]
            total = np.array([covariance(each, law.error) for each in every])
            means = law.worst.mean_mm + [each.bias_mm(law.error) - model.bias_mm(law.error) for each in every]
            return *self._form(law, name, total, quantile, means), total
        to_error = model.tcp_from_localisation if law.error == "tcp" else np.eye(3)
        other = np.zeros((3, 3))
        for block in model.blocks:
            if not block.imaged:
                gain = model.gain(block, law.error) * block.std
                other += gain @ gain.T
        total = to_error @ covariances @ to_error.T + other
        return *self._form(law, name, total, quantile), total

    def _form(
        self, law: ErrorLaw, name: str, total: Array, quantile: float, means: Array | None = None
    ) -> tuple[Array, Array]:
        """Pearson's quantile (...), mm, of a target's error with other covariances (..., 3, 3) and means (..., 3), and
        cumulants (..., 3).

        Manufacturing errors count as Gaussian.
        """
        mean = law.worst.mean_mm if means is None else np.moveaxis(means, -1, 0)
        uniform: list[Array] = []
        triangular: list[Array] = []
        for block in self.models[name].blocks:
            for j, own in enumerate(block.laws):
                if not block.grouped and own in (Law.UNIFORM, Law.TRIANGULAR):
                    column = self.models[name].gain(block, law.error)[:, j] * block.half_width[j]
                    (uniform if own is Law.UNIFORM else triangular).append(column)
        with np.errstate(all="ignore"):
            cumulants = square_cumulants(mean, np.moveaxis(total, (-2, -1), (0, 1)), uniform, triangular)
            form = np.asarray(np.sqrt(pearson_square(*cumulants, float(ndtri(quantile)))))
        return np.where(np.isfinite(form), form, inf), np.stack(cumulants, axis=-1)
