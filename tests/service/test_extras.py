"""An installation without one of its parts: what still works, and what a person is told to type for the rest.

Expected: pyproject.toml, the lock file of the core and the import statements themselves, read here on their own."""

from __future__ import annotations

import ast
import json
import os
import re
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib.metadata import distribution, packages_distributions
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import httpx
import psutil
import pytest
from containers import USER, contain, run_contained, surroundings
from openapi_scenes import ended_job
from packaging.requirements import Requirement
from served import served
from service_scenes import EXAMPLES, ROOT, ask, check_problem, client_of, small_design
from test_compute_pool import gone

from family import COMMAND, SOURCES, run_process, run_python, started
from tailstack.errors import MissingExtraError
from tailstack.extras import MODULES_OF, install_command
from tailstack.version import __version__
from tailstack_service import environment
from tailstack_service.cli.doctor import CHECKS, Ailment
from tailstack_service.cli.main import main
from tailstack_service.environment import PLAIN_PROCESSES, FolderError, state_directory
from tailstack_service.operations.example import EXAMPLE_DESIGN
from tailstack_service.problems import PdfUnavailable
from tailstack_service.report import pdf
from waiting import LIMIT_SECONDS, until

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LARGEST_CORE_BYTES = 450e6
DEMO = str(EXAMPLES / "demo.yaml")
EVERYTHING = tuple(module for modules in MODULES_OF.values() for module in modules)


def plain(requirement: str) -> str:
    """The name of a requirement as packages spell it in their metadata."""
    return re.split(r"[\[<>=;! ]", requirement)[0].lower().replace("_", "-")


packages = cache(packages_distributions)  # a second of reading what is installed


def distributions_of(module: str) -> set[str]:
    return {plain(name) for name in packages()[module]}


def command(extras: str) -> str:
    """What a checkout says is to be typed, for there is no index that has it."""
    return f"pip install -e '{ROOT}[{extras}]'"


def tailstack(*arguments: str, without: tuple[str, ...], folder: Path) -> subprocess.CompletedProcess[str]:
    """A command in a Python that does not have these modules."""
    code = f"import sys; sys.modules.update(dict.fromkeys({without!r})); sys.argv[0] = 'tailstack'\n"
    code += "from tailstack_service.cli.main import command; command()"
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("TAILSTACK_", "OMP_"))}
    variables |= {"PYTHONPATH": SOURCES, "TAILSTACK_DATABASE": f"sqlite:///{folder / 'jobs.sqlite3'}"}
    return run_python("-c", code, *arguments, env=variables, cwd=folder)


