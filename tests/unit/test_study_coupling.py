"""Coupling of installation error and noise: against closed forms, the oracles' noise covariance and the plain chain.

Where the expected values come from is said at each test.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import reference_chain
from plain_data import problems_of
from scenes import broken_system, cube8_system, mount, projection_looking, with_noise
from tailstack.errors import LimitError, OutOfRangeError, StudyError
from tailstack.geometry.rotation import RotationForm
from tailstack.studies.coupling import (
    TRIALS_BEYOND,
    CouplingCase,
    Ratio,
    StudyCoupling,
    average_near,
    level_torsor,
    study_coupling,
    tell_coupling,
    tell_side,
    widen,
    write_conclusions,
    write_percent,
)
from tailstack.studies.sections import SECTIONS, estimate_by_sections, take_quantile
from tailstack.system import Law

ORACLE = json.loads((Path(__file__).parents[1] / "data/oracles/noise_covariance_cube8.json").read_text())
PIVOT = np.array([0.0, 0.0, -95.0])
Q = np.array([0.0, 0.0, 70.0])
LEVEL = (2.0, 5.0)


@pytest.fixture(scope="module")
def cube() -> StudyCoupling:
    return study_coupling(cube8_system(), levels=(LEVEL, (10.0, 20.0)), trials=2**16, error="localisation")


def case_of(study: StudyCoupling, reading: str, rotation_deg: float | None) -> CouplingCase:
    return next(case for case in study.cases if case.reading == reading and case.rotation_deg == rotation_deg)


def level_matrix() -> tuple[np.ndarray, np.ndarray]:
    """R and the shift of ``X -> R (X - p) + p + t`` of LEVEL, written out."""
    angle, t = np.deg2rad(LEVEL[0]), np.full(3, LEVEL[1] / np.sqrt(3))
    rotation = reference_chain.rotation(np.full(3, angle), RotationForm.FULL)
    return rotation, PIVOT + t - rotation @ PIVOT


def test_installation_alone_is_the_rigid_displacement(cube: StudyCoupling) -> None:
    """closed_form: T q in the Eq 18 reading, T^-1 q in the physical one, minus q."""
    rotation, shift = level_matrix()
    assert case_of(cube, "eq18", 2.0).p95_installation_mm == pytest.approx(
        np.linalg.norm(rotation @ Q + shift - Q), rel=1e-9
    )
    back = rotation.T @ (Q - shift)
    assert case_of(cube, "physical", 2.0).p95_installation_mm == pytest.approx(np.linalg.norm(back - Q), rel=1e-9)


def test_noise_alone_is_the_oracle_s(cube: StudyCoupling) -> None:
    """oracle: P95 0.2518 mm and the covariance of eight corners at 0.5 px; sampled (65,536 trials: 1 % is 3 sigma)."""
    case = case_of(cube, "physical", 2.0)
    expected = np.array(ORACLE["Sigma"])
    assert case.p95_noise_mm == pytest.approx(ORACLE["P95"], rel=0.012)
    assert case.noise_rms_nominal_mm == pytest.approx(np.sqrt(np.trace(expected)), rel=0.012)


def test_eq18_turns_the_noise_and_leaves_its_size(cube: StudyCoupling) -> None:
    """closed_form: q_hat = T q_hat_0 trial by trial, so the gain is one to rounding; and P95 together is that of
    T q - q + R n with n of the oracle's covariance (independent: 10^6 NumPy draws, 0.05 % is 3 sigma of both)."""
    case = case_of(cube, "eq18", 2.0)
    assert abs(case.gain.value - 1) < 1e-9
    assert max(abs(end - 1) for end in case.gain.interval) < 1e-9
    rotation, shift = level_matrix()
    rng = np.random.default_rng(3)
    noise = rng.multivariate_normal(np.zeros(3), np.array(ORACLE["Sigma"]), 1_000_000)
    errors = rotation @ Q + shift - Q + noise @ rotation.T
    assert case.p95_together_mm == pytest.approx(np.quantile(np.linalg.norm(errors, axis=1), 0.95), rel=5e-4)


