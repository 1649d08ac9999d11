"""Fifty quantiles of a law, the middles of fifty equal parts: shots of a quantile dot plot (Kay et al., CHI 2016)."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from ..geometry.arrays import Array
from ..results.score import SHOTS
from .declared import MixedLaw, law_quantile

ORDERS = (np.arange(SHOTS) + 0.5) / SHOTS
WITHIN = 1e-4  # of its order, beside the error of the law itself
_INTERVALS, _ROUNDS = 24, 60


def fifty_quantiles(law: MixedLaw) -> Array:
    """(50,) mm, quantiles of |e| at ORDERS, checked to WITHIN, by chords over normal deviates; NaN: there is none."""
    law = MixedLaw(law.laws, law.weights, ORDERS[-1], fine=False)
    found, off = np.full(SHOTS, np.nan), float(law.weights.sum()) >= ORDERS
    end = law_quantile(law.laws[int(law.weights.argmax())], ORDERS[-1], fine=False).quantile_mm or 1e-9
    while law.probability(end) < ORDERS[off].max(initial=WITHIN) - WITHIN:
        end *= 1.1
    radii = end * np.linspace(0.0, 1.0, _INTERVALS + 1)
    known = np.array([law.probability(r) for r in radii.tolist()])
    for _ in range(_ROUNDS):
        found[off] = np.interp(ndtri(ORDERS[off]), ndtri(np.clip(known, 1e-12, 1 - 1e-12)), radii)
        reached = np.array([law.probability(r) for r in found[off].tolist()])
        radii, known = np.sort(np.append(radii, found[off])), np.sort(np.append(known, reached))
        off[off] = (np.abs(reached - ORDERS[off]) > WITHIN) & ((found[off] > 0) | (reached < ORDERS[off]))
        if not off.any():
            break
    return found
