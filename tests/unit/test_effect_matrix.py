"""Every effect, declared with what is typical of it, in front of everything that has to know of it.

Each pair of a consumer, a function ``meet_NAME``, and an effect is a test; nothing here names an effect.
``PYTHONPATH=tests python tests/unit/test_effect_matrix.py`` writes the pairs into docs/effects.md.
"""

from __future__ import annotations

import contextlib
import html
import io
import json
import textwrap
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from plain_data import DEMO, REMOVED, problems_of, replaced
from tailstack import DesignFunction, load_design, score, score_batch
from tailstack.batch import COMPILED, Batch
from tailstack.design import compile_design
from tailstack.design.plausibility import find_implausible
from tailstack.design.pointers import find_numbers, set_numbers
from tailstack.effects import EFFECTS, EffectKind
from tailstack.effects.kind import Excess
from tailstack.errors import DesignError
from tailstack.fields import describe_fields
from tailstack.laws import Drawn
from tailstack.montecarlo.plan import compile_plan
from tailstack.optimisation.exact_law import image_parts
from tailstack.optimisation.problem import present_choice
from tailstack.optimisation.task import read_task
from tailstack.optimisation.terms import estimator_affine, image_parts_at, lay, pivot_shift_of, terms_of
from tailstack.propagation.linear import linearise
from tailstack.studies.bench.levels import BenchDraws, expect, simulate_benches
from tailstack.studies.coupling import study_coupling
from tailstack.studies.estimators import study_estimators
from tailstack.studies.linearity import study_linearity
from tailstack.studies.views import study_views
from tailstack.system import System
from tailstack_service.cli.main import main
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.schemas import json_schema
from typical import declare
from validity_trials import paired_norms

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "effects.md"
HEAD = """# Effects and who knows of them

Each pair of an *effect*, a file of `solver/tailstack/effects/`, and a consumer is a test, which writes this page:
`./run test tests/unit/test_effect_matrix.py -k EFFECT-CONSUMER`.

"""
CELLS = 102  # of the matrix: it does not shrink
KINDS = {kind.compile.__module__.rpartition(".")[2]: kind for kind in EFFECTS}
PLAIN = DEMO | {"model": {"estimator": "pose"}}
COORDINATE = "/fiducials/points/0/position_mm/0"


class Subject:
    """The demo with one effect."""

    def __init__(self, kind: EffectKind[Any]) -> None:
        self.kind, self.data = kind, json.loads(json.dumps(PLAIN))
        assert declare(self.data, kind, np.random.default_rng(39), 1.0)
        self.design = load_design(self.data)
        self.system = compile_design(self.design)
        self.effects = self.system.effects
        self.model = linearise(self.system, self.system.targets[0])
        self.scored = score(self.design, losses=False)
        self.score = self.scored.targets[0]
        self.p95_mm = self.score.p95_mm

    @property
    def places(self) -> list[tuple[str | int, ...]]:
        """Where its numbers stand in the document."""
        own = set(self.kind.section.model_fields)
        return [place for place in find_numbers(self.data, ()) if own & set(place)]


@cache
def subject(name: str) -> Subject:
    return Subject(KINDS[name])


def is_half_width(place: tuple[str | int, ...]) -> bool:
    return next(step for step in reversed(place) if isinstance(step, str)).startswith("half_width")


def p95_of(data: dict[str, Any]) -> float:
    return score(load_design(data), losses=False).targets[0].p95_mm


def linear_p95_of(system: System) -> float | None:
    """That of the study at the one point of its grid at which the design stands."""
    axes: dict[str, Any] = {"noises_px": (0.3,), "rotations_deg": (0.0,), "spreads": (1.0,)}
    study = study_linearity(system, **axes, counts=(len(system.fiducials_mm),), trials=2**13)
    return study.points[0].first_order_p95_mm


@cache
def of_none() -> tuple[float, float | None]:
    """P95 of the demo without an effect: of its score, and of the study of linearity."""
    return p95_of(PLAIN), linear_p95_of(compile_design(load_design(PLAIN)))


