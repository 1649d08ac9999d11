"""The command line, in process: answers on stdout, everything else on stderr, the exit code that was promised;
spellings, slips of the hand, and numbers as they are typed."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any
from unittest.mock import Mock
from urllib.parse import urlsplit

import pytest
from jsonschema import Draft202012Validator
from service_scenes import EXAMPLES, coplanar_design, limited, small_design, write_json

from family import SOURCES, run_python
from tailstack import load_design, verify
from tailstack.design import list_presets
from tailstack_service.cli.main import verbs
from tailstack_service.console.command_line import number, spell_commands, whole
from tailstack_service.console.remote import DEFAULT_URL
from tailstack_service.documents import to_json
from tailstack_service.report.chapters.verification import drawn_by
from tailstack_service.schemas import TITLES, json_schema

DEMO = str(EXAMPLES / "demo.yaml")


# --- help and usage -------------------------------------------------------------------------------


def test_help_names_every_verb(call: Any) -> None:
    code, out, _ = call("--help")
    assert code == 0
    assert all(f"    {verb} " in out for verb in verbs())
    assert "Which view buys most: every aimed view turned" in " ".join(call("study", "views", "--help")[1].split())
    assert f"(default {urlsplit(DEFAULT_URL).port})" in " ".join(call("serve", "--help")[1].split())


@pytest.mark.parametrize(
    "arguments",
    [
        (), ("nonsense",), ("score",), ("score", DEMO, "--trials", "3"), ("verify", DEMO, "--trials", "0"),
        ("verify", DEMO, "--trials", "many"), ("verify", DEMO, "--precision", "2"), ("verify", DEMO, "--seed", "-1"),
        ("verify", DEMO, "--trials", "10", "--precision", "0.1"), ("verify", DEMO, "--method", "magic"),
        ("optimise", DEMO, "--starts", "0"), ("optimise", DEMO, "--starts", "20000"),
        ("verify", DEMO, "--trials", "1e30"), ("serve", "--port", "70000"), ("convert", DEMO), ("score", DEMO, "--js"),
    ],
)  # fmt: skip
def test_usage_errors_are_2_and_name_the_next_command(refused: Any, arguments: tuple[str, ...]) -> None:
    err = refused(*arguments)
    assert "next: tailstack" in err or "usage: tailstack" in err


# --- schemas --------------------------------------------------------------------------------------


def test_schemas_are_listed_and_printed(call: Any) -> None:
    code, out, _ = call("schema")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == list(TITLES)
    for name in TITLES:
        code, out, _ = call("schema", name)
        assert code == 0
        assert json.loads(out) == json_schema(name)
    entries = {entry["const"]: entry["description"] for entry in json_schema("presets")["oneOf"]}
    assert len(entries) >= 4
    for preset in list_presets():
        assert f"Source: {preset['source']}." in entries[preset["name"]]
        assert entries[preset["name"]].lower().endswith(f"{preset['remark']}.".lower())


# --- validate -------------------------------------------------------------------------------------


def test_validate_says_what_no_layout_undercuts(call: Any) -> None:
    code, out, err = call("validate", "--bound", DEMO)
    assert (code, err) == (0, "")
    assert "bound: tip-accuracy: To first order, no layout of 12 fiducials" in out
    assert "bound: cost: To first order, no layout of 12 fiducials" in out
    told = json.loads(call("validate", "--bound", "--json", DEMO)[1])
    (bound,), cheapest = told["bounds"], told["cheapest"]
    assert bound["tightest_bound_mm"] < bound["limit"] < bound["lower_bound_mm"] < bound["quantile_mm"]
    assert 1500 < cheapest["lower_bound"] < cheapest["cost"]
    code, out, err = call("validate", "--bound", str(EXAMPLES / "forearm_shell.yaml"))
    assert code == 2
    assert "no optimise section" in err


# --- score ----------------------------------------------------------------------------------------


def test_score_prints_the_budget_and_the_verdict(call: Any) -> None:
    code, out, _ = call("score", DEMO)
    verdict = out.strip().splitlines()[-1]
    assert verdict.startswith("verdict: ")
    assert code == {"pass": 0, "fail": 1, "inconclusive": 4}[verdict.split()[1]]
    for heading in (
        "The design misses tip-accuracy: in 95 % of shots",
        "share, %",
        "a tenth tighter",
        "not included: ",
    ):
        assert heading in out
    assert "\x1b" not in out


def test_printed_budget_is_the_one_in_the_document(call: Any) -> None:
    """Rows by falling share; each printed share is the document's."""
    _, text, _ = call("score", DEMO)
    _, out, _ = call("score", DEMO, "--json")
    contributors = json.loads(out)["targets"][0]["contributors"]
    interfaces = {"structure_connector", "connector_flange"}  # by their names, the others by their labels
    called = {e["name"] if e["name"] in interfaces else e["label"]: e["name"] for e in contributors}
    totals = {name: max(e["variance_share"] for e in contributors if e["name"] == name) for name in called.values()}
    block = text[text.index("Where the error at") :].splitlines()[4:]
    rows = [line.split("  ")[0].partition(":")[0] for line in block[: block.index("")] if not line.startswith(" ")]
    printed = [called[row] for row in rows]
    assert printed == sorted(totals, key=lambda name: totals[name], reverse=True)