@pytest.mark.long(
    "report-study linearity demo.yaml --figure reach.svg",
    "postgres-db check --database jobs",
    "dask-worker --engine dask",
)
@pytest.mark.parametrize(
    ("extra", "arguments"),
    [
        ("optimise", ("optimise", DEMO)),
        ("serve", ("serve", "--port", "0")),
        ("serve", ("worker",)),
        ("serve", ("jobs", "list")),
        ("serve", ("db", "check")),
        ("serve", ("keys", "list")),
        ("serve", ("openapi",)),
        ("report", ("report", DEMO)),
        ("report", ("study", "linearity", DEMO, "--figure", "reach.svg")),
        ("pdf", ("report", DEMO, "--format", "pdf")),
        ("postgres", ("db", "check", "--database", "postgresql://somebody@127.0.0.1:1/jobs")),
        ("dask", ("worker", "--engine", "dask")),
        ("dicom", ("convert", "shot.dcm", "shot.dcm", "-o", "design.yaml")),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(Path(word).name for word in value),
)
def test_a_verb_whose_extra_is_missing_names_the_command_that_installs_it(
    extra: str, arguments: tuple[str, ...], tmp_path: Path
) -> None:
    if extra in ("postgres", "dask"):
        assert tailstack("db", "migrate", without=(), folder=tmp_path).returncode == 0
    (tmp_path / "shot.dcm").write_bytes(b"")
    done = tailstack(*arguments, without=MODULES_OF[extra], folder=tmp_path)
    assert command(extra) in done.stderr
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert "internal" not in done.stderr
    assert "Traceback" not in done.stderr


def test_what_is_missing_is_told_at_once_to_people_programs_and_python(tmp_path: Path) -> None:
    done = tailstack("demo", without=EVERYTHING, folder=tmp_path)
    assert command("optimise,serve,report") in done.stderr
    assert done.returncode == 2
    assert not list(tmp_path.iterdir())  # refused before anything is written
    done = tailstack("optimise", DEMO, "--json", without=MODULES_OF["optimise"], folder=tmp_path)
    problem = json.loads(done.stderr)
    assert problem["type"] == "/v1/problems/missing-extra"
    assert problem["errors"][0]["hint"] == command("optimise")
    code = f"import sys; sys.modules.update(dict.fromkeys({MODULES_OF['optimise']!r}))\nfrom tailstack import optimise"
    done = run_python("-c", code)
    assert "MissingExtraError" in done.stderr
    assert command("optimise") in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    "commands",
    [
        (("validate", DEMO), ("score", DEMO, "--json"), ("convert", DEMO, "-o", "demo.json", "--force"), ("--help",)),
        pytest.param(
            (
                ("verify", DEMO, "--trials", "2000", "--json"),
                ("gate", DEMO, "--mode", "auto", "--format", "json"),
                ("sweep", DEMO, "--set", "views.0.fiducial_noise_px=0.1:0.5:3", "--json"),
                ("report", DEMO, "--format", "json", "--parts", "score"),
                ("schema", "score"),
            ),
            marks=pytest.mark.long,
        ),
    ],
    ids=lambda commands: " ".join(words[0] for words in commands),
)
def test_the_core_alone_answers_as_the_whole_installation_does(
    commands: tuple[tuple[str, ...], ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    call: Callable[..., tuple[int, str, str]],
) -> None:
    """The whole is in this process."""
    monkeypatch.chdir(tmp_path)
    code = f"""
import contextlib, io, json, sys
sys.modules.update(dict.fromkeys({EVERYTHING!r}))
from tailstack_service.cli.main import main
said = []
for words in {commands!r}:
    output = io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True)
    with contextlib.redirect_stdout(output):
        code = main(words)
    said.append([code, output.buffer.getvalue().decode()])
print(json.dumps(said))
"""
    done = run_python("-c", code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = [(code, text) for code, text in json.loads(done.stdout)]
    assert {code for code, _ in found} <= {0, 1}, ([code for code, _ in found], done.stderr)
    assert found == [call(*words)[:2] for words in commands]


@pytest.mark.long
def test_doctor_lists_what_is_left_out(tmp_path: Path) -> None:
    done = tailstack("doctor", without=MODULES_OF["serve"], folder=tmp_path)
    assert "not installed: serve; for all of them:" in " ".join(done.stdout.split())  # lines are wrapped
    assert command("serve") in [line.strip() for line in done.stdout.splitlines()]  # ... but those that are copied
    assert "OMP_NUM_THREADS 1" in " ".join(done.stdout.split())  # a command's, unless its user says otherwise
    assert "FAIL" not in done.stdout
    assert done.returncode == 0


@pytest.mark.long
def test_a_service_without_the_optimiser_says_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        f"import sys; sys.modules.update(dict.fromkeys({(*MODULES_OF['optimise'], *MODULES_OF['report'])!r}))\n"
    )
    with served(tmp_path, PYTHONPATH=f"{tmp_path}{os.pathsep}{SOURCES}", TAILSTACK_MAX_WAIT_SECONDS="600") as service:
        design = {"Content-Type": "application/yaml"}, (EXAMPLES / "demo.yaml").read_bytes()
        with client_of(service.url, headers=design[0]) as client:
            assert client.post("/v1/scores", content=design[1]).status_code == 200
            refused = client.post("/v1/optimisations", content=design[1], headers={"Prefer": "wait=600"})
            assert check_problem(refused, 501, "missing-extra")["errors"][0]["hint"] == command("optimise")
            done = client.post("/v1/verifications?trials=1000", content=design[1], headers={"Prefer": "wait=600"})
            assert done.status_code in (200, 303)
            result = client.get("/v1/jobs?limit=1").json()["jobs"][0]["links"]["result"]
            page = client.get(f"{result}/report?format=html")
            assert command("report") in check_problem(page, 501, "missing-extra")["errors"][0]["hint"]
            assert client.get("/v1/problems/missing-extra").status_code == 200


# --- where the command takes it from ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("noted", "expected"),
    [
        (None, f"pip install 'tailstack[pdf,optimise]=={__version__}'"),
        (
            {"url": "file:///home/me/my%20clone", "dir_info": {}},
            "pip install 'tailstack[pdf,optimise] @ file:///home/me/my%20clone'",
        ),
        (
            {"url": "file:///tmp/tailstack-0.1.0-py3-none-any.whl", "archive_info": {"hash": "sha256=00"}},
            "pip install 'tailstack[pdf,optimise] @ file:///tmp/tailstack-0.1.0-py3-none-any.whl'",
        ),
        (
            {"url": "https://git.example.com/g/tailstack", "vcs_info": {"vcs": "git", "commit_id": "e3342c7"}},
            "pip install 'tailstack[pdf,optimise] @ git+https://git.example.com/g/tailstack@e3342c7'",
        ),
    ],
    ids=["index", "folder", "wheel", "repository"],
)
def test_an_extra_comes_from_where_the_package_came_from(
    noted: dict[str, object] | None, expected: str, tmp_path: Path
) -> None:
    """An installed copy of the package, with what pip notes of its origin (PEP 610)."""
    shutil.copytree(ROOT / "solver" / "tailstack", tmp_path / "tailstack", ignore=shutil.ignore_patterns("__pycache__"))
    metadata = tmp_path / f"tailstack-{__version__}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: tailstack\nVersion: {__version__}\n")
    if noted is not None:
        (metadata / "direct_url.json").write_text(json.dumps(noted))
    code = "from tailstack.extras import install_command as f; print(f('pdf', 'optimise'))"
    done = run_python("-c", code, said={"PYTHONPATH": str(tmp_path)}, cwd=tmp_path, check=True)
    assert done.stdout.strip() == expected
    Requirement(shlex.split(expected)[2])  # is one that pip reads


