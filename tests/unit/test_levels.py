"""Drawn once per unit, per mounting or at each shot: what a reading holds, by score, simulation and document.

Draws nested three deep are in ``test_statistics_of_measures``.
"""

from __future__ import annotations

import copy
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import tailstack
from family import run_python
from plain_data import DEMO, EXAMPLES
from scenes import cube8_system, mount, with_noise
from tailstack import verification
from tailstack.design import compile_design, load_design
from tailstack.errors import DesignError
from tailstack.laws import RISKS, Drawn
from tailstack.montecarlo.chain import draw
from tailstack.montecarlo.plan import compile_plan
from tailstack.optimisation import optimise
from tailstack.results.score import budget_table
from tailstack.results.tables import On
from tailstack.scoring import score
from tailstack.system import Law, Requirement, System
from tailstack.verification import _narrow, verify

LAWS = Path(tailstack.__file__).with_name("laws.py")
EXAMPLE = EXAMPLES / "gallery" / "per_unit_limit.yaml"
DEGREES = np.deg2rad(1.0)


def clipped_on(**changes: Any) -> System:
    """A structure that is clipped on for each procedure, on a flange that stays."""
    first = mount("structure_connector", (0, 0, -95), half_width=[0.1 * DEGREES] * 3 + [0.1] * 3, law=Law.UNIFORM)
    second = mount("connector_flange", (0, 0, -145), half_width=[0.08 * DEGREES] * 3 + [0.05] * 3)
    first = replace(first, drawn=Drawn.MOUNTING)
    return cube8_system(structure_connector=first, connector_flange=second, views=with_noise(0.7), **changes)


def on(risk: str) -> Requirement:
    return Requirement(risk, "tcp", 0.95, 1.0, 0.95, ("target",), risk, None if risk == "pooled" else 0.9)


def test_no_pooled_number_depends_on_a_level() -> None:
    """The score to rounding, the simulation to the last bit."""
    system = clipped_on(requirements=(on("pooled"),))
    found = [
        replace(system, structure_connector=replace(system.structure_connector, drawn=level),
                connector_flange=replace(system.connector_flange, drawn=level), manufacturing_drawn=level)
        for level in Drawn
    ]  # fmt: skip
    scored = [score(each, losses=False).targets[0].p95_mm for each in found]
    assert scored == pytest.approx([scored[0]] * 3, rel=1e-12)
    drawn = [verify(each, trials=4096, seed=3).targets[0] for each in found]
    assert drawn[1] == drawn[0] == drawn[2]


def test_a_reading_shares_what_its_level_holds_and_draws_the_rest_again() -> None:
    system = clipped_on()
    for level, wanted in ((Drawn.UNIT, (8, 2)), (Drawn.MOUNTING, (2, 2))):
        plan = compile_plan(system, shots_per_unit=4, held=level)
        z = draw(plan, 5, np.arange(8))
        for name, count in zip(("structure_connector", "connector_flange"), wanted, strict=True):
            assert len(np.unique(z[:, plan.columns_of(name)], axis=0)) == count, (level, name)
        assert len(np.unique(z[:, plan.columns_of("fiducial_noise:view0")], axis=0)) == 8


def test_the_simulation_judges_mountings_as_the_score_does() -> None:
    """sampled: 2,048 units and mountings; the estimate within 2 % of the simulation (five times its standard error)."""
    system = clipped_on(requirements=(on("per_unit"), on("per_mounting")))
    estimated, simulated = score(system, losses=False).verdict.checks, verify(system, trials=4096).verdict.checks
    for estimate, check in zip(estimated, simulated, strict=True):
        assert check.value == pytest.approx(estimate.value, rel=0.02)
    assert simulated[1].headline == "P95 that 90 % of mountings keep"
    assert simulated[0].value > 1.03 * simulated[1].value  # the two readings are apart: one is not taken for the other


def test_the_document_says_the_level_and_a_default_leaves_the_hash() -> None:
    data = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    before = load_design(data).sha256
    data["interfaces"]["structure_connector"]["drawn"] = "unit"
    data["execution"]["drawn"] = "shot"
    assert load_design(data).sha256 == before
    data["interfaces"]["structure_connector"]["drawn"] = "mounting"
    data["requirements"][1]["risk"] = "per_mounting"
    design = load_design(data)
    assert design.sha256 != before
    system = compile_design(design)
    assert system.structure_connector.drawn is Drawn.MOUNTING
    assert system.requirements[1].level is Drawn.MOUNTING
    data["interfaces"]["structure_connector"]["drawn"] = "week"
    with pytest.raises(DesignError, match="unit, mounting, shot"):
        load_design(data)


def test_the_budget_says_how_often_each_contributor_is_drawn() -> None:
    """As the table of docs/design.md has it, unless the document says another level; what is known is not drawn."""
    data = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    data["interfaces"]["structure_connector"]["drawn"] = "mounting"
    data["fiducials"]["manufacturing"]["drawn"] = "shot"
    data["fiducials"]["diameter_mm"] = 2.0  # the balls' images: known
    found = score(load_design(data), losses=False)
    lines = found.targets[0].contributors
    once = {"structure_connector": "mounting", "connector_flange": "unit", "ball_images": None}
    assert {line.name for line in lines} > once.keys() | {"execution", "fiducial_manufacturing"}
    assert {line.name: line.drawn for line in lines} == {line.name: once.get(line.name, "shot") for line in lines}
    table = budget_table(found.targets[0]).on(On.SHEET)
    drawn = [column.title for column in table.columns].index("Drawn per")
    words = {row.cells[0]: row.cells[drawn] for row in table.rows if row.depth == 0}
    assert {*Drawn, None} == set(words.values())


