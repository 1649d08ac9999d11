"""Simulated shots in which fiducials are missed, against structures from which they were really taken."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_montecarlo_shards import cut_at

from plain_data import DEMO, problems_of, replaced
from plain_trials import simulate
from scenes import cios_system, cube8_system, installation, random_system, system_of, taken
from tailstack import load_design, score, verify
from tailstack.design.write import Revision, revise_design
from tailstack.errors import IllPosedError, OutOfRangeError
from tailstack.estimation import missed as missed_module
from tailstack.estimation.checks import examine
from tailstack.estimation.missed import find_surely_answered, hide_fiducials
from tailstack.montecarlo.chain import draw, draw_losses, run_indices
from tailstack.montecarlo.estimators import cvar_interval
from tailstack.montecarlo.plan import compile_plan, object_frame, replan
from tailstack.montecarlo.shards import BLOCK
from tailstack.montecarlo.simulate import Run, Simulation
from tailstack.system import Estimator, Requirement, Triangulation
from tailstack.verification import Sampling, prepare, verify_prepared


def text_of(record):
    """Its JSON; ValueError for a number that is none."""
    return json.dumps(record.to_dict(), allow_nan=False)


SEVEN = np.random.default_rng(3).uniform(-50, 50, (7, 3)) + np.array([0, 0, -20.0])


def missed(system, probability):
    """The system whose fiducials are each missed so often."""
    return replace(system, loss_probability=(probability,) * len(system.fiducial_labels))


def by_lot(system, shots, rng):
    """(shots,) mm: patterns drawn by NumPy, then so many shots of each structure that is left, by its own seed."""
    lost = rng.random((shots, len(system.fiducials_mm))) < np.array(system.loss_probability)
    patterns, counts = np.unique(lost, axis=0, return_counts=True)
    norms = []
    for pattern, count in zip(patterns, counts, strict=True):
        rest = taken(system, set(np.flatnonzero(pattern)))
        errors = run_indices(compile_plan(rest), int(rng.integers(2**60)), 0, int(count)).errors[0, 0]
        norms.append(np.sqrt((errors**2).sum(axis=0)))
    return np.concatenate(norms)


@pytest.mark.long("twelve", "pose")
@pytest.mark.parametrize("scene", ["cube", "twelve", "random", "pose", "weighted"])
def test_p95_over_shots_with_beads_missed_is_that_of_structures_without_them(scene):
    """brute force: 4.5 standard errors of both samples together, one false alarm in 100,000."""
    rng = np.random.default_rng(11)
    system = missed(cube8_system(), 0.02)
    if scene == "twelve":
        system = missed(cios_system(), 0.05)
    elif scene == "random":
        system = random_system(rng, 10, 2, targets=1)
        system = replace(system, loss_probability=(0.0, 0.02, 0.2, 0.01, 0.05, 0.0, 0.1, 0.02, 0.04, 0.0))
    elif scene == "pose":
        system = missed(replace(cube8_system(), estimator=Estimator.POSE), 0.05)
    elif scene == "weighted":
        system = missed(replace(cube8_system(), triangulation=Triangulation.WEIGHTED), 0.01)
    ours, theirs = (4_000, 4_000) if scene == "weighted" else (60_000, 60_000)
    norms = by_lot(system, theirs, rng)
    found = simulate(system, trials=ours, seed=4).of(0)
    limit = np.sort(found.tail)[-round(0.05 * ours)]
    within = (norms <= limit).mean()
    assert within == pytest.approx(0.95, abs=4.5 * np.sqrt(0.95 * 0.05 * (1 / ours + 1 / theirs)))
    assert norms.mean() == pytest.approx(found.mean_norm, abs=4.5 * norms.std() * np.sqrt(1 / ours + 1 / theirs))


def test_the_check_and_the_score_agree_on_what_missing_beads_does():
    """exact law: 5 in 100,000 shots miss three beads or more, which the score counts as beyond."""
    system = missed(cube8_system(), 0.01)
    line = score(system).losses[0]
    check = verify(system, trials=400_000, seed=2)
    target = check.targets[0]
    assert target.first_order_p95_mm == pytest.approx(line.mixture.value, rel=0.002)
    assert target.first_order_p95_mm > 1.01 * line.value
    assert check.first_order_ratio == pytest.approx(1, abs=0.01)
    assert not [finding for finding in check.verdict.findings if finding.rule == "first-order-gap"]


def test_shots_that_miss_nothing_have_the_digits_they_had():
    """digits: of the same seed without a probability."""
    plain, often = compile_plan(cios_system()), compile_plan(missed(cios_system(), 0.03))
    numbers = np.arange(5000)
    lost = draw_losses(often, 9, numbers)
    complete = ~lost.any(axis=1)
    assert complete.mean() == pytest.approx(0.97**12, abs=0.03)
    np.testing.assert_array_equal(draw(plain, 9, numbers), draw(often, 9, numbers))
    errors = [run_indices(plan, 9, 0, 5000).errors for plan in (plain, often)]
    np.testing.assert_array_equal(errors[0][..., complete], errors[1][..., complete])
    assert (errors[0][..., ~complete] != errors[1][..., ~complete]).all()
    np.testing.assert_array_equal(draw_losses(often, 9, numbers[4000:]), lost[4000:])


@pytest.mark.parametrize("estimator", [Estimator.DLT, Estimator.POSE])
def test_a_bead_that_every_shot_misses_is_one_that_no_view_sees(estimator):
    """digits: of the same seed with views[].sees."""
    system = replace(cios_system(), estimator=estimator)
    always = replace(system, loss_probability=(0.0, 0.0, 1.0, *[0.0] * 9))
    labels = tuple(label for label in system.fiducial_labels if label != "F3")
    hidden = replace(system, views=tuple(replace(view, sees=labels) for view in system.views))
    each = [run_indices(compile_plan(one), 3, 0, 3000, reprojection=True) for one in (always, hidden)]
    np.testing.assert_array_equal(each[0].errors, each[1].errors)
    np.testing.assert_array_equal(each[0].reprojection, each[1].reprojection)
    assert each[0].missed == 3000


@pytest.mark.parametrize("estimator", [Estimator.DLT, Estimator.POSE])
def test_what_is_surely_answered_is_not_refused(estimator):
    """consistency: with the full examination, over patterns that leave few, flat and undetermined structures."""
    rng = np.random.default_rng(8)
    flat = rng.uniform(-40, 40, (10, 3)) * [1, 1, 1e-7] + np.array([0, 0, -20])
    flat[:4, 2] += rng.uniform(5, 30, 4)  # what holds it off a plane
    said = []
    for points in (flat, rng.uniform(-40, 40, (10, 3)) + np.array([0, 0, -20])):
        system = replace(system_of(points), estimator=estimator)
        lost = rng.random((200, 10)) < 0.4
        lost[:8, :4], lost[:8, 4:] = True, False
        sure = find_surely_answered(system, (system.sees > 0) & ~lost[:, None])
        for pattern, surely in zip(lost, sure, strict=True):
            try:
                examine(hide_fiducials(system, pattern))
                said.append((True, bool(surely)))
            except IllPosedError:
                assert not surely
                said.append((False, False))
    passed = [surely for answered, surely in said if answered]
    assert len(passed) < len(said)
    assert sum(passed) > (0.9 if estimator is Estimator.DLT else 0.3) * len(passed)


def test_shots_that_miss_much_cost_no_examination_each(monkeypatch):
    """Twelve beads, three in ten missed: of 2,000 patterns in a block hardly one is examined by itself, and the plans
    of all have, bit for bit, the tables of a plan made for each."""
    calls = []
    monkeypatch.setattr(missed_module, "examine", lambda system: calls.append(system) or examine(system))
    rng = np.random.default_rng(4)
    system = missed(system_of(rng.uniform(-50, 50, (12, 3)) + np.array([0, 0, -20])), 0.3)
    plan = compile_plan(system)
    run_indices(plan, 0, 0, 2048)
    lost = draw_losses(plan, 0, np.arange(2048))
    patterns = np.unique(lost[lost.any(axis=1)], axis=0)
    answered = patterns[(~patterns).sum(axis=1) >= 6]
    assert len(answered) > 500
    assert len(calls) - (len(patterns) - len(answered)) < 0.1 * len(answered)
    for part, pattern in zip(replan(plan, answered[:100]), answered[:100], strict=True):
        (alone,) = replan(plan, pattern[None])
        own = object_frame(system.fiducials_mm[~pattern])
        assert (part.tables.products[0, ~pattern, 9] == 1).all()
        assert (part.tables.products[0, ~pattern, 3] == own.points[:, 0]).all()
        for name, table in part.tables._asdict().items():
            assert np.array_equal(table, getattr(alone.tables, name)), name
            assert table.flags.c_contiguous
            assert not table.flags.writeable


def test_each_bead_is_missed_as_often_as_it_says_and_by_itself():
    """binomial: 5 standard errors for each of the twelve and each pair of the first three."""
    probability = np.linspace(0.0, 0.4, 12)
    plan = compile_plan(replace(cios_system(), loss_probability=tuple(probability)))
    lost = draw_losses(plan, 1, np.arange(100_000))
    doubt = 5 * np.sqrt(probability * (1 - probability) / 100_000)
    assert (np.abs(lost.mean(axis=0) - probability) <= doubt).all()
    for a, b in ((9, 10), (9, 11), (10, 11)):
        both = probability[a] * probability[b]
        assert (lost[:, a] & lost[:, b]).mean() == pytest.approx(both, abs=5 * np.sqrt(both / 100_000))


def test_one_seed_has_one_answer_however_it_is_cut():
    system = missed(system_of(SEVEN), 0.02)
    system = replace(system, requirements=(Requirement("r", "tcp", 0.95, 9.0, 0.95, ("target",)),))
    ready, elsewhere = prepare(system), SimpleNamespace(shards=cut_at(BLOCK))
    whole = text_of(verify_prepared(ready, Sampling(trials=40_000, seed=5), threads=1))
    assert whole == text_of(verify_prepared(ready, Sampling(trials=40_000, seed=5), threads=3))
    assert whole == text_of(verify_prepared(ready, Sampling(trials=40_000, seed=5), sampler=elsewhere))  # type: ignore[arg-type]  # nothing else is asked of it here
    simulation = Simulation(compile_plan(system), 5, threads=1)
    run = Run(simulation)
    run.grow(16_384)
    grown, once = run.grow(40_000), Run(simulation).grow(40_000)
    np.testing.assert_array_equal(grown.of(0).tail, once.of(0).tail)
    assert (grown.missed, grown.unanswered) == (once.missed, once.unanswered)
    assert once.unanswered > 0


def test_shots_left_without_an_answer_count_as_beyond_and_are_told():
    """binomial: of seven beads DLT can do without one; 4.5 standard errors."""
    system = missed(system_of(SEVEN), 0.02)
    system = replace(system, requirements=(Requirement("r", "tcp", 0.9, 50.0, 0.95, ("target",)),))
    check = verify(system, trials=50_000, seed=1)
    expected = 1 - 0.98**7 - 7 * 0.02 * 0.98**6
    none = check.losses.trials_without_answer / check.losses.trials
    doubt = 4.5 * np.sqrt(expected * (1 - expected) / 50_000)
    assert none == pytest.approx(expected, abs=doubt)
    (target,) = check.targets
    norms = np.linalg.norm(run_indices(compile_plan(system), 1, 0, 50_000).errors[0, 0], axis=0)
    answered = norms[np.isfinite(norms)]
    assert len(norms) - len(answered) == check.losses.trials_without_answer
    rank = int(np.ceil(0.95 * 50_000)) - 1
    assert target.p95_mm == pytest.approx(np.sort(np.where(np.isnan(norms), np.inf, norms))[rank], rel=1e-12)
    assert target.mean_norm_mm == pytest.approx(answered.mean(), rel=1e-12)
    assert target.worst_mm == pytest.approx(answered.max(), rel=1e-12)
    assert target.exceedance.probability == pytest.approx((~(norms <= 50.0)).mean(), rel=1e-12)
    beyond = np.sort(answered)[rank + 1 :]
    assert target.cvar95_mm == pytest.approx(beyond.mean(), rel=0.005)
    (remark,) = [finding for finding in check.verdict.findings if finding.rule == "missed-fiducials"]
    assert remark.severity == "warning"
    assert f"{check.losses.trials_without_answer} of 50000" in remark.message
    assert check.reprojection.trials < 16_384
    assert text_of(check)


@pytest.mark.long
def test_a_unit_misses_beads_shot_by_shot():
    """A requirement on each unit: its own shots differ in what they miss, and it comes to more than without misses."""
    system = replace(
        system_of(SEVEN), structure_connector=installation("structure_connector", (0.0, 0.0, -95.0), 0.05, 0.05)
    )
    plan = compile_plan(missed(system, 0.1), shots_per_unit=64)
    lost = draw_losses(plan, 3, np.arange(640)).any(axis=1).reshape(10, 64)
    assert (lost.any(axis=1) & ~lost.all(axis=1)).all()
    unit = Requirement("unit", "tcp", 0.95, 5.0, 0.95, ("target",), "per_unit", 0.9)
    each = replace(system, requirements=(unit,))
    plain, often = (verify(one, trials=2000).verdict.checks[0].value for one in (each, missed(each, 0.01)))
    assert often > 1.01 * plain


def test_radial_sampling_and_a_quantile_without_a_bound_are_refused():
    with pytest.raises(OutOfRangeError, match="how often fiducials are missed"):
        verify(missed(cios_system(), 0.01), method="radial")
    problem = problems_of(verify, missed(system_of(SEVEN), 0.1), error=IllPosedError)[0]
    assert (problem.pointer, problem.code) == ("/fiducials/loss_probability", "no-bound")
    assert "no bound that 95 % of shots keep" in problem.detail
    with pytest.raises(IllPosedError, match="of 2000 shots miss so many fiducials that they have no answer"):
        verify(missed(system_of(SEVEN), 0.97), trials=2000)


def test_a_limit_of_the_mean_of_the_tail_does_not_pass_where_a_shot_has_no_answer():
    numbers = 1.0, 1.2, 2.0, 20_000, 0.95, 3
    low, high = cvar_interval(*numbers)
    assert cvar_interval(*numbers, is_open=True) == (low, np.inf)
    assert high < 1.3


def test_a_mean_that_has_no_upper_end_is_told_so_and_not_waited_for():
    """One shot without an answer may be off by anything: more shots decide a mean only where it fails."""
    system = missed(system_of(SEVEN), 0.02)
    mean = score(replace(system, loss_probability=())).targets[0].mean_norm_mm
    trials = {}
    for limit in (1.5 * mean, 0.9 * mean):
        limited = Requirement("r", "tcp", 0.9, limit, 0.95, ("target",), statistic="mean")
        ready = prepare(replace(system, requirements=(limited,)))
        check = verify_prepared(ready, Sampling(sequential=True, max_trials=1 << 18))
        trials[check.verdict.status] = check.trials
        for finding in check.verdict.findings:
            assert ("however many are drawn" in finding.message) == (finding.rule == "requirement-inconclusive")
            assert "ask for more trials" not in finding.message
    assert trials["inconclusive"] == 1 << 13
    assert trials["fail"] <= 1 << 13


def test_a_mean_is_open_by_the_design_and_not_by_the_luck_of_the_draw():
    """A cube of which one shot in 18 million has no answer: none is drawn, and the limit of the mean is open all the
    same, by estimate and by simulation; where it is one in a billion of billions, it is kept."""
    statuses = {}
    for system in (missed(cube8_system(), 0.001), missed(cios_system(), 0.001)):
        limited = Requirement("r", "tcp", 0.9, 50.0, 0.95, ("target",), statistic="mean")
        (target,) = (replace(system.targets[0], name="target"),)
        ready = prepare(replace(system, targets=(target,), requirements=(limited,)))
        check = verify_prepared(ready, Sampling(trials=4000))
        assert check.losses.trials_without_answer == 0
        statuses[len(system.fiducials_mm)] = check.verdict.status
        estimated = score(ready.system).verdict.checks[0]
        assert (estimated.open_because == check.verdict.checks[0].open_because) == check.losses.has_open_means
    assert statuses == {8: "inconclusive", 12: "pass"}


@pytest.mark.parametrize(("scene", "some"), [(cube8_system, False), (cube8_system, True), (cios_system, True)])
def test_the_probability_of_no_answer_is_that_of_all_patterns(scene, some):
    """brute force: every pattern there is, each examined as a structure of its own."""
    system = scene()
    probability = np.linspace(0.02, 0.2, len(system.fiducials_mm))
    if some:
        probability[:4] = 0.0
    system = replace(system, loss_probability=tuple(probability))
    lossy, expected = np.flatnonzero(probability), 0.0
    for number in range(2 ** len(lossy)):
        lost = np.zeros(len(probability), dtype=bool)
        lost[lossy] = [number >> k & 1 for k in range(len(lossy))]
        try:
            examine(hide_fiducials(system, lost))
        except IllPosedError:
            expected += np.where(lost, probability, 1 - probability).prod()
    assert expected > 0
    assert missed_module.probability_unanswered(system) == pytest.approx(expected, rel=1e-9)


def test_a_bead_that_is_moved_keeps_its_own_probability():
    data = replaced(DEMO, ("fiducials", "loss_probability"), 0.05)
    design = load_design(replaced(data, ("fiducials", "points", 0, "loss_probability"), 0.3))
    moved = revise_design(design, Revision(fiducials_mm=np.array(design.fiducials.positions_mm) + 0.5))
    points = moved.document.fiducials.points
    assert [point.loss_probability for point in points] == [0.3, *[None] * 11]
    assert points[0].position_mm == tuple(np.array(design.fiducials.positions_mm)[0] + 0.5)
