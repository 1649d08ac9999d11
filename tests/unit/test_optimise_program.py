"""The programme's parts against the compiled model: gains, covariances, costs, geometric rows, meaning of variables.

Value and gradient of its quantiles are held to the exact law in ``test_optimise_exact_law``.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest

from optimise_scenes import at_prices, fixed_layout, general_problem, oracle_problem, places_in_box, requirement
from scenes import cube_fiducials, mount
from tailstack.contributors import declared_law
from tailstack.geometry.arrays import Array
from tailstack.geometry.rotation import RotationForm, torsor_transform
from tailstack.optimisation import FreeFiducial, PlacementProblem
from tailstack.optimisation.exact_law import Correction, image_parts
from tailstack.optimisation.prices import Price, reciprocal
from tailstack.optimisation.problem import Choice, apply_choice, present_choice
from tailstack.optimisation.program import Parameters, Program, build_program
from tailstack.optimisation.regions import BoxRegion, Cylinder, KeepOut, mirror, turns
from tailstack.optimisation.search import search
from tailstack.optimisation.terms import every_terms, pivot_shift_of, terms_of
from tailstack.propagation.linear import covariance, linearise
from tailstack.system import Reading

UP = np.array([0.0, 0.0, 1.0])
LOOSE = BoxRegion(np.array([-60.0] * 3), np.array([50.0] * 3))
CURVES = (
    Price("power", 2e-6, exponent=2.0), Price("exponential", 3.0, scale=0.05), reciprocal(1e-4),
    Price("exponential", 1.5, scale=0.004),
)  # fmt: skip


def _regions(problem: PlacementProblem, regions: tuple[object, ...], **changes: object) -> PlacementProblem:
    """Groups of fiducials in the given regions, by the number of copies."""
    group = 1 + len(changes.get("symmetry", ()))  # type: ignore[arg-type]
    places = tuple(FreeFiducial(tuple(range(k * group, (k + 1) * group)), region) for k, region in enumerate(regions))  # type: ignore[arg-type]
    return replace(problem, places=places, **changes)  # type: ignore[arg-type]


PROBLEMS: dict[str, PlacementProblem] = {
    "pivots and locators": general_problem(3),
    "pivots and locators, eq18": general_problem(4, reading=Reading.EQ18),
    "pivots and locators, small angles": general_problem(5, rotation_form=RotationForm.SMALL_ANGLE),
    "mirror": _regions(general_problem(6), (LOOSE, LOOSE), symmetry=mirror(np.zeros(3), np.array([1.0, 0, 0]))),
    "three-fold": _regions(general_problem(7), (LOOSE, LOOSE), symmetry=turns(np.zeros(3), UP, 3)),
    "scaling": replace(general_problem(9), objective="scaling"),
    "quantile with a cost limit": replace(
        at_prices(general_problem(10), *CURVES), objective="quantile", cost_limit=2.0
    ),
    "cost on three curves": at_prices(general_problem(11), *CURVES),
}  # fmt: skip


@cache
def _built(problem: PlacementProblem) -> Program:
    terms = tuple(terms_of(problem, demand) for demand in problem.demands)
    return build_program(problem, terms)


def _variables(program: Program, rng: np.random.Generator) -> Array:
    """Random variables within their bounds."""
    low, high = program.bounds("main")
    shrunk = rng.uniform(0.1, 0.9, len(low))
    low, high = np.maximum(low, -8.0), np.minimum(high, 3.0)
    x = low + shrunk * (high - low)
    x[-1] = 0.1
    return np.asarray(x)


def _corrections(problem: PlacementProblem, rng: np.random.Generator) -> tuple[Correction, ...]:
    def one() -> Correction:
        images, widths = rng.normal(size=15 + 3 * common), rng.normal(size=len(problem.half_widths))
        pivots = rng.normal(size=3 * len(problem.pivots)) / 30
        return Correction(rng.normal(), np.concatenate([images, widths, pivots]))

    common = len(terms_of(problem, problem.demands[0]).common)
    return tuple(one() for _ in problem.demands)


@pytest.mark.parametrize("name", ["scaling", "quantile with a cost limit", "cost on three curves"])
def test_cost_and_objective_are_those_of_the_price_curves(name: str) -> None:
    """closed form: w h^-n and w exp(-h / scale) written out, and central differences of their sum's logarithm."""
    problem = PROBLEMS[name]
    program, rng = _built(problem), np.random.default_rng(3)
    x = _variables(program, rng)
    vector = Parameters(
        np.zeros(2), np.zeros((2, 0)), _corrections(problem, rng), np.zeros(0)
    ).vector(program, "main")  # fmt: skip

    def log_cost(at: Array) -> float:
        h = program.split(at).half_width
        if name == "scaling":
            return float(np.log(0.02 / h[0] + 0.03 / h[1] + 1 / h[2] + 1 / h[3]))
        return float(np.log(
            2e-6 / h[0] ** 2 + 3 * np.exp(-h[1] / 0.05) + 1e-4 / h[2] + 1.5 * np.exp(-h[3] / 0.004)
        ))  # fmt: skip

    step = 1e-5
    slope = np.array([(log_cost(x + step * e) - log_cost(x - step * e)) / (2 * step) for e in np.eye(len(x))])
    f, g = (part.full().ravel() for part in program.constraints(x, vector))
    gradient = program.gradient(x, vector)[1].full().ravel()
    assert problem.cost(program.split(x).half_width) == pytest.approx(np.exp(log_cost(x)), rel=1e-12)
    if problem.objective == "quantile":
        assert f[0] == x[-1]
        np.testing.assert_array_equal(gradient, np.eye(len(x))[-1])
        (k,) = [k for k, row in enumerate(program.rows) if row.kind == "cost"]
        # a hundred-thousandth of the cost limit is left for half-widths that are rounded down
        assert g[k] == pytest.approx(log_cost(x) - np.log(2.0 * (1 - 1e-5)), rel=1e-12)
        gradient = program.jacobian(x, vector)[1].full()[k]
    else:
        assert f[0] == pytest.approx(log_cost(x), rel=1e-12)
    np.testing.assert_allclose(gradient, slope, rtol=1e-7, atol=1e-9)


