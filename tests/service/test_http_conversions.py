"""Fiducial files and designs converted over HTTP: every format, units and frames, and what cannot be read."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
import yaml
from jsonschema import Draft202012Validator
from service_scenes import check_problem, client_with, small_design

from tailstack.design.write import data_to_yaml
from tailstack_service.schemas import json_schema
from tailstack_service.settings import Settings

CSV = "label,x_cm,y_cm,z_cm\nA,1,2,-3\nB,0.5,0,0\n"
FCSV = (
    "# Markups fiducial file version = 4.11\n# CoordinateSystem = RAS\n# columns = id,x,y,z,label\n"
    "1,-10,-20,-30,A\n2,-5,0,0,B\n"
)
MARKUPS = json.dumps(
    {"markups": [{"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": [
        {"label": "A", "position": [10, 20, -30]}, {"label": "B", "position": [5, 0, 0]}]}]}
)  # fmt: skip
POINTS = [{"label": "A", "position_mm": [10.0, 20.0, -30.0]}, {"label": "B", "position_mm": [5.0, 0.0, 0.0]}]


@pytest.fixture(scope="module")
def client() -> Iterator[httpx.Client]:
    with client_with(Settings(max_fiducials=10)) as client:
        yield client


def converted(response: httpx.Response) -> dict[str, Any]:
    assert response.status_code == 200, response.text
    document: dict[str, Any] = response.json()
    Draft202012Validator(json_schema("conversion")).validate(document)
    return document


@pytest.mark.parametrize(
    ("form", "text", "noted"), [("csv", CSV, "factor 10"), ("fcsv", FCSV, "RAS"), ("mrk.json", MARKUPS, "")]
)
def test_the_same_beads_from_every_format(client: httpx.Client, form: str, text: str, noted: str) -> None:
    document = converted(client.post("/v1/conversions", json={"format": form, "content": text, "to": "yaml"}))
    assert document["fiducials"] == POINTS
    section = yaml.safe_load(document["content"])["fiducials"]
    assert section["points"] == POINTS
    assert section["origin"]["file"] == f"content.{form}"
    assert section["origin"]["sha256"] == hashlib.sha256(text.encode()).hexdigest()
    assert noted in " ".join(document["notes"])
    plain = client.post(f"/v1/conversions?from={form}&to=yaml", content=text, headers={"Content-Type": "text/plain"})
    assert converted(plain) == document


@pytest.mark.parametrize("to", ["csv", "fcsv", "mrk.json", "yaml", "json"])
def test_there_and_back(client: httpx.Client, to: str) -> None:
    document = converted(client.post("/v1/conversions", json={"format": "csv", "content": CSV, "to": to}))
    assert document["format"] == to
    if to in ("csv", "fcsv", "mrk.json"):
        back = converted(client.post("/v1/conversions", json={"format": to, "content": document["content"]}))
        assert (back["fiducials"], back["notes"]) == (POINTS, [])


def test_a_design_to_another_form_and_to_its_beads(client: httpx.Client) -> None:
    text = data_to_yaml(small_design())
    header = {"Content-Type": "application/yaml"}
    document = converted(client.post("/v1/conversions?to=json", content=text, headers=header))
    assert json.loads(document["content"]) == small_design()
    beads = converted(client.post("/v1/conversions?to=csv", content=text, headers=header))
    assert [point["label"] for point in beads["fiducials"]] == [f"F{k}" for k in range(1, 9)]
    assert len(beads["content"].splitlines()) == 9


@pytest.mark.parametrize(
    ("body", "status", "slug", "pointer"),
    [
        ({"format": "csv", "content": "x,y,z\n1,2,3\n"}, 422, "invalid-design", "/content"),
        ({"format": "csv", "content": "x_mm,y_mm,z_mm\n1,2\n"}, 422, "invalid-design", "/content"),
        ({"format": "csv", "content": "x_mm,y_mm,z_mm\n" + "1,2,3\n" * 11}, 422, "limit-exceeded", "/content"),
        ({"format": "mrk.json", "content": "{}"}, 422, "invalid-design", "/content"),
        ({"format": "mrk.json", "content": "nonsense"}, 422, "invalid-design", "/content"),
        ({"format": "json", "content": json.dumps(small_design(fiducials={"file": "/etc/passwd.csv"}))}, 422,
         "invalid-design", "/content/fiducials/file"),
        ({"format": "stl", "content": "x"}, 422, "invalid-request", "/format"),
        ({"format": "csv", "content": ""}, 422, "invalid-request", "/content"),
        ({"format": "csv"}, 422, "invalid-request", ""),
        ({"format": "csv", "content": CSV, "to": "pdf"}, 422, "invalid-request", "/to"),
        ({"format": "csv", "content": CSV, "url": "http://127.0.0.1/"}, 422, "invalid-request", "/url"),
    ],
)  # fmt: skip
def test_what_cannot_be_converted(client: httpx.Client, body: Any, status: int, slug: str, pointer: str) -> None:
    document = check_problem(client.post("/v1/conversions", json=body), status, slug)
    assert document["errors"][0]["pointer"] == pointer


def test_a_bad_line_of_a_file_is_named(client: httpx.Client) -> None:
    body = {"format": "csv", "content": "x_mm,y_mm,z_mm\n1,2,3\n1,wide,3\n"}
    entry = check_problem(client.post("/v1/conversions", json=body), 422, "invalid-design")["errors"][0]
    assert (entry["file"], entry["line"]) == ("content.csv", 3)


def test_plain_text_says_what_it_is(client: httpx.Client) -> None:
    plain = {"Content-Type": "text/plain"}
    check_problem(client.post("/v1/conversions", content=CSV, headers=plain), 422, "invalid-request")
    check_problem(client.post("/v1/conversions?from=stl", content=CSV, headers=plain), 422, "invalid-request")
    check_problem(client.post("/v1/conversions?form=csv", content=CSV, headers=plain), 422, "invalid-request")
    converted(client.post("/v1/conversions", content=CSV, headers={"Content-Type": "text/csv; charset=utf-8"}))
    check_problem(client.post("/v1/conversions", content=CSV, headers={"Content-Type": "text/html"}), 415,
                  "unsupported-media-type")  # fmt: skip
