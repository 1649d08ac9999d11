"""The sheet for the supplier: by command and over HTTP, in every form, with nothing on it that is not his."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import httpx
import openpyxl
import pytest
from pypdf import PdfReader
from service_scenes import EXAMPLES

from plain_data import DEMO
from tailstack import load_design
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.report.chapters.supplier import draw_up_sheet

HOSTILE = ["=1+1", "+A", "-2", "@x", 'a "b", c;d', "<script>alert(1)</script>", "日本", "x\u2028y"]
SECRET = ("limit_mm", "tip-accuracy", "optimise", "price", "siemens", "targets")


def hand_over(source: Any, form: str) -> bytes:
    """What a sheet of a design holds in a form, through the same functions as command and service."""
    return render("sheet", to_json(draw_up_sheet(load_design(source))), form)


def with_fiducials(**stated: Any) -> dict[str, Any]:
    """The demonstration with other fiducials."""
    return {**DEMO, "fiducials": stated}


def test_csv_gives_the_same_beads_again_whatever_they_are_called(tmp_path: Path) -> None:
    """independent: another design reads the file; a second reading of it is by the csv module."""
    points = [
        {"label": label, "position_mm": [7.123456789012345 * k - 31, (17 * k * k) % 53 - 26.5, -20.1 - (11 * k) % 47]}
        for k, label in enumerate(HOSTILE)
    ]
    made = {"half_width_mm": [0.05, 0.03, 0.02], "distribution": "uniform"}
    design = with_fiducials(points=points, diameter_mm=3.0, manufacturing=made)
    table = hand_over(design, "csv")
    (tmp_path / "sheet.csv").write_bytes(table)
    again = with_fiducials(file="sheet.csv", diameter_mm=3.0, manufacturing=made)
    read = load_design(again, base_directory=tmp_path)
    assert read.fiducials.labels == tuple(HOSTILE)
    assert read.sha256 == load_design(design).sha256
    rows = list(csv.DictReader(io.StringIO(table.decode())))
    assert not any(cell.startswith(("=", "+", "@")) for row in rows for cell in row.values())
    assert not any(row["label"].startswith("-") for row in rows)
    wanted = {"diameter_mm": "3.0", "tolerance_x_mm": "0.05", "tolerance_y_mm": "0.03", "tolerance_z_mm": "0.02"}
    assert all(wanted.items() <= row.items() for row in rows)


def test_pages_have_beads_seats_and_dimensions_and_nothing_of_what_was_computed() -> None:
    html = hand_over(DEMO, "html").decode()
    pdf = PdfReader(io.BytesIO(hand_over(DEMO, "pdf")))
    book = openpyxl.load_workbook(io.BytesIO(hand_over(DEMO, "xlsx")))
    assert {"Beads", "structure_connector", "connector_flange"} <= set(book.sheetnames)
    pages = " ".join(page.extract_text() for page in pdf.pages)
    for told in (html, pages):
        assert all(words in told for words in ("Centres of the beads", "two dowel pins", "F12", "triangular", "0.15"))
        assert not any(word in told for word in SECRET)
    record = json.loads(hand_over(DEMO, "json"))
    assert not any(word in json.dumps(record) for word in SECRET)
    # each ordinate of each bead stands at the picture's edge: closed form, read from the document
    svg = re.search(r"<svg.*?</svg>", html, re.DOTALL)
    assert svg is not None
    ordinates = {float(text.replace("−", "-")) for text in re.findall(r">(−?[\d.]+)</text>", svg[0])}
    places = [point["position_mm"] for point in DEMO["fiducials"]["points"]]
    assert {float(value) for place in places for value in place} | {0.0, -95.0, -145.0} <= ordinates
    numbers = re.findall(r'fill="#0072b2">([\d, ]+)</text>', svg[0])
    assert sorted(int(one) for words in numbers for one in words.split(",")) == sorted([*range(1, 13)] * 2)


def test_hostile_names_are_text_and_what_is_not_stated_is_said() -> None:
    points = [{**point, "label": f"{label}{k}"} for k, (point, label) in enumerate(
        zip(DEMO["fiducials"]["points"], (HOSTILE * 2)[:12], strict=True))]  # fmt: skip
    design = {
        **with_fiducials(points=points),
        "optimise": None,
        "name": "<b>x</b>",
        "interfaces": {},
        "assumed": ["/fiducials/points"],
    }
    html = hand_over(design, "html").decode()
    assert "<script>alert" not in html
    assert "<b>x" not in html
    assert "agree on one" in html
    assert "To be settled" in html
    many = [{"position_mm": [k % 31 - 15.05, (7 * k) % 29 - 14, -(k % 37) - 0.01 * k]} for k in range(300)]
    assert hand_over(with_fiducials(points=many), "html").count(b"<svg") == 1


def test_the_command_writes_every_form_and_refuses_what_is_not_for_a_supplier(
    call: Any, refused: Any, tmp_path: Path
) -> None:
    demo = EXAMPLES / "demo.yaml"
    code, out, _ = call("report", demo, "--supplier", "--format", "html,csv,json", "-o", tmp_path)
    assert code == 0
    assert [Path(line).name for line in out.split()] == [f"demo.supplier.{end}" for end in ("html", "csv", "json")]
    code, _, _ = call("report", "--verify", tmp_path / "demo.supplier.html", demo)
    assert code == 0
    tampered = (tmp_path / "demo.supplier.json").read_text().replace("-29.0", "-28.0")
    (tmp_path / "other.json").write_text(tampered)
    assert call("report", "--verify", tmp_path / "other.json", demo)[0] == 1
    other = EXAMPLES / "first_carrier.yaml"
    assert call("report", "--verify", tmp_path / "demo.supplier.html", other)[0] == 1, "it is not that of this design"
    assert "--supplier --format csv" in refused("report", demo, "--format", "csv")
    assert "one design" in refused("report", demo, demo, "--supplier")
    assert "--seed" in refused("report", demo, "--supplier", "--seed", "3")
    assert call("report", demo, "--supplier", "--summary", "-o", tmp_path)[0] == 0
    assert len(PdfReader(tmp_path / "demo.supplier.pdf").pages) == 1


@pytest.mark.parametrize("media", ["text/csv", "text/html", "application/json"])
def test_a_service_hands_over_the_same_bytes(client: httpx.Client, media: str) -> None:
    form = media.rpartition("/")[2]
    answer = client.post("/v1/sheets", json={"design": DEMO}, headers={"Accept": media})
    assert answer.status_code == 200
    assert answer.content == hand_over(DEMO, form)
    assert answer.headers["content-type"].startswith(media)
    refusal = client.post("/v1/sheets", json={"design": DEMO, "seed": 3})
    assert refusal.status_code == 422


def test_pins_and_faces_stand_as_they_are_drawn() -> None:
    """table: H7/g6 of 6 mm is +0.012/0 and -0.004/-0.012 (ISO 286-2); half of a deviation is on no drawing."""
    seat = draw_up_sheet(load_design(EXAMPLES / "dowelled_seat.yaml")).seats[0]
    assert seat.tolerances == ()
    pin = next(feature for feature in seat.features if feature.name == "pin 1")
    assert "6 H7/g6: hole +0.012/+0 " in pin.stated
    assert "pin -0.004/-0.012 " in pin.stated
    assert (pin.position_mm, pin.normal) == ((-30.0, 0.0, -95.0), (0.0, 0.0, 1.0))
