"""exp, sin and cos of the lanes against the maths library."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tailstack.tail.elementary import exponential, share_lost, sine_and_cosine


def test_exponential() -> None:
    for x in [*np.linspace(-10, 10, 997), -1e-300, 0.0, 1e-9]:
        assert exponential(float(x)) == pytest.approx(math.exp(x), rel=4e-15)
    for x in np.linspace(-30, 30, 101):
        assert exponential(float(x)) == pytest.approx(math.exp(x), rel=1e-13)
    for x in np.linspace(-60, -30, 101):
        assert exponential(float(x)) == pytest.approx(math.exp(x), rel=3e-10)
    assert exponential(-700.0) == exponential(-math.inf) == pytest.approx(math.exp(-64), rel=1e-9)
    assert math.isnan(exponential(math.nan)) or exponential(math.nan) == exponential(-64.0)


def test_share_lost() -> None:
    """However little is lost, and where all is."""
    for x in [*np.geomspace(1e-300, 700, 2000), 0.0, math.inf]:
        assert share_lost(float(x)) == pytest.approx(-math.expm1(-x), rel=2e-15, abs=0.0)


@pytest.mark.parametrize(
    ("largest", "most"), [(10.0, 2e-16), (1e4, 2e-16), (9e5, 2e-16), (1e9, 1.2e-7), (1e12, 1.3e-4)]
)
def test_sine_and_cosine(largest: float, most: float) -> None:
    rng = np.random.default_rng(3)
    quarters = np.arange(-8, 9) * math.pi / 4
    for x in [*rng.uniform(-largest, largest, 4000), *quarters, 0.0, -0.0]:
        sine, cosine = sine_and_cosine(float(x))
        assert abs(sine - math.sin(x)) <= most
        assert abs(cosine - math.cos(x)) <= most
        assert sine**2 + cosine**2 == pytest.approx(1.0, abs=1e-15)