def test_the_verdict_is_the_exit_code(call: Any, tmp_path: Path) -> None:
    for limit_mm, code in ((50.0, 0), (0.1, 1)):
        path = str(write_json(tmp_path / "design.json", limited(limit_mm)))
        asked = (("score", path), ("score", path, "--json"), ("verify", path, "--trials", "2000"))
        assert [call(*arguments)[0] for arguments in asked] == [code] * 3
    path = str(write_json(tmp_path / "design.json", small_design(requirements=None, optimise=None)))
    code, out, _ = call("score", path)
    assert code == 0
    assert "verdict: no requirement" in out
    path = str(write_json(tmp_path / "design.json", small_design()))
    p95_mm = json.loads(call("score", path, "--json")[1])["targets"][0]["p95_mm"]
    path = str(write_json(tmp_path / "edge.json", limited(p95_mm)))
    assert call("score", path)[0] == 4
    code, out, _ = call("verify", path, "--trials", "2000", "--json")
    assert code == 4
    assert json.loads(out)["verdict"]["status"] == "inconclusive"


def test_score_reads_stdin(call: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(Path(DEMO).read_bytes())))
    _, piped, _ = call("score", "-", "--json")
    _, named, _ = call("score", DEMO, "--json")
    assert json.loads(piped)["targets"] == json.loads(named)["targets"]


def test_another_target_of_a_region(call: Any, refused: Any) -> None:
    path = str(EXAMPLES / "locators_321.yaml")
    out = call("score", path, "--target", "workspace[2]")[1]
    assert "Where the error at target workspace[2] comes from" in out
    assert "workspace[0]" in refused("score", path, "--target", "elsewhere")


# --- verify, optimise -----------------------------------------------------------------------------


def test_verify_answers_in_both_forms_and_the_same_for_any_number_of_threads(call: Any) -> None:
    _, out, _ = call("verify", DEMO, "--trials", "5000", "--seed", "7", "--json")
    document = json.loads(out)
    Draft202012Validator(json_schema("verification")).validate(document)
    assert (document["seed"], document["method"]) == (7, "plain")
    assert document["trials"] >= 5000
    low, high = document["targets"][0]["p95_interval_mm"]
    assert low <= document["targets"][0]["p95_mm"] <= high
    code, out, _ = call("verify", DEMO, "--trials", "20000")
    assert "how sure: P95 is known to " in out
    assert out.strip().splitlines()[-1].startswith("verdict: ")
    assert code in (0, 1, 4)
    answers = [call("verify", DEMO, "--trials", "4000", "--json", "--threads", n)[1] for n in ("1", "2")]
    assert json.loads(answers[0])["targets"] == json.loads(answers[1])["targets"]


