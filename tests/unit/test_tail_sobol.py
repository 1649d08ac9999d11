"""Our scrambled Sobol points against SciPy's: the same bits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from tailstack.tail.sobol import scrambled_sobol


@pytest.mark.parametrize(("dimension", "log2_count"), [(1, 0), (1, 6), (2, 12), (47, 7), (313, 5), (1500, 3)])
@pytest.mark.parametrize("seed", [0, 20240229])
def test_points_are_those_of_scipy(dimension, log2_count, seed):
    """independent: scipy.stats.qmc.Sobol from a generator in the same state."""
    ours = scrambled_sobol(dimension, log2_count, np.random.default_rng([seed, dimension]))
    theirs = qmc.Sobol(dimension, scramble=True, rng=np.random.default_rng([seed, dimension]))
    assert np.array_equal(ours, theirs.random_base2(log2_count))


def test_more_dimensions_than_there_are_numbers_for():
    with pytest.raises(ValueError, match="at most 21201 dimensions"):
        scrambled_sobol(30_000, 2, np.random.default_rng(1))
