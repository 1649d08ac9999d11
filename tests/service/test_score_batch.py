"""``tailstack score DESIGN --batch TABLE``: every format there and back, refusals with their line, flat memory."""

from __future__ import annotations

import io
import random
import sys
from pathlib import Path
from typing import Any

import pytest
from door_pages import run_page
from table_scenes import read_rows, write_table

from family import run_process
from plain_data import problems_of, read_cases
from tailstack import load_design, score
from tailstack.design import design_to_yaml
from tailstack_service.cli.main import main
from tailstack_service.console.progress import Progress
from tailstack_service.problems import RequestError
from tailstack_service.tables import ENDINGS, read_table

DEMO = str(Path(__file__).parents[2] / "examples" / "demo.yaml")
AP, BEAD = "views.AP.fiducial_noise_px", "/fiducials/points/2/position_mm/1"
ROWS: list[tuple[str, float, float]] = [("a", 0.3, -30.0), ("b", 0.2, -31.5), ("c", -1.0, -30.0)]
ADDED = ["p95_mm:tip", "mean_norm_mm:tip", "bias_norm_mm:tip", "within_limits", "reason"]


def write(path: Path) -> None:
    """The table in the format of the path's ending."""
    path.write_bytes(write_table(ENDINGS[path.suffix], ["variant", AP, BEAD], ROWS))


@pytest.mark.parametrize("form", [".csv", ".ndjson", ".arrow", ".parquet"])
def test_a_table_comes_back_in_its_format_with_the_scores_of_its_rows(form: str, tmp_path: Path) -> None:
    """independent: other readers and writers, and the score of each row's own design."""
    there, back = tmp_path / f"table{form}", tmp_path / f"scores{form}"
    write(there)
    assert main(["score", DEMO, "--batch", str(there), "-o", str(back)]) == 3
    found = read_rows(ENDINGS[form], back.read_bytes())
    assert list(found[0]) == ["variant", AP, BEAD, *ADDED]
    for row, (variant, noise, place) in zip(found, ROWS, strict=True):
        assert (row["variant"], row[AP], row[BEAD]) == (variant, noise, place)
        if noise < 0:
            assert "at least 0" in row["reason"]
            assert row["p95_mm:tip"] in (None, "")
            continue
        expected = score(load_design(DEMO).with_value(AP, noise).with_value(BEAD, place)).targets[0]
        assert row["p95_mm:tip"] == pytest.approx(expected.p95_mm, rel=1e-9)
        assert row["mean_norm_mm:tip"] == pytest.approx(expected.mean_norm_mm, rel=1e-9)
        assert row["within_limits"] == "no"
        assert not row["reason"]
    first = back.read_bytes()
    assert main(["score", DEMO, "--batch", str(there), "-o", str(back), "--threads", "1"]) == 3
    assert back.read_bytes() == first


@pytest.mark.parametrize("form", [".ndjson", ".arrow", ".parquet"])
def test_what_is_carried_along_is_lost_in_no_format(form: str, tmp_path: Path) -> None:
    """Numbers whose file says so stay numbers; texts stay texts, whatever their column is called."""
    there, back = tmp_path / f"table{form}", tmp_path / f"scores{form}"
    rows: list[tuple[Any, ...]] = [(0.3, "n/a", 1.25), (0.2, "3,5", 2.5)]
    there.write_bytes(write_table(ENDINGS[form], [AP, "play_mm", "value"], rows))
    assert main(["score", DEMO, "--batch", str(there), "-o", str(back)]) == 0
    found = read_rows(ENDINGS[form], back.read_bytes())
    assert [(row[AP], row["play_mm"], row["value"]) for row in found] == rows


def test_columns_of_other_names_and_the_ones_that_are_asked_for(tmp_path: Path, capsys: Any) -> None:
    table = tmp_path / "german.csv"
    table.write_bytes("\ufeffVariante;Rauschen\r\nA;0.2\r\n\r\nB;0.4\r\n".encode())
    command = ["score", DEMO, "--batch", str(table), "--set", "views.*.fiducial_noise_px=Rauschen"]
    assert main([*command, "--columns", "p95_mm,verdict"]) == 0
    out, said = capsys.readouterr()
    lines = out.splitlines()
    assert lines[0] == "Variante;Rauschen;p95_mm:tip;verdict;reason"
    assert [line.split(";")[0::3] for line in lines[1:]] == [["A", "fail"], ["B", "fail"]]
    assert "carried along: Variante" in said
    assert "2 rows: 2 in full (a verdict takes how far first order can be trusted, row by row)" in said


@pytest.mark.parametrize(("text", "place", "said"), read_cases("tables", "batch"))
def test_a_table_that_cannot_be_read_is_refused_where_it_is_wrong(
    text: str, place: str, said: str, tmp_path: Path, refused: Any
) -> None:
    table, out = tmp_path / "table.csv", tmp_path / "scores.csv"
    table.write_text(text)
    error = refused("score", DEMO, "--batch", table, "-o", out)
    assert said in error
    assert (f"table.csv{place}" if place else "") in error
    assert not list(tmp_path.glob("scores*"))


