"""The cures of slips as a person meets them: at the command, over HTTP, in a gate; alike findings are told once."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_scenes import EXAMPLES, ROOT, check_problem, small_design

from plain_data import read_cases
from tailstack.design.plausibility import PLAUSIBILITY

DEMO = EXAMPLES / "demo.yaml"
YAML = {"Content-Type": "application/yaml"}
JSON = {"Content-Type": "application/json"}


def written(tmp_path: Path, old: str, new: str, count: int = 1) -> Path:
    text = DEMO.read_text()
    assert old in text
    path = tmp_path / "design.yaml"
    path.write_text(text.replace(old, new, count))
    return path


SLIPS = [
    ("    limit_mm: 1.0", "    limit_mm: 1,0", "/requirements/0/limit_mm", "write decimals with a point: 1.0"),
    ("    quantile: 0.95", "    quantile: 95", "/requirements/0/quantile", "it is a fraction: 95 % is 0.95"),
    ("uniform } # beads", "gaussian } # beads", "/fiducials/manufacturing/distribution", "did you mean normal?"),
]


@pytest.mark.parametrize(("old", "new", "pointer", "cure"), SLIPS)
def test_the_command_and_the_service_name_the_same_cure(
    client: httpx.Client, call: Any, tmp_path: Path, old: str, new: str, pointer: str, cure: str
) -> None:
    path = written(tmp_path, old, new)
    line = path.read_text().splitlines().index(next(x for x in path.read_text().splitlines() if new in x)) + 1
    for verb in ("validate", "score"):
        code, _, told = call(verb, path)
        assert code == 2
        assert f"{path}:{line}:" in told
        assert f" {pointer}: " in told
        assert f"  hint: {cure}\n" in told
    for route in ("/v1/validations", "/v1/scores"):
        found = check_problem(client.post(route, content=path.read_bytes(), headers=YAML), 422, "invalid-design")
        (entry,) = found["errors"]
        assert (entry["pointer"], entry["hint"], entry["line"]) == (pointer, cure, line)


def test_options_of_a_request_are_cured_like_fields(client: httpx.Client) -> None:
    def hint(**options: Any) -> str:
        body = {"design": small_design(), **options}
        return check_problem(client.post("/v1/verifications", json=body), 422, "invalid-request")["errors"][0]["hint"]

    assert hint(precision=5) == "it is a fraction: 5 % is 0.05"
    assert hint(precision="0,01") == "write decimals with a point: 0.01"
    assert hint(presicion=0.01) == "did you mean precision?"
    answer = client.post("/v1/verifications?presicion=0.1", content=b"a: 1", headers=YAML)
    assert check_problem(answer, 422, "invalid-request")["errors"][0]["hint"] == "did you mean precision?"


@pytest.mark.parametrize(("method", "path", "meant"), read_cases("http", "routes"))
def test_a_route_that_is_misspelt_is_answered_with_the_nearest(
    client: httpx.Client, method: str, path: str, meant: str | None
) -> None:
    hint = check_problem(client.request(method, path), 404, "not-found")["errors"][0]["hint"]
    assert hint == (f"did you mean {meant}? " if meant else "") + "GET /openapi.json lists every path"
    if meant:
        listed = client.get("/openapi.json").json()["paths"]
        verb, template = meant.split()
        assert verb.lower() in listed[template]


def test_a_schema_that_is_misspelt_is_answered_with_the_nearest(client: httpx.Client, refused: Any) -> None:
    found = check_problem(client.get("/v1/schemas/desgin"), 404, "not-found")
    assert found["errors"][0]["hint"] == "did you mean design?"
    assert "did you mean design? one of design, validation" in refused("schema", "desgin")


WITHOUT_LINE_ENDS = b"label,x_mm,y_mm,z_mm" + b"".join(b"F%d,%d,0,5" % (k, 10 * k) for k in range(8))
FORM, CSV, EXCEL = ({"Content-Type": kind} for kind in
                    ("application/x-www-form-urlencoded", "text/csv", "application/vnd.ms-excel"))  # fmt: skip


def without_line_ends(name: str) -> bytes:
    """published: curl(1) strips carriage returns and newlines from what -d reads from a file."""
    return (EXAMPLES / name).read_bytes().replace(b"\r", b"").replace(b"\n", b"")


@pytest.mark.parametrize(
    ("route", "body", "headers", "status", "hints"),
    [
        ("/v1/scores", DEMO.read_bytes(), JSON, 400, ["send Content-Type: application/yaml"]),
        ("/v1/comparisons", DEMO.read_bytes(), JSON, 400, ["takes JSON"]),
        ("/v1/scores", json.dumps({"design": small_design()}).encode(), YAML, 422,
         ["send Content-Type: application/json"]),
        ("/v1/scores", DEMO.read_bytes(), FORM, 415, ["-H 'Content-Type: application/yaml'", "--data-binary @FILE"]),
        ("/v1/scores", without_line_ends("demo.yaml"), YAML, (400, 422), ["--data-binary @FILE"]),
        ("/v1/scores", without_line_ends("first_carrier.yaml"), YAML, (400, 422), ["--data-binary @FILE"]),
        ("/v1/conversions?to=yaml", WITHOUT_LINE_ENDS, CSV, (400, 422), ["--data-binary @FILE"]),
        ("/v1/conversions", WITHOUT_LINE_ENDS, JSON, 400, ["it is no JSON: say in Content-Type what it is"]),
        ("/v1/conversions", b"x_mm,y_mm,z_mm", EXCEL, 415,
         ["text/csv", "text/plain", "model/step", "application/json"]),
        ("/v1/scores", b"x_mm,y_mm,z_mm", EXCEL, 415, ["application/yaml", "application/json"]),
        ("/v1/comparisons", b"x_mm,y_mm,z_mm", EXCEL, 415, ["application/json"]),
    ],
)  # fmt: skip
def test_a_body_that_is_sent_otherwise_than_it_is_meant_gets_the_way(
    client: httpx.Client, route: str, body: bytes, headers: dict[str, str], status: Any, hints: list[str]
) -> None:
    answer = client.post(route, content=body, headers=headers)
    assert answer.status_code in (status if isinstance(status, tuple) else (status,)), answer.text
    hint = answer.json()["errors"][0]["hint"]
    assert [each for each in hints if each not in hint] == []


@pytest.mark.parametrize(("body", "headers"), [(b"[1", JSON), (b"", YAML)], ids=["damaged", "nothing"])
def test_no_way_is_told_where_none_is_known(client: httpx.Client, body: bytes, headers: dict[str, str]) -> None:
    hint = client.post("/v1/scores", content=body, headers=headers).json()["errors"][0]["hint"]
    assert "--data-binary" not in hint
    assert hint == "" or not body


def test_a_charset_that_is_not_taken_gets_the_way_to_utf_8(client: httpx.Client) -> None:
    for named in ("windows-1252", '"UTF-16LE"', "ISO-8859-1; boundary=x"):
        header = {"Content-Type": f"application/yaml; charset={named}"}
        found = check_problem(client.post("/v1/scores", content=b"x", headers=header), 415, "unsupported-media-type")
        assert "as UTF-8" in found["errors"][0]["hint"]
        assert f"iconv -f {named.partition(';')[0].strip(chr(34)).lower()} -t UTF-8" in found["errors"][0]["hint"]
    for named in ("utf-8", '"UTF-8"', "US-ASCII"):
        header = {"Content-Type": f"application/yaml; charset={named}"}
        assert client.post("/v1/scores", content=DEMO.read_bytes(), headers=header).status_code == 200


@pytest.mark.parametrize("name", ["my design.yaml", "it's $HOME; rm.yaml"])
def test_the_command_to_type_next_survives_the_shell(
    call: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """independent: shlex.split reads it as a shell would."""
    monkeypatch.chdir(tmp_path)
    Path(name).write_text("schema: tailstack/design/1\nname: x\n")
    told = call("score", name)[2].splitlines()[-1].removeprefix("next: ").partition("   ")[0]
    assert shlex.split(told) == ["tailstack", "validate", name]
    told = call("example", "first_carrier", "-o", f"new {name}")[1].splitlines()[-1].removeprefix("next: ")
    assert shlex.split(told) == ["tailstack", "score", f"new {name}"]


# --- alike findings -----------------------------------------------------------------------------------------


def test_ten_alike_findings_are_told_once_with_their_cure(call: Any, tmp_path: Path, refused: Any) -> None:
    """Text for people says it once; the problem document keeps every entry."""
    path = written(tmp_path, "label: F", "lable: F", 12)
    lines = [k for k, each in enumerate(path.read_text().splitlines(), 1) if "lable" in each]
    told = call("validate", path)[2]
    assert told.count("did you mean label?") == 1
    assert f"{path}:{lines[0]}:9: /fiducials/points/0/lable: unknown field 'lable'" in told
    others = ", ".join(map(str, lines[1:9]))
    assert f"  and 11 more like it: lines {others}, ...\n" in told
    assert "and 11 more like it" in refused("score", str(path))
    assert len(json.loads(call("score", path, "--json")[2])["errors"]) == 12
    told = " ".join(call("gate", path, "--mode", "analytic")[1].split())
    assert told.count("unknown field 'lable'") == 1
    assert f"and 11 more like it: lines {others}, ..." in told


def test_two_of_a_kind_and_different_ones_are_told_one_by_one(call: Any, tmp_path: Path) -> None:
    path = written(tmp_path, "target_noise_px: 0.3", "target_noise_px: 0,3", 2)
    path.write_text(path.read_text().replace("    quantile: 0.95", "    quantile: 95"))
    told = call("validate", path)[2]
    assert told.count("write decimals with a point") == 2
    assert told.count("  hint: ") == 3
    assert "more like it" not in told


def test_the_page_on_designs_lists_every_remark() -> None:
    page = (ROOT / "docs" / "design.md").read_text()
    table = page.partition("## What is remarked as implausible")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    listed = [rule for row in rows for rule in row.split("`")[1::2]]
    assert listed == list(PLAUSIBILITY)
