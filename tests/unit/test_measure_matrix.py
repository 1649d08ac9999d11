"""Every measure, declared and limited, in front of everything that has to know of it.

Each pair of a consumer, a function ``meet_NAME``, and a measure is a test, and none is left out.
``PYTHONPATH=tests python tests/unit/test_measure_matrix.py`` writes what they are into docs/measures.md.
"""

from __future__ import annotations

import contextlib
import html
import io
import json
import textwrap
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from plain_data import DEMO
from tailstack import DesignFunction, load_design, score, score_batch, verify
from tailstack.design import compile_design
from tailstack.measures import MEASURE, STATED, Measure
from tailstack.optimisation.exact_law import image_parts
from tailstack.optimisation.problem import PlacementProblem, present_choice
from tailstack.optimisation.symbols import plain
from tailstack.optimisation.task import read_task
from tailstack.optimisation.terms import (
    estimator_affine,
    image_parts_at,
    lay,
    linearise_demand,
    pivot_shift_of,
    terms_of,
)
from tailstack.propagation.linear import chain_of
from tailstack.results import Check, Score, Verification
from tailstack_service.cli.main import main
from tailstack_service.schemas import json_schema

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "measures.md"
HEAD = """# Measures and who knows of them

Each pair of a [*measure*](design.md#what-a-requirement-limits), a file of `solver/tailstack/measures/`, and a consumer
is a test, which writes this page: `./run test tests/unit/test_measure_matrix.py -k MEASURE-CONSUMER`.

"""
MEASURES = (*STATED, *(MEASURE[name] for name in ("axial_above", "x_below", "localisation_y_above")))
COORDINATE = "/fiducials/points/0/position_mm/0"
STEP_MM = 1e-2


def stated(measure: Measure) -> dict[str, str]:
    """As a requirement says it."""
    return {"error": measure.name.removesuffix(f"_{measure.side}"), **({"side": measure.side} if measure.side else {})}


class Subject:
    """The demo with a trajectory and a body, and a limit on every measure that is taken."""

    def __init__(self, **requirement: Any) -> None:
        self.data = json.loads(json.dumps(DEMO))
        tip = self.data["targets"][0]
        x, y, z = tip["position_mm"]
        tip |= {"entry": "entry", "corridor_mm": 1.5}
        self.data["targets"] += [
            {"name": "entry", "position_mm": [x, y, z - 30]},
            {"name": "side", "position_mm": [x + 20, y + 10, z]},
        ]
        self.data["bodies"] = [{"name": "implant", "targets": ["tip", "entry", "side"]}]
        self.data["requirements"] = [
            {"name": measure.name, **stated(measure), measure.limit_field: 2.0, **requirement} for measure in MEASURES
        ]
        self.data["optimise"]["requirement"] = [measure.name for measure in MEASURES]
        self.design = load_design(self.data)

    @cached_property
    def score(self) -> Score:
        return score(self.design)

    @cached_property
    def noisier(self) -> Score:
        """Where images of targets have twice the noise."""
        views = [{**view, "target_noise_px": 2 * view["target_noise_px"]} for view in self.data["views"]]
        return score(load_design({**self.data, "views": views}), losses=False)

    @cached_property
    def verification(self) -> Verification:
        return verify(self.design, trials=20_000, seed=3)

    @cached_property
    def without(self) -> dict[str, Score]:
        """The score of the structure without each bead."""
        beads = self.data["fiducials"]
        rest = {gone["label"]: [each for each in beads["points"] if each is not gone] for gone in beads["points"]}
        designs = {name: {**self.data, "fiducials": {**beads, "points": points}} for name, points in rest.items()}
        return {name: score(load_design(data), losses=False) for name, data in designs.items()}

    @cached_property
    def moved(self) -> Score:
        return score(
            self.design.with_value(COORDINATE, DEMO["fiducials"]["points"][0]["position_mm"][0] + 1), losses=False
        )

    @cached_property
    def table(self) -> dict[str, Any]:
        """Compiled, and in full of a pair and of one side: of what is asked of the one, no row is in full."""
        at = self.data["fiducials"]["points"][0]["position_mm"][0]
        columns: dict[str, Any] = {}
        for alone, way in ((False, "compiled"), (True, "in full")):
            own = {each.name for each in MEASURES if (each.paired or bool(each.side)) == alone}
            asked = [each for each in self.data["requirements"] if each["name"] in own]
            design = load_design({**self.data, "requirements": asked, "optimise": None})
            batch = score_batch(design, {COORDINATE: [at, at + 1]}, columns=("value",))
            assert batch.ways[way] == 2
            columns |= batch.columns
        return columns

    @cached_property
    def function(self) -> DesignFunction:
        return DesignFunction(self.design, [COORDINATE])

    @cached_property
    def ends(self) -> list[Score]:
        """A step to either side of the present place."""
        return [self.function.score([self.function.present[0] + k * STEP_MM], losses=False) for k in (-1, 1)]

    @cached_property
    def placement(self) -> tuple[PlacementProblem, Any, list[Any]]:
        """The problem of the optimiser, its mechanics as they are, and the projections and beads as told then."""
        problem = read_task(self.design).problems[0]
        mechanics = pivot_shift_of(problem, present_choice(problem))
        return problem, mechanics, [plain(part.at(mechanics)) for part in estimator_affine(problem)]

    @cached_property
    def gate(self) -> Any:
        return json.loads(tailstack(self.data, "gate", "--mode", "analytic", "--format", "json"))["designs"][0]

    @cached_property
    def page(self) -> str:
        return html.unescape(tailstack(self.data, "report", "--parts", "score", "--format", "html"))

    def check(self, measure: Measure) -> Check:
        return check_of(self.score.verdict.checks, measure)


