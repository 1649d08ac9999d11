"""UM-Bridge 1.0 at /umbridge: the protocol's own tests, its Python client against the library, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import umbridge
from door_pages import run_page
from scipy.stats import qmc
from served import served
from service_scenes import ROOT, check_problem, client_of, client_with, small_design

from tailstack import DesignFunction, compile_design, load_design, score
from tailstack.montecarlo import compile_plan, evaluate
from tailstack_service.examples import read_example
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS

CONFORMITY = ROOT / "tests" / "data" / "umbridge"
INPUTS = [
    "fiducials.points.0.position_mm.1", "views.*.fiducial_noise_px",
    "interfaces.structure_connector.tolerances.rz.half_width_deg",
]  # fmt: skip
VALUES = [-31.0, 0.25, 0.12]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    database = f"sqlite:///{tmp_path_factory.mktemp('umbridge') / 'jobs.sqlite3'}"
    with client_with(Settings(database=database, worker_processes=1)) as client:
        yield client


@pytest.fixture
def url(client: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("NO_PROXY", "*")  # the protocol's client and tests ask requests, which reads it
    return f"{client.base_url}".rstrip("/") + "/umbridge"


def ask(client: httpx.Client, verb: str, **body: Any) -> httpx.Response:
    return client.post(f"/umbridge/{verb}", json={"name": "score", **body})


def message_of(response: httpx.Response, word: str = "InvalidInput") -> str:
    assert response.status_code == 400, response.text
    assert set(response.json()) == {"error"}
    assert response.json()["error"]["type"] == word
    text: str = response.json()["error"]["message"]
    return text


@pytest.mark.long
def test_the_protocols_own_tests_pass(url: str, tmp_path: Path) -> None:
    for name in ("conftest.py", "test_model_schema.py"):
        (tmp_path / name).write_bytes((CONFORMITY / f"{name}.txt").read_bytes())
    command = [
        sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "-c", "/dev/null",
        str(tmp_path), "--model_url", url, "--input_value", "0.1",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=LIMIT_SECONDS, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout


def test_the_page_prints_what_it_says(url: str) -> None:
    printed, quoted = run_page("umbridge", **{"http://127.0.0.1:8321/umbridge": url})
    assert printed == quoted


def test_the_protocols_client_gets_what_the_library_says(url: str) -> None:
    """independent: the library's own score and gradient, in this process."""
    config = {"design": small_design(), "inputs": INPUTS, "outputs": ["targets.0.p95_mm", "targets.0.mean_norm_mm"]}
    model = umbridge.HTTPModel(url, "score")
    assert (model.get_input_sizes(config), model.get_output_sizes(config)) == ([3], [2])
    function = DesignFunction(load_design(small_design()), INPUTS)
    target = function.score(VALUES).targets[0]
    ((p95, mean),) = model([VALUES], config)
    assert p95 == pytest.approx(target.p95_mm, abs=1e-12)
    assert mean == pytest.approx(target.mean_norm_mm, abs=1e-12)

    _, slopes = function.p95_gradient(VALUES)
    np.testing.assert_allclose(model.gradient(0, 0, [VALUES], [2.0, 0.0], config), 2 * slopes, rtol=0, atol=1e-12)
    alone = {**config, "outputs": ["targets.0.p95_mm"]}
    direction = [0.3, -1.0, 2.0]
    along = model.apply_jacobian(0, 0, [VALUES], direction, alone)
    np.testing.assert_allclose(along, [slopes @ direction], rtol=0, atol=1e-12)
    assert model.supports_gradient()
    assert not model.supports_apply_hessian()


def test_without_a_configuration_the_half_widths_of_the_demo_are_varied(url: str) -> None:
    model = umbridge.HTTPModel(url, "score")
    tolerances = [
        seat["tolerances"][name] for seat in read_example("demo")["interfaces"].values() for name in seat["tolerances"]
    ]
    present = [next(value for key, value in each.items() if key.startswith("half_width")) for each in tolerances]
    assert model.get_input_sizes() == [len(present)]
    ((p95,),) = model([present])
    assert p95 == score(load_design(read_example("demo"))).targets[0].p95_mm


def test_a_design_that_was_sent_before_is_named_by_its_hash_and_patched(client: httpx.Client) -> None:
    sent = client.post("/v1/scores", json={"design": small_design()}).json()
    patch = {"targets": [{"name": "tip", "position_mm": [3, 2, 60]}]}
    config = {"design_sha256": sent["provenance"]["design_sha256"], "patch": patch, "inputs": INPUTS[1:2]}
    ((p95,),) = ask(client, "Evaluate", input=[[0.3]], config=config).json()["output"]
    assert p95 == score(load_design({**small_design(), **patch})).targets[0].p95_mm
    unknown = ask(client, "Evaluate", input=[[0.3]], config={"design_sha256": "0" * 64, "inputs": INPUTS[1:2]})
    assert "is kept here; send the design whole" in message_of(unknown)


