"""What a person reads first has an engineer's words; the method's own stand behind --details, and each says where.

Run as a user would, in process, over every example and every verb that prints results.
"""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from service_scenes import EXAMPLES, ROOT

from family import TAILSTACK, started
from plain_data import read_cases
from tailstack.results.tables import Table
from tailstack_service.cli.main import main
from tailstack_service.cli.words import FIRST, read_glossary
from tailstack_service.operations.rendering import document_of
from tailstack_service.rendering.document import Bullets, Document, Figure, Paragraph
from waiting import LIMIT_SECONDS

# What must not be met without --details, and where it went.
BANNED = dict(read_cases("words", "banned"))
DESIGNS = sorted(EXAMPLES.glob("*.yaml"))
BENCHES = sorted((EXAMPLES / "measurements").glob("bench_*.csv"))
DEMO = str(EXAMPLES / "demo.yaml")
HALF_WIDTH = "interfaces.structure_connector.tolerances.rx.half_width_deg=0.05,0.2"


def met_in(text: str, names: tuple[str, ...] = ()) -> list[str]:
    """Banned words of a text, whatever a design's author called it left out."""
    for name in names:
        text = text.replace(name, "")
    plain = " ".join(re.sub(r"\[[a-z-]+\]", "", text).split()).lower()  # a rule's id is to be typed, not read
    return [f"{found[0]!r}: {where}" for word, where in BANNED.items() if (found := re.search(word, plain))]


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    """The text of a command, which must fit 80 columns."""
    monkeypatch.delenv("COLUMNS", raising=False)

    def run(*arguments: str) -> str:
        assert main(arguments) in (0, 1, 4)
        text = capsys.readouterr().out.partition("\nwhat to change in ")[0]  # below it: YAML and a command, to copy
        assert max(map(len, text.splitlines())) <= 80
        return text

    return run


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_a_score_a_check_and_a_validation_are_plain(printed: Any, path: Path) -> None:
    for arguments in (("score", str(path)), ("verify", str(path), "--trials", "20000"), ("validate", str(path))):
        assert met_in(printed(*arguments)) == [], arguments


def test_a_sweep_and_a_gate_are_plain(printed: Any) -> None:
    assert met_in(printed("sweep", DEMO, "--set", HALF_WIDTH)) == []
    assert met_in(printed("sweep", DEMO, "--set", HALF_WIDTH, "--check", "verification", "--trials", "8192")) == []
    files = [str(path) for path in DESIGNS if path.stem != "small_cluster_far_target"]
    assert met_in(printed("gate", *files, "--mode", "analytic")) == []


@pytest.mark.long
def test_studies_are_plain(printed: Any) -> None:
    assert met_in(printed("study", "coupling", DEMO, "--trials", "16384")) == []
    grid = ("--noise", "0.3,3", "--rotation", "0,1", "--count", "12", "--trials", "8192")
    assert met_in(printed("study", "linearity", DEMO, *grid)) == []
    for bench in BENCHES:
        assert met_in(printed("study", "compare", DEMO, "--measurements", str(bench))) == []


