"""Machines that are not like ours: each command works there or names what to set, and doctor says it beforehand.

And without what Linux alone has.
"""

from __future__ import annotations

import os
import re
import signal
import stat
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from containers import USER, contain, run_contained, surroundings
from openapi_scenes import ended_job
from served import served
from service_scenes import ROOT, ask, client_of, small_design

from family import COMMAND, run_python, started
from tailstack.errors import MissingExtraError
from tailstack_service import environment
from tailstack_service.cli.doctor import CHECKS, Ailment
from tailstack_service.cli.main import main
from tailstack_service.environment import PLAIN_PROCESSES, FolderError, state_directory
from tailstack_service.operations.example import EXAMPLE_DESIGN
from tailstack_service.problems import PdfUnavailable
from tailstack_service.report import pdf
from waiting import LIMIT_SECONDS, until

DESIGN = str(ROOT / "examples" / "demo.yaml")


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

    def no_home(_: type[Path]) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", classmethod(no_home))
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


def without_fonts(folder: Path) -> str:
    """A fontconfig with a list of no folders, as in an image that has its library and no font."""
    file = folder / "fonts.conf"
    file.write_text('<?xml version="1.0"?><fontconfig></fontconfig>', encoding="utf-8")
    return str(file)


def test_without_a_font_the_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("weasyprint")
    assert re.fullmatch(r"WeasyPrint \S+, [1-9]\d* fonts?", CHECKS["pdf"]())
    monkeypatch.setenv("FONTCONFIG_FILE", without_fonts(tmp_path))
    with pytest.raises(PdfUnavailable, match=r"fontconfig finds no font here.* apt install fonts-dejavu-core"):
        CHECKS["pdf"]()


def test_a_missing_font_is_no_defect_of_the_service(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from tailstack_service.problems import problem_document

    monkeypatch.setattr(pdf, "count_fonts", lambda: 0)
    with pytest.raises(PdfUnavailable) as refusal:
        pdf.load_weasyprint()
    assert problem_document(refusal.value, instance="/v1/reports").status == 501
    monkeypatch.setattr("tailstack_service.cli.db.run", lambda _: pdf.load_weasyprint())
    assert main(["db", "check"]) == 3
    assert "tailstack db: PDF cannot be written here" in capsys.readouterr().err


@pytest.mark.long
def test_a_report_without_a_font_is_refused_and_not_killed(tmp_path: Path) -> None:
    file = tmp_path / "x.pdf"
    said = {"FONTCONFIG_FILE": without_fonts(tmp_path)}
    done = run_python(*COMMAND, "report", DESIGN, "-o", file, said=said)
    assert (done.returncode, file.exists()) == (3, False), done.stderr
    assert "apt install fonts-dejavu-core" in done.stderr


# --- no solver ----------------------------------------------------------------------------------------


def test_an_ipopt_that_cannot_be_loaded_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    casadi = pytest.importorskip("casadi")
    from tailstack.optimisation.solver import make_solver, require_ipopt

    def load(_: str) -> None:
        raise RuntimeError("Plugin 'ipopt' is not found.\n libcoinmumps.so: cannot open shared object file")

    monkeypatch.setattr(casadi, "load_nlpsol", load)
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

    assert "P95" in run("demo", "-o", str(room / "demo")).stdout
    assert "P95" in run("score", DESIGN, code=1).stdout
    run("report", DESIGN, "-o", str(room / "x.pdf"), code=1)
    assert (room / "x.pdf").read_bytes().startswith(b"%PDF")
    assert "this user has no home" in run("db", "migrate").stderr
    assert f"{room}/tailstack-{USER}/tailstack.sqlite3: sound" in run("db", "check").stdout
    assert "as this user has no home" in run("doctor").stdout.replace("\n" + " " * 21, " ")


@pytest.mark.long
def test_commands_that_can_write_nowhere(room: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return run_contained(*arguments, read_only=True)

    for arguments in (["score", DESIGN], ["gate", DESIGN, "--mode", "analytic"]):
        done = run(*arguments)
        assert done.returncode in (0, 1, 4), (arguments, done.stderr)
        assert "defect" not in done.stderr
    for arguments in (["demo"], ["report", DESIGN], ["db", "migrate"], ["serve"]):
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
        assert process.stdout is not None
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
        assert answer is not None
        assert answer.status_code == 200, answer.text
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LIMIT_SECONDS)
    assert "Traceback" not in (room / "log").read_text()


# --- a system without what Linux has --------------------------------------------------------------


def children_of(process: psutil.Process) -> list[psutil.Process]:
    """All below it; none is a process that others are forked from."""
    found = process.children(recursive=True)
    assert not any("tailstack_service.processes.nursery" in each.cmdline() for each in found if each.is_running())
    return [each for each in found if "tailstack_service.processes.child" in each.cmdline()]


def lives(process: psutil.Process) -> bool:
    with suppress(psutil.NoSuchProcess):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False


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
        computing = children_of(process)
        assert computing
        process.kill()
        until(lambda: not any(map(lives, computing)), lambda: computing)