def test_variables_stand_for_what_they_say() -> None:
    """closed form: boxes, logarithms, mirror images and turns written out."""
    rng = np.random.default_rng(0)
    for name, copies in (
        ("pivots and locators", []),
        ("mirror", [np.diag([-1.0, 1, 1])]),
        ("three-fold", [np.array([[-0.5, -s, 0], [s, -0.5, 0], [0, 0, 1]]) for s in (0.75**0.5, -(0.75**0.5))]),
    ):  # fmt: skip
        problem = PROBLEMS[name]
        program = _built(problem)
        x = _variables(program, rng)
        choice = program.split(x)
        expected = problem.system.fiducials_mm.copy()
        for g, place in enumerate(problem.places):
            expected[place.fiducials[0]] = -5 + 55 * x[3 * g : 3 * g + 3]
            for i, turn in zip(place.fiducials[1:], copies, strict=True):
                expected[i] = turn @ expected[place.fiducials[0]]
        count = len(problem.places)
        np.testing.assert_allclose(choice.fiducials_mm, expected, atol=1e-12)
        np.testing.assert_allclose(choice.half_width, np.exp(x[3 * count : 3 * count + 4]), rtol=1e-14)
        first = problem.system.structure_connector.pivot_mm - 5 + 25 * x[3 * count + 4 : 3 * count + 7]
        second = problem.system.connector_flange.pivot_mm + 5 + 25 * x[3 * count + 7 : 3 * count + 10]
        np.testing.assert_allclose(choice.pivots_mm, [first, second], rtol=1e-12)
        np.testing.assert_allclose(program.join(choice, x[-1]), x, atol=1e-12)
        made = apply_choice(problem, choice)
        np.testing.assert_array_equal(made.structure_connector.pivot_mm, choice.pivots_mm[0])
        np.testing.assert_array_equal(made.connector_flange.pivot_mm, choice.pivots_mm[1])
        np.testing.assert_allclose(made.structure_connector.sources.half_width[[0, 3]], choice.half_width[:2])
        np.testing.assert_allclose(made.connector_flange.sources.half_width[[0, 2]], choice.half_width[2:])


def _random_choice(problem: PlacementProblem, rng: np.random.Generator) -> Choice:
    here = present_choice(problem)
    layout = here.fiducials_mm + rng.uniform(-20, 20, here.fiducials_mm.shape) * np.isin(
        np.arange(len(here.fiducials_mm)), problem.free_fiducials
    )[:, None]  # fmt: skip
    pivots = here.pivots_mm + rng.uniform(-200, 200, here.pivots_mm.shape)
    return Choice(layout, here.half_width * rng.uniform(0.3, 3, 4), pivots)