def test_the_optimiser_names_what_it_cannot_draw_again() -> None:
    data = copy.deepcopy(DEMO)
    data["fiducials"]["manufacturing"]["drawn"] = "mounting"
    data["requirements"][0] |= {"risk": "per_unit", "min_yield": 0.9}
    with pytest.raises(DesignError, match="fiducial manufacturing is drawn at each mounting"):
        optimise(load_design(data))


ONE_MORE = """
import json, sys, types
module = sys.modules["tailstack.laws"] = types.ModuleType("tailstack.laws")
exec(sys.stdin.read(), module.__dict__)
from test_levels import read_as
print(json.dumps([read_as(level) for level in ("mounting", "week")]))
"""


def read_as(level: str) -> dict[str, Any]:
    """What score, simulation, optimiser and an answer's words tell of a clip that is drawn so, and judged so."""
    data = copy.deepcopy(DEMO)
    data["interfaces"]["structure_connector"]["drawn"] = level
    data["requirements"][0] |= {"risk": f"per_{level}", "min_yield": 0.9}
    data["optimise"] = {"rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5}, "requirement": "tip-accuracy"}
    design = load_design(data)
    found, drawn, best = score(design), verify(design, trials=2048, seed=3), optimise(design)
    checks = [each.verdict.checks[0] for each in (found, drawn)]
    lines = found.targets[0].contributors
    told = [[check.value, check.interval, check.headline, check.risk] for check in checks]
    shares = [[line.drawn, line.variance_share] for line in lines]
    return {"checks": told, "cost": best.cost_exact_law, "shares": shares}


@pytest.mark.long
def test_one_level_more_is_one_value() -> None:
    """A week between mounting and shot: judged by each week, a clip drawn weekly is one drawn at each mounting, digit
    by digit; only the words differ."""
    source = LAWS.read_text(encoding="utf-8")
    with_weeks = source.replace('    SHOT = "shot"', '    WEEK = "week"\n    SHOT = "shot"')
    assert len(with_weeks.splitlines()) == len(source.splitlines()) + 1
    places = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    answer = run_python("-c", ONE_MORE, input=with_weeks, check=True, said={"PYTHONPATH": places})
    mountings, weeks = json.loads(answer.stdout)
    assert json.dumps(mountings).replace("mounting", "week") == json.dumps(weeks)
    assert [check[2] for check in weeks["checks"]] == ["P95 that 90 % of weeks keep"] * 2
    assert len(RISKS) == len(Drawn)


def test_units_that_are_alike_have_the_quantile_of_all_shots(monkeypatch: pytest.MonkeyPatch) -> None:
    """closed form: without a source that is drawn per unit each unit's P95 is that of all shots, whatever the yield.
    512 shots tell a P95 to 2 %, and 2,048 a P99.5, by which units seem to differ: neither a pass nor a fail may come of
    that.  Deeper than shots reach, only a limit that hardly a shot of all is beyond is kept."""
    system = cube8_system()
    rarely = Requirement("of all shots", "tcp", 0.995, 1.0, 0.95, ("target",))
    whole = verify(replace(system, requirements=(rarely,)), trials=2**18, seed=3)
    p95, worst, p995 = whole.targets[0].p95_mm, whole.targets[0].worst_mm, whole.verdict.checks[0].value

    def ask(limit: float, min_yield: float, quantile: float = 0.95) -> Requirement:
        name = f"{min_yield:g} of units, P{100 * quantile:g}, {limit:.4f}"
        return Requirement(name, "tcp", quantile, limit, 0.95, ("target",), "per_unit", min_yield)

    asked = [ask(times * p95, share) for times in (0.97, 1.03) for share in (0.1, 0.95)]
    rare = [ask(0.97 * p995, 0.1, 0.995), ask(1.03 * p995, 0.95, 0.995)]
    monkeypatch.setattr(verification, "MOST_SHOTS", 2**11)
    deep = [ask(0.9 * worst, 0.8, 0.9999), ask(1.5 * worst, 0.8, 0.9999)]
    found = verify(replace(system, requirements=(*asked, *rare, *deep)), trials=2**18, seed=4)
    assert found.stopping.endswith("2,048 units of 512 shots each were drawn. Besides, 2,048 units of 2,048 shots each "
                                   "were drawn.")  # fmt: skip
    checks = found.verdict.checks
    for check in checks[:6]:
        known = p95 if check.quantile == 0.95 else p995
        low, high = check.interval
        assert high is not None
        assert low < known < high
        assert check.value == pytest.approx(known, rel=0.015)
        assert check.status != ("pass" if check.limit < known else "fail")
    assert [check.status for check in checks[6:]] == ["inconclusive", "pass"]
    assert "2048 shots are drawn of each unit, too few for its P99.99" in checks[6].open_because


def test_the_scatter_of_units_is_told_from_that_of_their_estimates() -> None:
    """sampled: quantiles of 2,048 units as far apart as they are known, and twice and half as far; with 20 seeds each
    the P90 over units is within 3 standard errors of 20 (0.3 % of seeds fail), where that of estimates is far off."""
    rng = np.random.default_rng(6)
    for apart in (0.5, 1.0, 2.0):
        found, plain = [], []
        for _ in range(20):
            truth = 10 + apart * rng.standard_normal(2048)
            first, second = truth + np.sqrt(2) * rng.standard_normal((2, 2048))  # of the halves of each unit's shots
            units = np.column_stack([(first + second) / 2, first - second])
            found.append(_narrow(units)[1843])
            plain.append(np.sort(units[:, 0])[1843])
        expected, error = 10 + 1.2816 * apart, np.std(found) / np.sqrt(20)
        assert abs(np.mean(found) - expected) < 3 * error + 1e-3 * apart
        assert np.mean(plain) - expected > 10 * error
