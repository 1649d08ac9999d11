"""What a command does besides its work when it starts and when it ends; without a clock."""

from __future__ import annotations

import platform
from pathlib import Path

import pytest
from gate_scenes import FORMATS
from pipeline_scenes import environment
from service_scenes import EXAMPLES

from family import COMMAND, run_python
from tailstack_service.operations.operation import LateImport
from tailstack_service.operations.registry import OPERATIONS

PREFIX = "tailstack_service.cli."


def told(code: str) -> list[str]:
    done = run_python("-c", code, env=environment(), check=True)
    return done.stderr.splitlines()


def loaded(*arguments: str) -> set[str]:
    """The verbs whose modules a command loads."""
    code = (
        "import sys; from tailstack_service.cli.main import OWN, main\n"
        f"main({list(arguments)!r})\n"
        f"print(*(verb for verb in OWN if {PREFIX!r} + verb in sys.modules), file=sys.stderr)"
    )
    return set(told(code)[-1].split())


def test_a_command_makes_the_parser_of_its_verb_only() -> None:
    for arguments in (("gate", "--explain"), ("version",)):
        assert loaded(*arguments) == {arguments[0]}
    assert loaded("--help") > {"gate", "report", "serve"}
    assert loaded() > {"gate", "report", "serve"}
    assert loaded("gat") == set()


@pytest.mark.long("score-casadi")
@pytest.mark.parametrize(
    ("arguments", "without"),
    [
        (("version",), ("numpy", "pydantic", "yaml", "tailstack.design")),
        (  # pydantic is: the options of every operation are models, from which the flags are made (0.1 s)
            ("--help",),
            ("numpy", "numba", "scipy", "casadi", "cvxpy", "matplotlib", "fastapi", "uvicorn", "httpx", "yaml",
             "sqlalchemy"),
        ),
        (
            ("validate", str(EXAMPLES / "demo.yaml")),
            ("numba", "llvmlite", "scipy", "jinja2", "tailstack.results.score"),
        ),
        (("convert", "--help"), ("numba", "scipy", "tailstack.design.document")),
        (
            ("score", str(EXAMPLES / "demo.yaml")),
            ("casadi", "cvxpy", "matplotlib", "weasyprint", "httpx", "httpx_sse", "pydantic_settings", "scipy.stats",
             "scipy.optimize"),
        ),
        (
            ("gate", str(EXAMPLES / "demo.yaml"), "--mode=analytic",
             *(f"--format={name}=/dev/null" for name in FORMATS)),
            ("casadi", "cvxpy", "fastapi", "starlette", "jinja2", "sqlalchemy", "weasyprint", "xlsxwriter",
             "scipy.stats", "distributed", "httpx", "jsonschema", "matplotlib"),
        ),
        (
            ("sweep", str(EXAMPLES / "demo.yaml"), "--set", "views.AP.fiducial_noise_px=0.1,0.4"),
            ("casadi", "cvxpy", "matplotlib", "jinja2"),  # its document has a picture, which no text draws
        ),
    ],
    ids=lambda value: value[0],
)  # fmt: skip
def test_a_command_loads_only_what_it_needs(arguments: tuple[str, ...], without: tuple[str, ...]) -> None:
    code = (
        "import sys; from tailstack_service.cli.main import main\n"
        f"main({list(arguments)!r})\n"
        f"print(*sorted(set({without!r}) & set(sys.modules)), file=sys.stderr)"
    )
    assert told(code)[-1] == ""


def test_what_an_operation_imports_late_is_there() -> None:
    """Names in texts are seen neither by the type checker nor by the linter."""
    for operation in OPERATIONS.values():
        assert isinstance(operation.record(), type), operation.name
        document = operation.document
        assert not isinstance(document, LateImport) or callable(document.load()), operation.name


def test_nothing_is_searched_for_cycles_at_the_end() -> None:
    """Handlers run last in, first out: the one here, registered first, sees what is left to the collector."""
    code = (
        "import atexit, gc, sys; own = gc.get_freeze_count()\n"  # Python 3.12 freezes what it starts with
        "atexit.register(lambda: print(gc.get_freeze_count(), file=sys.stderr))\n"
        "from tailstack_service.cli.main import main\n"
        "main(['version']); main(['version']); before = len(gc.get_objects())\n"
        "atexit.register(lambda: print(gc.get_freeze_count() - own, len(gc.get_objects()), file=sys.stderr))"
    )
    during, after = told(code)[-2:]
    assert during.split()[0] == "0"
    assert int(after.split()[0]) > 0.9 * int(during.split()[1])


def test_a_program_that_calls_main_keeps_its_collector() -> None:
    code = (
        "import gc, sys; own = gc.get_freeze_count()\n"
        "from tailstack_service.cli.main import main\n"
        "before = gc.get_threshold(); main(['version'])\n"
        "print(gc.isenabled(), gc.get_freeze_count() - own, gc.get_threshold() == before, file=sys.stderr)"
    )
    assert told(code)[-1] == "True 0 True"


NOT_THIS_PROCESSOR = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "+fma4"}  # none made since 2017 has it


@pytest.mark.long(but=["score-another processor", "serve-no compiler"])
@pytest.mark.parametrize(
    ("given", "words"),
    [
        (NOT_THIS_PROCESSOR, "NUMBA_CPU_FEATURES=+fma4 ask for kernels with fma4, which this processor ("),
        ({"NUMBA_DISABLE_JIT": "1"}, "NUMBA_DISABLE_JIT is set, and the kernels are written for the compiler"),
    ],
    ids=["another processor", "no compiler"],
)
@pytest.mark.parametrize(
    "command",
    [("score", str(EXAMPLES / "demo.yaml")), ("gate", str(EXAMPLES / "demo.yaml")), ("worker",), ("serve", "--port=0")],
    ids=lambda command: command[0],
)
def test_settings_of_numba_that_cannot_work_are_refused_at_the_start(
    command: tuple[str, ...], given: dict[str, str], words: str, tmp_path: Path
) -> None:
    if "NUMBA_CPU_NAME" in given and platform.machine().lower() not in ("x86_64", "amd64"):
        pytest.skip("names of x86-64 processors")
    variables = environment(TAILSTACK_DATABASE=f"sqlite:///{tmp_path / 'jobs.sqlite3'}", **given)
    done = run_python(*COMMAND, *command, env=variables, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert "internal" not in done.stderr
    assert "unset" in done.stderr


@pytest.mark.long
def test_who_optimises_does_not_wait_for_the_tables_of_statistics() -> None:
    """Half a second of every computing process of a service, which loads the optimiser before its first task."""
    code = "import sys, tailstack.optimisation.course; print('scipy.stats' in sys.modules, file=sys.stderr)"
    assert told(code)[-1] == "False"