@pytest.mark.parametrize("name", ["pivots and locators", "pivots and locators, eq18",
                                  "pivots and locators, small angles", "mirror"])  # fmt: skip
def test_gains_are_exactly_affine_in_pivots(name: str) -> None:
    """independent: the linear model of the changed system, at choices far from the present one."""
    problem, rng = PROBLEMS[name], np.random.default_rng(8)
    for demand in problem.demands:
        term, error = terms_of(problem, demand), demand.requirement.error
        for _ in range(4):
            choice = _random_choice(problem, rng)
            shift = pivot_shift_of(problem, choice)
            model = linearise(apply_choice(problem, choice), demand.targets[0])
            expected = np.vstack([
                block.gain(error).T for block in model.blocks
                if "noise" not in block.contributor and block.contributor != "fiducial_manufacturing"
            ])  # fmt: skip
            np.testing.assert_allclose(np.asarray(term.gains.at(shift), dtype=float), expected, rtol=1e-10, atol=1e-10)
            np.testing.assert_allclose(
                np.asarray(term.bias.at(shift), dtype=float), model.bias_mm(error), rtol=1e-10, atol=1e-10
            )
            np.testing.assert_allclose(
                np.asarray(term.reconstructed.at(shift)[0], dtype=float), model.reconstructed_mm, rtol=1e-10
            )


@pytest.mark.parametrize("seed", range(3))
def test_the_split_model_has_the_covariance_of_the_score(seed: int) -> None:
    """independent: constants + image part + free half-widths add up to the linear model's own covariance."""
    problem = general_problem(seed)
    for demand in problem.demands:
        term, error = terms_of(problem, demand), demand.requirement.error
        model = linearise(problem.system, demand.targets[0])
        images = image_parts(model, error)
        total = term.covariance + images.noise + images.made
        for k, free in enumerate(problem.half_widths):
            sources = getattr(problem.system, free.contributor).sources
            std = sources.std[sources.names.index(free.component)]
            total = total + np.outer(term.free_gain[:, k], term.free_gain[:, k]) * std**2
        np.testing.assert_allclose(total, covariance(model, error), rtol=1e-12, atol=1e-15)
        law = declared_law(model, error, model.bias_mm(error))
        np.testing.assert_array_equal(term.bias_mm, law.mean)


def _images(problem: PlacementProblem, layout: Array) -> list[Array]:
    """(N, 2) px in each view, of the structure where its known bias puts it."""
    system, found = problem.system, []
    moved = np.hstack([layout, np.ones((len(layout), 1))])
    if system.reading is Reading.PHYSICAL:
        moved = moved @ torsor_transform(
            system.structure_connector.known, system.structure_connector.pivot_mm, system.rotation_form
        ).T  # fmt: skip
    for view in system.views:
        image = moved @ view.projection.T
        found.append(image[:, :2] / image[:, 2:])
    return found