@pytest.mark.long("optimise -Residual of the optimality conditions Lower bound: ")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("score", DEMO, "--second-order"),
            ("first order", "linearisation: good to 1 %. nu = ", "(Eq 16)", "dP95/dh", "sha256"),
        ),
        (("verify", DEMO, "--trials", "20000"), ("eight lanes", "redone by SVD", "estimate /", "normalised")),
        (
            ("optimise", DEMO, "--starts", "1"),
            ("Residual of the optimality conditions", "Lower bound: ", "closed form", "tightening"),
        ),
        (("sweep", DEMO, "--set", HALF_WIDTH), ("first order", "|bias|")),
        (("study", "coupling", DEMO, "--trials", "16384"), ("sectioning", "noise gain", "nu = ")),
    ],
    ids=lambda value: " ".join(value[:2]).split("/")[0] if isinstance(value, tuple) else None,
)  # fmt: skip
def test_details_say_how_it_was_computed(printed: Any, arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    text = " ".join(printed(*arguments, "--details").split())
    assert [word for word in words if word not in text] == []


def test_help_is_plain(capsys: pytest.CaptureFixture[str]) -> None:
    pages = [["--help"], *([verb, "--help"] for verb in ("score", "verify", "optimise", "sweep", "gate", "validate"))]
    pages += [["study", name, "--help"] for name in ("linearity", "coupling", "compare")]
    for page in pages:
        assert main(page) == 0
        assert met_in(capsys.readouterr().out, ("--covariances",)) == [], page  # which is to be typed


# --- the report -------------------------------------------------------------------------------------------


def strings_of(document: Document) -> Iterator[str]:
    """What the project lead and the designer read, without the rows of tables and the pictures themselves."""
    yield from (document.kind, document.sentence, *document.matters)
    yield from (words for number in document.numbers for words in (number.label, number.detail))
    yield from (figure.caption for figure in document.figures)
    for section in document.sections:
        if section.reader == "auditor":
            continue
        yield section.title
        for block in section.blocks:
            if isinstance(block, Paragraph):
                yield block.text
            elif isinstance(block, Bullets):
                yield from block.items
            elif isinstance(block, Figure | Table):
                yield block.caption


@pytest.mark.long("score,verification,optimisation")
@pytest.mark.parametrize("parts", ["score", "score,verification,optimisation"])
def test_what_a_report_says_first_is_plain(tmp_path: Path, parts: str) -> None:
    arguments = ["report", DEMO, "--format", "json", "-o", str(tmp_path / "out"), "--parts", parts, "--starts", "1"]
    assert main([*arguments, "--trials", "20000"] if "," in parts else arguments[:-2]) in (0, 1, 4)
    (file,) = tmp_path.rglob("*.json")
    document = document_of("report", file.read_bytes())
    assert met_in("\n".join(strings_of(document))) == []


# --- pages ------------------------------------------------------------------------------------------------


def run_in_terminal(width: int, *arguments: str) -> str:
    """What a command writes on a terminal of so many columns."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, width, 0, 0))
    told = {key: value for key, value in os.environ.items() if key != "COLUMNS"} | {"NO_COLOR": "1"}
    command = started(*TAILSTACK, *arguments, stdout=slave, stderr=subprocess.DEVNULL, cwd=ROOT, env=told)
    said = b""
    with os.fdopen(master, "rb", buffering=0) as terminal, command as process:
        os.close(slave)
        with suppress(OSError):  # so a terminal ends that nobody writes to any more
            while piece := terminal.read(65536):
                said += piece
        process.wait(LIMIT_SECONDS)
    return said.decode().replace("\r\n", "\n").replace("\x1b[0m", "")  # which numba's colours leave at exit


@pytest.mark.long
def test_tables_are_as_wide_as_the_terminal(printed: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    narrow, wide = (run_in_terminal(width, "score", DEMO) for width in (60, 160))
    assert max(map(len, narrow.splitlines())) <= 60
    assert "connector_flange: connector on flange, spigot and four bolts " in wide
    assert 80 < max(map(len, wide.splitlines())) <= 160
    for name in ("spigot", "structure_connector", "manufacturing"):  # nothing is cut
        assert name in narrow.replace("\n", "").replace(" ", "")
    piped = printed("score", DEMO)
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["score", DEMO]) == 1
    assert piped != narrow  # a pipe has 80 columns, whatever terminal the other end is


def test_columns_says_how_wide_a_pipe_is(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    texts = {}
    for width in ("60", "160", "0", "x", ""):
        monkeypatch.setenv("COLUMNS", width)
        main(["score", DEMO])
        texts[width] = capsys.readouterr().out
    assert max(map(len, texts["60"].splitlines())) <= 60
    assert max(map(len, texts["160"].splitlines())) > 80
    assert texts["0"] == texts["x"] == texts[""]


# --- words ------------------------------------------------------------------------------------------------


def test_words_explains_a_dozen_first_and_any_other(printed: Any) -> None:
    first = printed("words")
    for term in ("P95", "TCP", "connector", "flange", "unit", "shot", "pooled", "fiducial", "bias", "half-width",
                 "budget", "verdict", "estimate"):  # fmt: skip
        assert len(re.findall(rf"^{term}: ", first, re.MULTILINE)) == 1, term
    assert printed("words", "tcp", "CVaR").startswith("TCP: the tool centre point")
    everything = printed("words", "--all")
    assert [len(re.findall(rf"^{re.escape(word.term)}: ", everything, re.MULTILINE)) for word in read_glossary()] == [
        1
    ] * len(read_glossary())


def test_a_misspelt_word_is_answered_with_the_nearest(refused: Any) -> None:
    assert "did you mean P95?" in refused("words", "P59")


def test_the_first_words_need_none_of_the_method(printed: Any) -> None:
    assert [word for word in met_in(printed("words")) if "first order" not in word] == []
    assert 10 <= sum(word.section == FIRST for word in read_glossary()) <= 15