def test_the_command_of_a_checkout_is_one_that_pip_carries_out(tmp_path: Path) -> None:
    """Without a network, and without changing this environment."""
    words = shlex.split(install_command("optimise"))
    options = ("--dry-run", "--no-deps", "--no-index", "--no-build-isolation", "--no-cache-dir")
    said = {"PIP_CONFIG_FILE": os.devnull, "PYTHONPATH": ""}
    done = run_python("-m", *words[:2], *options, *words[2:], said=said, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"tailstack-{__version__}" in done.stdout


def test_nothing_that_ships_installs_tailstack_by_name() -> None:
    """There is no such package on an index: its name may be anybody's. A page that names an index says so itself."""
    listed = run_process("git", "ls-files", cwd=ROOT).stdout.split()
    files = [name for name in listed if not name.endswith(".lock") and name.split("/")[0] not in ("tests", "openapi")]
    if not files:
        pytest.skip("NOT TESTED: this is no git checkout")
    found = [
        f"{name}:{number}: {line.strip()[:100]}"
        for name in files
        if name not in ("CHANGELOG.md", "solver/tailstack/extras.py")
        and Path(name).suffix in (".md", ".yml", ".yaml", ".py", ".ipynb", ".tsx", ".ts", ".html", "")
        for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1)
        if re.search(r"pip install (-\S+ )*['\"]?tailstack(?!-)", line)
    ]
    assert found == []


# --- what belongs to which part -----------------------------------------------------------------------------