@pytest.mark.long
def test_gain_at_the_biased_geometry_is_the_plain_chain_s(cube: StudyCoupling) -> None:
    """independent: 2000 trials of the plain SVD chain on the same noise with and without the level.  A trial's ratio
    spreads by 4 %, so theirs is good to 0.35 % (4 sigma); known: -1.7 % at 2 deg + 5 mm, -5 % at 10 deg + 20 mm."""
    system = cube8_system()
    moved = replace(system, structure_connector=mount("structure_connector", PIVOT, bias=level_torsor(LEVEL)))
    rng = np.random.default_rng(11)
    squares = np.zeros(2)
    still = reference_chain.run(moved, moved.targets[0], {})["localisation"]
    for _ in range(2000):
        inputs = {
            f"{kind}_noise:{view.name}": rng.normal(0, 0.5, size)
            for view in system.views
            for kind, size in (("fiducial", 16), ("target", 2))
        }
        biased = reference_chain.run(moved, moved.targets[0], inputs)["localisation"] - still
        nominal = reference_chain.run(system, system.targets[0], inputs)["localisation"]
        squares += [biased @ biased, nominal @ nominal]
    gain = case_of(cube, "physical", 2.0).gain
    assert gain.value == pytest.approx(np.sqrt(squares[0] / squares[1]), rel=3.5e-3)
    assert gain.value == pytest.approx(0.983, abs=1e-3)
    assert gain.interval[0] < (gain.first_order or 0.0) < gain.interval[1]
    assert case_of(cube, "physical", 10.0).gain.value == pytest.approx(0.95, abs=4e-3)


def test_first_order_predicts_what_quadrature_does_not(cube: StudyCoupling) -> None:
    """known: joint above quadrature by per cents, below the sum, first order within 0.3 %."""
    for case in cube.cases:
        if case.rotation_deg is None:
            assert case.p95_installation_mm < 1e-12
            continue
        assert tell_side(case.against_quadrature) == 1
        assert tell_side(case.against_sum) == -1
        assert abs(case.against_first_order.value - 1) < 3e-3
        for ratio in (case.against_quadrature, case.against_sum, case.against_vector_sum):
            assert ratio.first_order == pytest.approx(ratio.value, abs=5e-4)


def test_declared_laws_are_sampled_as_declared() -> None:
    """closed_form: with uniform tolerances on one translation and vanishing noise the error is uniform: P95 = 0.95 h.
    sampled: 0.4 % is 3 sigma of P95 at 32,768 trials (density 1 / h)."""
    seat = mount("structure_connector", PIVOT, half_width=(0, 0, 0, 0.3, 0, 0), law=Law.UNIFORM)
    quiet = cube8_system(structure_connector=seat, views=with_noise(1e-4))
    study = study_coupling(quiet, levels=(), trials=2**15)
    assert {case.reading for case in study.cases} == {"physical", "eq18"}
    for case in study.cases:
        assert case.p95_installation_mm == pytest.approx(0.95 * 0.3, rel=4e-3)
        assert case.p95_together_mm == pytest.approx(case.p95_installation_mm, rel=1e-3)
        assert case.against_first_order.value == pytest.approx(1.0, abs=4e-3)


def test_bounded_components_stand_at_their_worst_end() -> None:
    """closed_form: a bias of 0.2 mm and a bounded 0.3 mm along it make 0.5 mm (within the noise of 1e-4 px)."""
    along = np.array([0, 0, 0, 0, 0, 0.1])
    seat = mount("structure_connector", PIVOT, bias=2 * along, half_width=3 * along, law=Law.BOUNDED)
    quiet = cube8_system(structure_connector=seat, views=with_noise(1e-4))
    study = study_coupling(quiet, levels=((0.0, 1.0),), trials=2**13)
    designed, moved = (case_of(study, "physical", degrees) for degrees in (None, 0.0))
    assert designed.p95_installation_mm == pytest.approx(0.5, rel=1e-6)
    assert designed.p95_first_order_mm == pytest.approx(0.5, rel=1e-3)
    assert moved.p95_installation_mm == pytest.approx(1.0, rel=1e-6)  # a level takes the place of known biases


