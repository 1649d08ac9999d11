"""``--remote``: a running service judges, to the last byte as the gate here does; a network that fails is 3."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from gate_scenes import BAD, GOOD, NEAR, STRICT, TODAY, waivers, write_documents
from service_scenes import answering, client_with, coplanar_design, http_answer, limited

from tailstack.design.write import data_to_yaml
from tailstack_service.cli.main import main
from tailstack_service.settings import Settings

UNUSED = {"name": "seat", "tolerances": ["structure_conector.r?"], "min_half_width_deg": 0.05}
POLICY = {**STRICT, "rules": {**STRICT["rules"], "fiducial-spacing": {"min_mm": 80.0},  # type: ignore[dict-item]
                              "process-capability": {"processes": [UNUSED]}},
          "verification": {"max_trials": 20000}}  # fmt: skip


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with client_with(Settings(worker_processes=1), worker=True) as client:
        yield str(client.base_url)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with everything that a gate can meet: also a design whose fiducials stand in a file of their own."""
    monkeypatch.chdir(tmp_path)
    filed = limited(1.4)
    points = [point["position_mm"] for point in filed["fiducials"].pop("points")]
    rows = "".join(f"P{k},{x!r},{y!r},{z!r}\n" for k, (x, y, z) in enumerate(points))
    (tmp_path / "beads.csv").write_text("label,x_mm,y_mm,z_mm\n" + rows, encoding="utf-8")
    filed["fiducials"]["file"] = "beads.csv"
    documents = {
        "good.yaml": GOOD, "bad ü.yaml": BAD, "near.yaml": limited(NEAR), "flat.yaml": coplanar_design(),
        "filed.yaml": filed, "broken.yaml": {"schema": "tailstack/design/1", "name": "half"}, "policy.yaml": POLICY,
        "waivers.yaml": waivers(10, designs=["bad*"]),
    }  # fmt: skip
    write_documents(tmp_path, documents)
    monkeypatch.setattr("tailstack_service.cli.gate.today", lambda: TODAY)
    return tmp_path


def gate(*arguments: str) -> int:
    return main(["gate", "--policy", "policy.yaml", *arguments])


@pytest.mark.long("arguments0-1")
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["good.yaml", "--mode", "analytic"], 1),  # spacing
        (["good.yaml", "filed.yaml", "--mode", "analytic"], 1),
        (["good.yaml", "near.yaml", "--policy", "lenient.yaml"], 4),
        (["bad ü.yaml", "--waivers", "waivers.yaml", "--mode", "analytic", "--policy", "lenient.yaml"], 0),
        (["good.yaml", "--waivers", "waivers.yaml", "--mode", "analytic", "--policy", "lenient.yaml"], 0),
        (["good.yaml", "broken.yaml", "flat.yaml", "near.yaml", "absent.yaml", "--mode", "analytic"], 2),
        (["broken.yaml"], 2),
        (["flat.yaml", "good.yaml"], 3),
        (["good.yaml", "--baseline", "base.json", "--mode", "analytic", "--policy", "lenient.yaml"], 0),
    ],
)
def test_the_answer_is_that_of_the_gate_here(folder: Path, url: str, arguments: list[str], code: int) -> None:
    lenient = {key: value for key, value in POLICY.items() if key != "rules"} | {"rules": STRICT["rules"]}
    (folder / "lenient.yaml").write_text(data_to_yaml(lenient), encoding="utf-8")
    if "base.json" in arguments:
        assert gate("near.yaml", "--mode", "analytic", "--on-inconclusive", "warn", "--format=json=base.json") == 1
        base = json.loads((folder / "base.json").read_text(encoding="utf-8"))
        base["provenance"]["tailstack_version"] = "0.0.1"
        (folder / "base.json").write_text(json.dumps(base, indent=2), encoding="utf-8")
    here = gate(*arguments, "--format=json=here.json", "--format=text=here.txt")
    there = gate(*arguments, "--format=json=there.json", "--format=text=there.txt", "--remote", url)
    assert (here, there) == (code, code)
    for end in ("json", "txt"):
        assert (folder / f"there.{end}").read_text("utf-8") == (folder / f"here.{end}").read_text("utf-8")


UNAUTHENTICATED = {
    "type": "/v1/problems/unauthenticated", "title": "Who are you?", "status": 401,
    "errors": [{"pointer": "", "code": "unauthenticated", "detail": "no key", "hint": ""}],
}  # fmt: skip


def test_a_key_is_sent_and_a_refusal_is_no_verdict(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TAILSTACK_KEY", "tsk_secret")
    with answering(http_answer(401, json.dumps(UNAUTHENTICATED).encode())) as (at, got):
        assert gate("good.yaml", "--mode", "analytic", "--remote", at, "--format=json=out.json") == 2
    assert b"authorization: bearer tsk_secret" in got[0].lower()
    assert b"tsk_secret" not in (folder / "out.json").read_bytes()
    assert json.loads((folder / "out.json").read_text())["verdict"] == "not evaluated"
    assert "tsk_secret" not in capsys.readouterr().err


RECORD_OF_ANOTHER = json.dumps({"schema": "tailstack/gate/1", "verdict": "pass", "exit_code": 0}).encode()


@pytest.mark.parametrize(
    "answer",
    [
        http_answer(200, b"<html>a proxy</html>"), http_answer(200, RECORD_OF_ANOTHER), http_answer(200, b""),
        http_answer(500, b"oops"), http_answer(503, b""), None,
    ],
    ids=["a page", "a record of another", "nothing", "500", "503", "it hangs up"],
)  # fmt: skip
def test_an_answer_that_is_none_leaves_with_3(folder: Path, answer: bytes | None) -> None:
    with answering(answer) as (at, _):
        assert gate("good.yaml", "--mode", "analytic", "--remote", at, "--format=json=out.json") == 3
    assert json.loads((folder / "out.json").read_text())["exit_code"] == 3


def test_a_record_about_other_designs_is_no_answer(folder: Path) -> None:
    assert gate("filed.yaml", "--mode", "analytic", "--format=json=other.json") == 1
    other = json.loads((folder / "other.json").read_text(encoding="utf-8"))
    other |= {"verdict": "pass", "exit_code": 0}
    with answering(http_answer(200, json.dumps(other).encode())) as (at, _):
        assert gate("good.yaml", "--mode", "analytic", "--remote", at) == 3


LOST = {
    "type": "/v1/problems/internal-error", "title": "Defect", "status": 500,
    "errors": [{"pointer": "/designs/0", "code": "internal-error", "detail": "lost", "hint": ""}],
}  # fmt: skip


@pytest.mark.parametrize(("state", "problem"), [("cancelled", None), ("failed", LOST)])
def test_a_job_that_does_not_succeed_is_no_verdict(folder: Path, state: str, problem: Any) -> None:
    job = {"schema": "tailstack/job/1", "id": "j1", "kind": "gate", "state": "queued", "problem": None}
    ended = json.dumps({**job, "state": state, "problem": problem}).encode()
    answers = ((202, json.dumps(job).encode()), (204, b""), (200, ended))
    with answering(*(http_answer(*answer) for answer in answers)) as (at, got):
        assert gate("good.yaml", "--remote", at, "--format=json=out.json") == 3
    assert [head.split(b" ")[1] for head in got] == [b"/v1/gates", b"/v1/jobs/j1/events", b"/v1/jobs/j1"]
    assert json.loads((folder / "out.json").read_text())["exit_code"] == 3
