"""The generated clients: made from the document by one command, small, whole, and used.

The Python client does what client_course.py does, typed, against a real service; the TypeScript example is compiled.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import node
import pytest
from answers import answers, committed_answers, differences, shape, shortened
from openapi_scenes import DOCUMENT, OPENAPI
from served import Served, served

from family import run_python
from plain_data import read_cases
from waiting import LIMIT_SECONDS

LARGEST_BYTES, MOST_FILES = 1_500_000, 320  # a file for each record of the contract
COURSE = Path(__file__).with_name("client_course.py")
USES = [
    entry.name
    for entry in ast.parse(COURSE.read_text(encoding="utf-8")).body
    if isinstance(entry, ast.FunctionDef) and not entry.name.startswith("_")
]
pytest.register_assert_rewrite(COURSE.stem)


def generated(folder: Path, choice: str) -> Path:
    """The folder, in which the command has made one of the clients."""
    done = run_python(OPENAPI / "generate.py", f"--{choice}", "-o", folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / choice


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the Python client."""
    return generated(tmp_path_factory.mktemp("clients"), "python")


@pytest.fixture(scope="module")
def types(tmp_path_factory: pytest.TempPathFactory, node_tools: None) -> Path:
    """The folder of the TypeScript types, with the example beside them."""
    folder = generated(tmp_path_factory.mktemp("clients"), "typescript")
    for name in ("example.ts", "tsconfig.json"):
        shutil.copy(OPENAPI / "typescript" / name, folder)
    return folder


@pytest.fixture(scope="module")
def course(package: Path) -> ModuleType:
    """client_course.py, which imports the client."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(package)
        return importlib.import_module(COURSE.stem)


@pytest.fixture(scope="module")
def client(course: ModuleType, services: Callable[..., Served]) -> Iterator[Any]:
    """Nobody is asked for a key here."""
    with course.Client(base_url=services().url, raise_on_unexpected_status=True, timeout=LIMIT_SECONDS) as client:
        yield client


# --- the Python client --------------------------------------------------------------------------------


def test_python_client_is_small_and_imports_whole(package: Path) -> None:
    files = contents(package)
    assert len(files) < MOST_FILES
    assert sum(map(len, files.values())) < LARGEST_BYTES
    modules = sorted(".".join(path.relative_to(package).with_suffix("").parts) for path in package.rglob("*.py"))
    code = "\n".join(f"import {module.removesuffix('.__init__')}" for module in modules)
    done = run_python("-W", "error", "-c", code, cwd=package)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_the_same_document_makes_the_same_bytes(package: Path, tmp_path: Path) -> None:
    """In another process, whose sets have another order."""
    again = generated(tmp_path, "python")
    assert contents(again) == contents(package)


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_every_operation_has_a_call_but_the_stream(package: Path) -> None:
    made = {path.stem for path in (package / "tailstack_client" / "api").rglob("*.py")} - {"__init__"}
    named = {operation["operationId"] for item in DOCUMENT["paths"].values() for operation in item.values()}
    assert named - made == {"get_job_events"}
    assert made <= named


@pytest.mark.parametrize("use", USES)
def test_python_client_is_used(use: str, course: ModuleType, request: pytest.FixtureRequest) -> None:
    function = getattr(course, use)
    function(**{name: request.getfixturevalue(name) for name in inspect.signature(function).parameters})


WRONG_PYTHON = {name: row for name, *row in read_cases("clients", "python")}

MYPY = """\
[mypy]
mypy_path = {package}
follow_imports = skip
disable_error_code = import-not-found, import-untyped