def test_no_line_of_json_is_lost_behind_empty_ones_and_no_field_behind_another() -> None:
    line = b'{"a": 0.5}\n'
    table = read_table(io.BytesIO(b"\n" + line + b" \n" * 1500 + line), "ndjson")
    assert [number for block in table.blocks for number in block.lines] == [2, 1503]
    with pytest.raises(RequestError, match="line 2 has the field 'a' twice"):
        list(read_table(io.BytesIO(line + b'{"a": 0.5, "a": 5}\n'), "ndjson").blocks)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b'{"a": 1', "line 2 is not JSON from column 8 on; got "),
        (b"{'a': 1}", "line 2 is not JSON from column 2 on; got "),
        (b'{"a": "\xff"}', "line 2 is not JSON; got "),
        (b'{"a": ' + b"[" * 100_000, "line 2 is not JSON; got "),
    ],
)
def test_a_line_that_is_not_json_is_refused_in_our_words(text: bytes, words: str) -> None:
    """Not in those of a parser ("Expecting ',' delimiter: line 1 column 8 (char 7)"), whose line is another one."""
    table = read_table(io.BytesIO(b'{"a": 0}\n' + text + b"\n"), "ndjson")
    (problem,) = problems_of(list, table.blocks, error=RequestError)
    assert problem.detail.startswith(words)
    assert len(problem.detail) < 120
    assert "one object" in (problem.hint or "")
    assert (problem.code, problem.line) == ("json-syntax", 2)


@pytest.mark.parametrize("form", [".csv", ".ndjson", ".arrow", ".parquet"])
def test_a_damaged_file_is_read_or_refused(form: str, tmp_path: Path) -> None:
    """Bytes changed, put in, taken out, cut off: never anything but rows or a refusal."""
    rng, there = random.Random(form), tmp_path / f"table{form}"
    write(there)
    sound, refused = there.read_bytes(), 0
    for _ in range(150):
        damaged = bytearray(sound)
        for _ in range(rng.choice((1, 1, 3, 20))):
            at = rng.randrange(len(damaged) + 1)
            damaged[at : at + rng.choice((0, 1, 1, 9))] = rng.randbytes(rng.choice((0, 1, 1, 3)))
        try:
            table = read_table(io.BytesIO(damaged), ENDINGS[form])
            for block in table.blocks:
                table.with_numbers(block, [0])
        except RequestError:
            refused += 1
    assert refused


def test_flags_of_a_table_mean_nothing_without_one(refused: Any) -> None:
    assert main(["score", DEMO, "--columns", "p95_mm"]) == 2
    assert main(["score", DEMO, "--batch", "table.csv", "--json"]) == 2
    assert "known: .csv" in refused("score", DEMO, "--batch", "table.doc")


def test_a_table_that_is_read_is_not_written_over(tmp_path: Path, refused: Any) -> None:
    table = tmp_path / "table.csv"
    table.write_text("views.*.target_noise_px\n0.3\n", encoding="utf-8")
    told = refused("score", DEMO, "--batch", str(table), "-o", str(tmp_path / "." / "table.csv"))
    assert "would overwrite a file that is read hint: give another name" in told
    assert table.read_text(encoding="utf-8") == "views.*.target_noise_px\n0.3\n"


def test_the_page_prints_what_it_says() -> None:
    printed, quoted = run_page("tables", **{"examples/demo.yaml": DEMO})
    assert printed == quoted


PEAK = """
import sys
from tailstack_service.cli.main import main
code = main(["score", sys.argv[1], "--batch", sys.argv[2], "-o", sys.argv[3]])
print(code, next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.mark.long
def test_memory_does_not_grow_with_the_table(tmp_path: Path) -> None:
    design = tmp_path / "normal.yaml"
    design.write_text(design_to_yaml(load_design(DEMO)).replace("uniform", "normal").replace("triangular", "normal"))
    peaks = []
    for count in (2_000, 60_000):
        table = tmp_path / f"{count}.csv"
        table.write_text(f"{AP},{BEAD}\n" + "".join(f"0.{k % 800 + 100},{-30 - k % 97 / 100}\n" for k in range(count)))
        command = [sys.executable, "-c", PEAK, str(design), str(table), str(tmp_path / "scores.csv")]
        done = run_process(*command, check=True)
        code, peak = done.stdout.split()
        assert code == "0", done.stderr
        assert f"{count:,} compiled" in done.stderr
        peaks.append(int(peak) / 1024)
    assert peaks[1] - peaks[0] < 25  # MB; a row kept in memory as it is written takes 300 bytes: 18 MB more
    assert peaks[1] < 300


@pytest.mark.parametrize(("ending", "told"), [(".csv", 3000), (".ndjson", 3000), (".parquet", 3000), (".arrow", 0)])
def test_while_it_runs_a_table_says_how_far_it_is(
    ending: str, told: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Slow rows are told some at a time; where a file does not say how many it has, only their number."""
    monkeypatch.setattr(f"{__name__}.ROWS", ROWS[:2] * 1500)
    write(tmp_path / f"variants{ending}")
    told_of: list[tuple[float, float, str]] = []
    monkeypatch.setattr(Progress, "report", lambda _, *how_far: told_of.append(how_far))
    command = ["score", DEMO, "--batch", str(tmp_path / f"variants{ending}"), "-o", str(tmp_path / "scores.csv")]
    assert main(command) == 0
    assert "3,000 rows: 3,000 compiled" in capsys.readouterr().err
    assert len(told_of) > 2
    assert [done for done, _, _ in told_of] == sorted({done for done, _, _ in told_of})
    assert all(total == (told or done) for done, total, _ in told_of)
    assert told_of[-1] == (3000, 3000, "3,000 rows")
