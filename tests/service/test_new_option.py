"""An option is one field: whoever adds it meets it at every door.  It is put into a copy of the service's sources."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from service_scenes import ROOT

from family import run_python
from waiting import LIMIT_SECONDS

DEMO = ROOT / "examples" / "demo.yaml"
BESIDE = '    scene: bool = Field(False, description="Add the scene in space, with the errors of a score.")\n'
ADDED = '    room_px: Annotated[float, Field(gt=0, le=90)] = Field(5.0, description="Room at the edge, px.")\n'
PROGRAM = """
import contextlib, functools, io, json, sys
from pathlib import Path

import tailstack_service
from tailstack_service.cli.main import main
from tailstack_service.http import computations
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
    computations.receive("layout", RawRequest(form, body, query), Settings()).compute()

told["help"] = ask("layout", "--help")[1]
told["refused"] = ask("layout", demo, "--room-px", "91")[2]
told["codes"] = [ask("layout", demo)[0], ask("layout", demo, "--room-px", "7", "--json")[0]]
yaml = Path(demo).read_bytes()
post("yaml", yaml, ("room_px", "8"))
told["openapi"] = json.loads(ask("openapi")[1])
post("json", json.dumps({"design": told["openapi"]["components"]["examples"]["LayoutRequest"]["value"]["design"],
                         "room_px": 9.5}).encode())
told["completed"] = "--room-px" in ask("completion", "bash")[1]
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
    content = content.replace(BESIDE, BESIDE + ADDED).replace("TYPE_CHECKING, Any", "TYPE_CHECKING, Annotated, Any")
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
    assert told["completed"]


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
