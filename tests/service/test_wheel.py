"""The built wheel, not the checkout: it holds everything that the commands need."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
from answers import committed_answers, text_with_answers
from service_scenes import EXAMPLES, ROOT

from family import COMMAND, run_python
from waiting import LIMIT_SECONDS


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The content of a wheel built from this checkout."""
    directory = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(directory)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=LIMIT_SECONDS)
    with zipfile.ZipFile(next(directory.glob("*.whl"))) as wheel:
        wheel.extractall(directory / "content")
    return directory / "content"


def call(unpacked: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return run_python("-P", *COMMAND, *arguments, cwd=unpacked.parent, said={"PYTHONPATH": str(unpacked)})


@pytest.fixture(scope="module")
def document(unpacked: Path) -> dict[str, Any]:
    """The document of the API as the wheel prints it."""
    return dict(json.loads(call(unpacked, "openapi").stdout))


@pytest.mark.long
def test_the_demo_design_is_shipped(unpacked: Path) -> None:
    shipped = unpacked / "tailstack_service" / "example_files" / "demo.yaml"
    assert shipped.read_bytes() == (EXAMPLES / "demo.yaml").read_bytes()
    done = call(unpacked, "validate", str(shipped))
    assert done.returncode == 0, done.stderr
    assert done.stdout.replace("\n", "").startswith(f"{shipped}: valid")  # a long path goes on in the next line


def test_the_page_of_the_api_is_shipped(unpacked: Path) -> None:
    ours = ROOT / "service" / "tailstack_service" / "docs_page"
    shipped = {path.name: path.read_bytes() for path in (unpacked / "tailstack_service" / "docs_page").iterdir()}
    assert shipped == {path.name: path.read_bytes() for path in ours.iterdir()}
    assert {"index.html", "LICENSE", "NOTICE", "swagger-ui-bundle.js"} <= set(shipped)


def test_the_manual_is_shipped_without_its_pictures_and_programs(unpacked: Path) -> None:
    shipped = unpacked / "tailstack_service" / "manual"
    pages = {path.relative_to(shipped): path.read_bytes() for path in shipped.rglob("*") if path.is_file()}
    docs = ROOT / "docs"
    assert pages == {path.relative_to(docs): path.read_bytes() for path in docs.rglob("*.md")}


@pytest.mark.long
def test_schemas_and_openapi_come_out_of_it(unpacked: Path, document: dict[str, Any]) -> None:
    assert call(unpacked, "schema", "design").returncode == 0
    assert text_with_answers(copy.deepcopy(document)) == (ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8")


def test_no_example_of_an_answer_is_shipped(unpacked: Path, document: dict[str, Any]) -> None:
    """They are for readers of the committed document: neither a file of them nor their text is in the wheel."""
    shown = set(committed_answers())
    assert "create_score" in shown
    assert not [path for path in unpacked.rglob("*") if path.stem in shown]
    assert not shown & document["components"]["examples"].keys()


def test_the_command_is_declared(unpacked: Path) -> None:
    entry = next(unpacked.glob("tailstack-*.dist-info/entry_points.txt")).read_text()
    assert "tailstack = tailstack_service.__main__:command" in entry


@pytest.mark.long
def test_the_database_is_made_from_it(unpacked: Path, tmp_path: Path) -> None:
    """The migrations are files, not imported by anything."""
    environment = {**os.environ, "PYTHONPATH": str(unpacked), "TAILSTACK_DATABASE": f"sqlite:///{tmp_path / 'jobs'}"}
    for action in ("migrate", "check"):
        done = run_python("-P", *COMMAND, "db", action, cwd=tmp_path, env=environment)
        assert done.returncode == 0, done.stderr
    assert done.stdout.endswith(": sound\n")


def test_examples_come_out_of_it(unpacked: Path) -> None:
    listed = call(unpacked, "example")
    assert "tube_carrier" in listed.stdout, listed.stderr
    assert call(unpacked, "example", "slicer_markups").returncode == 0
    shipped = unpacked / "tailstack_service" / "example_files" / "paper"
    assert {"c_arm.yaml", "tables.py", "published_tables.json"} <= {path.name for path in shipped.iterdir()}
