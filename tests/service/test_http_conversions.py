"""Fiducial files and designs converted over HTTP: every format, units and frames, and what cannot be read."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import httpx
import pytest
import yaml
from jsonschema import Draft202012Validator
from service_scenes import EXAMPLES, check_problem, client_with, small_design

from plain_data import read_cases
from tailstack.design import load_design
from tailstack.design.write import data_to_yaml
from tailstack_service.schemas import json_schema
from tailstack_service.settings import Settings

CLIENT = {"settings": Settings(max_fiducials=10)}
STEP, YAML, PLAIN = ({"Content-Type": kind} for kind in ("model/step", "application/yaml", "text/plain"))
CARRIER = (EXAMPLES / "integrations" / "step" / "carrier.step").read_text(encoding="utf-8")  # eight balls of 3 mm
CSV = "label,x_cm,y_cm,z_cm\nA,1,2,-3\nB,0.5,0,0\n"
FCSV = (
    "# Markups fiducial file version = 4.11\n# CoordinateSystem = RAS\n# columns = id,x,y,z,label\n"
    "1,-10,-20,-30,A\n2,-5,0,0,B\n"
)
POINTS = [{"label": "A", "position_mm": [10.0, 20.0, -30.0]}, {"label": "B", "position_mm": [5.0, 0.0, 0.0]}]


def converted(response: httpx.Response) -> dict[str, Any]:
    assert response.status_code == 200, response.text
    document: dict[str, Any] = response.json()
    Draft202012Validator(json_schema("conversion")).validate(document)
    return document


def test_beads_of_a_file_as_json_or_as_they_are(client: httpx.Client) -> None:
    document = converted(client.post("/v1/conversions", json={"format": "csv", "content": CSV, "to": "yaml"}))
    assert (document["format"], document["fiducials"]) == ("yaml", POINTS)
    section = yaml.safe_load(document["content"])["fiducials"]
    assert section["points"] == POINTS
    assert section["origin"]["file"] == "content.csv"
    assert section["origin"]["sha256"] == hashlib.sha256(CSV.encode()).hexdigest()
    assert "factor 10" in " ".join(document["notes"])
    plain = client.post("/v1/conversions?from=csv&to=yaml", content=CSV, headers=PLAIN)
    assert converted(plain) == document


def test_a_design_to_another_form_and_to_its_beads(client: httpx.Client) -> None:
    text = data_to_yaml(small_design())
    document = converted(client.post("/v1/conversions?to=json", content=text, headers=YAML))
    assert json.loads(document["content"]) == small_design()
    beads = converted(client.post("/v1/conversions?to=csv", content=text, headers=YAML))
    assert [point["label"] for point in beads["fiducials"]] == [f"F{k}" for k in range(1, 9)]
    assert len(beads["content"].splitlines()) == 9


@pytest.mark.parametrize(
    ("body", "status", "slug", "pointer"),
    [
        ({"format": "csv", "content": "x,y,z\n1,2,3\n"}, 422, "invalid-design", "/content"),
        ({"format": "csv", "content": "x_mm,y_mm,z_mm\n" + "1,2,3\n" * 11}, 422, "limit-exceeded", "/content"),
        ({"format": "mrk.json", "content": "nonsense"}, 422, "invalid-design", "/content"),
        ({"format": "json", "content": json.dumps(small_design(fiducials={"file": "/etc/passwd.csv"}))}, 422,
         "invalid-design", "/content/fiducials/file"),
        ({"format": "stl", "content": "x"}, 422, "invalid-request", "/format"),
        ({"format": "csv", "content": ""}, 422, "invalid-request", "/content"),
        ({"format": "csv"}, 422, "invalid-request", ""),
        ({"format": "csv", "content": CSV, "to": "pdf"}, 422, "invalid-request", "/to"),
        ({"format": "csv", "content": CSV, "url": "http://127.0.0.1/"}, 422, "invalid-request", "/url"),
        ({"format": "csv", "content": CSV, "frame": "CON"}, 422, "invalid-request", "/frame"),
        ({"format": "csv", "content": CSV, "files": {"a.csv": CSV}}, 422, "invalid-request", "/files"),
    ],
)  # fmt: skip
def test_what_cannot_be_converted(client: httpx.Client, body: Any, status: int, slug: str, pointer: str) -> None:
    document = check_problem(client.post("/v1/conversions", json=body), status, slug)
    assert document["errors"][0]["pointer"] == pointer


def test_a_type_that_says_what_it_is_needs_no_more(client: httpx.Client) -> None:
    converted(client.post("/v1/conversions", content=CSV, headers={"Content-Type": "text/csv; charset=utf-8"}))
    page = client.post("/v1/conversions", content=CSV, headers={"Content-Type": "text/html"})
    check_problem(page, 415, "unsupported-media-type")


def test_balls_of_a_step_file_alone_and_in_the_place_of_the_fiducials_of_a_design(client: httpx.Client) -> None:
    query = "?sphere_diameter_mm=3&sphere_tolerance_mm=0.1&name=BEAD[!8]"
    document = converted(client.post(f"/v1/conversions{query}", content=CARRIER, headers=STEP))
    assert [point["label"] for point in document["fiducials"]] == [f"BEAD{k}" for k in range(1, 8)]
    assert [body["reason"] for body in document["bodies"]] == [""] * 7 + ["no name of it matches BEAD[!8]"]
    again = client.post(f"/v1/conversions{query}&from=step", content=CARRIER, headers=PLAIN)
    assert converted(again) == document
    body = {"format": "step", "content": CARRIER, "name": "BEAD?", "sphere_diameter_mm": 3, "base": small_design()}
    replaced = converted(client.post("/v1/conversions", json=body))
    made = load_design(replaced["content"])
    assert made.document.targets == load_design(small_design()).document.targets
    assert list(made.fiducials.positions_mm) == [tuple(point["position_mm"]) for point in replaced["fiducials"]]


@pytest.mark.parametrize(("name", "place", "cure"), read_cases("http", "named_files"))
def test_files_that_a_design_names_come_with_it_and_are_read_from_no_disk(
    client: httpx.Client, name: str, place: str, cure: str
) -> None:
    """independent: the design that the command reads, with the files beside it."""
    path = EXAMPLES / "gallery" / f"{name}.yaml"
    design = load_design(path)
    files = {each: (path.parent / each).read_text(encoding="utf-8") for each in design.files}
    body = {"format": "yaml", "content": path.read_text(encoding="utf-8"), "files": files}
    assert load_design(converted(client.post("/v1/conversions", json=body))["content"]).sha256 == design.sha256
    *_, last = files
    left = {each: text for each, text in files.items() if each != last}
    for others, words in (({last: "rubbish"}, ""), ({last: ""}, ""), ({"x.urdf": ""}, cure)):
        refused = client.post("/v1/conversions", json={**body, "files": left | others})
        (problem,) = check_problem(refused, 422, "invalid-design")["errors"]
        assert problem["pointer"] == f"/content/{place}"
        assert words in problem["hint"]


def test_a_step_file_may_be_longer_than_a_design() -> None:
    padded = CARRIER.replace("DATA;", "DATA;\n/*" + "x" * 30_000 + "*/")
    with client_with(Settings(max_body_bytes=20_000, max_step_bytes=90_000)) as client:
        query = "/v1/conversions?sphere_diameter_mm=3&to=csv"
        assert client.post(query, content=padded, headers=STEP).status_code == 200
        too_long = client.post(query, content=padded + " " * 20_000, headers=STEP)
        assert "TAILSTACK_MAX_STEP_BYTES" in check_problem(too_long, 413, "limit-exceeded")["errors"][0]["hint"]
        plain = client.post("/v1/conversions", content=padded, headers=YAML)
        assert "TAILSTACK_MAX_BODY_BYTES" in check_problem(plain, 413, "limit-exceeded")["errors"][0]["hint"]


@pytest.mark.parametrize(
    ("kind", "query", "content", "slug", "words"),
    [
        (STEP, "sphere_diameter_mm=5", CARRIER, "invalid-design", "8 of 3 mm"),
        (STEP, "sphere_diameter_mm=3&frame=CON", CARRIER, "invalid-design", "no coordinate system"),
        (STEP, "sphere_diameter_mm=none", CARRIER, "invalid-request", "expected a number"),
        (STEP, "sphere_diameter_mm=-1", CARRIER, "invalid-request", "above 0"),
        (STEP, "spheres=3", CARRIER, "invalid-request", "spheres"),
        (PLAIN, "from=csv&xmalab=in", CSV, "invalid-request", "'mm' or 'cm'"),
        (PLAIN, "from=fcsv", FCSV.replace("\n", ""), "invalid-design", "--data-binary @FILE"),
        (PLAIN, "from=csv", "x_mm,y_mm,z_mm\n1,2,3\n1,wide,3\n", "invalid-design", '"line": 3'),
        (PLAIN, "", CSV, "invalid-request", "from"),
        (PLAIN, "from=stl", CSV, "invalid-request", "stl"),
        (PLAIN, "form=csv", CSV, "invalid-request", "form"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used(
    client: httpx.Client, kind: dict[str, str], query: str, content: str, slug: str, words: str
) -> None:
    document = check_problem(client.post(f"/v1/conversions?{query}", content=content, headers=kind), 422, slug)
    assert words in json.dumps(document["errors"], ensure_ascii=False)
