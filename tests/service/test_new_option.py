"""An option is one field: whoever adds it meets it at every door.  It is put into a copy of the service's sources.

So is a column.
"""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from browsing import used
from served import served
from service_scenes import EXAMPLES, ROOT

from family import run_python
from waiting import LIMIT_SECONDS

DEMO = ROOT / "examples" / "demo.yaml"
BESIDE = '    scene: bool = False\n    """Add the scene in space, with the errors of a score."""\n'
ADDED = '    room_px: Annotated[float, Field(gt=0, le=90)] = 5.0\n    """Room at the edge, px."""\n'
PROGRAM = """
import contextlib, functools, io, json, sys
from pathlib import Path

import tailstack_service
from tailstack_service.cli.main import main
from tailstack_service.operations import perform
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.request import RawRequest
from tailstack_service.settings import Settings

demo = sys.argv[1]
told = {"sources": tailstack_service.__file__, "given": []}

def ask(*arguments):
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(arguments)
    out.flush()
    return code, out.buffer.getvalue().decode(), err.getvalue()

layout = OPERATIONS["layout"]

@functools.wraps(layout.run)
def run(call, own=layout.run):
    told["given"].append(call.options.room_px)
    return own(call)

object.__setattr__(layout, "run", run)

def post(form, body, *query):
    perform.receive("layout", RawRequest(form, body, query), Settings()).compute()

told["help"] = ask("layout", "--help")[1]
told["refused"] = ask("layout", demo, "--room-px", "91")[2]
told["codes"] = [ask("layout", demo)[0], ask("layout", demo, "--room-px", "7", "--json")[0]]
yaml = Path(demo).read_bytes()
post("yaml", yaml, ("room_px", "8"))
told["openapi"] = json.loads(ask("openapi")[1])
post("json", json.dumps({"design": told["openapi"]["components"]["examples"]["LayoutRequest"]["value"]["design"],
                         "room_px": 9.5}).encode())
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the copy says of the option."""
    folder = tmp_path_factory.mktemp("copy")
    copied = folder / "tailstack_service"
    shutil.copytree(ROOT / "service" / "tailstack_service", copied, ignore=shutil.ignore_patterns("__pycache__"))
    file = copied / "operations" / "layout.py"
    content = file.read_text(encoding="utf-8")
    assert content.count(BESIDE) == 1
    content = content.replace(BESIDE, BESIDE + ADDED)
    content = content.replace("from typing import", "from pydantic import Field\nfrom typing import Annotated,")
    file.write_text(content, encoding="utf-8")
    path = os.pathsep.join([str(folder), str(ROOT / "solver")])
    done = run_python(
        "-c", PROGRAM, str(DEMO), said={"PYTHONPATH": path, "COLUMNS": "100"}, timeout=3 * LIMIT_SECONDS, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    assert Path(answer["sources"]).is_relative_to(folder)
    return answer


def test_it_is_a_flag_with_its_bounds(told: dict[str, Any]) -> None:
    assert "[--room-px X]" in told["help"]
    assert "--room-px X  room at the edge, px (default 5.0)" in told["help"]
    assert "argument --room-px: expected a number above 0 and at most 90; got 91" in told["refused"]


def test_it_is_in_the_body_and_the_query_of_the_route(told: dict[str, Any]) -> None:
    document = told["openapi"]
    described = document["components"]["schemas"]["LayoutRequest"]["properties"]["room_px"]
    assert described["description"] == "Room at the edge, px."
    assert (described["exclusiveMinimum"], described["maximum"], described["default"]) == (0, 90, 5.0)
    (parameter,) = [each for each in document["paths"]["/v1/layouts"]["post"]["parameters"]
                    if each.get("name") == "room_px"]  # fmt: skip
    assert (parameter["in"], parameter["schema"]["maximum"]) == ("query", 90)


def test_it_is_among_the_options_that_a_run_is_given(told: dict[str, Any]) -> None:
    """By its default, by the flag, by the query of a YAML body, by the body in JSON."""
    assert told["codes"] == [0, 0]
    assert told["given"] == [5.0, 7.0, 8.0, 9.5]


# --- a column -------------------------------------------------------------------------------------


BEFORE = '        Column("dP95/dh", "mm/unit", "significant", on=IN_DETAIL, of=lambda row: row.line.dp95_per_unit),\n'
TOY = '        Column("Toyness", "toys", "fixed", 1, of=lambda row: 1000 * row.line.variance_share),\n'
FIELD, RENAMED = "dp95_per_unit", "toy_slope"
PROGRAM_OF_COLUMN = """
import io, json, sys
import openpyxl
from tailstack import load_design, score
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render_all
from tailstack_service.rendering.text import Page, write_on
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.schemas import json_schema

found = score(load_design(sys.argv[1]))
told = {"terminal": OPERATIONS["score"].write(found), "notebook": found._repr_html_()}
with write_on(Page(160, details=True)):
    told["details"] = OPERATIONS["score"].write(found)
made = dict(render_all("score", to_json(found), ("html", "xlsx")))
told["html"] = made["html"].decode()
sheet = openpyxl.load_workbook(io.BytesIO(made["xlsx"]))["Budget"]
told["xlsx"] = "\\n".join(" ".join(str(cell) for cell in row) for row in sheet.iter_rows(values_only=True))
largest = max(line.variance_share for line in found.worst_target.contributors)
told["record"], told["schema"] = to_json(found).decode(), json.dumps(json_schema("score"))
print(json.dumps({"told": told, "largest": 1000 * largest}))
"""


def copy_with_column(folder: Path) -> str:
    """PYTHONPATH with a copy of the sources in which the column is added, to a file of which no kernel is made."""
    shutil.copytree(ROOT / "solver" / "tailstack", folder / "tailstack", ignore=shutil.ignore_patterns("*.nb?"))
    file = folder / "tailstack" / "results" / "score.py"
    text = file.read_text(encoding="utf-8")
    assert text.count(BEFORE) == 1
    file.write_text(text.replace(BEFORE, TOY + BEFORE), encoding="utf-8")
    return os.pathsep.join(str(place) for place in (folder, ROOT / "service"))


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, str], float]:
    """What a copy with the column, and with the field renamed, shows of a score; the largest number in the column."""
    folder = tmp_path_factory.mktemp("copy")
    copy = copy_with_column(folder)
    for each in (folder / "tailstack" / "results" / "score.py", folder / "tailstack" / "budget.py"):
        text = each.read_text(encoding="utf-8")
        assert FIELD in text
        each.write_text(text.replace(FIELD, RENAMED), encoding="utf-8")
    done = run_python(
        "-c",
        PROGRAM_OF_COLUMN,
        str(EXAMPLES / "demo.yaml"),
        said={"PYTHONPATH": copy},
        timeout=5 * LIMIT_SECONDS,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    return found["told"], found["largest"]


@pytest.mark.parametrize("writer", ["terminal", "details", "notebook", "html", "xlsx"])
def test_every_writer_has_the_column(shown: tuple[dict[str, str], float], writer: str) -> None:
    told, largest = shown
    words = told[writer].lower()
    assert "toyness" in words
    assert "toys" in words
    assert (f"{largest:.1f}" if writer != "xlsx" else f"{largest:.4f}"[:-2]) in words


@pytest.mark.long
def test_the_page_has_the_column(tmp_path: Path, browser: None) -> None:
    with served(tmp_path, PYTHONPATH=copy_with_column(tmp_path)) as service:
        found = used(service.url, "figures", script="shown.mjs")
    for state in ("before", "after"):
        shown = found[state]
        assert "Toyness toys" in [" ".join(head.split()) for head in shown["heads"]]
        assert len(shown["rows"]) > 5
    assert found["after"]["rows"] != found["before"]["rows"]
    assert f"P95 {found['p95']} mm" in found["after"]["caption"]


def test_a_field_that_is_renamed_where_it_is_declared_and_computed_is_renamed_in_what_is_published(
    shown: tuple[dict[str, str], float],
) -> None:
    told, _ = shown
    for document in ("record", "schema"):
        assert RENAMED in told[document]
        assert FIELD not in told[document]
    for writer in ("details", "html"):
        assert "dp95/dh" in told[writer].lower()