def tailstack(*arguments: str) -> str:
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.redirect_stdout(out):
        main(list(arguments))
    out.flush()
    return out.buffer.getvalue().decode()


def meet_score(own: Subject, folder: Path) -> None:
    assert own.p95_mm != pytest.approx(of_none()[0], rel=1e-8)


def meet_budget(own: Subject, folder: Path) -> None:
    assert {effect.name for effect in own.effects} <= {line.name for line in own.score.contributors}


def meet_simulation(own: Subject, folder: Path) -> None:
    """sampled: the same deviates in chain and first order; what differs is the second order."""
    plan = compile_plan(own.system)
    for effect in own.effects:
        if effect.sources.count:
            assert len(np.arange(plan.dimension)[plan.columns_of(effect.name)]) == effect.sources.count
    chain, linear = paired_norms(own.system, "tcp", 8192, 7)
    assert np.quantile(chain, 0.95) == pytest.approx(np.quantile(linear, 0.95), rel=0.02)
    assert np.quantile(linear, 0.95) == pytest.approx(own.p95_mm, rel=0.05)


def meet_optimiser(own: Subject, folder: Path) -> None:
    """independent: the linear model; the optimiser has terms of its own."""
    problem = read_task(own.design).problems[0]
    demand, mechanics = problem.demands[0], pivot_shift_of(problem, present_choice(problem))
    projections, told = (part.at(mechanics) for part in estimator_affine(problem))
    term, laid = terms_of(problem, demand), lay(problem, problem.system.fiducials_mm, mechanics)
    aim = term.reconstructed.at(mechanics)
    found = image_parts_at(problem.estimation, term, laid, projections, told, aim).numbers
    wanted = image_parts(linearise(problem.system, demand.targets[0]), "tcp").numbers
    np.testing.assert_allclose(np.asarray(found, float), wanted, rtol=1e-7, atol=1e-12)


def meet_derivative(own: Subject, folder: Path) -> None:
    """By a coordinate of a bead, and by every half-width of the effect."""
    widths = ["/" + "/".join(map(str, place)) for place in own.places if is_half_width(place)]
    function, step = DesignFunction(own.design, [COORDINATE, *widths]), 1e-3
    slopes = function.p95_gradient(function.present)[1]
    for at, slope in zip(np.eye(1 + len(widths)), slopes, strict=True):
        away = step * at * np.where(np.arange(len(at)) > 0, function.present, 1.0)
        below, above = (function.score(function.present + k * away, losses=False).targets[0].p95_mm for k in (-1, 1))
        assert slope == pytest.approx((above - below) / (2 * away.sum()), rel=1e-3, abs=1e-7)


def meet_batch(own: Subject, folder: Path) -> None:
    at = own.data["fiducials"]["points"][0]["position_mm"][0]
    table = score_batch(own.design, {COORDINATE: [at, at + 1]}, columns=("p95_mm",))
    (column,) = table.columns.values()
    moved = set_numbers(own.data, ((("fiducials", "points", 0, "position_mm", 0),),), [at + 1.0])
    assert list(column) == pytest.approx([own.p95_mm, p95_of(moved)], rel=1e-12)
    assert Batch(own.design, (COORDINATE,), ("p95_mm",)).way == COMPILED


def meet_losses(own: Subject, folder: Path) -> None:
    """brute force: the scores of structures that are left."""
    (found,) = score(own.design).losses

    def without(k: int) -> float:
        return p95_of(replaced(own.data, ("fiducials", "points", k), REMOVED))

    worst = own.system.fiducial_labels.index(found.single.lost[0])
    assert without(worst) == pytest.approx(found.single.value, rel=1e-9)
    assert without(worst - 1) <= found.single.value


def meet_coupling(own: Subject, folder: Path) -> None:
    study = study_coupling(own.system, trials=2**13, levels=())
    for effect in own.effects:
        if effect.sources.count:
            assert effect.words in (study.noise if effect.drawn is Drawn.SHOT else study.installation)
    assert study.cases[0].p95_together_mm == pytest.approx(own.p95_mm, rel=0.05)


