"""``tailstack init`` and ``tailstack example``: from nothing to a design that scores."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
import yaml
from service_scenes import EXAMPLES, commands

from tailstack.design import check_design, load_design
from tailstack.design.presets import PRESETS

DESIGNS = sorted(path.stem for path in EXAMPLES.glob("*.yaml"))


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run a command in a folder of its own; (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO())

    return commands(capsys)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


# --- init -----------------------------------------------------------------------------------------


def test_the_first_design_scores_and_passes(call: Any) -> None:
    code, out, err = call("init")
    assert (code, out) == (0, "next: tailstack score design.yaml\n")
    assert err.splitlines()[-1] == "wrote design.yaml"
    assert "verdict: pass, on 25 assumed values (estimate)" in call("score", "design.yaml")[1]
    assert check_design(load_design(Path("design.yaml")))[1] == ()  # nothing is remarked
    text = Path("design.yaml").read_text(encoding="utf-8")
    assert text.startswith("# yaml-language-server: $schema=")
    assert text.count("#") > 10


@pytest.mark.long
def test_the_first_design_can_be_optimised(call: Any) -> None:
    call("init")
    code, _, err = call("optimise", "design.yaml", "--starts", "1", "-o", "better.yaml")
    assert code == 0, err
    assert "# where a bead truly sits" in Path("better.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("count", "size_mm"), [(6, 40.0), (9, 25.0), (17, 45.0), (30, 50.0)])
def test_every_first_design_is_well_posed(call: Any, preset: str, count: int, size_mm: float) -> None:
    lengths = {"source_isocentre_mm": "700", "pixel_mm": "0.4"}
    given = [f"--{name.replace('_', '-')}={lengths[name]}" for name in PRESETS[preset].missing if name in lengths]
    flags = [f"--fiducials={count}", f"--size-mm={size_mm}", "--target=5,-5,40"]
    code, out, err = call("init", "-", f"--preset={preset}", *flags, *given)
    assert code == 0, err
    design = load_design(out)
    _, findings, _ = check_design(design)
    assert [finding for finding in findings if finding.severity != "note"] == []
    assert len(design.fiducials.labels) == count
    points = design.fiducials.positions_mm
    assert all(abs(value) <= size_mm / 2 for point in points for value in point)
    assert all(max(point[axis] for point in points) > 0.3 * size_mm for axis in range(3))


def test_flags_say_what_is_asked_for(call: Any) -> None:
    flags = ["--name", "knee: left", "--fiducials", "8", "--size-mm", "5e1", "--target", "1,2,70", "--limit-mm", "2.5"]
    code, out, _ = call("init", "-", *flags, "--noise-px", "0.2", "--preset", "siemens-cios-fusion-deepdrr")
    data = yaml.safe_load(out)
    assert code == 0
    assert data["name"] == "knee: left"
    assert len(data["fiducials"]["points"]) == 8
    assert data["optimise"]["box"] == {"min_mm": [-25, -25, -25], "max_mm": [25, 25, 25]}
    assert data["targets"][0]["position_mm"] == [1, 2, 70]
    assert data["requirements"][0]["limit_mm"] == 2.5
    assert data["views"][0]["fiducial_noise_px"] == 0.2


def test_on_a_terminal_it_asks_for_what_no_flag_says(call: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = ["", "siemens-cios", "siemens-cios-fusion", "many", "1e1", "", "0,0", "0,0,80", "", "650"]
    monkeypatch.setattr("sys.stdin", Terminal("\n".join(answers) + "\n"))
    code, out, err = call("init", "mine.yaml", "--limit-mm", "3")
    assert (code, out) == (0, "next: tailstack score mine.yaml\n")
    assert "no preset is called 'siemens-cios'; did you mean siemens-cios-fusion?" in err
    assert "expected a whole number; got 'many'" in err
    assert "expected three numbers with commas between them like 0,0,90; got '0,0'" in err
    assert "distance from source to isocentre, mm [700]: " in err
    assert "limit of the error" not in err
    data = yaml.safe_load(Path("mine.yaml").read_text(encoding="utf-8"))
    assert (data["name"], len(data["fiducials"]["points"])) == ("first design", 10)
    assert data["views"][1]["source_isocentre_mm"] == 650
    assert data["targets"][0]["position_mm"] == [0, 0, 80]


def test_a_length_that_nobody_says_is_refused_with_its_flag(call: Any) -> None:
    code, out, err = call("init", "-", "--preset", "siemens-xa-a")
    assert (code, out) == (2, "")
    assert "the source of preset siemens-xa-a does not state pixel_mm" in err
    assert "hint: --pixel-mm X" in err


def test_nothing_is_overwritten_unasked(call: Any) -> None:
    Path("design.yaml").write_text("precious", encoding="utf-8")
    for arguments in (["init"], ["example", "demo", "-o", "design.yaml"]):
        code, out, err = call(*arguments)
        assert (code, out) == (2, "")
        assert "design.yaml is there already\n  hint: give another name, or --force to overwrite it" in err
        assert Path("design.yaml").read_text(encoding="utf-8") == "precious"
    assert call("init", "--force")[0] == 0
    assert load_design(Path("design.yaml")).name == "first design"


def test_a_carrier_that_no_view_shows_is_refused_before_anything_is_written(call: Any) -> None:
    code, out, err = call("init", "--size-mm", "500")
    assert (code, out) == (2, "")
    assert "/views/" in err
    assert "line" not in err  # of a text that nobody has
    assert err.endswith("next: tailstack init --help\n")
    assert list(Path().iterdir()) == []


# --- example --------------------------------------------------------------------------------------


def test_examples_are_listed_with_a_line_each(call: Any) -> None:
    code, out, _ = call("example")
    assert code == 0
    names = [line.split()[0] for line in out.splitlines()[:-1]]
    assert names[: len(DESIGNS)] == DESIGNS
    assert {"ci-gate", "measurements", "paper"} <= set(names[len(DESIGNS) :])
    assert "drill guide, reference structure with 12 beads" in out


@pytest.mark.parametrize("name", DESIGNS)
def test_an_example_that_is_printed_stands_alone(call: Any, name: str) -> None:
    code, out, err = call("example", name)
    assert (code, err) == (0, "")
    assert load_design(out, allow_files=False).sha256 == load_design(EXAMPLES / f"{name}.yaml").sha256
    assert out.startswith("# ")
    assert "yaml-language-server" not in out


@pytest.mark.parametrize("name", DESIGNS)
def test_an_example_that_is_written_brings_what_it_refers_to(call: Any, name: str) -> None:
    code, out, err = call("example", name, "-o", f"{name}.yaml")
    assert (code, out) == (0, f"next: tailstack score {name}.yaml\n")
    assert err.splitlines()[-1] == f"wrote {name}.yaml"
    assert load_design(Path(f"{name}.yaml")).sha256 == load_design(EXAMPLES / f"{name}.yaml").sha256
    original = (EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    assert Path(f"{name}.yaml").read_text(encoding="utf-8").splitlines()[1:] == original[1:]


def test_a_folder_is_written_as_a_folder(call: Any) -> None:
    assert call("example", "ci-gate")[0] == 2
    assert call("example", "ci-gate", "-o", "gate")[0] == 0
    written, original = (folder / "policy.yaml" for folder in (Path("gate"), EXAMPLES / "ci-gate"))
    assert written.read_text().splitlines()[1:] == original.read_text().splitlines()[1:]  # the first names the schema
    assert Path("gate/README.md").read_bytes() == (EXAMPLES / "ci-gate" / "README.md").read_bytes()
    assert call("gate", "gate/pass.yaml", "--policy", "gate/policy.yaml", "--mode", "analytic")[0] in (0, 4)


def test_modules_for_other_programs_are_written_whole(call: Any) -> None:
    assert call("example", "integrations", "-o", "doors")[0] == 0
    for name in ("freecad/InitGui.py", "freecad/icons/score.svg", "slicer/Tailstack.py", "slicer/tailstack_http.py"):
        assert (Path("doors") / name).read_bytes() == (EXAMPLES / "integrations" / name).read_bytes()


@pytest.mark.parametrize("name", ["paper-c_arm", "paper/c_arm.yaml"])
def test_a_design_of_a_folder_is_an_example_too(call: Any, name: str) -> None:
    code, out, _ = call("example", name)
    assert code == 0
    assert load_design(out).sha256 == load_design(EXAMPLES / "paper" / "c_arm.yaml").sha256


def test_the_list_fits_a_terminal_of_a_hundred_columns(call: Any) -> None:
    assert max(map(len, call("example")[1].splitlines())) <= 100


def test_an_unknown_example_is_answered_with_the_nearest(call: Any) -> None:
    code, out, err = call("example", "flat_plat")
    assert (code, out) == (2, "")
    assert "no example is called 'flat_plat'; did you mean flat_plate?" in err
