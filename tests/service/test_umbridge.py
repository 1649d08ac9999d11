"""A design over UM-Bridge 1.0, by the example: the protocol's own tests, its Python client against the library."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import requests
import umbridge
from door_pages import run_page
from postgres import free_ports
from scipy import stats
from service_scenes import EXAMPLES, ROOT

from family import run_process, started
from tailstack import DesignFunction, compile_design, load_design
from tailstack.montecarlo.chain import evaluate
from tailstack.montecarlo.plan import compile_plan
from waiting import LIMIT_SECONDS, until

CONFORMITY = ROOT / "tests" / "data" / "umbridge"
EXAMPLE = ROOT / "examples" / "integrations" / "umbridge" / "serve_design.py"
DEMO = EXAMPLES / "demo.yaml"
INPUTS = ["fiducials.points.0.position_mm.1", "views.*.fiducial_noise_px"]
VALUES = [-31.0, 0.25]

pytestmark = pytest.mark.long


def answers(url: str) -> bool:
    try:
        return requests.get(f"{url}/Info", timeout=LIMIT_SECONDS).ok
    except requests.ConnectionError:
        return False


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    port = next(free_ports())
    with started(sys.executable, EXAMPLE, DEMO, str(port), stdout=subprocess.DEVNULL, stderr=None):
        until(lambda: answers(f"http://127.0.0.1:{port}"))
        yield f"http://127.0.0.1:{port}"


@pytest.fixture(autouse=True)
def directly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "*")  # the protocol's client and tests ask requests, which reads it


def test_the_protocols_own_tests_pass(url: str, tmp_path: Path) -> None:
    for name in ("conftest.py", "test_model_schema.py"):
        (tmp_path / name).write_bytes((CONFORMITY / f"{name}.txt").read_bytes())
    command = [
        sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "-c", "/dev/null",
        str(tmp_path), "--model_url", url, "--input_value", "0.1",
    ]  # fmt: skip
    done = run_process(*command, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout


def test_the_page_prints_what_it_says(url: str) -> None:
    printed, quoted = run_page("umbridge", **{"http://127.0.0.1:4242": url})
    assert printed == quoted


def test_the_protocols_client_gets_what_the_library_says(url: str) -> None:
    """independent: the library's own score and gradient, in this process."""
    model, config = umbridge.HTTPModel(url, "score"), {"inputs": INPUTS}
    assert (model.get_input_sizes(config), model.get_output_sizes(config)) == ([2], [1])
    function = DesignFunction(load_design(DEMO), INPUTS)
    assert model([VALUES], config) == [[function.score(VALUES).targets[0].p95_mm]]
    _, slopes = function.p95_gradient(VALUES)
    np.testing.assert_allclose(model.gradient(0, 0, [VALUES], [2.0], config), 2 * slopes, rtol=0, atol=1e-12)
    along = model.apply_jacobian(0, 0, [VALUES], [0.3, -1.0], config)
    np.testing.assert_allclose(along, [slopes @ [0.3, -1.0]], rtol=0, atol=1e-12)
    data = load_design(DEMO).source.data["interfaces"]
    assert model.get_input_sizes() == [sum(len(seat["tolerances"]) for seat in data.values())]


def test_one_shot_of_the_chain_is_that_of_the_monte_carlo(url: str) -> None:
    """independent: uniform numbers made of deviates by SciPy's distribution functions."""
    plan = compile_plan(compile_design(load_design(DEMO)))
    kinds = {"normal": stats.norm(), "uniform": stats.uniform(-1, 2), "triangular": stats.triang(0.5, -1, 2)}
    draw = np.random.default_rng(5).uniform
    deviates = np.array([[draw(-0.9, 0.9) for _ in plan.laws] for _ in range(4)])
    uniform = [[kinds[law].cdf(z) for law, z in zip(plan.laws, row, strict=True)] for row in deviates]
    model = umbridge.HTTPModel(url, "chain")
    found = [model([[float(u) for u in row]])[0] for row in uniform]
    np.testing.assert_allclose(found, evaluate(plan, deviates)[:, 0, 0], rtol=0, atol=1e-10)