def test_intervals_cover() -> None:
    """sampled: ratio of two dependent P95 with a known value, 300 samples of 8,192; seed 5.  At 95 % a correct
    interval misses 15; more than 30 or fewer than 4 come once in 10^4."""
    rng = np.random.default_rng(5)
    trials, missed = SECTIONS * 256, 0
    truth = 2.0 * 1.959963985 / (np.sqrt(2.0) * 1.959963985)  # P95 of |2 x| over |x + y|, x and y standard normal
    for _ in range(300):
        x, y = rng.standard_normal((2, trials))
        a, b = np.abs(2 * x), np.abs(x + y)
        found = estimate_by_sections(
            lambda part, a=a, b=b: take_quantile(a[part], 0.95) / take_quantile(b[part], 0.95),  # type: ignore[misc]
            trials,
            0.95,
        )
        missed += not found.interval[0] <= truth <= found.interval[1]
    assert 4 <= missed <= 30


def test_intervals_cover_differences_smaller_than_the_gaps_between_trials() -> None:
    """sampled: |x| against |x| (1 + u 1e-5) with u standard normal, whose truth is one; 300 samples of 8,192, seed 6.
    The same trial is then P95 of both, and quantiles alone would miss in most samples."""
    rng, missed, alone = np.random.default_rng(6), 0, 0
    for _ in range(300):
        x, u = rng.standard_normal((2, SECTIONS * 256))
        a, b = np.abs(x) * (1 + 1e-5 * u), np.abs(x)
        for found, by in ((average_near, "window"), (lambda values, p: take_quantile(values, p), "quantile")):
            ratio = estimate_by_sections(
                lambda part, f=found, a=a, b=b: f(a[part], 0.95) / f(b[part], 0.95),  # type: ignore[misc]
                len(x),
                0.95,
            )
            out = not ratio.interval[0] <= 1 <= ratio.interval[1]
            missed, alone = missed + (out and by == "window"), alone + (out and by == "quantile")
    assert 4 <= missed <= 30
    assert alone > 100


def test_a_mean_about_a_quantile_is_over_its_share_of_the_trials() -> None:
    """closed_form: of 1 .. 1000 in any order those of rank 940 to 960."""
    values = np.random.default_rng(7).permutation(np.arange(1.0, 1001.0))
    assert average_near(values, 0.95) == np.arange(940.0, 961.0).mean()


def test_the_answer_is_the_seed_s() -> None:
    changed = {"levels": ((1.0, 2.0),), "trials": 8192}
    once = study_coupling(cube8_system(), threads=1, **changed)  # type: ignore[arg-type]
    again = study_coupling(cube8_system(), threads=2, **changed)  # type: ignore[arg-type]
    other = study_coupling(cube8_system(), seed=1, **changed)  # type: ignore[arg-type]
    assert once == again
    assert once.cases[1].p95_together_mm != other.cases[1].p95_together_mm


def test_words_follow_the_intervals(cube: StudyCoupling) -> None:
    above, below, open_ = (
        Ratio(v, i, None) for v, i in ((1.02, (1.01, 1.03)), (0.98, (0.97, 0.99)), (1.01, (0.99, 1.03)))
    )
    assert [tell_coupling(ratio) for ratio in (above, below, open_)] == ["more", "less", "none seen"]
    assert tell_coupling(Ratio(1 + 1e-12, (1 + 5e-13, 1 + 2e-12), None)) == "none seen"
    assert write_percent(above) == "+2.0 %"
    case = case_of(cube, "physical", 2.0)

    def with_sum(ratio: Ratio) -> CouplingCase:
        return replace(case, against_vector_sum=ratio, coupling=tell_coupling(ratio))

    assert write_conclusions([with_sum(open_)])[0].startswith("Together they make no more than their sum")
    assert "no more than their sum" in write_conclusions([with_sum(below)])[0]
    assert "In 1 of 2 cases P95 is more" in write_conclusions([with_sum(above), with_sum(below)])[0]
    exceeded = replace(case, against_sum=above)
    assert "is exceeded in 1 of 1 cases" in write_conclusions([exceeded])[0]
    assert write_conclusions([replace(case, against_quadrature=below)])[1].startswith(
        "P95 is nowhere seen above the root of the sum of squares"
    )