@pytest.mark.parametrize("reading", list(Reading))
def test_geometric_rows_hold_where_the_rules_are_kept(reading: Reading) -> None:
    """brute force: distances, images of the displaced structure, borders and zones, each row by its own number."""
    zone = KeepOut("clamp", BoxRegion(np.array([-20.0, -20, -40]), np.array([30.0, 10, 0])), 3.0)
    tube = Cylinder(np.array([0.0, 0, -60]), UP, 90.0, 50.0, 20.0)
    problem = oracle_problem(6)
    biased = mount(
        "structure_connector",
        (0.0, 0.0, -95.0),
        bias=(0.02, -0.03, 0.01, 1.0, 2.0, -1.0),
        half_width=(1e-3,) * 3 + (0.0,) * 3,
    )
    problem = replace(
        problem,
        system=replace(problem.system, structure_connector=biased, reading=reading),
        places=(*places_in_box((1,), np.array([[-90.0, -90, -120], [90, 90, 40]])), FreeFiducial((4,), tube)),
        keep_out=(zone,),
        min_projected_spacing_px=80.0,
        min_spacing_mm=25.0,
        image_margin_px=120.0,
        target_clearance_px=400.0,
    )
    program, rng = _built(problem), np.random.default_rng(1)
    term = program.terms[0]
    size = np.array([1535.0, 1535.0])
    free = {1, 4}
    seen: dict[str, set[bool]] = {}
    for _ in range(30):
        x = np.concatenate([rng.uniform(-1, 1, 6), np.log(problem.upper) - 1, [0.0]])
        choice = program.split(x)
        layout = choice.fiducials_mm
        vector = Parameters(
            np.zeros(1), np.zeros((1, 0)), _corrections(problem, rng), program.pieces_of(choice)
        ).vector(program, "main")  # fmt: skip
        values = program.constraints(x, vector)[1].full().ravel()
        images = _images(problem, layout)
        found: dict[str, list[float]] = {}
        for row, value in zip(program.rows, values, strict=True):
            found.setdefault(row.kind, []).append(float(value))
        pairs = [(i, j) for i, j in combinations(range(6), 2) if {i, j} & free]
        np.testing.assert_allclose(
            found["spacing"], [np.linalg.norm(layout[i] - layout[j]) ** 2 / 625 - 1 for i, j in pairs], rtol=1e-9,
            atol=1e-12,
        )  # fmt: skip
        np.testing.assert_allclose(
            found["projected_spacing"],
            [np.linalg.norm(image[i] - image[j]) ** 2 / 6400 - 1 for image in images for i, j in pairs], rtol=1e-8,
            atol=1e-10,
        )  # fmt: skip
        inside = [min((image[i] - 120).min(), (size - 120 - image[i]).min()) > 0 for image in images for i in (1, 4)]
        assert (min(found["field"]) > 0) == all(inside)
        radius = np.hypot(*layout[4, :2])
        assert (min(found["region"]) > 0) == (20 < radius < 50 and -60 < layout[4, 2] < 30)
        clear = [((layout[i] < [-23, -23, -43]) | (layout[i] > [33, 13, 3])).any() for i in (1, 4)]
        assert [value > 0 for value in found["keep_out"]] == clear
        centres = [p @ [*term.reconstructed_mm[0], 1] for p in problem.estimation.projections]
        gaps = [
            np.linalg.norm(image[i] - centre[:2] / centre[2]) ** 2 / 160000 - 1
            for image, centre in zip(images, centres, strict=True) for i in (1, 4)
        ]  # fmt: skip
        np.testing.assert_allclose(found["target_clearance"], gaps, rtol=1e-8, atol=1e-10)
        for kind in found:
            seen.setdefault(kind, set()).add(min(found[kind]) > 0)
    seen.pop("quantile")
    assert all(outcomes == {True, False} for outcomes in seen.values()), seen


def test_rows_between_fixed_fiducials_are_left_out() -> None:
    """closed form: pairs of fixed fiducials cannot be helped; a layout without freedom has no rows but quantiles."""
    problem = replace(oracle_problem(6), places=places_in_box((2,)))
    spacing = [row for row in _built(problem).rows if row.kind == "spacing"]
    assert sorted(row.fiducials for row in spacing) == [(0, 2), (1, 2), (2, 3), (2, 4), (2, 5)]
    fixed = _built(fixed_layout(oracle_problem(8), cube_fiducials()))
    assert [row.kind for row in fixed.rows] == ["quantile"]


def _costs(problem: PlacementProblem) -> Array:
    """What two starts come to: variables and cost."""
    found = search(problem, starts=2, seed=3, threads=1)
    return np.concatenate([found.iterates[0].point.x, [found.best_objective]])


def test_a_programme_serves_another_limit_and_nothing_else() -> None:
    """independent: the same search in a thread that has built nothing yet, bit for bit."""
    problem = oracle_problem(6)
    wider = replace(problem, requirements=(requirement(1.3 * problem.requirements[0].limit),))
    dearer = replace(problem, half_widths=tuple(replace(f, price=reciprocal(2.0)) for f in problem.half_widths))
    first = build_program(problem, every_terms(problem))
    again = build_program(wider, every_terms(wider))
    assert again.explore[0] is first.explore[0]
    assert again.problem is wider
    assert build_program(dearer, every_terms(dearer)).explore[0] is not first.explore[0]
    here = [_costs(each) for each in (problem, wider, problem, dearer)]
    alone = []
    for each in (problem, wider, dearer):
        with ThreadPoolExecutor(1) as thread:
            alone.append(thread.submit(_costs, each).result())
    assert here[0].tobytes() == here[2].tobytes() == alone[0].tobytes()
    assert here[1].tobytes() == alone[1].tobytes()
    assert here[3].tobytes() == alone[2].tobytes()
    assert here[0][-1] > here[1][-1]