def test_the_precision_of_p95_is_not_that_of_a_rarer_quantile(call: Any, tmp_path: Path) -> None:
    """closed form: of 20,000 shots twenty are beyond P99.9, a thousand beyond P95."""
    design = small_design()
    design["requirements"] = [{"name": "rare", "quantile": 0.999, "limit_mm": 5.0}]
    drawn = write_json(tmp_path / "rare.json", design), "--trials", "20000"
    shown, out = json.loads(call("verify", *drawn, "--json")[1]), call("verify", *drawn)[1]
    (low, high), p95 = shown["targets"][0]["p95_interval_mm"], shown["targets"][0]["p95_mm"]
    known, rare = 50 * (high - low) / p95, 100 * shown["precision_reached"]
    assert rare > 2 * known
    words = f"P95 is known to ± {known:.2f} %, what requirements ask for to ± {rare:.2f} %"
    assert words in " ".join(out.split())


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [
        {"trials": 2000}, {"precision": 0.1}, {"precision": 0.02, "max_trials": 60_000},
        {"method": "radial", "trials": 512}, {"method": "radial", "precision": 0.05},
    ],
    ids=lambda options: "-".join(options),
)  # fmt: skip
def test_a_report_of_a_check_names_the_command_that_draws_the_same(
    options: dict[str, Any], call: Any, tmp_path: Path
) -> None:
    path = write_json(tmp_path / "design.json", small_design())
    check = verify(load_design(path), seed=3, **options)
    _, out, _ = call("verify", path, *drawn_by(check).split(), "--json")
    assert json.loads(out) == json.loads(to_json(check))


def test_an_infeasible_limit_is_1_and_explained(call: Any, tmp_path: Path) -> None:
    design = str(write_json(tmp_path / "design.json", limited(0.01)))
    code, out, err = call("optimise", design, "--starts", "1")
    assert (code, out) == (1, "")
    assert "  hint: " in err


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["validate", "score", "verify", "optimise"])
@pytest.mark.parametrize("kind", ["missing", "directory", "binary", "empty", "nul"])
def test_bad_files_are_2(call: Any, tmp_path: Path, verb: str, kind: str) -> None:
    path = tmp_path / "design.yaml"
    if kind == "directory":
        path.mkdir()
    elif kind == "binary":
        path.write_bytes(bytes(range(256)))
    elif kind == "empty":
        path.touch()
    name = "a\0b.yaml" if kind == "nul" else str(path)
    code, _, err = call(verb, name)
    assert code == 2
    assert err