def test_one_shot_of_the_chain_is_that_of_the_monte_carlo(url: str) -> None:
    """independent: deviates drawn by NumPy, made uniform by SciPy's distributions, evaluated by the library."""
    from scipy import stats

    design = load_design(read_example("demo"))
    plan = compile_plan(compile_design(design))
    rng = np.random.default_rng(5)
    kinds = {"normal": stats.norm(), "uniform": stats.uniform(-1, 2), "triangular": stats.triang(0.5, -1, 2)}
    uniform = rng.uniform(1e-4, 1 - 1e-4, (4, plan.dimension))
    deviates = np.array([[kinds[law].ppf(u) for law, u in zip(plan.laws, row, strict=True)] for row in uniform])
    model = umbridge.HTTPModel(url, "chain")
    assert (model.get_input_sizes(), model.get_output_sizes()) == ([plan.dimension], [3])
    found = [model([row.tolist()], {"example": "demo", "target": "tip"})[0] for row in uniform]
    np.testing.assert_allclose(found, evaluate(plan, deviates)[:, 0, 0], rtol=0, atol=1e-10)
    assert not model.supports_gradient()


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ({"input": [[0.3]], "config": {"inputs": ["views.AP.fiducial_noise"]}}, "did you mean"),
        ({"input": [[-1.0]], "config": {"inputs": ["views.AP.fiducial_noise_px"]}}, "must be"),
        ({"input": [[0.3]], "config": {"inputs": ["/name"]}}, "only numbers can be varied"),
        ({"input": [[0.3]], "config": {"input": ["/name"]}}, "/config/input: there is no option"),
        ({"input": [[0.3]], "config": {"example": "dem"}}, "/config/example: no example is called"),
        ({"input": [[0.3]], "config": {"example": "demo", "design": {}}}, "give one of design"),
        ({"input": [[0.3]], "config": {"design": {"schema": "x"}}}, "/config/design"),
        ({"input": [[0.3]], "config": {"inputs": INPUTS[1:2], "outputs": ["targets.tip.p95"]}}, "did you mean"),
        ({"input": [[0.3]], "config": {"inputs": INPUTS[1:2], "outputs": ["targets.0.name"]}}, "one number"),
        ({"input": [0.3]}, "/input/0"),
        ({"input": [["0.3"]]}, "/input/0/0"),
        ({}, "/input"),
        ({"input": [[0.3] * 2_000]}, "/input/0"),
    ],
)  # fmt: skip
def test_what_cannot_be_evaluated_is_refused_where_it_is(client: httpx.Client, body: dict[str, Any], said: str) -> None:
    assert said in message_of(ask(client, "Evaluate", **body))


def test_what_has_no_derivative_says_so(client: httpx.Client) -> None:
    config = {"inputs": ["interfaces.connector_flange.pivot_mm.2"]}
    assert "is not known: it moves" in message_of(ask(client, "Gradient", input=[[-145]], sens=[1], config=config))
    config = {"inputs": ["views.*.fiducial_noise_px"], "outputs": ["targets.0.mean_norm_mm"]}
    assert "only P95 has a derivative" in message_of(ask(client, "Gradient", input=[[0.3]], sens=[1], config=config))
    assert ask(client, "Gradient", input=[[0.3]], sens=[0], config=config).json() == {"output": [0.0]}


def test_models_and_features_that_are_not_there_are_refused_in_the_protocols_words(client: httpx.Client) -> None:
    message_of(ask(client, "Evaluate", name="scores"), "ModelNotFound")
    message_of(ask(client, "ApplyHessian"), "UnsupportedFeature")
    message_of(ask(client, "Gradient", name="chain"), "UnsupportedFeature")
    message_of(ask(client, "Evaluate", name="chain", input=[[0.0]]))
    assert client.get("/umbridge/Info").json() == {"protocolVersion": 1.0, "models": ["score", "chain"]}
    check_problem(client.post("/umbridge/Evaluation", json={}), 404, "not-found")


@pytest.mark.parametrize(
    "body",
    [b"", b"[]", b"{", b'{"name": NaN}', b'{"name": "score", "input": [[1e999]]}', b"\xff", b'{"name": "\\ud800"}'],
)
def test_what_is_no_body_is_refused(client: httpx.Client, body: bytes) -> None:
    response = client.post("/umbridge/Evaluate", content=body)
    assert response.status_code == 400
    assert response.json()["error"]["message"]


@pytest.mark.long
def test_a_service_with_keys_asks_for_one(tmp_path: Path) -> None:
    with served(tmp_path, TAILSTACK_AUTH="required") as service:
        key = service.run("keys", "create", "--tenant", "a", "--name", "test", "--scope", "compute").strip()
        reader = service.run("keys", "create", "--tenant", "a", "--name", "reader", "--scope", "read").strip()
        with client_of(service.url) as client:
            for path in ("Info", "Evaluate"):
                send = client.get if path == "Info" else client.post
                check_problem(send(f"/umbridge/{path}"), 401, "unauthenticated")
                allowed = send(f"/umbridge/{path}", headers={"Authorization": f"Bearer {reader}"})
                check_problem(allowed, 403, "forbidden")
            body = json.dumps({"name": "score", "input": [VALUES], "config": {"inputs": INPUTS}})
            header = {"Authorization": f"Bearer {key}"}
            found = client.post("/umbridge/Evaluate", content=body, headers=header)
            assert found.status_code == 200, found.text


def test_the_first_point_of_a_sobol_sequence_is_refused_with_what_to_do(client: httpx.Client) -> None:
    """independent: SciPy's own sequence; its scrambled points, and those shifted by half of 1 / N, are taken."""

    def shoot(point: Any) -> httpx.Response:
        return client.post("/umbridge/Evaluate", json={"name": "chain", "input": [list(point)]})

    size = client.post("/umbridge/InputSizes", json={"name": "chain"}).json()["inputSizes"][0]
    plain = qmc.Sobol(size, scramble=False).random(4)
    assert "scramble the sequence, or shift every point" in message_of(shoot(plain[0]))
    assert "Sobol" not in message_of(shoot(np.full(size, -0.5)))
    for point in (*(plain + 0.5 / 4), *qmc.Sobol(size, scramble=True, seed=1).random(2)):
        assert shoot(point).status_code == 200
