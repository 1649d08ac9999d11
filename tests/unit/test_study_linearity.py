"""The reach of first order: points against published ratios, intervals that hold, classes, layouts, refusals."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any

import numpy as np
import pytest

from plain_data import read_cases
from scenes import broken_system, cube8_system, mount, with_noise
from tailstack import verify
from tailstack.errors import StudyError
from tailstack.propagation.linear import linearise
from tailstack.studies.linearity import (
    GridPoint,
    apply_place,
    classify,
    default_counts,
    examine_place,
    is_beyond,
    order_far_apart,
    study_linearity,
    write_sentences,
)
from tailstack.system import Law, Sources, Triangulation

TRIALS = 2**15


@pytest.mark.parametrize(("noise_px", "ratio"), [(5.0, 1.0), (10.0, 0.995), (20.0, 0.988), (40.0, 0.957)])
def test_ratio_of_the_cube_over_noise_in_the_published_form(noise_px: float, ratio: float):
    """independent: the plain 4x4 triangulation on a 100 mm cube, target 110 mm from its middle, measured by other
    programs: within 0.3 % to 5 px, then -0.5, -1.2 and -4.3 %, each good to some 0.2 %."""
    system = cube8_system(triangulation=Triangulation.PUBLISHED)
    point = examine_place(system, 0, "tcp", GridPoint(noise_px, 0.0, 1.0, 8), 2**13, 1)
    low, high = point.ratio_interval
    assert low < point.ratio < high
    assert point.ratio == pytest.approx(ratio, abs=0.003 + 1.2 * (high - low))
    assert high - low < 0.04
    assert point.monte_carlo_p95_mm == pytest.approx(point.first_order_p95_mm / point.ratio, rel=1e-12)


@pytest.mark.long("40.0")
@pytest.mark.parametrize("noise_px", [10.0, 40.0])
def test_ratio_against_plain_monte_carlo(noise_px: float):
    """sampled: order statistics of 400,000 trials of another seed, no linear model in them; 99 % interval, and ours."""
    system = cube8_system(views=with_noise(noise_px))
    plain = verify(system, trials=400_000, seed=77).targets[0]
    point = examine_place(system, 0, "tcp", GridPoint(noise_px, 0.0, 1.0, 8), TRIALS, 1)
    error = 1.4 * (plain.p95_interval_mm[1] - plain.p95_interval_mm[0]) / 2 / plain.p95_mm
    low, high = point.ratio_interval
    assert low - error <= plain.first_order_ratio <= high + error


@pytest.mark.parametrize(("rotation_deg", "ratio"), [(1.0, 1.0008), (2.0, 1.0020), (5.0, 1.0054)])
def test_ratio_over_random_rotations_of_both_interfaces(rotation_deg: float, ratio: float):
    """independent: random rotations of 1, 2 and 5 deg give 1.0008, 1.0020 and 1.0054."""
    second = mount("connector_flange", (0, 0, -145), half_width=[radians(rotation_deg)] * 3 + [0] * 3)
    point = examine_place(
        cube8_system(connector_flange=second), 0, "tcp", GridPoint(0.5, rotation_deg, 1.0, 8), TRIALS, 2
    )
    assert point.ratio == pytest.approx(ratio, abs=0.0015)


@pytest.mark.long
def test_a_far_target_of_a_small_cluster_is_plainly_optimistic():
    """sampled: plain Monte Carlo of another seed; beyond the reach of the linearisation it says so."""
    system = broken_system(views=with_noise(2.0))
    point = examine_place(system, 0, "localisation", GridPoint(2.0, 0.0, 1.0, 7), TRIALS, 3)
    plain = verify(system, trials=20_000, seed=8).targets[0].localisation
    assert point.ratio == pytest.approx(plain.first_order_ratio, rel=0.15)
    assert point.ratio < 0.4
    assert (point.within, point.sure, point.errs) == ("beyond", True, "optimistic")
    assert point.promise == "not valid"
    assert point.trials == TRIALS // 8


@pytest.mark.long
def test_intervals_hold_what_they_promise():
    """sampled: 40 seeds; the truth is the pooled ratio of all.  Of 95 % intervals at least 33 hold it with probability
    0.9986."""
    place = GridPoint(4.0, 0.0, 0.5, 8)
    found = [examine_place(cube8_system(), 0, "localisation", place, 2**13, seed) for seed in range(40)]
    logs = np.log([point.ratio for point in found])
    truth = float(np.exp(logs.mean()))
    held = sum(point.ratio_interval[0] <= truth <= point.ratio_interval[1] for point in found)
    assert held >= 33
    # ... and they are not wide for nothing: their half-widths against the scatter of the ratios
    half = np.mean([np.diff(np.log(point.ratio_interval))[0] / 2 for point in found])
    assert half == pytest.approx(2.13 * logs.std(ddof=1), rel=0.25)


@pytest.mark.parametrize(("ratio", "interval", "expected"), read_cases("studies", "classes"))
def test_classes_and_whether_they_are_sure(ratio: float, interval: tuple[float, float], expected: tuple[str, bool]):
    assert classify(ratio, interval) == tuple(expected)


def test_what_a_point_changes_and_what_it_leaves():
    """closed form: distances scale with the spread, rotations get their standard deviation, translations stay."""
    half = [radians(0.3)] * 3 + [0.4] * 3
    system = cube8_system(
        structure_connector=mount("structure_connector", (0, 0, -95), half_width=half, law=Law.UNIFORM)
    )
    here = apply_place(system, GridPoint(2.0, 1.5, 0.5, 6))
    assert len(here.fiducials_mm) == len(here.fiducial_labels) == 6
    centre = system.fiducials_mm.mean(axis=0)
    kept = np.sort(order_far_apart(system.fiducials_mm)[:6])
    assert here.fiducials_mm - centre == pytest.approx(0.5 * (system.fiducials_mm[kept] - centre))
    assert {view.fiducial_noise_px for view in here.views} == {view.target_noise_px for view in here.views} == {2.0}
    sources = here.structure_connector.sources
    assert sources.names == ("rx", "ry", "rz", "tx", "ty", "tz")
    assert sources.laws == (Law.NORMAL,) * 3 + (Law.UNIFORM,) * 3
    assert sources.std == pytest.approx([radians(1.5)] * 3 + [0.4 / 3**0.5] * 3)
    still = apply_place(system, GridPoint(2.0, 0.0, 1.0, 8)).structure_connector.sources
    assert still.names == ("tx", "ty", "tz")
    assert still.direction == pytest.approx(np.eye(6)[:, 3:])


def test_fiducials_that_are_kept_are_far_apart():
    """closed form: of a line of points the ends come first, then the middle."""
    points = np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])
    order = order_far_apart(points)
    assert set(order[:2]) == {0, 8}
    assert order[2] == 4
    assert sorted(order) == list(range(9))


@pytest.mark.long
def test_the_grid_is_whole_and_repeatable():
    axes: dict[str, Any] = {
        "noises_px": (0.5, 2.0),
        "rotations_deg": (0.0, 1.0),
        "spreads": (1.0, 0.3),
        "counts": (8, 6),
    }
    first = study_linearity(cube8_system(), **axes, trials=2**13, seed=4, threads=1)
    assert study_linearity(cube8_system(), **axes, trials=2**13, seed=4, threads=2) == first
    assert [(p.fiducials, p.spread, p.noise_px, p.rotation_deg) for p in first.points[:5]] == [
        (8, 1.0, 0.5, 0.0), (8, 1.0, 0.5, 1.0), (8, 1.0, 2.0, 0.0), (8, 1.0, 2.0, 1.0), (8, 0.3, 0.5, 0.0),
    ]  # fmt: skip
    assert len(first.points) == 16
    for point in first.points:
        if point.status == "ok":
            alone = apply_place(
                cube8_system(), GridPoint(point.noise_px, point.rotation_deg, point.spread, point.fiducials)
            )
            assert point.nu == pytest.approx(linearise(alone, alone.targets[0]).nu, rel=1e-12)


def test_a_point_that_determines_nothing_is_a_row_with_its_reason():
    """Too wide for the detector of the reference C-arm, whose field is 102 mm: refused, and the others are there."""
    study = study_linearity(
        cube8_system(), noises_px=(0.5,), rotations_deg=(0.0,), spreads=(1.0, 5.0), counts=(8,), trials=2**13
    )
    good, bad = study.points
    assert (good.status, bad.status) == ("ok", "refused")
    assert bad.reason
    assert bad.ratio is bad.within is bad.nu is None
    assert "Of 1 point the estimate" in study.sentences[0]


def test_a_locator_keeps_its_shift_and_loses_its_turn():
    """closed form: a source along (rx, ty) leaves ty at the pivot, one that only turns leaves nothing."""
    both = np.array([[1e-3, 0, 0, 0, 1, 0], [0, 0, 1e-3, 0, 0, 0], [0, 0, 0, 0, 0, 1.0]]).T
    sources = Sources(("A1", "A2", "A3"), (Law.UNIFORM,) * 3, np.full(3, 0.3), np.ones(3), ("mm",) * 3, both)
    first = cube8_system().structure_connector
    for rotation_deg, names in ((0.0, ("A1", "A3")), (2.0, ("rx", "ry", "rz", "A1", "A3"))):
        here = apply_place(
            cube8_system(structure_connector=replace(first, sources=sources)), GridPoint(1.0, rotation_deg, 1.0, 8)
        )
        kept = here.structure_connector.sources
        assert kept.names == names
        assert kept.direction[:, -2:] == pytest.approx(np.eye(6)[:, [4, 5]])
        assert kept.std[-2:] == pytest.approx([0.3 / 3**0.5] * 2)
    assert both[0, 0] == 1e-3  # the design's own is not written to


def test_words_count_what_is_there():
    """Counted by hand; what an interval leaves open is neither within nor beyond."""
    base = examine_place(cube8_system(), 0, "tcp", GridPoint(0.5, 0.0, 1.0, 8), 2**13, 1)
    points = [
        replace(base, ratio=1.002, ratio_interval=(1.0, 1.004), errs="none seen"),
        replace(base, ratio=1.02, ratio_interval=(1.015, 1.025), errs="pessimistic"),
        replace(base, ratio=1.008, ratio_interval=(1.004, 1.012), errs="pessimistic"),
        replace(base, ratio=0.7, ratio_interval=(0.65, 0.75), errs="optimistic", nu=0.31),
        replace(base, ratio=0.94, ratio_interval=(0.92, 0.96), errs="optimistic", nu=0.21),
        replace(base, ratio=0.78, ratio_interval=(0.74, 0.82), errs="optimistic", nu=0.41),
        replace(base, ratio=1.3, ratio_interval=(1.21, 1.4), errs="pessimistic", nu=0.51),
    ]
    assert [is_beyond(point, 0.01) for point in points[:3]] == [False, True, None]
    assert [is_beyond(point, 0.2) for point in points[3:]] == [True, False, None, True]
    said = write_sentences(points)
    assert said[0].startswith(
        "Of 7 points the estimate is, with the whole interval, within 1 % at 1 (1 open), within 5 % at 3 (1 open), "
        "within 20 % at 4 (1 open)."
    )
    assert "Where it is surely further off than 5 %, it is too small at 2 points and too large at 1." in (said[1])
    assert "Nowhere" in write_sentences(points[:3])[1]


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ({"noises_px": (0.0,)}, "noise must lie between"),
        ({"spreads": (-1.0,)}, "spread must lie between"),
        ({"counts": (5,)}, "count must lie between 6 and 8"),
        ({"rotations_deg": (90.0,)}, "rotation must lie between"),
        ({"noises_px": (1.0, 1.0)}, "each of them once"),
        ({"noises_px": tuple(np.linspace(0.1, 9, 2000)), "counts": (6, 7, 8)}, "at most 5,000 points"),
    ],
)
def test_refusals_of_axes(axes: dict, said: str):
    with pytest.raises(StudyError, match=said):
        study_linearity(cube8_system(), **axes)


def test_default_counts():
    assert default_counts(12) == (12, 8, 7)
    assert default_counts(8) == (8, 7, 6)
    assert default_counts(6) == (6,)