def test_commands_are_named_as_they_can_be_typed(call: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad = str(write_json(tmp_path / "bad.json", {"name": "no design"}))
    for name in ("tailstack", "./run tailstack", "../main/run tailstack"):
        monkeypatch.setenv("TAILSTACK_COMMAND", name)
        assert (
            call("score", bad)[2].splitlines()[-1].startswith(f"next: {name} validate {bad}   (all rules: {name} sch")
        )
        assert call("score")[2].splitlines()[-1] == f"next: {name} score --help"
        out = call("keys", "revoke", "--help")[1]
        assert out.startswith(f"usage: {name} keys revoke ")
        assert f"as {name} keys list shows it" in out
        twice = spell_commands(spell_commands("a newer tailstack has it: tailstack db check"))
        assert twice == f"a newer tailstack has it: {name} db check"


def test_with_json_a_refusal_is_a_problem_document_on_stderr(call: Any, tmp_path: Path) -> None:
    path = tmp_path / "design.yaml"
    path.write_text("schema: tailstack/design/1\nname: 3\n")
    code, out, err = call("score", str(path), "--json")
    assert (code, out) == (2, "")
    document = json.loads(err)
    Draft202012Validator(json_schema("problem")).validate(document)
    entry = next(entry for entry in document["errors"] if entry["pointer"] == "/name")
    assert (entry["file"], entry["line"], entry["column"]) == (str(path), 2, 7)
    assert document["instance"] == "tailstack score"


def test_ill_posed_geometry_is_3(call: Any, tmp_path: Path) -> None:
    path = str(write_json(tmp_path / "flat.json", coplanar_design()))
    for verb in ("validate", "score", "verify", "study linearity"):
        code, out, err = call(*verb.split(), path)
        assert (code, out.count("not valid")) == (3, int(verb == "validate"))
        assert "  hint: " in err
        assert "tailstack validate" in err.rpartition("\nnext: ")[2]


def test_a_defect_is_one_paragraph_and_3(call: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TAILSTACK_TRACEBACK", raising=False)
    monkeypatch.setattr("tailstack.scoring.score", Mock(side_effect=ZeroDivisionError("somewhere")))
    code, out, err = call("score", DEMO)
    assert (code, out) == (3, "")
    assert "ZeroDivisionError: somewhere" in err
    assert "TAILSTACK_TRACEBACK=1" in err
    assert json.loads(call("score", DEMO, "--json")[2])["type"] == "/v1/problems/internal-error"
    monkeypatch.setenv("TAILSTACK_TRACEBACK", "1")
    code, out, err = call("score", DEMO)
    assert (code, out) == (3, "")
    assert "Traceback" in err
    assert "ZeroDivisionError: somewhere" in err


def test_a_traceback_that_is_asked_for_changes_no_exit_code(
    call: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Above all not a gate's: a policy that cannot be read is 2, and 1 would say that the design fails."""
    policy = tmp_path / "policy.yaml"
    policy.write_text("rules: 3\n", encoding="utf-8")
    flat = str(write_json(tmp_path / "flat.json", coplanar_design()))
    nowhere = str(tmp_path / "nowhere.yaml")
    calls = (("gate", DEMO, "--policy", str(policy)), ("score", flat), ("score", nowhere))
    plain = [call(*arguments)[0] for arguments in calls]
    monkeypatch.setenv("TAILSTACK_TRACEBACK", "1")
    for arguments, code in zip(calls, plain, strict=True):
        again, _, err = call(*arguments)
        assert (again, "Traceback" in err) == (code, True)
    assert plain[:2] == [2, 3]


def test_a_standard_output_that_takes_nothing_is_told_as_that() -> None:
    """What a full disk says is no request that is not valid; --json has a type of its own for it."""
    with open("/dev/full", "wb") as full:
        plain = run_python("-m", "tailstack", "version", stdout=full)
        record = run_python("-m", "tailstack", "validate", "--json", DEMO, stdout=full)
    assert (plain.returncode, record.returncode) == (3, 3)
    assert "cannot write to standard output: No space left on device" in plain.stderr
    assert "next: make room or name another place, then repeat the command" in plain.stderr
    told = json.loads(record.stderr)
    assert (told["type"], told["status"]) == ("/v1/problems/cannot-write", 500)


@pytest.mark.parametrize("where", ["tailstack.scoring.score", "tailstack_service.cli.main.build_parser"])
def test_an_interrupt_is_130_at_work_and_while_the_command_is_read(
    where: str, call: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(where, Mock(side_effect=KeyboardInterrupt))
    code, out, err = call("score", DEMO)
    assert (code, out, err) == (130, "", "tailstack: interrupted\n")


def test_colour_only_on_a_terminal(call: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert "\x1b[" in call("score", DEMO)[1]
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[" not in call("score", DEMO)[1]


def test_doctor_finds_nothing_wrong(call: Any) -> None:
    code, out, _ = call("doctor")
    assert code == 0, out
    lines = out.replace("\n" + " " * 21, " ").splitlines()  # what is longer than 80 columns goes on below itself
    assert max(map(len, out.splitlines())) <= 80
    assert all(line.startswith("ok") for line in lines)
    (kernels,) = [line for line in lines if line.split()[1] == "kernels"]
    places = re.search(r"(\d+) kernels: (.*); for cpython 3\.\d+, numba .*, llvmlite .*, numpy 2\.\d+$", kernels)
    assert places is not None, kernels
    counts = re.findall(r"(\d+) (?:in /|installed, for|not compiled yet)", places[2])
    assert sum(map(int, counts)) == int(places[1]) > 20


# --- as people type it ----------------------------------------------------------------------------


def test_another_way_to_ask_is_answered(call: Any) -> None:
    for flag in ("--version", "-V", "version"):
        assert call(flag) == (0, "tailstack 0.1.0\n", "")
    code, out, _ = call("optimize", "--help")
    assert code == 0
    assert out.startswith("usage: tailstack optimise ")


def test_python_m_tailstack_is_the_command_and_hints_say_so() -> None:
    outside = {"PYTHONPATH": SOURCES, "PATH": ""}
    done = run_python("-P", "-m", "tailstack", "score", "nowhere.yaml", env=outside)
    assert done.returncode == 2
    assert done.stderr.startswith("tailstack score: the design document is not valid")
    assert "next: python -m tailstack init" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["scroe", DEMO], "tailstack: there is no verb 'scroe'; did you mean score?"),
        (["optimse", DEMO], "tailstack: there is no verb 'optimse'; did you mean optimise?"),
        (["zzzzzz"], "tailstack: there is no verb 'zzzzzz'"),
        (["compare", DEMO, DEMO], "tailstack: there is no verb 'compare'; did you mean report?"),
        (["score", DEMO, "--jsn"], "tailstack score: unrecognized arguments: --jsn; did you mean --json?"),
        (
            ["verify", DEMO, "--trails=5"],
            "tailstack verify: unrecognized arguments: --trails=5; did you mean --trials?",
        ),
        (["verify", DEMO, "--nonsense"], "tailstack verify: unrecognized arguments: --nonsense"),
        (["study", "veiws"], "did you mean views?"),
        (["jobs", "lits"], "(choose from list, show, follow, cancel); did you mean list?"),
        (["--json", "score", DEMO], "tailstack: flags stand after the verb; got --json before it"),
    ],
)
def test_a_slip_of_the_hand_is_answered_with_what_was_meant(call: Any, arguments: list[str], said: str) -> None:
    code, out, err = call(*arguments)
    assert (code, out) == (2, "")
    assert err.splitlines()[0].endswith(said)
    assert err.splitlines()[1].startswith("next: tailstack ")


@pytest.mark.parametrize(
    ("arguments", "following"),
    [([DEMO], "score"), ([DEMO, "verify"], "verify"), (["parts/none.yml", "--json"], "score")],
)
def test_a_design_without_a_verb_is_answered_with_the_command(call: Any, arguments: list[str], following: str) -> None:
    code, out, err = call(*arguments)
    assert (code, out) == (2, "")
    assert err.splitlines() == [
        f"tailstack: {arguments[0]!r} is a file, and no verb stands before it",
        f"next: tailstack {following} {arguments[0]}   (all verbs: tailstack --help)",
    ]


# --- numbers --------------------------------------------------------------------------------------


def test_numbers_are_taken_as_people_type_them(call: Any) -> None:
    for typed in ("20000", "2e4", "20_000", "2.0e4", "+20000"):
        code, out, _ = call("verify", DEMO, "--trials", typed, "--seed", "1", "--json")
        assert code in (0, 1)
        assert json.loads(out)["trials"] == 20000
    for typed in ("0.05", "5%", "5e-2", "5.0 %"):
        assert number({"ge": 1e-4, "lt": 1})(typed) == 0.05
    code, out, _ = call("verify", DEMO, "--precision", "5%", "--json")
    assert code in (0, 1, 4)
    assert out == call("verify", DEMO, "--precision", "0.05", "--json")[1]
    seed: Any = whole(0, 2**63 - 1)
    assert seed("9223372036854775807") == 2**63 - 1


def test_what_is_no_number_is_refused_with_its_cure(refused: Any, call: Any) -> None:
    for typed in ("1.5", "1e-3", "1e999999999", "nan", "inf", "many", "1%", "0x10", "", "1,000"):
        assert f"argument --trials: expected a whole number; got {typed!r}" in refused(
            "verify", DEMO, "--trials", typed
        )
    for typed, said in (
        ("5", "below 1; got 5 (5 per cent is written 5%)"),
        ("200%", "below 1; got 200%"),
        ("nan", "a number; got 'nan'"),
    ):
        assert said in refused("verify", DEMO, "--precision", typed)
    for typed in ("5", "5%"):
        _, _, err = call("gate", DEMO, "--max-regression", typed)
        assert "--baseline" in err
    assert "expected a number of per cent; got 'five'" in call("gate", DEMO, "--max-regression", "five")[2]
