"""What a newcomer types and sees on a terminal of 80 columns: help, slips, refusals, places that cannot be written;
and the first design, with examples to begin with."""

from __future__ import annotations

import io
import json
import re
from math import radians
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator
from service_scenes import EXAMPLES, commands

from plain_data import read_cases
from tailstack.design import Revision, check_design, design_to_data, load_design, revise_design
from tailstack.design.presets import PRESETS
from tailstack.kernels import calls, store
from tailstack_service.cli.doctor import CHECKS
from tailstack_service.cli.main import verbs
from tailstack_service.console.progress import Progress
from tailstack_service.rendering.text import wrap
from tailstack_service.schemas import json_schema
from turned_clock import TurnedClock


@pytest.fixture
def bare(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run a command in a folder of its own; (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("COLUMNS", "80")
    return commands(capsys)


@pytest.fixture
def call(bare: Any) -> Any:
    """The same where there is a first design."""
    bare("init")
    return bare


def write_changed(name: str, pattern: str, replacement: str) -> None:
    text = Path("design.yaml").read_text(encoding="utf-8")
    changed = re.sub(pattern, replacement, text)
    assert changed != text
    Path(name).write_text(changed, encoding="utf-8")


# --- help -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", [None, *verbs()])
def test_help_fits_a_terminal_of_80_columns(call: Any, verb: str | None) -> None:
    code, out, _ = call(*([] if verb is None else [verb]), "--help")
    assert code == 0
    assert out.startswith(f"usage: tailstack {verb or ''}".rstrip())
    wide = [line for line in out.splitlines() if len(line) > 80]
    assert wide == []


def test_help_is_a_word_too_and_says_what_can_be_typed_without_a_checkout(call: Any) -> None:
    """An installation by pip has no folder of examples."""
    words = " ".join(call("--help")[1].split())
    begin = words.partition("start with: ")[2]
    assert "examples/" not in begin
    assert "tailstack init" in begin
    assert "tailstack score design.yaml" in begin
    assert call("score", "design.yaml")[0] == 0
    assert call("help") == call("--help")
    assert call("help", "score") == call("score", "--help")


def test_what_is_misspelt_is_answered_with_what_was_meant(refused: Any, call: Any) -> None:
    for typed, meant in (("--verison", "--version"), ("-hepl", "--help")):
        assert f"there is no flag {typed!r}; did you mean {meant}?" in refused(typed)
    assert "no example is called 'flat_plat'; did you mean flat_plate?" in refused("example", "flat_plat")
    assert "it is a flag of tailstack verify" in call("score", "design.yaml", "--precision", "0.01")[2]
    names = [target.name for target in load_design(Path("design.yaml")).document.targets]
    assert f"did you mean {names[0]}?" in refused("score", "design.yaml", "--target", names[0][:-1].upper())


# --- files that are not there -----------------------------------------------------------------------------


def test_what_comes_next_is_said_once(call: Any) -> None:
    for verb in ("score", "validate", "optimise", "verify"):
        code, _, err = call(verb, "quite-another.yaml")
        assert code == 2
        assert err.splitlines()[-1] == "next: tailstack init   (makes a first design; tailstack example prints others)"
    write_changed("law.yaml", "uniform", "unifrom")
    assert "\nnext: mend it, then tailstack validate law.yaml " in call("validate", "law.yaml")[2]


def test_a_design_without_a_section_optimise_is_told_to_add_it_by_all_that_need_it(call: Any) -> None:
    """``validate``, which allocate named, finds nothing wrong with it."""
    data = yaml.safe_load((EXAMPLES / "dowelled_seat.yaml").read_text(encoding="utf-8"))
    data["requirements"][0]["limit_mm"] = 0.1
    Path("seat.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    assert "once a section `optimise` says what may change" in " ".join(
        call("score", "seat.yaml", "--no-losses")[1].split()
    )
    for verb in ("optimise", "allocate"):
        said = call(verb, "seat.yaml")[2]
        assert "hint: add optimise with" in said
        assert f"\nnext: mend it, then tailstack {verb} seat.yaml " in said


# --- the same of many -------------------------------------------------------------------------------------


def test_six_tolerances_in_radians_are_one_warning(call: Any) -> None:
    write_changed("rad.yaml", "half_width_deg: 0.1", "half_width_deg: 0.00175")
    code, out, _ = call("validate", "rad.yaml")
    words = " ".join(out.split())
    assert (code, out.count("warning: ")) == (0, 1)
    assert "If radians were meant, write 0.1003." in words
    assert "The same holds for structure_connector ry half_width_deg, structure_connector rz half_width_deg," in words
    assert len(json.loads(call("score", "rad.yaml", "--json")[1])["verdict"]["findings"]) >= 6  # programs get each


def test_beads_in_the_wrong_unit_are_one_refusal_a_view(call: Any) -> None:
    """Each bead is imaged elsewhere, so that no two sentences are the same."""
    rows = "\n".join(f"{x},{y},{z}" for x in (-40, 40) for y in (-40, 40) for z in (-35, 35))
    Path("points.csv").write_text(f"x_cm,y_cm,z_cm\n{rows}\n", encoding="utf-8")
    write_changed("cm.yaml", r"  points: .*\n(    - .*\n)+", "  file: points.csv\n")
    code, _, err = call("validate", "cm.yaml")
    assert code == 3
    assert err.count("a longer source_isocentre_mm widens the field") == 2
    assert err.count("more like it: line") == 2
    assert "the positions, which the file states (x_mm, coordinateUnits)" in err  # which unit would show them


# --- what is written --------------------------------------------------------------------------------------


@pytest.mark.parametrize("width", ["0.161496", "0.1", "0.007", "1.234567"])
def test_a_number_of_degrees_comes_back_as_it_was(width: str) -> None:
    change = Revision(half_width={("structure_connector", "rx"): radians(float(width))})
    revised = design_to_data(revise_design(load_design(EXAMPLES / "demo.yaml"), change))
    assert repr(revised["interfaces"]["structure_connector"]["tolerances"]["rx"]["half_width_deg"]) == width


@pytest.mark.long
def test_a_report_may_be_named(call: Any) -> None:
    assert call("report", "design.yaml", "-o", "mine.HTML", "--parts", "score")[1] == "mine.HTML\n"
    assert Path("mine.HTML").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert call("report", "design.yaml", "-o", "new/mine.json", "--parts", "score")[1] == "new/mine.json\n"
    assert json.loads(Path("new/mine.json").read_bytes())["schema"] == "tailstack/report/1"
    assert call("report", "design.yaml", "-o", "plain", "--parts", "score")[1] == "plain/design.html\n"
    Path("v2.html").mkdir()  # a folder stays one
    assert call("report", "design.yaml", "-o", "v2.html", "--parts", "score")[1] == "v2.html/design.html\n"


def test_a_report_that_is_named_otherwise_than_its_format_is_refused(refused: Any) -> None:
    assert "-o mine.html is one file, of html; --format asks for json, html" in refused(
        "report", "design.yaml", "-o", "mine.html", "--format", "json,html"
    )
    assert not Path("mine.html").exists()


# --- places that cannot be written ------------------------------------------------------------------------


def test_a_service_without_a_place_for_its_database_says_how_to_name_one(
    refused: Any, monkeypatch: pytest.MonkeyPatch, loggers: None
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/proc/nobody")
    monkeypatch.delenv("TAILSTACK_DATABASE", raising=False)
    err = refused("serve", "--port", "0")
    assert "/proc/nobody cannot be written (" in err
    assert "--database or TAILSTACK_DATABASE names another place" in err


def test_doctor_does_not_mind_a_cache_that_nothing_has_to_be_written_to(
    call: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "is_writable", lambda: False)
    monkeypatch.setattr(store.TRAFFIC, "unwritable", "/home/nobody cannot be written (Permission denied)")
    monkeypatch.setattr("tailstack_service.cli.doctor.CHECKS", {"compile cache": CHECKS["compile cache"]})
    monkeypatch.setattr(calls.KernelCall, "file", lambda _: Path("there"))
    assert call("doctor")[:2] == (0, "ok    compile cache  not needed: every kernel is compiled\n")
    monkeypatch.setattr(calls.KernelCall, "file", lambda _: None)
    code, out, _ = call("doctor")
    assert code == 3
    assert " ".join(out.split()) == (
        "FAIL compile cache /home/nobody cannot be written (Permission denied); set NUMBA_CACHE_DIR to a folder that "
        "can be"
    )


# --- kernels that do not fit ------------------------------------------------------------------------------


def test_why_kernels_are_compiled_is_said_once_and_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal of 80 columns the reason used to be cut off, and in a log it stood in every line."""
    made = [store.StoredKernel(Path("x"), "k", "()", f"built for {level}, here is x86-64-v2") for level in ("a", "b")]
    monkeypatch.setattr(store, "installed_directories", lambda: (Path("installed"),))
    monkeypatch.setattr(store, "stored_kernels", lambda _: iter(made))
    reason = store.why_not_installed()
    assert reason == "those installed were built for a and for b, here is x86-64-v2"
    log = io.StringIO()
    clock = TurnedClock()
    with Progress("compiling kernels, once on this machine", log, clock=clock) as progress:
        progress.preface = wrap(reason, first="kernels are compiled: ", indent="  ")
        for seconds in (1.0, 2.0):
            clock.until_waits(seconds)
            clock.turn(seconds)
        clock.until_waits(4.0)
    assert log.getvalue().count("compiling kernels, once on this machine: ") == 2
    lines = log.getvalue().splitlines()
    assert " ".join(" ".join(lines[:2]).split()) == f"kernels are compiled: {reason}"
    assert max(map(len, lines)) <= 80
    assert log.getvalue().count("built for a") == 1
    log = io.StringIO()
    with Progress("compiling", log) as progress:
        progress.preface = "why"
    assert log.getvalue() == ""


# --- files of another kind, and what lies beside a design ---------------------------------------------------


@pytest.mark.parametrize(
    ("file", "content", "what", "following"),
    [
        ("r.pdf", b"%PDF-1.7\n\xe2\xe3\xcf\xd3", "this is a PDF", "tailstack report --verify r.pdf"),
        ("c.step", b"ISO-10303-21;\nHEADER;", "this is a STEP file", "tailstack convert c.step -o design.yaml"),
        ("t.xlsx", b"PK\x03\x04\x14\x00", "this is a ZIP archive", "tailstack report --verify t.xlsx"),
        ("r.html", b"<!doctype html>\n<html>", "this is a web page", "tailstack report --verify r.html"),
        ("s.json", b'{"$schema": "https://json-schema.org/draft/2020-12/schema"}', "this is a JSON schema",
         "tailstack init "),
        ("long.pdf", b"%PDF-1.7\n" + bytes(2_000_000), "this is a PDF", "tailstack report --verify long.pdf"),
    ],
    ids=lambda value: value if isinstance(value, str) and value.count(".") == 1 else "",
)  # fmt: skip
@pytest.mark.parametrize("verb", ["score", "validate", "optimise"])
def test_a_file_of_another_kind_is_named_with_its_verb(
    call: Any, verb: str, file: str, content: bytes, what: str, following: str
) -> None:
    Path(file).write_bytes(content)
    code, _, err = call(verb, file)
    assert code == 2
    assert what in err
    assert "UTF-8" not in err
    assert "bracket" not in err
    assert err.splitlines()[-1].startswith(f"next: {following}")


@pytest.mark.parametrize(
    ("arguments", "said", "unsaid"), read_cases("commands", "beside"), ids=["ending", "folder", "step", "policy"]
)
def test_what_is_wrong_beside_the_design_is_not_blamed_on_it(
    call: Any, arguments: tuple[str, ...], said: str, unsaid: str
) -> None:
    code, _, err = call(*arguments)
    assert code == 2
    assert said in err
    assert unsaid not in err
    assert err.splitlines()[-1] == f"next: tailstack {arguments[0]} --help"


def test_validate_answers_in_json_with_a_line_for_each_design(call: Any) -> None:
    write_changed("law.yaml", "uniform", "unifrom")
    code, out, err = call("validate", "design.yaml", "law.yaml", "--json")
    assert code == 2
    (record,) = [json.loads(line) for line in out.splitlines()]
    assert (record["schema"], record["valid"]) == ("tailstack/validation/1", True)
    Draft202012Validator(json_schema("validation")).validate(record)
    (problem,) = [json.loads(line) for line in err.splitlines()]
    Draft202012Validator(json_schema("problem")).validate(problem)
    assert {entry["file"] for entry in problem["errors"]} == {"law.yaml"}
    assert all("unifrom" in entry["detail"] for entry in problem["errors"])


# --- slips that had no cure ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pattern", "replacement", "said"),
    read_cases("design", "typed"),
    ids=["short", "long", "PA", "PnP", "angle", "indented"],
)
def test_a_slip_is_answered_with_what_to_write(call: Any, pattern: str, replacement: str, said: str) -> None:
    write_changed("slip.yaml", pattern, replacement)
    code, _, err = call("validate", "slip.yaml")
    assert code == 2
    assert said in " ".join(err.split())
    assert "convert the number" not in err
    assert "-35.-18" not in err


# --- a first design -------------------------------------------------------------------------------


DESIGNS = sorted(path.stem for path in EXAMPLES.glob("*.yaml"))


# --- init -----------------------------------------------------------------------------------------


def test_the_first_design_scores_and_passes(bare: Any) -> None:
    code, out, err = bare("init")
    assert (code, out) == (0, "next: tailstack score design.yaml\n")
    assert err.splitlines()[-1] == "wrote design.yaml"
    assert "verdict: pass, on 25 assumed values (estimate)" in bare("score", "design.yaml")[1]
    assert check_design(load_design(Path("design.yaml")))[1] == ()  # nothing is remarked
    text = Path("design.yaml").read_text(encoding="utf-8")
    assert text.startswith("# yaml-language-server: $schema=")
    assert text.count("#") > 10


@pytest.mark.long
def test_the_first_design_can_be_optimised(bare: Any) -> None:
    bare("init")
    code, _, err = bare("optimise", "design.yaml", "--starts", "1", "-o", "better.yaml")
    assert code == 0, err
    assert "# where a bead truly sits" in Path("better.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("count", "size_mm"), [(6, 40.0), (9, 25.0), (17, 45.0), (30, 50.0)])
def test_every_first_design_is_well_posed(bare: Any, preset: str, count: int, size_mm: float) -> None:
    lengths = {"source_isocentre_mm": "700", "pixel_mm": "0.4"}
    given = [
        f"--{name.replace('_', '-')}={lengths[name]}" for name in PRESETS[preset].view_must_state if name in lengths
    ]
    flags = [f"--fiducials={count}", f"--size-mm={size_mm}", "--target=5,-5,40"]
    code, out, err = bare("init", "-", f"--preset={preset}", *flags, *given)
    assert code == 0, err
    design = load_design(out)
    _, findings, _ = check_design(design)
    assert [finding for finding in findings if finding.severity != "note"] == []
    assert len(design.fiducials.labels) == count
    points = design.fiducials.positions_mm
    assert all(abs(value) <= size_mm / 2 for point in points for value in point)
    assert all(max(point[axis] for point in points) > 0.3 * size_mm for axis in range(3))


def test_flags_say_what_is_asked_for(bare: Any) -> None:
    flags = ["--name", "knee: left", "--fiducials", "8", "--size-mm", "5e1", "--target", "1,2,70", "--limit-mm", "2.5"]
    code, out, _ = bare("init", "-", *flags, "--noise-px", "0.2", "--preset", "siemens-cios-fusion-deepdrr")
    data = yaml.safe_load(out)
    assert code == 0
    assert data["name"] == "knee: left"
    assert len(data["fiducials"]["points"]) == 8
    assert data["optimise"]["box"] == {"min_mm": [-25, -25, -25], "max_mm": [25, 25, 25]}
    assert data["targets"][0]["position_mm"] == [1, 2, 70]
    assert data["requirements"][0]["limit_mm"] == 2.5
    assert data["views"][0]["fiducial_noise_px"] == 0.2


def test_on_a_terminal_it_asks_for_what_no_flag_says(bare: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = ["", "siemens-cios", "siemens-cios-fusion", "many", "1e1", "", "0,0", "0,0,80", "", "650"]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(answers) + "\n"))
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    code, out, err = bare("init", "mine.yaml", "--limit-mm", "3")
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


def test_a_length_that_nobody_says_is_refused_with_its_flag(bare: Any) -> None:
    code, out, err = bare("init", "-", "--preset", "siemens-xa-a")
    assert (code, out) == (2, "")
    assert "the source of preset siemens-xa-a does not state pixel_mm" in err
    assert "hint: --pixel-mm X" in err


def test_nothing_is_overwritten_unasked(bare: Any) -> None:
    Path("design.yaml").write_text("precious", encoding="utf-8")
    beads = str(EXAMPLES / "fiducials" / "marker8.csv")
    commands = (
        ["init"],
        ["example", "demo", "-o", "design.yaml"],
        ["convert", beads, "-o", "design.yaml"],
        ["optimise", "nowhere.yaml", "-o", "design.yaml"],  # before anything is read
    )
    for arguments in commands:
        code, out, err = bare(*arguments)
        assert (code, out) == (2, "")
        assert "design.yaml is there already\n  hint: give another name, or --force to overwrite it" in err
        assert Path("design.yaml").read_text(encoding="utf-8") == "precious"
    assert bare(*commands[2], "--force")[0] == 0
    assert "fiducials" in Path("design.yaml").read_text(encoding="utf-8")
    assert bare("init", "--force")[0] == 0
    assert load_design(Path("design.yaml")).name == "first design"


def test_a_carrier_that_no_view_shows_is_refused_before_anything_is_written(bare: Any) -> None:
    code, out, err = bare("init", "--size-mm", "500")
    assert (code, out) == (2, "")
    assert "/views/" in err
    assert "line" not in err  # of a text that nobody has
    assert err.endswith("next: tailstack init --help\n")
    assert list(Path().iterdir()) == []


# --- example --------------------------------------------------------------------------------------


def test_examples_are_listed_with_a_line_each(bare: Any) -> None:
    code, out, _ = bare("example")
    assert code == 0
    names = [line.split()[0] for line in out.splitlines()[:-1]]
    assert names[: len(DESIGNS)] == DESIGNS
    assert {"ci-gate", "measurements", "paper"} <= set(names[len(DESIGNS) :])
    assert "drill guide, reference structure with 12 beads" in out
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.parametrize(
    ("name", "file"),
    [
        *((name, f"{name}.yaml") for name in DESIGNS),
        *((each, "paper/c_arm.yaml") for each in ("paper-c_arm", "paper/c_arm.yaml")),
    ],
)
def test_an_example_that_is_printed_stands_alone(bare: Any, name: str, file: str) -> None:
    """Also a design of a folder, by either name."""
    code, out, err = bare("example", name)
    assert (code, err) == (0, "")
    assert load_design(out, allow_files=False).sha256 == load_design(EXAMPLES / file).sha256
    assert out.startswith("# ")
    assert "yaml-language-server" not in out


@pytest.mark.parametrize("name", DESIGNS)
def test_an_example_that_is_written_brings_what_it_refers_to(bare: Any, name: str) -> None:
    code, out, err = bare("example", name, "-o", f"{name}.yaml")
    assert (code, out) == (0, f"next: tailstack score {name}.yaml\n")
    assert err.splitlines()[-1] == f"wrote {name}.yaml"
    assert load_design(Path(f"{name}.yaml")).sha256 == load_design(EXAMPLES / f"{name}.yaml").sha256
    original = (EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    assert Path(f"{name}.yaml").read_text(encoding="utf-8").splitlines()[1:] == original[1:]


def test_a_folder_is_written_as_a_folder_and_modules_for_other_programs_whole(bare: Any) -> None:
    assert bare("example", "ci-gate")[0] == 2
    assert bare("example", "ci-gate", "-o", "gate")[0] == 0
    written, original = (folder / "policy.yaml" for folder in (Path("gate"), EXAMPLES / "ci-gate"))
    assert written.read_text().splitlines()[1:] == original.read_text().splitlines()[1:]  # the first names the schema
    assert Path("gate/README.md").read_bytes() == (EXAMPLES / "ci-gate" / "README.md").read_bytes()
    assert bare("gate", "gate/pass.yaml", "--policy", "gate/policy.yaml", "--mode", "analytic")[0] in (0, 4)
    assert bare("example", "integrations", "-o", "doors")[0] == 0
    for name in ("freecad/InitGui.py", "freecad/icons/score.svg", "slicer/Tailstack.py", "slicer/tailstack_http.py"):
        assert (Path("doors") / name).read_bytes() == (EXAMPLES / "integrations" / name).read_bytes()