def meet_linearity(own: Subject, folder: Path) -> None:
    assert linear_p95_of(own.system) != pytest.approx(of_none()[1], rel=1e-8)


def meet_estimators(own: Subject, folder: Path) -> None:
    cases = {case.estimator: case.p95_mm for case in study_estimators(own.design).cases}
    assert cases["pose"] == pytest.approx(own.p95_mm, rel=0.3)
    assert len(cases) == 4


def meet_views(own: Subject, folder: Path) -> None:
    with patch("tailstack.studies.views.COARSE_DEG", 60.0):
        study = study_views(own.design, cone_deg=4, step_deg=4)
    assert study.p95_mm == pytest.approx(own.p95_mm, rel=1e-12)
    assert any(one.p95_mm is not None for one in study.views[0].directions)


def meet_compare(own: Subject, folder: Path) -> None:
    """sampled: 3,000 benches of four trials; their spread is good to 4 %, the second order left out."""
    predicted = expect(own.model, "tcp", 0.0)
    errors = simulate_benches(own.system, 0, "tcp", (2, 2), BenchDraws(3, 3000))
    found = np.trace(np.cov(errors[:, 0].T))
    assert found == pytest.approx(np.trace(predicted.unit + predicted.installation + predicted.shot), rel=0.12)


def meet_gate(own: Subject, folder: Path) -> None:
    (folder / "d.json").write_text(json.dumps(own.data), encoding="utf-8")
    record = tailstack("gate", str(folder / "d.json"), "--mode", "analytic", "--format", "json")
    assert f"{own.p95_mm:.6g}"[:6] in record


def meet_report(own: Subject, folder: Path) -> None:
    text = html.unescape(render("score", to_json(own.scored), "html").decode())
    assert any(effect.label in text for effect in own.effects)


def meet_page(own: Subject, folder: Path) -> None:
    """The page makes its fields of the schema, and its sliders of the bounds there."""
    schema = json.dumps(json_schema("design"))
    for name, field in describe_fields(own.kind.section).items():
        assert field.description
        assert f'"{name}"' in schema


def meet_plausibility(own: Subject, folder: Path) -> None:
    """What is typical is not doubted; a number beyond its domain is refused there."""
    rules = {doubt.id for doubt in own.kind.doubts}
    assert not [finding for finding in find_implausible(own.design, own.system) if finding.rule in rules]
    for place in own.places:
        pointer = problems_of(load_design, set_numbers(own.data, ((place,),), [1e9]), error=DesignError)[0].pointer
        assert ("/" + "/".join(map(str, place))).startswith(pointer.rsplit("/", 1)[0])


def meet_validity(own: Subject, folder: Path) -> None:
    """What is typical is no larger than what first order was calibrated with, and has a validity number."""
    limits = own.kind.limits(own.system) if own.kind.limits else ()
    assert not [limit for limit in limits if isinstance(limit, Excess)]
    assert 0 < own.model.nu < 1


CONSUMERS: dict[str, Callable[[Subject, Path], None]] = {
    name.removeprefix("meet_"): meet for name, meet in list(globals().items()) if name.startswith("meet_")
}


def meet(effect: str, consumer: str) -> None:
    """What ``test_new_effect.py`` asks of an effect that it adds."""
    with TemporaryDirectory() as folder:
        CONSUMERS[consumer](subject(effect), Path(folder))


@pytest.mark.parametrize("consumer", CONSUMERS)
@pytest.mark.parametrize("effect", KINDS)
def test_it_is_met(effect: str, consumer: str) -> None:
    meet(effect, consumer)


def write_page() -> str:
    """The text of docs/effects.md."""
    lists = {"Effects": list(KINDS), "Consumers": list(CONSUMERS)}
    lines = (f"{title}: {', '.join(f'`{name}`' for name in names)}." for title, names in lists.items())
    return HEAD + "\n\n".join(textwrap.fill(line, 120) for line in lines) + "\n"


def test_the_page_is_the_matrix_and_the_matrix_does_not_shrink() -> None:
    assert len(KINDS) * len(CONSUMERS) >= CELLS
    assert PAGE.read_text(encoding="utf-8") == write_page()


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