[mypy-tailstack_client.*]
follow_imports = silent
"""


def test_programs_with_the_python_client_are_typed(package: Path, tmp_path: Path) -> None:
    """The course has no error, and each of its copies with one thing changed has one; one run of mypy."""
    right = COURSE.read_text(encoding="utf-8")
    for number, (part, wrong) in enumerate(WRONG_PYTHON.values()):
        assert part in right
        (tmp_path / f"wrong{number}.py").write_text(right.replace(part, wrong), encoding="utf-8")
    settings = tmp_path / "mypy.ini"
    settings.write_text(MYPY.format(package=package), encoding="utf-8")
    programs = [COURSE, *sorted(tmp_path.glob("wrong*.py"))]
    command = ("-m", "mypy", "--config-file", settings, "--cache-dir", tmp_path / "cache")
    done = run_python(*command, *programs)
    found = set(re.findall(r"(\w+)\.py:\d+: error", done.stdout))
    assert found == {f"wrong{number}" for number in range(len(WRONG_PYTHON))}, done.stdout + done.stderr


# --- the TypeScript types -----------------------------------------------------------------------------


def test_typescript_example_has_the_right_types(types: Path) -> None:
    done = node.run("tsc", "--project", types)
    assert done.returncode == 0, done.stdout


WRONG_TYPESCRIPT = {name: row for name, *row in read_cases("clients", "typescript")}


@pytest.mark.long
def test_wrong_typescript_programs_are_refused(types: Path, tmp_path: Path) -> None:
    """The example with one thing changed, many times over, in one run of the compiler."""
    example = (types / "example.ts").read_text(encoding="utf-8")
    shutil.copy(types / "tailstack.d.ts", tmp_path)
    for number, (right, wrong) in enumerate(WRONG_TYPESCRIPT.values()):
        assert right in example
        (tmp_path / f"wrong{number}.ts").write_text(example.replace(right, wrong), encoding="utf-8")
    settings = json.loads((types / "tsconfig.json").read_text(encoding="utf-8"))
    settings["files"] = [f"wrong{number}.ts" for number in range(len(WRONG_TYPESCRIPT))]
    (tmp_path / "tsconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    done = node.run("tsc", "--project", tmp_path)
    assert done.returncode != 0
    found = {int(number) for number in re.findall(r"wrong(\d+)\.ts\(\d+,\d+\): error TS", done.stdout)}
    assert found == set(range(len(WRONG_TYPESCRIPT))), done.stdout


# --- the examples of answers --------------------------------------------------------------------------


@pytest.mark.long
def test_committed_examples_of_answers_have_the_form_of_the_answers(tmp_path: Path) -> None:
    """What a service answers today is what the document shows; the optimiser's path is the processor's own."""
    with served(tmp_path) as service:
        fresh = {name: shortened(answer) for name, answer in answers(service.url)}
    shown = committed_answers()
    again = "repeat: python openapi/answers.py URL"
    assert set(fresh) == set(shown), again
    for name, answer in fresh.items():
        assert shape(answer) == shape(shown[name]), f"{name}: {again}"
        if name != "create_optimisation":
            assert list(differences(answer, shown[name])) == [], f"{name}: {again}"
    best = [found["create_optimisation"]["cost_after"] for found in (fresh, shown)]
    assert best[0] == pytest.approx(best[1], rel=0.01)


def test_a_shown_answer_is_cut_where_rows_are_many_and_nowhere_else() -> None:
    """By hand: a vector and a design keep their entries, rows and long lists two."""
    design = {"fiducials": {"points": [{"name": name} for name in "ABCD"]}, "views": [{}] * 3}
    whole = {"bias_mm": [1, 2, 3], "rows": [{"at": [4, 5, 6, 7]}] * 5, "long": list(range(13)), "design": design}
    cut = {"bias_mm": [1, 2, 3], "rows": [{"at": [4, 5, 6, 7]}] * 2, "long": [0, 1], "design": design}
    assert shortened(whole) == shortened(cut) == cut


def test_an_answer_that_says_something_else_would_be_noticed() -> None:
    shown = committed_answers()["create_score"]
    fresh = json.loads(json.dumps(shown))
    fresh["targets"][0]["p95_mm"] *= 1.0001
    fresh["targets"][0]["bias_mm"][2] += 1e-12
    fresh["verdict"]["status"] = "fail"
    fresh["provenance"]["tailstack_version"] = "9"
    assert [line.split(":")[0] for line in differences(fresh, shown)] == ["/targets/0/p95_mm", "/verdict/status"]
