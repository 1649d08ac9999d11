"""Measurement files: every form is read, and what cannot be what it claims to be is refused with line and reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from plain_data import read_cases
from scenes import cube8_system, target
from tailstack.errors import TailstackError
from tailstack.studies.bench.compare import study_comparison
from tailstack.studies.bench.file import Measurements, read_measurements

ONE = ("tip",)
POINTS = "installation,trial,x_mm,y_mm,z_mm\n1,1,1,2,3\n1,2,4,5,6\n2,1,7,8,9\n"


def read(text: str | bytes, targets: tuple[str, ...] = ONE) -> Measurements:
    return read_measurements(text if isinstance(text, bytes) else text.encode(), targets, "bench.csv")


def refused(text: str | bytes, targets: tuple[str, ...] = ONE) -> tuple[int | None, str, str]:
    """(line, code, whole message) of the first problem."""
    with pytest.raises(TailstackError) as found:
        read(text, targets)
    assert found.value.exit_code == 2
    problem = found.value.problems[0]
    assert problem.file == "bench.csv"
    return problem.line, problem.code, str(problem)


def test_points_are_read_installation_by_installation() -> None:
    found = read(POINTS)
    (group,) = found.groups
    assert (found.form, found.unit, found.rows, group.level, group.target) == ("points", "mm", 3, "all", "tip")
    assert (group.sizes, group.installations, group.line) == ((2, 1), ("1", "2"), 2)
    np.testing.assert_array_equal(group.values_mm, [[1, 2, 3], [4, 5, 6], [7, 8, 9]])


@pytest.mark.parametrize(
    "text",
    [
        POINTS.upper().replace("MM", "mm"),
        POINTS.replace("1,2,3", '"1","2","3"'),
        POINTS.replace("1,2,3", " 1 , 2 , 3.0e0"),
        "trial,z_mm,installation,x_mm,y_mm\n1,3,1,1,2\n2,6,1,4,5\n1,9,2,7,8\n",
        "installation,trial,x_m,y_m,z_m\n1,1,1e-3,2e-3,3e-3\n1,2,.004,.005,.006\n2,1,0.007,0.008,0.009\n",
        "installation,trial,x_\u03bcm,y_\u03bcm,z_\u03bcm\n1,1,1000,2000,3000\n1,2,4000,5000,6000\n2,1,7000,8000,9000\n",
    ],
)
def test_the_same_file_written_otherwise(text: str) -> None:
    """Habits that every reader of tables meets: ``people_habits.py``."""
    (group,) = read(text).groups
    np.testing.assert_allclose(group.values_mm, [[1, 2, 3], [4, 5, 6], [7, 8, 9]], rtol=1e-12)
    assert group.sizes == (2, 1)


def test_units_are_noted_installations_put_together_and_twins_remarked() -> None:
    found = read("x_cm,y_cm,z_cm\n1,2,3\n4,5,6\n7,8,9\n")
    assert any("from cm to mm" in note for note in found.notes)
    (group,) = read("installation,error_mm\nB,1\nA,2\nB,3\nA,4\n").groups
    assert group.installations == ("B", "A")
    assert group.values_mm.tolist() == [1, 3, 2, 4]
    assert any("lines 2 and 3" in note for note in read("error_mm\n1\n1\n3\n").notes)
    assert read("error_mm\n1\n2\n3\n").notes == ()


def test_levels_and_their_installation_errors() -> None:
    found = read("level,rx_deg,tz_cm,error_cm\nL0,0,0,1\nL0,0,0,2\nL0,0,0,3\nL1,90e-1,.5,1\nL1,9,0.5,2\nL1,9.0,.50,3\n")
    first, second = found.groups
    assert not first.deliberate.any()
    assert second.deliberate == pytest.approx([np.deg2rad(9), 0, 0, 0, 0, 5.0])
    assert read(POINTS).groups[0].deliberate is None


def test_summary_statistics() -> None:
    first = read("level,n,mean_mm,sd_mm\nL0,12,0.5,0.1\nL1,12,0.9,0.2\n").groups[0].summary
    assert (first.n, first.mean_mm, first.sd_mm) == (12, 0.5, 0.1)
    bare = read("level,mean_m\nL0,0.001\n").groups[0].summary
    assert (bare.n, bare.mean_mm, bare.sd_mm) == (None, 1.0, None)


def test_targets_are_those_of_the_design() -> None:
    text = "target,error_mm\na,1\na,2\na,3\nb,1\nb,2\nb,4\n"
    assert [group.target for group in read(text, ("a", "b")).groups] == ["a", "b"]
    line, code, said = refused(text, ("a",))
    assert (line, code) == (5, "unknown-target")
    assert "targets: a" in said
    line, code, said = refused("error_mm\n1\n2\n3\n", ("a", "b"))
    assert (line, code) == (1, "csv-header")
    assert "add a column target" in said


BAD = [
    *read_cases("measurements", "files"),
    ("level,n,mean_mm,sd_mm\nA," + "9" * 5000 + ",1,0\n", 2, "out-of-range", "n is a whole number"),
    ("level,error_mm\n" + "A,1\n" * 20_001, 20_002, "too-many", "20,001 lines of measurements"),
    ("error_mm\n" + "1\n" * 2001, 2002, "too-many", "at most 2,000"),
    (b"\xff\xfe" + POINTS.encode("utf-16-le")[:-1], None, "not-text", "UTF-16"),
    (b"error_mm\n1\n\xb5\n", 3, "wrong-type", "got 'µ'"),
    (b"error_mm\n1\n\x81\n", 3, "not-text", "neither UTF-8 nor Windows-1252"),
    (b"error_mm\n1\n2\x00\n3\n", 3, "not-text", "NUL"),
    (b"PK\x03\x04", None, "not-text", "workbook"),
    (b"x" * 20_000_001, None, "too-large", "longer than"),
]


@pytest.mark.parametrize(("text", "line", "code", "said"), BAD)
def test_rubbish_is_refused_with_its_line(text: str | bytes, line: int | None, code: str, said: str) -> None:
    found_line, found_code, message = refused(text)
    assert (found_line, found_code) == (line, code)
    assert said in message


def test_control_characters_do_not_reach_a_terminal() -> None:
    assert "\x1b" not in refused("error_mm\n1\n\x1b[31m2\n")[2]


def test_a_file_that_is_not_there_is_the_system_s_to_tell(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_measurements(tmp_path / "none.csv", ONE)


def test_points_in_con_are_errors_in_the_frame_asked_for() -> None:
    """closed_form: e_tcp = R_tcp_con (x - q); in con it is x - q.  Points and error vectors then compare alike."""
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    system = cube8_system(targets=(target((0, 0, 70), "tip"),), T_tcp_flange=turn)
    errors = np.random.default_rng(1).normal(0, 0.09, (5, 3)).round(6)
    points = "x_mm,y_mm,z_mm\n" + "".join(f"{x:.6f},{y:.6f},{70 + z:.6f}\n" for x, y, z in errors)
    for error, expected in (("tcp", errors @ turn[:3, :3].T), ("localisation", errors)):
        vectors = "error_x_um,error_y_um,error_z_um\n" + "".join(
            f"{x * 1e3:.3f},{y * 1e3:.3f},{z * 1e3:.3f}\n" for x, y, z in expected
        )
        found = [
            study_comparison(system, text.encode(), error=error).levels[0]  # type: ignore[arg-type]
            for text in (points, vectors)
        ]
        assert found[0].bias.measured_mm == pytest.approx(tuple(expected.mean(axis=0)), abs=1e-9)
        assert [test.p_value for test in found[0].tests] == [test.p_value for test in found[1].tests]


@pytest.mark.parametrize(
    "set_by", ["tx_mm,error_mm\n400,400\n400,401\n400,402\n", "ry_deg,error_mm\n44,1\n44,1\n44,2\n"]
)
def test_a_level_that_cannot_be_imaged_is_refused_at_its_line(set_by: str) -> None:
    """The field of view is +-102 mm at the isocentre."""
    with pytest.raises(TailstackError, match=r"outside view|behind it") as found:
        study_comparison(cube8_system(), set_by.encode(), error="localisation")
    problem = found.value.problems[0]
    assert (problem.line, found.value.exit_code) == (2, 2)


def test_a_summary_is_held_against_the_norm() -> None:
    """The mean and spread of one file given as trials and as a summary are tested alike."""
    system = cube8_system(targets=(target((0, 0, 70), "tip"),))
    norms = np.abs(np.random.default_rng(2).normal(0.14, 0.06, 9)).round(4)
    trials = study_comparison(system, ("error_mm\n" + "".join(f"{n}\n" for n in norms)).encode())
    summed = study_comparison(
        system, f"level,n,mean_mm,sd_mm\nall,9,{norms.mean():.12f},{norms.std(ddof=1):.12f}\n".encode()
    )
    assert [t.test for t in summed.levels[0].tests] == ["mean", "spread"]
    for one, other in zip(trials.levels[0].tests, summed.levels[0].tests, strict=False):
        assert one.p_value == other.p_value
    assert summed.levels[0].norm.interval_mm == pytest.approx(trials.levels[0].norm.interval_mm, rel=1e-9)
    assert summed.levels[0].quantiles == ()


def test_a_summary_without_trials_is_only_shown() -> None:
    """The form of the paper's S4: a level that is its own reference, and no number of trials."""
    system = cube8_system(targets=(target((0, 0, 70), "tip"),))
    study = study_comparison(system, b"level,mean_mm,sd_mm\nL0,0,0\nL1,.69,.1\nL2,1.38,.2\n")
    assert study.verdict == "not testable"
    rules = {finding.rule: finding for finding in study.findings}
    assert "its own reference" in study.levels[0].not_tested
    assert "not stated" in study.levels[1].not_tested
    assert "levels-not-stated" in rules
    assert "benches of 100 trials" in rules["assumed-trials"].message