def third_party_imports() -> set[str]:
    """Top-level names of every import statement of the two packages, but for the standard library's and our own."""
    names = set()
    for file in [*(ROOT / "solver" / "tailstack").rglob("*.py"), *(ROOT / "service").rglob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add((node.module or "").partition(".")[0])
    return names - set(sys.stdlib_module_names) - {"tailstack", "tailstack_service"}


def locked_core() -> set[str]:
    lock = (ROOT / "requirements-core.lock").read_text(encoding="utf-8")
    return {plain(line) for line in re.findall(r"^[a-z].*==", lock, re.MULTILINE)}


@pytest.mark.long
def test_every_package_that_is_imported_belongs_to_the_core_or_to_an_extra() -> None:
    core = locked_core()
    strange = {name for name in third_party_imports() if name not in EVERYTHING and not distributions_of(name) & core}
    assert not strange


def test_the_extras_of_pyproject_bring_what_is_imported() -> None:
    extras = PROJECT["optional-dependencies"]
    assert set(extras) == {*MODULES_OF, "all"}
    for extra, modules in MODULES_OF.items():
        brought = {plain(requirement) for requirement in extras[extra]}
        own = {name for module in modules for name in distributions_of(module)}
        assert own - COME_ALONG <= brought, extra
        assert brought - {"tailstack", "uvloop"} <= own, extra  # uvicorn takes uvloop by itself


COME_ALONG = {"starlette", "h11", "cycler", "dask"}  # with fastapi, uvicorn, matplotlib and distributed


def test_the_lock_of_the_core_holds_what_the_core_needs_and_is_part_of_the_others() -> None:
    core = (ROOT / "requirements-core.lock").read_text(encoding="utf-8")
    assert {plain(requirement) for requirement in PROJECT["dependencies"]} <= locked_core()
    whole = (ROOT / "requirements-run.lock").read_text(encoding="utf-8")
    pinned = re.compile(r"^[a-z].*==[^ ]+", re.MULTILINE)
    assert set(pinned.findall(core)) <= set(pinned.findall(whole))


def test_all_is_every_extra() -> None:
    extras = PROJECT["optional-dependencies"]
    reached, waiting = set(), ["all"]
    while waiting:
        extra = waiting.pop()
        reached.add(extra)
        for requirement in extras[extra]:
            if inside := re.fullmatch(r"tailstack\[(.*)\]", requirement):
                waiting += inside[1].split(",")
    assert reached == set(extras)


def brought_by(requirements: list[str]) -> set[str]:
    """The packages that these requirements install here, and what those need in turn."""
    found: set[str] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        wanted = waiting.pop()
        if plain(wanted.name) in found or (wanted.marker and not wanted.marker.evaluate({"extra": ""})):
            continue
        found.add(plain(wanted.name))
        waiting += [Requirement(text) for text in distribution(wanted.name).requires or ()]
    return found


def test_the_core_is_small() -> None:
    """Bytes on disk as the installed packages list them, bytecode included, and tailstack's own sources twice."""
    files = [file.locate() for name in brought_by(PROJECT["dependencies"]) for file in distribution(name).files or ()]
    sources = [*(ROOT / "solver").rglob("*.py"), *(ROOT / "service").rglob("*.py")]
    size = sum(Path(str(file)).stat().st_size for file in (*files, *sources, *sources) if Path(str(file)).is_file())
    assert size < LARGEST_CORE_BYTES


# --- machines that are not like ours --------------------------------------------------------------


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """No folder for temporary files, as Python sees it."""
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: ["/nonexistent"])


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """Neither HOME nor an entry among the users; gives the folder for temporary files."""
    for variable in ("HOME", "XDG_STATE_HOME", "TAILSTACK_DATABASE"):
        monkeypatch.delenv(variable, raising=False)

    monkeypatch.setattr(Path, "home", Mock(side_effect=RuntimeError("Could not determine home directory.")))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    environment.lent_directory.cache_clear()
    yield tmp_path
    environment.lent_directory.cache_clear()


# --- no home ------------------------------------------------------------------------------------------


