"""A designer who wants a bad design through the gate: each test is a way to try, and what the gate says of it.

Designs are plain data that is changed as an author would change it; what is expected is read from what was changed.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from gate_scenes import TODAY, judge_files, of_rule, plain_record, policy, write_documents
from service_scenes import ROOT, sound_design
from test_gate_verdicts import waiver, waivers

from tailstack_service.cli.main import main

JUDGING = ("p95", "cvar", "exceedance", "per-unit-yield")
EVERY = (
    *JUDGING, "first-order-gap", "conditioning", "fiducial-spacing", "visibility", "overlap", "process-capability",
    "process-unused", "regression", "limit-relaxed", "not-compared", "class-relaxed", "class-unused",
    "waiver-unused", "waiver-wide", "model-version",
)  # fmt: skip
PROMISE = {"name": "tip-accuracy", "limit_mm": 1.4}  # mm; the small design keeps it with a P95 of about 0.65
TWO = [{"name": "tip", "position_mm": [0, 0, 70]}, {"name": "side", "position_mm": [20, 0, 60]}]


def design(*requirements: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return sound_design(requirements=list(requirements) or None, optimise=None, **changes)


def baseline(*requirements: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """The record of a gate that the honest design passes."""
    record = judge_files({"guide.yaml": design(*(requirements or (PROMISE,)), **changes)})
    assert record.exit_code == 0
    return plain_record(record)


# --- nothing is judged ----------------------------------------------------------------------------


@pytest.mark.parametrize("rules", [EVERY, JUDGING, ("p95",)], ids=["every rule", "what judges", "the one it needs"])
def test_a_policy_that_switches_off_what_would_judge_does_not_pass(rules: tuple[str, ...]) -> None:
    off = {name: {"severity": "off"} for name in rules}
    record = judge_files({"guide.yaml": design({**PROMISE, "limit_mm": 0.01})}, policy=policy(off))
    assert (record.verdict, record.exit_code) == ("not evaluated", 3)
    (finding,) = of_rule(record, "not-evaluated")
    assert "p95 is off" in finding.message
    (named,) = of_rule(record, "not-judged")
    assert "tip-accuracy (P95 of the error at the tool within 0.01 mm) was not judged" in named.message
    (left,) = record.designs[0].not_judged
    assert (left.requirement, left.target, left.rule) == ("tip-accuracy", "tip", "p95")


def test_a_class_that_switches_off_what_would_judge_does_not_pass_and_is_a_finding_of_the_policy() -> None:
    classes = [{"name": "prototypes", "files": ["p/*"], "rules": {"p95": {"severity": "off"}}}]
    bad = design({**PROMISE, "limit_mm": 0.01})
    record = judge_files({"p/guide.yaml": bad, "guide.yaml": design(PROMISE)}, policy=policy(classes=classes))
    assert [entry.verdict for entry in record.designs] == ["not evaluated", "pass"]
    assert record.exit_code == 3
    (finding,) = of_rule(record, "class-relaxed")
    assert (finding.file, finding.pointer) == ("policy", "/classes/0/rules/p95/severity")
    assert finding.severity == "warning"
    assert "class prototypes: p95 is off" in finding.message
    assert "p/guide.yaml" in finding.message


def test_a_trivial_second_requirement_does_not_hide_the_one_that_is_not_judged() -> None:
    """One requirement per unit is judged, so there is a verdict; the other one is named in the record."""
    easy = {"name": "easy", "limit_mm": 50.0, "risk": "per_unit", "min_yield": 0.5}
    bad = design({**PROMISE, "limit_mm": 0.01}, easy)
    off = policy({"p95": {"severity": "off"}})
    record = judge_files({"guide.yaml": bad}, policy=off)
    assert record.exit_code == 0
    (finding,) = of_rule(record, "not-judged")
    assert (finding.severity, finding.pointer) == ("warning", "/requirements/0")
    assert [entry.requirement for entry in record.designs[0].not_judged] == ["tip-accuracy"]
    assert judge_files({"guide.yaml": bad}, policy=off, fail_level="warning").exit_code == 1
    strict = policy({"p95": {"severity": "off"}, "not-judged": {"severity": "error"}})
    assert judge_files({"guide.yaml": bad}, policy=strict).exit_code == 1


def test_a_target_that_no_requirement_is_about_is_named() -> None:
    record = judge_files({"guide.yaml": design({**PROMISE, "targets": ["tip"]}, targets=TWO)})
    (finding,) = of_rule(record, "not-judged")
    assert (finding.severity, finding.pointer) == ("note", "/targets")
    assert "at target side" in finding.message
    assert record.exit_code == 0
    limited = policy({"p95": {"limit_mm": 5.0}})
    assert not of_rule(judge_files({"guide.yaml": design(PROMISE, targets=TWO)}, policy=limited), "not-judged")


# --- the design sets its own bar ------------------------------------------------------------------


def changed(**fields: Any) -> dict[str, Any]:
    return {**PROMISE, **fields}


@pytest.mark.parametrize(
    ("before", "after", "pointer", "words"),
    [
        (PROMISE, [changed(limit_mm=50.0)], "/requirements/0/limit_mm", "limit raised from 1.4 to 50 mm"),
        (PROMISE, [changed(quantile=0.5)], "/requirements/0/quantile", "quantile lowered from 0.95 to 0.5"),
        (PROMISE, [changed(confidence=0.5)], "/requirements/0/confidence", "confidence lowered from 0.95 to 0.5"),
        (PROMISE, [changed(error="localisation")], "/requirements/0/error", "was about the tcp error"),
        (PROMISE, [changed(name="other", limit_mm=50.0)], "/requirements", "the requirement went at target tip"),
        (PROMISE, [changed(risk="per_unit", min_yield=0.5)], "/requirements/0", "judged under per-unit-yield now"),
        (
            changed(risk="per_unit", min_yield=0.9), [changed(risk="per_unit", min_yield=0.2)],
            "/requirements/0/min_yield", "yield lowered from 0.9 to 0.2",
        ),
        (
            changed(risk="per_unit", min_yield=0.9), [changed(risk="per_unit", min_yield=0.9, limit_mm=50.0)],
            "/requirements/0/limit_mm", "limit raised from 1.4 to 50 mm",
        ),
        (
            changed(risk="per_unit", min_yield=0.9), [changed(risk="per_mounting", min_yield=0.9)],
            "/requirements/0/risk", "it is read per_mounting, and was read per_unit",
        ),
        (
            PROMISE, [changed(limit_mm=50.0), changed(name="decoy", error="localisation")],
            "/requirements/0/limit_mm", "limit raised from 1.4 to 50 mm",
        ),
    ],
)  # fmt: skip
def test_a_requirement_that_asks_for_less_than_in_the_baseline_fails(
    before: dict[str, Any], after: list[dict[str, Any]], pointer: str, words: str
) -> None:
    record = judge_files({"guide.yaml": design(*after)}, baseline=baseline(before))
    (finding,) = of_rule(record, "limit-relaxed")
    assert (finding.severity, finding.pointer) == ("error", pointer)
    assert words in finding.message
    assert (record.verdict, record.exit_code) == ("fail", 1)


AS_MUCH = {
    "the same": [PROMISE],
    "a tighter limit": [changed(limit_mm=1.0)],
    "a higher quantile": [changed(quantile=0.99)],
    "renamed": [changed(name="another name")],
    "implied by another": [changed(name="tighter", limit_mm=1.3), changed(limit_mm=50.0)],
    "its only target by name": [changed(targets=["tip"])],
}


@pytest.mark.parametrize("after", AS_MUCH.values(), ids=[*AS_MUCH])
def test_what_asks_for_as_much_or_more_is_no_finding(after: list[dict[str, Any]]) -> None:
    record = judge_files({"guide.yaml": design(*after)}, baseline=baseline(PROMISE))
    assert not of_rule(record, "limit-relaxed")
    assert record.exit_code == 0


@pytest.mark.parametrize(
    ("after", "pointer", "words"),
    [
        (design(changed(targets=["side"]), targets=TWO), "/requirements/0/targets", "not asked for any more at target"),
        (design(PROMISE, targets=TWO[1:]), "/targets", "no error at target tip"),
        (design(PROMISE, targets=[{"name": "tip", "position_mm": [0, 0, 10]}, TWO[1]]), "/targets/0",
         "by up to 60 mm, at target tip"),
    ],
    ids=["of all it keeps one", "one went", "one moved"],
)  # fmt: skip
def test_a_target_that_is_kept_no_longer_fails(after: dict[str, Any], pointer: str, words: str) -> None:
    record = judge_files({"guide.yaml": after}, baseline=baseline(PROMISE, targets=TWO))
    (finding,) = of_rule(record, "limit-relaxed")
    assert (finding.pointer, record.exit_code) == (pointer, 1)
    assert words in finding.message


@pytest.mark.parametrize("after", [{"limit_mm": 50.0}, {}, {"limit_mm": 1.4, "severity": "note"}])
def test_a_limit_of_the_policy_that_was_relaxed_fails(after: dict[str, Any]) -> None:
    """In the same merge request as the design: the baseline knows both."""
    bare = {"guide.yaml": design(changed(limit_mm=1.4))}
    strict = policy({"p95": {"limit_mm": 1.3}, "cvar": {"limit_mm": 2.0}})
    before = plain_record(judge_files(bare, policy=strict))
    record = judge_files(bare, policy=policy({"p95": after, "cvar": {"limit_mm": 2.0}}), baseline=before)
    assert record.exit_code == 1
    assert any(finding.message.startswith("p95 (") for finding in of_rule(record, "limit-relaxed"))
    record = judge_files(bare, policy=policy({"p95": {"limit_mm": 1.3}}), baseline=before)
    assert ["cvar" in finding.message for finding in of_rule(record, "limit-relaxed")] == [True]


def test_switching_a_rule_off_against_a_baseline_fails_even_where_something_else_is_judged() -> None:
    both = design(PROMISE, {"name": "units", "limit_mm": 50.0, "risk": "per_unit", "min_yield": 0.5})
    before = plain_record(judge_files({"guide.yaml": both}))
    record = judge_files({"guide.yaml": both}, policy=policy({"p95": {"severity": "off"}}), baseline=before)
    (finding,) = of_rule(record, "limit-relaxed")
    assert "rule p95 counts as off, and counted as error" in finding.message
    assert record.exit_code == 1


# --- renamed --------------------------------------------------------------------------------------


def relaxed_and_renamed(**more: Any) -> dict[str, Any]:
    return design(changed(limit_mm=50.0), **{"name": "something else entirely", **more})


def test_a_renamed_file_is_compared_by_what_the_design_consists_of() -> None:
    """File, name and requirements are changed, and one bead by a hair."""
    record = judge_files({"new.yaml": relaxed_and_renamed()}, baseline=baseline())
    assert record.exit_code == 1
    assert "limit raised" in of_rule(record, "limit-relaxed")[0].message
    (said,) = of_rule(record, "not-compared")
    assert (said.severity, "compared with guide.yaml" in said.message) == ("note", True)

    nudged = relaxed_and_renamed()
    nudged["fiducials"]["points"][0]["position_mm"][0] += 1e-6
    assert judge_files({"new.yaml": nudged}, baseline=baseline()).exit_code == 1


def shifted(name: str) -> dict[str, Any]:
    """Another design: its beads lie 2 mm beside."""
    other = design(PROMISE, name=name)
    for point in other["fiducials"]["points"]:
        point["position_mm"][0] += 2.0
    return other


def unlike_any_other(target: str = "tip") -> dict[str, Any]:
    """File, name and limit, and every section by something."""
    other = relaxed_and_renamed()
    for point in other["fiducials"]["points"]:
        point["position_mm"][2] -= 3.0
    for view in other["views"]:
        view["fiducial_noise_px"] = 0.29
    other["targets"][0]["position_mm"][2] += 1.0
    other["targets"][0]["name"] = target
    del other["interfaces"]
    return other


def test_a_limit_is_not_got_rid_of_by_changing_everything_a_little() -> None:
    """File and design renamed, each section moved by 1e-9: a limit of 50 passed with two warnings."""
    nudged = relaxed_and_renamed()
    for point in nudged["fiducials"]["points"]:
        point["position_mm"] = [value + 1e-9 for value in point["position_mm"]]
    for view in nudged["views"]:
        view["fiducial_noise_px"] += 1e-9
    nudged["targets"][0]["position_mm"][2] += 1e-9
    for changed_design in (nudged, unlike_any_other()):
        record = judge_files({"new.yaml": changed_design}, baseline=baseline())
        assert record.exit_code == 1
        assert next(finding.severity for finding in of_rule(record, "limit-relaxed")) == "error"
        (said,) = of_rule(record, "not-compared")
        assert (said.severity, "compared with guide.yaml" in said.message) == ("note", True)


def test_where_one_file_went_and_one_came_it_is_that_one() -> None:
    """Even with another name of the target: its limit went with it."""
    record = judge_files({"new.yaml": unlike_any_other("probe")}, baseline=baseline())
    assert record.exit_code == 1
    assert of_rule(record, "limit-relaxed")


def test_a_design_that_is_found_nowhere_says_so_and_warns_if_one_went() -> None:
    other = unlike_any_other("probe")
    two = plain_record(judge_files({"guide.yaml": design(PROMISE), "second.yaml": shifted("second")}))
    record = judge_files({"new.yaml": other}, baseline=two)
    note, said = of_rule(record, "not-compared")
    assert (note.severity, note.file) == ("note", "new.yaml")
    assert "nothing was compared" in note.message
    assert (said.severity, said.file, said.pointer) == ("warning", "baseline", "/designs/0")
    assert said.message.startswith("guide.yaml, second.yaml: judged in the baseline and not here")
    assert said.message.endswith("or changed beyond recognition and called new.yaml")
    assert judge_files({"new.yaml": other}, baseline=two, fail_level="warning").exit_code == 1
    both = judge_files({"new.yaml": other, "guide.yaml": design(PROMISE)}, baseline=baseline())
    (said,) = of_rule(both, "not-compared")
    assert (said.severity, said.file) == ("note", "new.yaml"), "nothing went: this one is new"


def test_a_design_whose_file_is_still_there_was_not_renamed() -> None:
    """Before a commit only the changed files are judged: a new variant is not taken for the one that it is made of."""
    record = judge_files({"variant.yaml": relaxed_and_renamed()}, baseline=baseline(), present=["guide.yaml"])
    assert record.exit_code == 0
    assert [finding.severity for finding in of_rule(record, "not-compared")] == ["note"]


def test_a_design_that_nobody_judges_any_more_is_missed(tmp_path: Path) -> None:
    """Renamed to what the pattern of the pipeline does not match, or removed."""
    other = shifted("another")
    both = {"guide.yaml": design(PROMISE), "other.yaml": other}
    before = plain_record(judge_files(both))
    record = judge_files({"guide.yaml": design(PROMISE)}, baseline=before)
    (said,) = of_rule(record, "not-compared")
    assert (said.file, said.pointer, said.severity) == ("baseline", "/designs/1", "warning")
    assert said.message.startswith("other.yaml: judged in the baseline and not here")
    assert (record.verdict, record.exit_code) == ("pass", 0)
    assert judge_files({"guide.yaml": design(PROMISE)}, baseline=before, fail_level="warning").exit_code == 1
    assert judge_files({"guide.yaml": design(PROMISE)}, baseline=before, present=["other.yaml"]).findings == ()
    renamed = judge_files({"guide.yaml": design(PROMISE), "b.yaml": other}, baseline=before)
    assert [finding.severity for finding in of_rule(renamed, "not-compared")] == ["note"]
    with contextlib.chdir(tmp_path):
        write_documents(tmp_path, {**both, "policy.yaml": policy()})
        options = ("--policy=policy.yaml", "--mode=analytic", "--fail-level=warning")
        assert main(["gate", "*e.yaml", "other.yaml", *options[:2], "--format=json=base.json"]) == 0
        assert main(["gate", "guide.yaml", *options, "--baseline=base.json"]) == 0, "the other file is still there"
        Path("other.yaml").rename("other.yml")
        assert main(["gate", "*e.yaml", *options, "--baseline=base.json"]) == 1


def test_a_class_that_weakens_or_takes_a_limit_away_is_a_finding() -> None:
    limits = {"cvar": {"limit_mm": 9.0}, "survives-loss": {"lost": 1}, "reliability": {"max_effect_mm": 9.0}}
    taken_away = {"cvar": {"limit_mm": None}, "survives-loss": {"lost": None}, "reliability": {"max_effect_mm": None}}
    classes = [
        {"name": "weak", "files": ["w*"], "rules": {"p95": {"severity": "warning"}, **taken_away}},
        {"name": "nobody", "files": ["x*"], "rules": {"p95": {"severity": "off"}}},
    ]
    rules = policy(limits, classes=classes)
    found = of_rule(judge_files({"weak.yaml": design(PROMISE)}, policy=rules), "class-relaxed")
    assert [(finding.pointer, finding.severity) for finding in found] == [
        ("/classes/0/rules/cvar/limit_mm", "warning"),
        ("/classes/0/rules/p95/severity", "note"),
        ("/classes/0/rules/reliability/max_effect_mm", "warning"),
        ("/classes/0/rules/survives-loss/lost", "warning"),
    ]


# --- waivers --------------------------------------------------------------------------------------


def wide(entry: dict[str, Any], limit_mm: float = 0.5, **more: Any) -> list[str]:
    """Messages about one waiver of a design whose P95 is about 0.65 mm."""
    given = waivers(waiver(**{"designs": ["guide.yaml"], "max_value": 0.9, **entry}))
    files = {"guide.yaml": design(changed(limit_mm=limit_mm), name="drill guide, rev C")}
    record = judge_files(files, waivers=given, **more)
    found = of_rule(record, "waiver-wide")
    assert {finding.severity for finding in found} <= {"warning"}
    return [f"{finding.pointer}: {finding.message}" for finding in found]


def test_a_waiver_is_wide_where_it_names_no_design() -> None:
    for designs in (None, ["*"], ["*.yaml"], ["designs/*", "guide.yaml"], ["?*.y*ml"], ["g*"]):
        said = wide({"designs": designs})
        assert any("names no design" in words for words in said), said
    for designs in (["guide.yaml"], ["designs/guide-*.yaml", "guide.yaml"], ["guid?.yaml"]):
        assert wide({"designs": designs}) == []


def test_a_waiver_far_beyond_the_limit_or_the_value_is_wide() -> None:
    (said,) = wide({"max_value": 0.9}, limit_mm=0.4)
    assert said.startswith("/waivers/0/max_value: ")
    assert "0.9 mm is beyond 2 times the limit, 0.4 mm" in said
    (said,) = wide({"max_value": 1.15}, limit_mm=0.6)
    assert "beyond 1.5 times what it accepts now, 0.6" in said
    assert len(wide({"max_value": 1e6})) == 2
    (said,) = wide({"max_value": 50.0}, limit_mm=1.4)
    assert "beyond 2 times the limit" in said, "it accepts nothing yet"
    loose = policy({"waiver-wide": {"max_limit_ratio": 1e6, "max_value_ratio": 1e6}})
    assert wide({"max_value": 50.0}, policy=loose) == []


def test_waivers_of_percent_and_of_what_must_not_be_small() -> None:
    """closed form: 100 % above is twice a P95; half of a distance is twice too near."""
    worse = design(PROMISE)
    for view in worse["views"]:
        view["fiducial_noise_px"], view["target_noise_px"] = 0.6, 0.6

    def said(rule: dict[str, Any], files: dict[str, Any], **more: Any) -> list[str]:
        given = waivers(waiver(**{"rule": "regression", "designs": ["guide.yaml"], **rule}))
        return [finding.message for finding in of_rule(judge_files(files, waivers=given, **more), "waiver-wide")]

    rises = judge_files({"guide.yaml": worse}, baseline=baseline())
    percent = of_rule(rises, "regression")[0].value
    assert 5 < percent < 29
    for times, wide_at in ((1.45, False), (1.55, True)):  # of a P95 that is percent more than it was
        told = said({"max_value": times * (100 + percent) - 100}, {"guide.yaml": worse}, baseline=baseline())
        assert ["is beyond 1.5 times what it accepts now" in words for words in told] == wide_at * [True]
    (words,) = said({"max_value": 101.0}, {"guide.yaml": worse}, baseline=baseline())[:1]
    assert "max_value 101 % is beyond 2 times the limit, 0 %" in words
    near = {"rule": "overlap", "max_value": None, "min_value": 12.0}
    strict = policy({"overlap": {"severity": "error", "min_px": 21.0}})
    assert said(near, {"guide.yaml": design(PROMISE)}, policy=strict) == []
    (words,) = said({**near, "min_value": 10.2}, {"guide.yaml": design(PROMISE)}, policy=strict)
    assert "min_value 10.2 px is beyond 2 times the limit, 21 px" in words


# --- the example ----------------------------------------------------------------------------------


def test_the_examples_repository_refuses_what_its_readme_tries(tmp_path: Path) -> None:
    folder = ROOT / "examples" / "ci-gate"
    for name in ("pass.yaml", "waived.yaml", "policy.yaml", "waivers.yaml"):
        (tmp_path / name).write_text((folder / name).read_text(encoding="utf-8"), encoding="utf-8")
    policy_ = ("--policy=policy.yaml", "--mode=analytic")
    with contextlib.chdir(tmp_path), patch("tailstack_service.cli.gate.today", lambda: TODAY):
        assert main(["gate", "pass.yaml", *policy_, "--format=json=baseline.json"]) == 0
        text = Path("pass.yaml").read_text(encoding="utf-8")
        assert text.count("limit_mm: 0.8") == 1
        Path("pass.yaml").write_text(text.replace("limit_mm: 0.8", "limit_mm: 50"), encoding="utf-8")
        assert main(["gate", "pass.yaml", *policy_]) == 0
        assert main(["gate", "pass.yaml", *policy_, "--baseline=baseline.json"]) == 1
        assert main(["gate", "waived.yaml", *policy_, "--waivers=waivers.yaml", "--on-inconclusive=warn"]) == 0
        wide_ = Path("waivers.yaml").read_text(encoding="utf-8").replace("max_value: 0.95", "max_value: 9.5")
        Path("waivers.yaml").write_text(wide_, encoding="utf-8")
        assert main(["gate", "waived.yaml", *policy_, "--waivers=waivers.yaml", "--on-inconclusive=warn"]) == 1
