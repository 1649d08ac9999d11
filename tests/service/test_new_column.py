"""A column is one line of a table: whoever adds it meets it in every writer.  It is put into a copy of the sources."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from browsing import used
from copied_sources import copy_sources, edit, path_of
from served import served
from service_scenes import EXAMPLES

from family import run_python
from waiting import LIMIT_SECONDS

BEFORE = '        Column("dP95/dh", "mm/unit", "significant", on=IN_DETAIL, of=lambda row: row.line.dp95_per_unit),\n'
TOY = '        Column("Toyness", "toys", "fixed", 1, of=lambda row: 1000 * row.line.variance_share),\n'
FIELD, RENAMED = "dp95_per_unit", "toy_slope"
PROGRAM = """
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


def copy_with_column(folder: Path) -> Path:
    """A copy of the sources in which the column is added, to a file of which no kernel is made."""
    source = copy_sources(folder)
    edit(source / "tailstack" / "results" / "score.py", (BEFORE, TOY + BEFORE))
    return source


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, str], float]:
    """What a copy with the column, and with the field renamed, shows of a score; the largest number in the column."""
    folder = tmp_path_factory.mktemp("copy")
    source = copy_with_column(folder)
    for each in (source / "tailstack" / "results" / "score.py", source / "tailstack" / "budget.py"):
        text = each.read_text(encoding="utf-8")
        assert FIELD in text
        each.write_text(text.replace(FIELD, RENAMED), encoding="utf-8")
    done = run_python(
        "-c",
        PROGRAM,
        str(EXAMPLES / "demo.yaml"),
        said={"PYTHONPATH": path_of(source)},
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
    with served(tmp_path, PYTHONPATH=path_of(copy_with_column(tmp_path))) as service:
        found = used(service.url, "figures", script="shown.mjs")
    for state in ("before", "after"):
        shown = found[state]
        assert "Toyness toys" in [" ".join(head.split()) for head in shown["heads"]]
        assert len(shown["rows"]) > 5
    assert found["after"]["rows"] != found["before"]["rows"]
    assert f"P95 {found['p95']} mm" in found["after"]["caption"]
    assert found["watched"]["messages"] == []  # the policy of the page lets no report bring a style along


def test_a_field_that_is_renamed_where_it_is_declared_and_computed_is_renamed_in_what_is_published(
    shown: tuple[dict[str, str], float],
) -> None:
    told, _ = shown
    for document in ("record", "schema"):
        assert RENAMED in told[document]
        assert FIELD not in told[document]
    for writer in ("details", "html"):
        assert "dp95/dh" in told[writer].lower()