@cache
def subject() -> Subject:
    return Subject()


@cache
def score_of_units() -> Score:
    return score(Subject(risk="per_unit", min_yield=0.9).design, losses=False)


def check_of(checks: Sequence[Check], measure: Measure) -> Check:
    """The first of a measure's requirement."""
    return next(check for check in checks if check.requirement == measure.name)


def tailstack(data: dict[str, Any], command: str, *options: str) -> str:
    """What a command prints of a design, or writes."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with TemporaryDirectory() as folder, contextlib.redirect_stdout(out):
        design = Path(folder) / "d.json"
        design.write_text(json.dumps(data), encoding="utf-8")
        if command == "report":
            main([command, str(design), *options, "-o", str(Path(folder) / "out")])
            (page,) = (Path(folder) / "out").glob("*.html")
            return page.read_text(encoding="utf-8")
        main([command, str(design), *options])
    out.flush()
    return out.buffer.getvalue().decode()


def meet_score(own: Subject, measure: Measure) -> None:
    check = own.check(measure)
    assert (check.error, check.unit, check.words) == (measure.name, measure.unit, measure.words)
    assert 0 < check.value < 10
    doubted = any(site.doubt for site in measure.sites(compile_design(own.design)))
    assert doubted == (f"estimate of {measure.words} is from a simulation" in (check.open_because or ""))
    assert doubted == (check.interval[1] is None)


def meet_budget(own: Subject, measure: Measure) -> None:
    """closed form: twice the noise has four times the variance."""

    def share_of_noise(found: Score) -> float:
        shares = {"tcp": "variance_share", "localisation": "localisation_share"}.get(measure.name)
        if shares:
            shared = {
                each.name: getattr(each, shares) for each in found.targets[0].contributors if each.component == "all"
            }
        else:
            result = next(each for each in found.measures if each.measure == measure.name)
            shared = {each.name: each.variance_share for each in result.shares}
        assert sum(shared.values()) == pytest.approx(1.0)
        return float(sum(share for name, share in shared.items() if name.startswith("target_noise")))

    before = share_of_noise(own.score)
    assert share_of_noise(own.noisier) == pytest.approx(4 * before / (1 + 3 * before))


def meet_simulation(own: Subject, measure: Measure) -> None:
    """sampled: P95 of 20,000 trials has a standard error of 1.2 % at most; first order leaves out less than 1 %."""
    drawn, estimate = check_of(own.verification.verdict.checks, measure), own.check(measure)
    assert (drawn.target, drawn.unit) == (estimate.target, estimate.unit)
    if measure.name == "worst_point":  # a lower bound
        assert drawn.value > 0.94 * estimate.value
    else:
        assert drawn.value == pytest.approx(estimate.value, rel=0.06)
    assert drawn.interval[0] < drawn.value < (drawn.interval[1] or 0)


def meet_units(own: Subject, measure: Measure) -> None:
    """independent: of what keeps its own P95 within the value 90 % do; the limit is beyond nearly all."""
    check = check_of(score_of_units().verdict.checks, measure)
    assert (check.value <= check.limit) == (check.yield_fraction >= 0.9)


def meet_losses(own: Subject, measure: Measure) -> None:
    """brute force: the scores of all structures that are left."""
    line = next(each for each in own.score.losses if each.requirement == measure.name)
    assert (line.unit, line.value) == (measure.unit, max_of(own.score, measure))
    worst = {label: max_of(rest, measure) for label, rest in own.without.items()}
    assert line.single.value == pytest.approx(max(worst.values()), rel=1e-9)
    assert worst[line.single.lost[0]] == max(worst.values())


def check_list(found: Score, measure: Measure) -> list[Check]:
    return [check for check in found.verdict.checks if check.requirement == measure.name]


def max_of(found: Score, measure: Measure) -> float:
    return max(check.value for check in check_list(found, measure))


def meet_batch(own: Subject, measure: Measure) -> None:
    check = own.check(measure)
    present, moved = own.table[f"value:{measure.name}:{check.target}"]
    there = next(each for each in check_list(own.moved, measure) if each.target == check.target)
    assert (present, moved) == pytest.approx((check.value, there.value), rel=1e-9)
    assert moved != present


def meet_derivative(own: Subject, measure: Measure) -> None:
    ends = [check_of(end.verdict.checks, measure).value for end in own.ends]
    value, (slope,) = own.function.p95_gradient(own.function.present, own.check(measure).target, measure.name)
    assert value == pytest.approx(own.check(measure).value, rel=1e-9)
    assert slope == pytest.approx((ends[1] - ends[0]) / (2 * STEP_MM), rel=1e-3, abs=1e-7)


def meet_optimiser(own: Subject, measure: Measure) -> None:
    """independent: the linear model; the optimiser has terms of its own."""
    problem, mechanics, (projections, told) = own.placement
    demand = next(each for each in problem.demands if each.requirement.name == measure.name)
    term, laid = terms_of(problem, demand), lay(problem, plain(problem.system.fiducials_mm), mechanics)
    found = image_parts_at(problem.estimation, term, laid, projections, told, plain(term.reconstructed_mm)).numbers
    model, _ = linearise_demand(chain_of(problem.system), demand)
    wanted = image_parts(model, measure.name).numbers
    np.testing.assert_allclose(np.asarray(found, float), wanted, rtol=1e-7, atol=1e-12)
    levers = np.vstack([block.gain(measure.name).T for block in model.blocks if block.effect.way == "link"])
    np.testing.assert_allclose(term.gains.base, levers, rtol=0, atol=1e-12)


def meet_gate(own: Subject, measure: Measure) -> None:
    number = next(each for each in own.gate["numbers"] if each["requirement"] == measure.name)
    assert (number["error"], number["unit"]) == (measure.name, measure.unit)
    assert number["value"] == pytest.approx(own.check(measure).value, rel=1e-12)


def meet_report(own: Subject, measure: Measure) -> None:
    assert measure.words in own.page


def meet_notebook(own: Subject, measure: Measure) -> None:
    with patch("tailstack.results.notebook.MOST_ROWS", 99):
        assert f"P95{measure.brief}<" in html.unescape(own.score._repr_html_())


def meet_page(own: Subject, measure: Measure) -> None:
    """The page makes its fields of the schema: what may be limited, and in which unit."""
    (fields,) = (
        each["properties"]
        for each in json_schema("design")["$defs"].values()
        if {"limit_mm", "error"} <= each.get("properties", {}).keys()
    )
    error = stated(measure)["error"]
    assert error in fields["error"]["enum"]
    assert fields["error"]["x-limited-by"][error] == measure.limit_field
    assert not measure.side or measure.side in json.dumps(fields["side"])


CONSUMERS: dict[str, Callable[[Subject, Measure], None]] = {
    name.removeprefix("meet_"): meet for name, meet in list(globals().items()) if name.startswith("meet_")
}


def meet(name: str, consumer: str) -> None:
    """What ``test_new_measure.py`` asks of a measure that it adds."""
    CONSUMERS[consumer](subject(), MEASURE[name])


@pytest.mark.parametrize("consumer", CONSUMERS)
@pytest.mark.parametrize("measure", [measure.name for measure in MEASURES])
def test_it_is_met(measure: str, consumer: str) -> None:
    meet(measure, consumer)


def write_page() -> str:
    """The text of docs/measures.md."""
    lists = {"Measures": [f"`{each.name}` ({each.unit})" for each in STATED], "Consumers": list(CONSUMERS)}
    lines = [f"{title}: {', '.join(names)}." for title, names in lists.items()]
    one_sided = " and ".join(f"`{measure.name}`" for measure in MEASURES if measure.side)
    lines[1] += " An angle or a corridor of `two_shots` is neither in losses nor in the optimiser. Which statistics "
    lines[1] += "and levels units, losses and optimiser take [stands with them](design.md#what-a-requirement-limits). "
    lines[1] += "The histogram of a report is of the error at one target."
    lines[0] += f" Those that `side: above` or `below` may stand with are asked as {one_sided}, too."
    return HEAD + "\n\n".join(textwrap.fill(line, 120) for line in lines) + "\n"


def test_the_page_is_the_matrix() -> None:
    assert PAGE.read_text(encoding="utf-8") == write_page()


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
