"""The OpenMDAO component: partials against OpenMDAO's own differences, and its driver at our optimiser's optimum; and a
Monte Carlo of OpenTURNS over the chain, against `verify`.

`sampled`: OpenTURNS draws with its own generator, a fixed seed; the error rate of each comparison is stated."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from door_pages import run_page
from service_scenes import EXAMPLES, ROOT

from optimise_scenes import solve_placement
from tailstack import compile_design, load_design, score, verify
from tailstack.design import Design
from tailstack.montecarlo.plan import compile_plan
from tailstack.optimisation.task import read_task

FOLDER = ROOT / "examples" / "integrations" / "openmdao"
DEMO = load_design(EXAMPLES / "demo.yaml")
LIMIT_MM = 1.1


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The example's module; what OpenMDAO writes goes into a folder of its own."""
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.chdir(tmp_path)
    import allocate

    yield allocate
    for name in ("allocate", "tailstack_openmdao"):
        sys.modules.pop(name, None)


MOTION = {"pivot_mm": [0, 0, -95], "tolerances": {"rx": {"half_width_deg": 0.1, "distribution": "uniform"}}}


@pytest.mark.long("plain")
@pytest.mark.parametrize("design", [DEMO, DEMO.with_value("views.LAT.motion", MOTION)], ids=["plain", "motion"])
def test_partials_are_those_of_openmdaos_differences(example: Any, design: Design) -> None:
    import openmdao.api as om

    inputs = [*example.PATHS, "fiducials.points.F1.position_mm.0", "fiducials.points.F6.position_mm.2"]
    problem = om.Problem(reports=False)
    tail = example.TailComponent(design=design, inputs=inputs, target="tip")
    problem.model.add_subsystem("tail", tail, promotes=["*"])
    problem.setup()
    problem.run_model()
    assert problem.get_val("p95_mm")[0] == score(design).targets[0].p95_mm
    (found,) = problem.check_partials(out_stream=None, form="central", step=1e-3, compact_print=True).values()
    slopes = found["p95_mm", "values"]
    np.testing.assert_allclose(slopes["J_fwd"], slopes["J_fd"], atol=2e-5)
    assert np.abs(slopes["J_fwd"]).min() > 1e-4


def test_its_driver_ends_at_the_optimisers_optimum(example: Any) -> None:
    """independent: IPOPT on the optimiser's own expressions, corrected to the exact law, against SLSQP on the score."""
    widths_deg, cost, p95 = example.allocate(DEMO, LIMIT_MM)
    task = read_task(example.with_the_same_freedom(DEMO, LIMIT_MM))
    found = solve_placement(task.problems[0], starts=1)
    np.testing.assert_allclose(widths_deg, np.rad2deg(found.choice.half_width), rtol=2e-3)
    assert p95 == pytest.approx(LIMIT_MM, rel=1e-5)
    at_the_optimum = sum(w / h for w, h in zip(example.FREE.values(), np.rad2deg(found.choice.half_width), strict=True))
    assert cost == pytest.approx(at_the_optimum, rel=2e-5)


# --- a Monte Carlo of OpenTURNS over the chain, against `verify` ----------------------------------


OPENTURNS = ROOT / "examples" / "integrations" / "openturns"


@pytest.fixture
def chain(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(OPENTURNS))
    import openturns
    import tail_by_openturns

    openturns.RandomGenerator.SetSeed(20_260_131)
    yield tail_by_openturns
    sys.modules.pop("tail_by_openturns", None)


@pytest.mark.long
def test_the_random_inputs_have_the_spreads_that_the_design_declares(chain: Any) -> None:
    law, inputs = chain.chain_of(DEMO)
    plan = compile_plan(compile_design(DEMO))
    np.testing.assert_allclose(list(inputs.getStandardDeviation()), plan.standard_std, atol=1e-12)
    assert list(law.getInputDescription())[:2] == ["fiducial_noise:AP[0]", "fiducial_noise:AP[1]"]


@pytest.mark.long
def test_p95_by_openturns_is_that_of_verify(chain: Any) -> None:
    """Wrong once in 1,000 seeds of OpenTURNS, beside what verify's own 400,000 trials leave open (0.1 %)."""
    _, low, high = chain.quantile_interval(*chain.chain_of(DEMO), trials=60_000, error_rate=1e-3)
    target = verify(DEMO, trials=400_000, seed=7).targets[0]
    assert low < target.p95_mm < high
    assert (high - low) / target.p95_mm < 0.03


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "module", "expected"),
    [
        ("openmdao", "example", r"\[1\.1437\d*\] \{.*'p95_mm', .*'values'"),
        ("openturns", "chain", r"\d+ random inputs, the last of them execution\[\d\]\nP95 1\.1\d+ mm, between"),
    ],
    ids=["openmdao", "openturns"],
)
def test_a_page_shows_what_its_example_prints(
    name: str, module: str, expected: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    request.getfixturevalue(module).main(str(EXAMPLES / "demo.yaml"))
    page = (ROOT / "docs" / "integrations" / f"{name}.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out in page
    (printed,), _ = run_page(name, **{"demo.yaml": str(EXAMPLES / "demo.yaml")})
    assert re.match(expected, printed), printed
