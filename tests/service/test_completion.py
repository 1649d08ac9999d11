"""Completion, tried in the shells themselves: verbs, flags, choices, designs and folders."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from postgres import required
from service_scenes import EXAMPLES

from family import run_process
from tailstack_service.cli.main import main
from tailstack_service.cli.verbs import verbs

SCRIPTS = Path(__file__).parent / "shells"
SHELLS = ("bash", "zsh", "fish")
CASES = [  # the line so far, what is among the offers, what is not
    ("tailstack sc", {"score", "schema"}, {"verify"}),
    ("tailstack ", set(verbs()), {"optimize"}),
    ("tailstack verify --tr", {"--trials"}, {"--threads"}),
    ("tailstack verify --method ra", {"radial"}, {"plain"}),
    ("tailstack jobs list --state su", {"succeeded"}, {"failed"}),
    ("tailstack study vi", {"views"}, {"coupling"}),
    ("tailstack score d", {"demo.yaml"}, {"data.csv", "draft.txt"}),
    ("tailstack optimise demo.yaml -o d", {"demo.yaml", "draft.txt"}, set()),
    ("tailstack completion ", set(SHELLS), {"tcsh"}),
    ("tailstack gate demo.yaml --format ", {"sarif", "junit", "json"}, {"demo.yaml", "draft.txt"}),
    ("tailstack report demo.yaml --format ", {"html", "pdf", "xlsx"}, {"demo.yaml", "draft.txt"}),
]


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with files to complete; the scripts are beside it."""
    room = tmp_path_factory.mktemp("completion") / "room"
    room.mkdir()
    shutil.copy(EXAMPLES / "demo.yaml", room)
    for name in ("data.csv", "draft.txt"):
        (room / name).write_text("x\n", encoding="utf-8")
    return room


@pytest.fixture
def script(room: Path, shell: str, capsys: pytest.CaptureFixture[str]) -> Path:
    """What ``tailstack completion`` prints for a shell."""
    if shutil.which(shell) is None:
        if required(shell):
            pytest.fail(f"{shell} is not installed; TAILSTACK_TESTS_REQUIRE lists it")
        pytest.skip(f"{shell} is not installed")
    assert main(["completion", shell]) == 0
    folder = room.parent / shell
    folder.mkdir(exist_ok=True)
    script = folder / "_tailstack"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    return script


def offers(shell: str, script: Path, line: str, room: Path) -> set[str]:
    command = {
        "bash": ["bash", "--norc", str(SCRIPTS / "complete.bash"), str(script), *line.split(" ")],
        "zsh": ["zsh", "-f", str(SCRIPTS / "complete.zsh"), str(script.parent), line],
        "fish": ["fish", "--no-config", "-c", f"source {script}; complete -C '{line}'"],
    }[shell]
    done = run_process(*command, cwd=room)
    return {offer.split("\t")[0] for offer in done.stdout.splitlines()}


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_offers_what_can_come_next(shell: str, script: Path, room: Path) -> None:
    for line, wanted, unwanted in CASES:
        found = offers(shell, script, line, room)
        assert wanted <= found, (line, found)
        assert not unwanted & found, (line, found)


def test_another_shell_is_2_and_the_known_ones_are_named(refused: Any) -> None:
    assert "choose from bash, zsh, fish); did you mean zsh?" in refused("completion", "zhs")
