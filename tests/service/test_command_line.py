"""The command line as people expect it: the version, spellings, slips of the hand, and numbers as they are typed."""

from __future__ import annotations

import json
from typing import Any

import pytest
from service_scenes import EXAMPLES

from family import SOURCES, run_python

DEMO = str(EXAMPLES / "demo.yaml")


@pytest.mark.parametrize("flag", ["--version", "-V", "version"])
def test_the_version_is_printed_on_every_way_to_ask(call: Any, flag: str) -> None:
    assert call(flag) == (0, "tailstack 0.1.0\n", "")


def test_python_m_tailstack_is_the_command_and_hints_say_so() -> None:
    outside = {"PYTHONPATH": SOURCES, "PATH": ""}
    done = run_python("-P", "-m", "tailstack", "score", "nowhere.yaml", env=outside)
    assert done.returncode == 2
    assert done.stderr.startswith("tailstack score: the design document is not valid")
    assert "next: python -m tailstack init" in done.stderr


def test_optimize_is_optimise(call: Any) -> None:
    code, out, _ = call("optimize", "--help")
    assert code == 0
    assert out.startswith("usage: tailstack optimise ")


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


@pytest.mark.parametrize("typed", ["20000", "2e4", "20_000", "2.0e4", "+20000"])
def test_a_count_is_taken_as_people_type_it(call: Any, typed: str) -> None:
    code, out, _ = call("verify", DEMO, "--trials", typed, "--seed", "1", "--json")
    assert code in (0, 1)
    assert json.loads(out)["trials"] == 20000


@pytest.mark.parametrize("typed", ["1.5", "1e-3", "1e999999999", "nan", "inf", "many", "1%", "0x10", "", "1,000"])
def test_what_is_no_count_is_refused_at_once(call: Any, typed: str) -> None:
    code, _, err = call("verify", DEMO, "--trials", typed)
    assert code == 2
    assert f"argument --trials: expected a whole number; got {typed!r}" in err


@pytest.mark.parametrize("typed", ["0.05", "5%", "5e-2", "5.0 %"])
def test_a_fraction_is_taken_in_per_cent_as_well(typed: str) -> None:
    from tailstack_service.console.arguments import number

    assert number({"ge": 1e-4, "lt": 1})(typed) == 0.05


def test_five_per_cent_reach_the_check(call: Any) -> None:
    code, out, _ = call("verify", DEMO, "--precision", "5%", "--json")
    assert code in (0, 1, 4)
    assert out == call("verify", DEMO, "--precision", "0.05", "--json")[1]


def test_whole_seeds_keep_every_digit() -> None:
    from tailstack_service.console.arguments import whole

    seed: Any = whole(0, 2**63 - 1)
    assert seed("9223372036854775807") == 2**63 - 1


@pytest.mark.parametrize(
    ("typed", "said"),
    [("5", "below 1; got 5 (5 per cent is written 5%)"), ("200%", "below 1; got 200%"), ("nan", "a number; got 'nan'")],
)
def test_a_number_beside_a_fraction_is_refused_with_its_cure(call: Any, typed: str, said: str) -> None:
    code, _, err = call("verify", DEMO, "--precision", typed)
    assert code == 2
    assert said in err.splitlines()[0]


def test_a_gate_takes_its_per_cent_with_the_sign(call: Any) -> None:
    for typed in ("5", "5%"):
        _, _, err = call("gate", DEMO, "--max-regression", typed)
        assert "--baseline" in err
    assert "expected a number of per cent; got 'five'" in call("gate", DEMO, "--max-regression", "five")[2]


def test_over_http_a_count_stays_strict() -> None:
    from pydantic import ValidationError

    from tailstack_service.operations.options import CheckOptions

    with pytest.raises(ValidationError):
        CheckOptions.model_validate({"trials": "1e6"})