def test_without_a_home_things_are_kept_among_temporary_files_and_that_is_said(
    homeless: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    assert main(["db", "migrate"]) == 0
    (own,) = (entry for entry in homeless.iterdir() if entry.name.startswith("tailstack-"))
    assert (own / "tailstack.sqlite3").exists()
    assert stat.S_IMODE(own.stat().st_mode) == 0o700
    assert "TAILSTACK_DATABASE or XDG_STATE_HOME names one that stays" in caplog.text
    assert main(["db", "check"]) == 0
    assert f"{own}/tailstack.sqlite3: sound" in capsys.readouterr().out
    said = CHECKS["folders"]()
    assert f"jobs and results in {own}, as this user has no home: TAILSTACK_DATABASE" in said


def test_a_folder_that_others_may_write_into_does_not_stand_in(homeless: Path) -> None:
    own = homeless / f"tailstack-{os.getuid()}"
    (homeless / "others").mkdir()
    for make in (lambda: own.symlink_to("others"), own.touch, lambda: (own.mkdir(), own.chmod(0o777))):
        make()
        with pytest.raises(FolderError, match="TAILSTACK_DATABASE or XDG_STATE_HOME names one that stays"):
            state_directory()
        (own.rmdir if own.is_dir() and not own.is_symlink() else own.unlink)()
    assert state_directory() == own


def test_a_home_that_is_the_root_of_a_container_is_none(homeless: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Docker sets HOME=/ for a user without an entry."""
    monkeypatch.setattr(Path, "home", classmethod(lambda _: Path("/nonexistent")))
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert state_directory() == homeless / f"tailstack-{os.getuid()}"
    monkeypatch.setenv("XDG_STATE_HOME", "/state")
    assert state_directory() == Path("/state/tailstack")


# --- no folder for temporary files --------------------------------------------------------------------


def test_without_a_folder_for_temporary_files_the_variable_is_named(
    nowhere: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for call in (environment.temporary_directory, pdf.load_weasyprint, CHECKS["folders"]):
        with pytest.raises(FolderError, match="set TMPDIR to a folder that can be written"):
            call()
    monkeypatch.setattr("tailstack_service.cli.db.run", lambda _: tempfile.mkdtemp())
    assert main(["db", "check"]) == 3
    said = capsys.readouterr().err
    assert "no temporary file can be written" in said
    assert "hint: set TMPDIR to a folder that can be written" in said


def test_without_home_and_temporary_files_both_are_named(homeless: Path, nowhere: None) -> None:
    with pytest.raises(FolderError, match="set TMPDIR"):
        state_directory()


# --- no font ------------------------------------------------------------------------------------------


def test_without_a_font_the_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fontconfig with a list of no folders, as in an image that has its library and no font."""
    pytest.importorskip("weasyprint")
    assert re.fullmatch(r"WeasyPrint \S+, [1-9]\d* fonts?", CHECKS["pdf"]())
    (tmp_path / "fonts.conf").write_text('<?xml version="1.0"?><fontconfig></fontconfig>', encoding="utf-8")
    monkeypatch.setenv("FONTCONFIG_FILE", str(tmp_path / "fonts.conf"))
    words = r"fontconfig finds no font here.* apt install fonts-dejavu-core"
    with pytest.raises(PdfUnavailable, match=words) as refusal:
        CHECKS["pdf"]()
    assert refusal.value.exit_code == 3


# --- no solver ----------------------------------------------------------------------------------------


def test_an_ipopt_that_cannot_be_loaded_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    casadi = pytest.importorskip("casadi")
    from tailstack.optimisation.solver import make_solver, require_ipopt

    said = "Plugin 'ipopt' is not found.\n libcoinmumps.so: cannot open shared object file"
    monkeypatch.setattr(casadi, "load_nlpsol", Mock(side_effect=RuntimeError(said)))
    require_ipopt.cache_clear()
    try:
        with pytest.raises(MissingExtraError, match=r"cannot load here: Plugin 'ipopt'.*libcoinmumps.so") as refusal:
            make_solver("explore", {}, {})
        assert refusal.value.problems[0].code == "missing-solver"
        assert "--force-reinstall" in refusal.value.problems[0].hint
        with pytest.raises(Ailment, match="needs IPOPT"):
            CHECKS["solver"]()
    finally:
        require_ipopt.cache_clear()
    monkeypatch.undo()
    assert "loads IPOPT" in CHECKS["solver"]()
    sources = {path.name: path.read_text() for path in (ROOT / "solver" / "tailstack").rglob("*.py")}
    assert [name for name, text in sources.items() if "nlpsol(" in text] == ["solver.py"], "all go through it"


# --- python -OO ---------------------------------------------------------------------------------------


def test_an_interpreter_that_drops_texts_is_refused() -> None:
    done = run_python("-OO", "-m", "tailstack_service", "version")
    assert (done.returncode, done.stdout) == (3, "")
    assert "-OO (PYTHONOPTIMIZE=2) leaves out the texts" in done.stderr


# --- all of it, as in a container ---------------------------------------------------------------------


@pytest.fixture
def room() -> Iterator[Path]:
    """A folder that everybody may write into; those of pytest are for one user."""
    with tempfile.TemporaryDirectory(prefix="room-") as folder:
        Path(folder).chmod(0o1777)
        yield Path(folder)


@pytest.mark.long
def test_commands_of_a_user_without_name_and_home(room: Path) -> None:
    def run(*arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        done = run_contained(*arguments, TMPDIR=str(room))
        assert done.returncode == code, (arguments, done.stderr)
        return done

    assert "P95" in run("score", DEMO, code=1).stdout
    run("report", DEMO, "--parts", "score", "--summary", "-o", str(room / "x.pdf"), code=1)
    assert (room / "x.pdf").read_bytes().startswith(b"%PDF")
    assert "this user has no home" in run("db", "migrate").stderr
    assert f"{room}/tailstack-{USER}/tailstack.sqlite3: sound" in run("db", "check").stdout
    assert "as this user has no home" in run("doctor").stdout.replace("\n" + " " * 21, " ")


@pytest.mark.long
def test_commands_that_can_write_nowhere(room: Path) -> None:
    run = partial(run_contained, read_only=True)
    for arguments in (["score", DEMO], ["gate", DEMO, "--mode", "analytic"]):
        done = run(*arguments)
        assert done.returncode in (0, 1, 4), (arguments, done.stderr)
        assert "defect" not in done.stderr
    for arguments in (["demo"], ["report", DEMO], ["db", "migrate"], ["serve"]):
        done = run(*arguments)
        assert done.returncode in (2, 3), (arguments, done.stderr)
        said = "-o names another place" if arguments[0] in ("demo", "report") else "TMPDIR|TAILSTACK_DATABASE"
        assert re.search(said, done.stderr), (arguments, done.stderr)
        assert "defect" not in done.stderr
    done = run("doctor")
    assert done.returncode == 3
    assert "set TMPDIR" in done.stdout.replace("\n" + " " * 21, " ")


@pytest.mark.long
def test_a_service_of_a_user_without_name_and_home(room: Path) -> None:
    command = contain(*COMMAND, "serve", "--port", "0")
    changes = {"TMPDIR": str(room), "TAILSTACK_WORKER_PROCESSES": "1", "TAILSTACK_SHORT_WORKERS": "1"}
    with (
        (room / "log").open("w") as log,
        started(*command, env=surroundings(**changes), cwd="/", stderr=log) as process,
    ):
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found is not None, (room / "log").read_text()

        def answer_to(method: str, path: str, **more: Any) -> httpx.Response | None:
            assert process.poll() is None, (room / "log").read_text()
            try:
                return ask(method, found.group() + path, **more)
            except httpx.TransportError:
                return None

        until(lambda: (answer := answer_to("GET", "/health/ready")) is not None and answer.status_code == 200)
        answer = answer_to("POST", "/v1/scores", json={"design": small_design()})
        assert answer.status_code == 200, answer.text
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LIMIT_SECONDS)
    assert "Traceback" not in (room / "log").read_text()


# --- a system without what Linux has --------------------------------------------------------------


def test_without_what_linux_has_a_service_answers_computes_and_leaves_nothing(tmp_path: Path) -> None:
    with served(tmp_path, **{PLAIN_PROCESSES: "1"}) as service:
        process = psutil.Process(service.pid)
        with client_of(service.url) as client:
            score = client.post("/v1/scores", json={"design": EXAMPLE_DESIGN})
            assert score.status_code == 200, score.text
            body = {"design": EXAMPLE_DESIGN, "trials": 2_000, "seed": 1}
            job = client.post("/v1/verifications", json=body)
            assert job.status_code == 202, job.text
            assert ended_job(client, f"/v1/jobs/{job.json()['id']}")["state"] == "succeeded"
        below = process.children(recursive=True)  # none of which is a process that others are forked from
        assert not any("tailstack_service.processes.nursery" in each.cmdline() for each in below if each.is_running())
        computing = [each for each in below if "tailstack_service.processes.child" in each.cmdline()]
        assert computing
        process.kill()
        until(lambda: all(gone(each.pid) for each in computing), lambda: computing)
