"""Trajectories in corridors: the joint law of both ends against drawn pairs, the simulation against its own trials."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from plain_data import EVERY
from tailstack import load_design, score, score_batch, verify
from tailstack.design import compile_design
from tailstack.errors import DesignError, TailstackError
from tailstack.montecarlo.chain import run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack.optimisation import optimise
from tailstack.optimisation.exact_law import exact_quantile
from tailstack.optimisation.problem import demands_of
from tailstack.optimisation.terms import linearise_demand
from tailstack.propagation.linear import chain_of
from tailstack.tail.bounded import worst_case
from tailstack.tail.declared import LawReading, LinearLaw, PairLaw, column_gradient, law_gradient, law_quantile
from tailstack.tail.per_unit import unit_risk

SCREW = EVERY["pedicle_screw"]
NO_COLUMNS = np.zeros((6, 0)), np.zeros(0, dtype=np.int64)


def normal_pair(covariance: Any, mean: Any = (0.0,) * 6) -> LinearLaw:
    return LinearLaw(np.array(mean), np.array(covariance, float), *NO_COLUMNS)


def test_ends_apart_and_ends_alike_have_their_closed_forms() -> None:
    """Rayleigh: of two independent ends the square of what one keeps, of equal ones what one keeps."""
    plane = np.diag([0.25, 0.25, 0.0])
    apart = np.kron(np.eye(2), plane)
    alike = np.kron(np.ones((2, 2)), plane)
    for r in (0.8, 1.3, 2.0):
        one = 1 - np.exp(-2 * r * r)
        both = PairLaw(normal_pair(apart), 0.95, fine=True)
        value, error = both.exceedance(r), both.probability_added(r)[1]
        assert value == pytest.approx(1 - one**2, rel=5e-3)
        assert abs(value - (1 - one**2)) < 5 * error
        assert PairLaw(normal_pair(alike), 0.95, fine=True).exceedance(r) == pytest.approx(1 - one, rel=1e-9)
    found = law_quantile(normal_pair(apart), 0.95)
    exact = np.sqrt(-np.log(1 - np.sqrt(0.95)) / 2)
    assert abs(found.quantile_mm - exact) < 5 * found.error_mm < 0.01


Array = np.ndarray[Any, np.dtype[np.float64]]
SHAPES = ([0, 0, 0, 0], [0.5, 0.5, 0, 0], [0.7, 0, 0.7, 0], [0.9, 0.3, 0.6, 0])  # cylinder, cone, ellipse, both


def needed(pairs: Array, room: Array) -> Array:
    """(n,) the smallest r at which both ends (n, 2, 2) are within half-axes r + room (2, 2), by bisection."""
    low, high = np.zeros(len(pairs)), np.abs(pairs).sum(axis=(1, 2))
    for _ in range(30):
        r = 0.5 * (low + high)
        inside = (((pairs / (r[:, None, None] + room)) ** 2).sum(axis=2) <= 1).all(axis=1)
        low, high = np.where(inside, low, r), np.where(inside, r, high)
    return high


def draw(rng: np.random.Generator, trials: int, shape: Any) -> tuple[LinearLaw, Array]:
    """A law of two ends in planes of their own, with much or little in common, and as many pairs: what they need (n,).

    In a channel that is no cylinder the planes are those of two axes, as measures have them."""
    basis, room = np.zeros((6, 4)), np.zeros(6)
    room[[0, 1, 3, 4]] = shape
    for k in range(2):
        plane = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        basis[3 * k : 3 * k + 3, 2 * k : 2 * k + 2] = (np.eye(3) if any(shape) else plane)[:, :2]
    common = rng.normal(size=(4, 6)) * rng.uniform(0.0, 0.5, 6)
    root = basis @ np.hstack([common, np.diag(rng.uniform(0.05, 0.6, 4))])
    count = int(rng.integers(0, 8))
    columns = basis @ (rng.normal(size=(4, count)) * rng.uniform(0.0, 0.4))
    law = LinearLaw(
        basis @ rng.normal(size=4) * rng.choice([0, 0.3]),
        root @ root.T,
        columns,
        rng.integers(0, 2, count),
        room if any(shape) else None,
    )
    longer = [np.zeros(0)]
    for part in np.array_split(np.arange(trials), max(trials // 500_000, 1)):
        u = rng.uniform(-1, 1, (len(part), 2, count))
        steps = np.where(law.kinds == 1, u.mean(axis=1), u[:, 0])
        x = law.mean + rng.normal(size=(len(part), root.shape[1])) @ root.T + steps @ law.columns.T
        pairs = (x @ basis).reshape(-1, 2, 2)
        longer.append(needed(pairs, np.reshape(shape, (2, 2))) if any(shape) else np.linalg.norm(pairs, axis=2).max(1))
    return law, np.sort(np.concatenate(longer))


def compare(rng: np.random.Generator, trials: int, shape: Any) -> None:
    law, longer = draw(rng, trials, shape)
    found = LawReading(law, 0.95, None)
    r = found.quantile.quantile_mm
    pair = PairLaw(law, 0.95, fine=True)
    for radius in (0.5 * r, r, 1.4 * r):
        value, error = pair.exceedance_with_error(radius)
        share = 1 - np.searchsorted(longer, radius) / trials
        assert abs(value - share) < 6.5 * np.sqrt(error**2 + value * (1 - value) / trials) + 1e-9
        assert error < 0.02 * value + 1e-6
    for told, drawn in ((found.mean_norm_mm, longer), (found.cvar_mm, longer[int(0.95 * trials) :])):
        assert told == pytest.approx(drawn.mean(), rel=3e-3, abs=6.5 * float(drawn.std()) / np.sqrt(len(drawn)))


def test_the_longer_of_two_is_that_of_drawn_pairs() -> None:
    """independent: 50,000 pairs by NumPy of a law in a channel of each shape.  A probability is out by 6.5 standard
    errors, of sampling and of trials together, in less than 1 of 1,000 runs (of Student's law with 15 degrees of
    freedom)."""
    rng = np.random.default_rng(7)
    for shape in SHAPES:
        compare(rng, 50_000, shape)


@pytest.mark.long
@pytest.mark.hostile
def test_eight_corridors_have_the_breaches_of_drawn_pairs(run_seed: int) -> None:
    """independent: 1,000,000 pairs of each by NumPy; out by chance in less than 1 of 2,500 runs."""
    rng = np.random.default_rng(run_seed + 11)
    for k in range(8):
        compare(rng, 1_000_000, SHAPES[k % 4])


def nested(law: LinearLaw, rng: np.random.Generator, units: int, shots: int) -> tuple[LinearLaw, Array]:
    """The law of a shot (a quarter of the installation's covariance, independent at either end, with two columns), and
    the own P95 of drawn units (n,), each the r at which 95 % of its shots are inside, by bisection."""
    covariance = 0.25 * law.covariance * np.kron(np.eye(2), np.ones((3, 3)))
    columns, room = 0.3 * law.columns[:, :2], np.zeros(6) if law.room is None else law.room
    shot = LinearLaw(np.zeros(6), covariance, columns, np.zeros(columns.shape[1], dtype=np.int64), law.room)
    u = rng.uniform(-1, 1, (units, 2, len(law.kinds)))
    steps = np.where(law.kinds == 1, u.mean(axis=1), u[:, 0])
    offsets = rng.multivariate_normal(law.mean, law.covariance, units, method="svd") + steps @ law.columns.T
    variances, axes = np.linalg.eigh(covariance)
    root, own = (axes * np.sqrt(variances.clip(0))).T, np.zeros(units)
    for unit, offset in enumerate(offsets):
        x = offset + rng.normal(size=(shots, 6)) @ root + rng.uniform(-1, 1, (shots, columns.shape[1])) @ columns.T
        squares, low, high = (x**2).reshape(-1, 2, 3), 0.0, 20.0
        for _ in range(20):
            r = 0.5 * (low + high)
            inside = ((squares / (r + room.reshape(2, 3)) ** 2).sum(axis=2) <= 1).all(axis=1).mean()
            low, high = (low, r) if inside >= 0.95 else (r, high)
        own[unit] = high
    return shot, own


def compare_units(rng: np.random.Generator, units: int, shots: int, shape: Any) -> None:
    installation = draw(rng, 0, shape)[0]
    shot, own = nested(installation, rng, units, shots)
    found = unit_risk(installation, shot, 0.95, float(np.quantile(own, 0.8)), 0.9)
    around = np.quantile(own, [0.89, 0.91])
    error = np.hypot(found.standard_error_mm, np.diff(around)[0] / 0.02 * np.sqrt(0.09 / units))
    assert abs(found.value_mm - np.quantile(own, 0.9)) < 5 * error + 0.005 * found.value_mm
    assert abs(found.yield_fraction - 0.8) < 5 * np.hypot(found.yield_standard_error, np.sqrt(0.16 / units)) + 0.01


def test_each_unit_has_a_law_of_both_ends_of_its_own() -> None:
    """independent: nested simulation by NumPy, 500 units of 500 shots.  A quantile over units or a yield is out by 5
    standard errors in less than 1 of 1,000 runs; the quantile of 500 shots is off by some tenths of a per cent."""
    compare_units(np.random.default_rng(5), 500, 500, SHAPES[3])


@pytest.mark.long
@pytest.mark.hostile
def test_eight_corridors_have_the_units_of_nested_simulation(run_seed: int) -> None:
    """independent, as above, with 1,000 units of 1,000 shots; out by chance in less than 1 of 500 runs."""
    rng = np.random.default_rng(run_seed + 12)
    for k in range(8):
        compare_units(rng, 1_000, 1_000, SHAPES[k % 4])


@pytest.mark.parametrize("shape", SHAPES)
def test_slopes_of_what_both_ends_need_are_those_of_differences(shape: Any) -> None:
    """differences: of the quantile itself, along random changes of mean, covariance and columns."""
    rng = np.random.default_rng(11)
    law = draw(rng, 0, shape)[0]
    while not law.kinds.size:
        law = draw(rng, 0, shape)[0]
    total = law_quantile(law, 0.95)
    slopes, by_columns = law_gradient(law, total), column_gradient(law, total)
    plane = law.covariance / np.trace(law.covariance)
    mean, root = plane @ rng.normal(size=6), plane @ rng.normal(size=(6, 6))
    columns, step = plane @ rng.normal(size=law.columns.shape), 1e-4

    def at(times: float) -> float:
        covariance = (np.eye(6) + times * root) @ law.covariance @ (np.eye(6) + times * root).T
        moved = replace(law, mean=law.mean + times * mean, covariance=covariance, columns=law.columns + times * columns)
        return law_quantile(moved, 0.95).quantile_mm

    covariance = root @ law.covariance + law.covariance @ root.T
    told = slopes.by_mean @ mean + (slopes.by_covariance * covariance).sum() + (by_columns * columns).sum()
    assert told == pytest.approx((at(step) - at(-step)) / (2 * step), rel=2e-3)
    assert slopes.by_log_column == pytest.approx((by_columns * law.columns).sum(axis=0), rel=2e-3, abs=1e-6)


def test_a_bounded_source_of_a_pair_stands_where_the_longer_is_longest() -> None:
    """brute force: both ends of three sources."""
    rng = np.random.default_rng(3)
    law = normal_pair(np.kron([[1, 0.8], [0.8, 1]], np.diag([0.04, 0.09, 0])), (0.2, 0, 0, 0, 0.1, 0))
    bounded = 0.3 * rng.normal(size=(6, 3)) * [[1], [1], [0], [1], [1], [0]]
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    each = [law_quantile(LinearLaw(law.mean + bounded @ s, law.covariance, *NO_COLUMNS), 0.95) for s in signs]
    found = worst_case(law, bounded, 0.95)
    assert found.quantile.quantile_mm == pytest.approx(max(one.quantile_mm for one in each), rel=1e-9)


def screw(**changes: Any) -> dict[str, Any]:
    """The example with fields of its trajectory changed, and its requirement on breaches alone."""
    tip, *others = SCREW["targets"]
    return {**SCREW, "targets": [{**tip, **changes}, *others], "requirements": SCREW["requirements"][2:]}


def test_breaches_of_a_screw_are_counted_and_estimated() -> None:
    """independent: 40,000 trials of the chain, both ends across the axis by cross products.  The estimate is within
    what the count leaves open (its interval of 95 % widened to 99.99 %), its own sampling and 3 % of first order."""
    design = load_design({**screw(), "requirements": [{**SCREW["requirements"][2], "limit_mm": 1.5}]})
    first, drawn, system = score(design, losses=False), verify(design, trials=40_000, seed=3), compile_design(design)
    errors = run_indices(compile_plan(system), 3, 0, 40_000).errors[:, 0]
    tip, entry = (system.T_tcp_con[:3, :3] @ target.position_mm for target in system.targets)
    along = (tip - entry) / np.linalg.norm(tip - entry)
    longer = np.max([np.linalg.norm(np.cross(end.T, along), axis=1) for end in errors], axis=0)
    estimate, check = first.measures[-1], drawn.measures[-1]
    assert (check.measure, check.site) == ("corridor", "entry to tip")
    assert check.p95 == pytest.approx(np.sort(longer)[38_000 - 1], rel=1e-12)
    assert [breach.probability for breach in check.breaches] == [
        float((longer > 1.25 + k).mean()) for k in (0, 2, 4, 6)
    ]
    assert drawn.verdict.checks[-1].value == (longer > 1.5).mean()
    for one, counted in zip(estimate.breaches, check.breaches, strict=True):
        room = 2 * (one.interval[1] - one.probability) + 0.03 * one.probability  # beyond what the count leaves open
        (least, most), share = counted.interval, counted.probability
        assert 2 * least - share - room <= one.probability < 2 * most - share + room
    assert first.verdict.checks[-1].status == drawn.verdict.checks[-1].status == "fail"
    assert estimate.p95 == pytest.approx(check.p95, rel=0.02)


def test_the_example_is_as_far_off_as_navigated_screws_are() -> None:
    """published: 88 navigated screws were 1.67 mm and 1.58 degrees off on average, the patient's motion and skiving
    included, which the example has not: from what it states it is to be less, by no more than a factor of 2."""
    found = score(load_design(SCREW), losses=False)
    angle = next(each.mean for each in found.measures if each.measure == "angle")
    assert 0.5 < found.targets[0].mean_norm_mm / 1.67 < 1
    assert 0.5 < angle / 1.58 < 1


def test_the_search_keeps_both_ends_of_a_corridor() -> None:
    """Each end by itself, half of what may be beyond: closed forms of the problem, no search."""
    system = compile_design(load_design(screw()))
    demands = demands_of(system, system.requirements[0])
    assert [(demand.place, demand.requirement.quantile) for demand in demands] == [("entry", 0.995), ("tip", 0.995)]
    assert len({demand.key for demand in demands}) == 2
    assert "P99.5 of the radius that the trajectory needs at target 'entry to tip', tip" in demands[1].text
    tip, entry = (linearise_demand(chain_of(system), demand)[0] for demand in reversed(demands))
    side = score(load_design(screw()), losses=False).measures[0]
    p95 = replace(demands[1], requirement=replace(demands[1].requirement, quantile=0.95))
    assert exact_quantile(tip, p95).value_mm == pytest.approx(side.p95, rel=1e-9)
    assert tip.blocks[0].gain("corridor").shape[0] == entry.blocks[0].gain("corridor").shape[0] == 3


def test_breaches_of_each_mounting_are_limited() -> None:
    """One mounting keeps its share of breaches where it keeps its own quantile: the two requirements are one."""
    each = {"name": "x", "error": "corridor", "limit_mm": 1.8, "risk": "per_mounting", "min_yield": 0.9}
    limits = [each | {"quantile": 0.99}, each | {"name": "y", "statistic": "probability", "limit_probability": 0.01}]
    for design in (screw(), screw(corridor_entry_mm=2.0)):
        checks = score(load_design({**design, "requirements": limits}), losses=False).verdict.checks
        assert checks[0].value == checks[1].value
        assert checks[0].yield_fraction == checks[1].yield_fraction
        drawn = verify(load_design({**design, "requirements": limits[:1]}), seed=1, trials=2_000).verdict.checks[0]
        assert drawn.interval[0] < checks[0].value < drawn.interval[1]


OF_EACH = {"risk": "per_mounting", "min_yield": 0.95}


@pytest.mark.long
@pytest.mark.parametrize(
    ("shape", "own", "noise_px", "limit_mm"),
    [({}, {}, 2.5, 1.8), ({}, OF_EACH, 1.5, 1.6), ({"corridor_entry_mm": 1.5}, OF_EACH, 1.5, 1.6)],
)
def test_millimetres_degrees_and_breaches_are_kept_at_once(
    shape: Any, own: Any, noise_px: float, limit_mm: Any
) -> None:
    """independent: the simulation of what was found, of another seed, which judges all three, over all or in each
    mounting."""
    data = {**screw(**shape), "optimise": {"rotation_bounds": {"min_deg": 0.02, "max_deg": 0.5}}}
    seats = SCREW["interfaces"]
    data["interfaces"] = seats | {"structure_connector": seats["structure_connector"] | {"drawn": "mounting"}}
    data["views"] = [dict(view, target_noise_px=noise_px) for view in SCREW["views"]]
    position, angle, breach = (item | own for item in SCREW["requirements"])
    data["requirements"] = [position, angle, breach | {"limit_mm": limit_mm}]
    before = score(load_design(data), losses=False).verdict.checks
    assert {check.status for check in before} != {"pass"}
    assert own or before[-1].value > 0.01
    found = optimise(load_design(data), starts=1)
    assert found.certificate.verification.verdict.status == "pass"
    again = verify(load_design(found.design), trials=20_000 if own else 400_000, seed=5)
    assert [check.status for check in again.verdict.checks] == ["pass"] * 4
    assert own or 0.005 < again.verdict.checks[-1].value < 0.01


@pytest.mark.parametrize("limits", [
    {"statistic": "probability", "limit_mm": 9.0, "limit_probability": 0.5}, {"limit_mm": 9.0},
    {"limit_mm": 9.0, "risk": "per_mounting", "min_yield": 0.9},
])  # fmt: skip
def test_where_fiducials_are_missed_the_estimate_decides_nothing_about_a_corridor(limits: dict[str, Any]) -> None:
    """Its law is that of the shots that miss none: the others may be all beyond."""
    design = {**screw(), "requirements": [{"name": "x", "error": "corridor", **limits}]}
    assert score(load_design(design), losses=False).verdict.status == "pass"
    found = score(load_design({**design, "fiducials": {**SCREW["fiducials"], "loss_probability": 0.01}}))
    (check,) = found.verdict.checks
    assert (check.status, check.interval) == ("inconclusive", (0.0, None))
    assert "where fiducials are missed" in check.open_because
    assert found.measures[-1].breaches == ()
    assert "the radius that the trajectory needs: of those that miss none" in found.verdict.findings[-1].message


def test_what_a_corridor_cannot_have_is_refused_or_said() -> None:
    with pytest.raises(DesignError, match="corridor_mm is read only beside entry"):
        load_design(screw(entry=None))
    for field in ({"corridor_major_mm": 2}, {"corridor_major_direction": [0, 0, 1]}):
        with pytest.raises(DesignError, match="go together"):
            load_design(screw(**field))
    with pytest.raises(DesignError, match=r"less than corridor_mm, 1\.25"):
        load_design(screw(corridor_major_mm=1, corridor_major_direction=[0, 0, 1]))
    with pytest.raises(DesignError, match="it tells no direction across it"):
        load_design(screw(corridor_major_mm=2, corridor_major_direction=[0, 24, 86]))
    with pytest.raises(DesignError, match="corridor_entry_mm is read only beside corridor_mm"):
        load_design(screw(corridor_mm=None, corridor_entry_mm=2))
    with pytest.raises(DesignError, match="read nowhere among the targets"):
        compile_design(load_design(screw(corridor_mm=None)))
    design = load_design({**screw(), "requirements": [{"name": "x", "error": "corridor", "limit_mm": 2}]})
    with pytest.raises(TailstackError, match="which no ray shows"):
        verify(design, seed=1, method="radial")
    batch = score_batch(design, {"views.*.target_noise_px": [3.0, 4.0]}, columns=("value",))
    assert batch.ways == {"compiled": 0, "in full": 2}
    told = score(design, losses=False).measures[-1].p95
    assert batch.columns["value:x:entry to tip"][0] == pytest.approx(told, rel=1e-12)
