"""A quantile and probabilities from one lattice, against the fine functions, each with a lattice of its own."""

from __future__ import annotations

import numpy as np
import pytest

from tailstack.tail.declared import law_cdf, law_quantile, linear_law
from tailstack.tail.per_unit import quantile_and_probabilities

NOISE = np.array([[0.04, 0.01, -0.02], [0.01, 0.09, 0.03], [-0.02, 0.03, 0.16]]) / 10
COLUMNS = np.array([[0.7, 0.0, 0.1, 0.3], [0.0, 0.6, 0.2, -0.2], [0.1, 0.0, 0.3, 0.2]])
FLAT = np.diag([0.04, 0.09, 0.0])
LAWS = {
    "declared": linear_law([0.2, 0, 0.1], NOISE, COLUMNS, [0, 1, 0, 1]),
    "without noise": linear_law([0.2, 0, 0.1], np.zeros((3, 3)), COLUMNS),
    "in a plane beside the origin": linear_law([0.2, 0, 0.3], FLAT, np.diag([0.5, 0.4, 0.0])[:, :2]),
    "Gaussian": linear_law([0.2, 0, 0.1], NOISE),
    "one source": linear_law([0.1, 0, 0], np.zeros((3, 3)), np.array([[0.5], [0.0], [0.0]])),
}


@pytest.mark.parametrize("name", LAWS)
def test_as_good_as_a_lattice_for_each(name):
    law = LAWS[name]
    quantile, probabilities = quantile_and_probabilities(law, 0.95, radii := quantiles(law))
    assert quantile == pytest.approx(radii[3], rel=1e-4)
    assert probabilities == pytest.approx([law_cdf(law, r) for r in radii], abs=1e-4)


def quantiles(law):
    """From well inside to beyond the lattice of the last but one."""
    middle = law_quantile(law, 0.95).quantile_mm
    return [0.2 * middle, 0.7 * middle, 0.95 * middle, middle, 1.3 * middle]


def test_no_radius_has_no_probability():
    assert quantile_and_probabilities(LAWS["declared"], 0.95, [np.nan, 100.0])[1] == [0.0, 1.0]
    assert quantile_and_probabilities(LAWS["Gaussian"], 0.95, [np.nan])[1] == [0.0]
    assert quantile_and_probabilities(LAWS["in a plane beside the origin"], 0.95, [0.29])[1] == [0.0]
    assert quantile_and_probabilities(LAWS["declared"], 0.95, [])[1] == []