def test_conclusions_hold_together() -> None:
    """closed_form: Student's t of 31 degrees at 1 - 0.025 / 90 over that at 0.975 is 3.85 / 2.04 (tables); sampled:
    ninety cases without coupling, 40 times over: conclusions by themselves would be wrong in nearly all, together they
    are in 5 % (more than six once in 300).  Seed 12."""
    one = Ratio(1.01, (1.0, 1.02), None)
    low, high = widen(one, 90).interval
    assert (high - low) / 0.02 == pytest.approx(3.85 / 2.0395, rel=0.01)
    assert widen(one, 1).interval == pytest.approx(one.interval)
    rng, wrong, alone = np.random.default_rng(12), 0, 0
    values = 1 + rng.standard_normal((40, 90)) / 1000
    halves = 2.0395 * np.sqrt(rng.chisquare(31, values.shape) / 31) / 1000
    for rows in zip(values, halves, strict=True):
        ratios = [Ratio(float(v), (float(v - h), float(v + h)), None) for v, h in zip(*rows, strict=True)]
        wrong += any(tell_side(widen(ratio, 90)) for ratio in ratios)
        alone += any(tell_side(ratio) for ratio in ratios)
    assert alone >= 35
    assert wrong <= 6


@pytest.mark.long
@pytest.mark.parametrize("why", ["beyond nu 0.2", "rays that hardly meet"])
def test_no_gain_is_given_where_the_noise_has_no_deviation(why: str) -> None:
    """known: a ratio whose denominator may vanish has no variance.  Rays 0.2 deg apart are noise themselves."""
    views = tuple(
        replace(view, projection=projection_looking(azimuth))
        for view, azimuth in zip(cube8_system().views, (0.0, 0.004), strict=True)
    )
    system = broken_system() if why == "beyond nu 0.2" else cube8_system(views=views)
    study = study_coupling(system, levels=((1.0, 2.0),), trials=8192)
    assert study.validity.nu > 0.2
    for case in study.cases:
        assert case.gain is None
        assert case.noise_rms_nominal_mm is None
    if why != "beyond nu 0.2":
        assert study_coupling(system, levels=()).trials == TRIALS_BEYOND


def test_a_level_out_of_the_image_is_remarked_and_one_out_of_sight_refused() -> None:
    """closed_form: 20 mm along (1, 1, 1) and 10 deg take a corner of the cube out of a field of +-102 mm; 45 deg and
    1 m take it behind the source."""
    said = study_coupling(cube8_system(), levels=((10.0, 20.0),), trials=8192).conclusions
    assert len(said) == 4
    assert "10 deg + 20 mm, physical reading" in said[3]
    assert "outside view" in said[3]
    with pytest.raises(StudyError, match=r"45 deg \+ 1000 mm.*behind it") as refused:
        study_coupling(cube8_system(), levels=((-45.0, 1000.0), (45.0, 1000.0)), trials=8192)
    assert refused.value.problems[0].code == "level"


def test_progress_reaches_its_end_and_what_is_held_at_a_time_is_bounded() -> None:
    told: list[tuple[int, int]] = []
    study_coupling(cube8_system(), levels=(), trials=8192, progress=lambda done, total: told.append((done, total)))
    assert told == [(k, 3 * SECTIONS) for k in range(1, 3 * SECTIONS + 1)]  # noise alone, and both readings
    with pytest.raises(LimitError, match="--trials"):
        study_coupling(cube8_system(), trials=2**26)


@pytest.mark.parametrize(
    ("noise_px", "options", "code"),
    [
        (0.5, {"trials": 8191}, "too-few-trials"),
        (0.5, {"levels": ((46.0, 0.0),)}, "level"),
        (0.5, {"levels": ((float("nan"), 0.0),)}, "level"),
        (0.0, {}, "no-noise"),
    ],
)
def test_what_cannot_be_measured_is_refused(noise_px: float, options: dict, code: str) -> None:
    system = cube8_system(views=with_noise(noise_px))
    problems = problems_of(study_coupling, system, **{"trials": 8192, **options}, error=OutOfRangeError)
    assert problems[0].code == code
