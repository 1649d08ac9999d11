"""The gate as a pure function: verdicts, exit codes, findings at their lines, waivers, baseline, fail closed."""

from __future__ import annotations

import copy
import re
from itertools import combinations
from math import cos, dist, sin
from typing import Any, get_args

import pytest
import yaml
from gate_scenes import TODAY, judge_files, of_rule, plain_record, policy
from service_scenes import EXAMPLES, coplanar_design, limited, small_design, sound_design

from plain_data import problems_of, read_cases
from tailstack import load_design, score, verify
from tailstack.design import design_to_data
from tailstack.design.plausibility import PLAUSIBILITY
from tailstack.design.write import data_to_yaml
from tailstack.errors import LimitError, TailstackError
from tailstack_service.gate.judge import judge
from tailstack_service.gate.policy import Implausible, Rules
from tailstack_service.gate.reading import GateError
from tailstack_service.gate.records import GateFinding, GateRecord
from tailstack_service.gate.request import admit_gate, read_gate
from tailstack_service.gate.rules import RULES
from tailstack_service.problems import RefusedAt, RequestError

P95 = score(load_design(sound_design())).targets[0].p95_mm


def bare() -> dict[str, Any]:
    """The small design without a requirement of its own."""
    return sound_design(requirements=None, optimise=None)


def waivers(*entries: dict[str, Any]) -> dict[str, Any]:
    return {"schema": "tailstack/waivers/1", "waivers": list(entries)}


def waiver(**changes: Any) -> dict[str, Any]:
    entry = {"rule": "p95", "owner": "J. Doe", "reason": "first article", "max_value": 2 * P95, "expires": "2026-12-31"}
    return {key: value for key, value in {**entry, **changes}.items() if value is not None}


def gate(*designs: dict[str, Any] | str, **more: Any) -> GateRecord:
    return judge_files({f"d{k}.yaml": design for k, design in enumerate(designs)}, **more)


def noisier(factor: float, **changes: Any) -> dict[str, Any]:
    design = limited(3 * P95, **changes)
    for view in design["views"]:
        view["fiducial_noise_px"] *= factor
        view["target_noise_px"] *= factor
    return design


@pytest.mark.parametrize(
    ("factor", "more", "verdict", "code"),
    [
        (1.0, {"on_inconclusive": "fail"}, "inconclusive", 1),
        (1.0, {"on_inconclusive": "warn", "fail_level": "warning"}, "inconclusive", 1),
        (1.0, {"policy": policy({"inconclusive": {"severity": "warning"}})}, "inconclusive", 0),
        (0.5, {"policy": policy({"p95": {"severity": "warning"}})}, "pass", 0),
        (0.5, {"policy": policy({"p95": {"severity": "warning"}}), "fail_level": "warning"}, "fail", 1),
    ],
)
def test_exit_codes(factor: float, more: dict[str, Any], verdict: str, code: int) -> None:
    """Those of a gate that is asked for nothing more are in the golden files (test_gate_formats.py)."""
    record = gate(limited(factor * P95), **more)
    assert (record.verdict, record.exit_code) == (verdict, code)


def test_a_finding_stands_at_the_line_of_the_limit_and_names_what_is_to_blame() -> None:
    text = data_to_yaml(limited(0.5 * P95))
    (finding,) = of_rule(gate(text), "p95")
    lines = text.splitlines()
    assert lines[finding.line - 1][finding.column - 1 :].startswith(f"{0.5 * P95:.6g}"[:5])
    assert "limit_mm" in lines[finding.line - 1]
    lines_of_budget = [c for c in score(load_design(sound_design())).targets[0].contributors if c.component != "all"]
    heaviest = max(lines_of_budget, key=lambda line: line.variance_share)
    assert heaviest.name in finding.message
    assert finding.value == pytest.approx(P95, rel=1e-12)


def test_findings_of_plain_data_have_a_pointer_and_no_line() -> None:
    (finding,) = of_rule(gate(limited(0.5 * P95)), "p95")
    assert (finding.pointer, finding.line, finding.column) == ("/requirements/0/limit_mm", None, None)


@pytest.mark.parametrize("name", ["p95", "cvar", "exceedance", "policy p95"])
def test_a_requirement_may_be_called_like_a_rule(name: str) -> None:
    own = {"name": name, "error": "localisation", "quantile": 0.9, "limit_mm": 0.01}
    record = gate(sound_design(requirements=[own]), policy=policy({"p95": {"limit_mm": 0.02}}))
    stated, of_the_policy = of_rule(record, "p95")
    assert stated.pointer == "/requirements/0/limit_mm"
    assert stated.message.startswith(f"{name}, target tip: P90 of the error of the located target is ")
    assert of_the_policy.pointer == "/targets/0"
    assert of_the_policy.message.startswith("p95, target tip: P95 of the error at the tool is ")


def test_nothing_to_judge_and_a_text_that_is_no_path_are_no_pass() -> None:
    record = gate(bare())
    assert (record.verdict, record.exit_code) == ("not evaluated", 3)
    assert [finding.rule for finding in record.findings] == ["not-evaluated"]
    with pytest.raises(RefusedAt, match="a mapping of fields"):
        admit_gate({"designs": [{"file": "x", "text": "/etc/hostname"}]}, today=TODAY)
    body = {"designs": [{"file": "d.yaml", "design": limited(1.0)}] * 3}
    with pytest.raises(LimitError, match="2 designs at most"):
        admit_gate(body, today=TODAY, max_designs=2)


def test_a_design_that_determines_nothing_leaves_with_3_whatever_the_others_do() -> None:
    record = gate(limited(1.5 * P95), coplanar_design(), limited(0.5 * P95))
    assert (record.verdict, record.exit_code) == ("not evaluated", 3)
    assert [design.verdict for design in record.designs] == ["pass", "not evaluated", "fail"]
    (finding,) = of_rule(record, "not-evaluated")
    assert "one plane" in finding.message
    assert finding.file == "d1.yaml"


def test_an_invalid_design_is_refused_at_the_door_and_found_by_the_gate() -> None:
    request = {"designs": [{"file": "bad.yaml", "text": "schema: tailstack/design/1\nname: x\nviews: 3\n"}]}
    problems = problems_of(admit_gate, request, today=TODAY, error=RefusedAt)
    assert any(problem.pointer == "/designs/0/text/views" and problem.line == 3 for problem in problems)
    record = judge(read_gate({**request, "today": "2026-11-21", "mode": "analytic"}))
    assert (record.verdict, record.exit_code) == ("not evaluated", 2)
    assert {finding.rule for finding in record.findings} == {"invalid-design"}
    assert any(finding.line == 3 for finding in record.findings)


def test_limits_of_the_policy_are_held_against_every_target() -> None:
    design = bare()
    failing = gate(design, policy=policy({"p95": {"limit_mm": 0.5 * P95}}))
    assert [finding.pointer for finding in of_rule(failing, "p95")] == ["/targets/0"]
    passing = gate(design, policy=policy({"p95": {"limit_mm": 2 * P95}}))
    assert (passing.verdict, passing.exit_code) == ("pass", 0)


def test_an_exceedance_is_the_quantile_of_its_complement() -> None:
    # closed form of the same question: P(|e| > limit) from the score of a design whose limit that is
    beyond = score(load_design(limited(P95))).targets[0].exceedance_probability
    assert beyond == pytest.approx(0.05, rel=1e-3)
    failing = gate(bare(), policy=policy({"exceedance": {"limit_mm": P95, "max_probability": 0.03}}))
    passing = gate(bare(), policy=policy({"exceedance": {"limit_mm": P95, "max_probability": 0.08}}))
    assert (failing.exit_code, passing.exit_code) == (1, 0)


def test_cvar_is_judged_with_an_interval_that_holds_the_truth() -> None:
    """independent: CVaR of a tenfold longer check with another seed lies within the interval of the gate's."""
    record = gate(bare(), mode="verify", policy=policy({"cvar": {"limit_mm": 5 * P95}}))
    (number,) = [number for number in record.designs[0].numbers if number.rule == "cvar"]
    truth = verify(load_design(sound_design()), trials=10 * record.designs[0].trials, seed=99).targets[0].cvar95_mm
    assert number.interval[0] < truth < number.interval[1]
    assert number.interval[1] - number.interval[0] < 0.1 * number.value
    assert number.status == "pass"


def test_distances_are_those_of_the_document() -> None:
    design = limited(2 * P95)
    points = [point["position_mm"] for point in design["fiducials"]["points"]]
    first, second, *_ = distances = sorted(dist(a, b) for a, b in combinations(points, 2))
    between = (first + second) / 2 if second > first + 1e-9 else first + 1e-6
    record = gate(design, policy=policy({"fiducial-spacing": {"min_mm": between}}))
    found = of_rule(record, "fiducial-spacing")
    assert len(found) == sum(distance < between for distance in distances)
    assert found[0].value == pytest.approx(first, rel=1e-12)
    assert record.exit_code == 1


@pytest.mark.parametrize(("over", "words"), [(0, None), (1, "1 more pair is closer"), (7, "7 more pairs are closer")])
def test_pairs_that_are_not_told_are_counted(over: int, words: str | None) -> None:
    """independent: all distances of the small design, sorted; the limit lies between the last that is too close and the
    next."""
    design = limited(2 * P95)
    for k, point in enumerate(design["fiducials"]["points"]):  # no two distances alike
        point["position_mm"] = [x + 0.31 * (k * k * i % 7) for i, x in enumerate(point["position_mm"], 1)]
    points = [point["position_mm"] for point in design["fiducials"]["points"]]
    distances = sorted(dist(a, b) for a, b in combinations(points, 2))
    assert distances[10 + over] - distances[9 + over] > 1e-3
    least = (distances[9 + over] + distances[10 + over]) / 2
    record = gate(design, policy=policy({"fiducial-spacing": {"min_mm": least}}))
    found = of_rule(record, "fiducial-spacing")
    assert [finding.value for finding in found[:10]] == pytest.approx(distances[:10])
    assert [finding.severity for finding in found] == ["error"] * 10 + ["note"] * (over > 0)
    if words is not None:
        assert found[10].message == f"{words} than {least:g} mm; told are the 10 closest"
        assert (found[10].pointer, found[10].value) == ("/fiducials/points", None)
    accepted = waiver(rule="fiducial-spacing", max_value=None, min_value=distances[0] - 1e-6)
    waived = gate(design, policy=policy({"fiducial-spacing": {"min_mm": least}}), waivers=waivers(accepted))
    assert waived.verdict == "pass", "what accepts the closest accepts them all"


def test_margin_and_overlap_of_the_views() -> None:
    views = score(load_design(sound_design())).views
    strict = {"visibility": {"min_margin_px": 1e4}, "overlap": {"min_px": 1e4}}
    record = gate(limited(2 * P95), policy=policy(strict))
    assert len(of_rule(record, "visibility")) == len(of_rule(record, "overlap")) == len(views)
    assert record.exit_code == 0, "warnings do not fail unless they are asked to"
    assert gate(limited(2 * P95), policy=policy(strict), fail_level="warning").exit_code == 1
    off = {rule: {"severity": "off"} for rule in ("visibility", "overlap")}
    assert not gate(limited(2 * P95), policy=policy(off)).findings


def test_beads_that_merge_are_found_whatever_the_policy_asks_for() -> None:
    """closed form: shadows of 8 mm beads are some 60 px wide before this C-arm; points of no size are 10 px apart."""
    design = limited(2 * P95)
    assert not of_rule(gate(design), "overlap")
    tight = min(view.closest_pair_px for view in score(load_design(design)).views)
    focal, depth = 1020 / 0.194, 700
    design["fiducials"]["diameter_mm"] = 1.2 * tight * depth / focal
    found = of_rule(gate(design, policy=policy({"overlap": {"min_px": 1}})), "overlap")
    assert found
    assert found[0].severity == "warning"
    assert found[0].limit == pytest.approx(1.2 * tight + 3, rel=0.1)
    said = " ".join(finding.message for finding in score(load_design(design)).verdict.findings)
    assert "are needed by their size" in said


def test_beads_that_merge_by_little_are_told_by_numbers_that_differ() -> None:
    """closed form: what two balls need less 3 px grows with their diameter; here it is 0.02 px more than they have,
    and 0.001 px, which rounding takes and nobody is told of."""
    design = limited(2 * P95)
    design["fiducials"]["diameter_mm"] = 1.0
    view = min(score(load_design(design)).views, key=lambda view: view.closest_pair_px - view.closest_pair_needs_px)
    per_mm = view.closest_pair_needs_px - 2.99  # 3 px of background less what rounding may take
    design["fiducials"]["diameter_mm"] = (view.closest_pair_px + 0.001 - 3) / per_mm
    assert not of_rule(gate(design, policy=policy({"overlap": {"min_px": 1}})), "overlap")
    assert "projected-overlap" not in {each.rule for each in score(load_design(design)).verdict.findings}
    design["fiducials"]["diameter_mm"] = (view.closest_pair_px + 0.02 - 3) / per_mm
    found = of_rule(gate(design, policy=policy({"overlap": {"min_px": 1}})), "overlap")
    said = [each.message for each in score(load_design(design)).verdict.findings if each.rule == "projected-overlap"]
    assert len(found) == len(said) >= 1, "the gate remarks what the check remarks"
    for message in (*said, found[0].message):
        apart, needed = map(float, re.findall(r"([\d.]+) px", message))
        assert apart < needed


def test_a_process_that_judges_nothing_is_remarked_at_its_pattern() -> None:
    def remarks(*processes: dict[str, Any], **more: Any) -> list[GateFinding]:
        rules = policy({"process-capability": {"processes": list(processes)}, **more.pop("rules", {})}, **more)
        return of_rule(gate(sound_design(), policy=rules), "process-unused")

    seat = {
        "name": "seat",
        "tolerances": ["structure_connector.rz", "structure_conector.r?"],
        "min_half_width_deg": 1e-6,
    }
    (slip,) = remarks(seat)
    assert (slip.severity, slip.file) == ("note", "policy")
    assert slip.pointer == "/rules/process-capability/processes/0/tolerances/1"
    words = "'structure_conector.r?' matches no tolerance of the design held to it; did you mean structure_co"
    assert words in slip.message

    shaft = {"name": "shaft", "tolerances": ["structure_connector.t?"], "min_half_width_deg": 1e-6}
    (unit,) = remarks(shaft)
    assert "matches only lengths (structure_connector.tx), and the process states no min_half_width_mm" in unit.message
    assert remarks({**shaft, "min_half_width_mm": 1e-9}) == []

    assert remarks(seat, rules={"process-unused": {"severity": "off"}}) == []
    assert remarks(seat, rules={"process-unused": {"severity": "error"}})[0].severity == "error"
    judged_off = {"process-capability": {"severity": "off", "processes": [seat]}}
    assert remarks(seat, rules=judged_off) == [], "a rule that is off has nothing to hold"
    unread = judge(read_gate(
        {**admit_gate({"designs": [{"file": "d0.yaml", "design": sound_design()}], "mode": "analytic",
                     "policy": policy({"process-capability": {"processes": [seat]}})}, today=TODAY).content,
         "designs": [{"file": "d0.yaml", "design": sound_design()}, {"file": "d1.yaml", "text": "name: x"}]}
    ))  # fmt: skip
    assert of_rule(unread, "process-unused") == [], "the design that could not be read may have it"


def test_processes_of_a_class_are_held_against_its_designs_only() -> None:
    seat = {"name": "seat", "tolerances": ["A?"], "min_half_width_deg": 1e-6}
    own = {"process-capability": {"processes": [seat]}}
    classes = [{"name": "first", "files": ["d0*"], "rules": own}, {"name": "other", "files": ["d9*"], "rules": own}]
    held = {"name": "held", "tolerances": ["structure_connector.rx"], "min_half_width_deg": 1e-6}
    rules = policy({"process-capability": {"processes": [held]}}, classes=classes)
    (found,) = of_rule(gate(sound_design(), sound_design(), policy=rules), "process-unused")
    assert found.pointer == "/classes/0/rules/process-capability/processes/0/tolerances/0"
    (found,) = of_rule(gate(sound_design(), policy=rules), "process-unused")
    assert found.pointer.startswith("/classes/0/"), "no design was held to the policy's own processes"


def test_a_tolerance_tighter_than_its_process() -> None:
    design = limited(2 * P95)
    name, interface = next((k, v) for k, v in design["interfaces"].items() if v.get("tolerances"))
    component, tolerance = next((k, v) for k, v in interface["tolerances"].items() if k.startswith("r"))
    width = tolerance["half_width_deg"]
    entry = {"name": "milled seat", "tolerances": [f"{name}.{component}"], "min_half_width_deg": 1.01 * width}
    rules = policy({"process-capability": {"processes": [entry]}})
    (finding,) = of_rule(gate(design, policy=rules), "process-capability")
    assert finding.pointer == f"/interfaces/{name}/tolerances/{component}/half_width_deg"
    assert (finding.value, finding.limit) == (width, 1.01 * width)
    wide = {**entry, "min_half_width_deg": width}
    assert not gate(design, policy=policy({"process-capability": {"processes": [wide]}})).findings


def test_a_tolerance_that_is_left_out_is_the_tightest() -> None:
    design = limited(2 * P95)
    name, interface = next((k, v) for k, v in design["interfaces"].items() if v.get("tolerances"))
    component = next(k for k in interface["tolerances"] if k.startswith("r"))
    entry = {"name": "milled seat", "tolerances": [f"{name}.{component}"], "min_half_width_deg": 1e-6}
    beads = {"name": "press fit", "tolerances": ["fiducials.manufacturing"], "min_half_width_mm": 1e-6}
    rules = policy({"process-capability": {"processes": [entry, beads]}})
    assert not of_rule(gate(design, policy=rules), "process-capability")
    del interface["tolerances"][component]
    del design["fiducials"]["manufacturing"]
    seat, bead = of_rule(gate(design, policy=rules), "process-capability")
    assert (seat.pointer, seat.value) == (f"/interfaces/{name}/tolerances", 0)
    assert (bead.pointer, bead.value) == ("/fiducials", 0)
    assert "not stated, so it does not vary" in seat.message
    del interface["tolerances"]
    assert of_rule(gate(design, policy=rules), "process-capability")[0].pointer == f"/interfaces/{name}"


def test_an_interface_that_is_left_out_is_named_where_a_process_is_to_hold_it() -> None:
    """A design passed by leaving out a whole interface: none of its tolerances was there to be judged."""
    design = limited(2 * P95)
    spigot = {"name": "spigot", "tolerances": ["connector_flange.r?"], "min_half_width_deg": 1e-6}
    robot = {"name": "robot", "tolerances": ["hand_eye.tx"], "min_half_width_mm": 1e-6}
    design["interfaces"].pop("connector_flange", None)
    design.get("execution", {}).pop("hand_eye", None)
    record = gate(design, policy=policy({"process-capability": {"processes": [spigot]}}))
    found = of_rule(record, "process-capability")
    assert [(one.pointer, one.value) for one in found] == [("/interfaces", 0)] * 3
    assert "connector_flange.rx: not stated" in found[0].message
    assert (record.verdict, record.exit_code) == ("fail", 1)
    (eye,) = of_rule(gate(design, policy=policy({"process-capability": {"processes": [robot]}})), "process-capability")
    assert (eye.pointer, eye.value) == ("/execution", 0)
    del design["interfaces"], design["optimise"]
    seat = {"name": "seat", "tolerances": ["structure_connector.tz"], "min_half_width_mm": 1e-6}
    rules = policy({"process-capability": {"processes": [seat]}})
    (bare_one,) = of_rule(gate(design, policy=rules), "process-capability")
    assert bare_one.message.startswith("structure_connector.tz: not stated")


@pytest.mark.long
def test_an_implausible_value_is_a_warning_that_a_policy_can_make_an_error() -> None:
    design = limited(9 * P95)
    design["views"][0] |= {"fiducial_noise_px": 0.0}
    name = next(k for k, v in design["interfaces"].items() if v.get("tolerances"))
    design["interfaces"][name]["tolerances"]["tx"] = {"half_width_mm": 20.0, "distribution": "bounded"}
    quiet = {"overlap": {"severity": "off"}, "p95": {"severity": "note"}, "inconclusive": {"severity": "warning"}}

    def found(**rule: Any) -> tuple[int, list[tuple[str, str]]]:
        record = gate(design, policy=policy({**quiet, "plausibility": rule}))
        return record.exit_code, [(f.severity, f.pointer) for f in of_rule(record, "plausibility")]

    wide = f"/interfaces/{name}/tolerances/tx/half_width_mm"
    noise = "/views/0/fiducial_noise_px"
    assert found() == (0, [("warning", wide), ("warning", noise)])
    assert found(severity="error") == (1, [("error", wide), ("error", noise)])
    only = {"severity": "error", "remarks": ["noise-too-small"]}
    assert found(**only) == (1, [("note", wide), ("error", noise)])
    assert found(severity="error", remarks=[]) == (0, [("note", wide), ("note", noise)])
    assert found(severity="off") == (0, [])


def test_the_first_class_that_matches_changes_single_fields() -> None:
    classes = [
        {"name": "loose", "files": ["d1.*"], "rules": {"p95": {"severity": "warning"}}},
        {"name": "looser", "files": ["d*"], "rules": {"p95": {"limit_mm": 9 * P95}}},
    ]
    rules = {"p95": {"limit_mm": 0.5 * P95}}
    plain = bare()
    record = gate(plain, plain, policy=policy(rules, classes=classes))
    assert [design.design_class for design in record.designs] == ["looser", "loose"]
    assert [design.verdict for design in record.designs] == ["pass", "pass"]
    assert [finding.severity for finding in of_rule(record, "p95")] == ["warning"]
    given = {"designs": [{"file": "x", "design": plain, "class": "loose"}], "policy": policy(rules, classes=classes)}
    assert judge(admit_gate({**given, "mode": "analytic"}, today=TODAY).gate).designs[0].design_class == "loose"


def test_a_waiver_suppresses_stays_visible_and_holds_on_its_last_day() -> None:
    record = gate(limited(0.5 * P95), waivers=waivers(waiver()))
    assert (record.verdict, record.exit_code) == ("pass", 0)
    (finding,) = of_rule(record, "p95")
    assert "J. Doe" in finding.suppressed_by
    assert "first article" in finding.suppressed_by
    for day in ("2026-11-21", "2027-05-20"):
        assert gate(limited(0.5 * P95), waivers=waivers(waiver(expires=day))).exit_code == 0
    assert gate(limited(P95), waivers=waivers(waiver(max_value=1.2 * P95))).exit_code == 0
    assert gate(limited(P95), waivers=waivers(waiver(max_value=1.0001 * P95))).exit_code == 4


@pytest.mark.parametrize(
    "changes",
    [{"max_value": P95}, {"designs": ["other*"]}, {"target": "elsewhere"}, {"rule": "cvar"}],
    ids=["the upper end is beyond it", "another design", "another target", "another rule"],
)
def test_a_waiver_that_does_not_cover_it_is_unused(changes: dict[str, Any]) -> None:
    record = gate(limited(0.5 * P95), waivers=waivers(waiver(**changes)))
    assert record.exit_code == 1
    notes = of_rule(record, "waiver-unused")  # of the waiver, and of a pattern of it that matches no design
    assert [finding.severity for finding in notes] == ["note"] * (2 if "designs" in changes else 1)


@pytest.mark.parametrize("more", [{}, {"on_inconclusive": "warn"}, {"fail_level": "error"}])
def test_an_expired_waiver_fails_even_a_design_that_passes(more: dict[str, Any]) -> None:
    record = gate(limited(2 * P95), waivers=waivers(waiver(expires="2026-11-20")), **more)
    assert (record.verdict, record.exit_code) == ("fail", 1)
    assert [finding.rule for finding in record.findings] == ["waiver-expired"]


def test_regressions_beyond_what_is_allowed_fail() -> None:
    base = plain_record(gate(limited(3 * P95)))
    worse = noisier(1.3)
    percent = 100 * (score(load_design(worse)).targets[0].p95_mm / P95 - 1)
    assert percent > 1
    record = gate(worse, baseline=base)
    (finding,) = of_rule(record, "regression")
    assert finding.value == pytest.approx(percent, rel=1e-9)
    assert record.exit_code == 1
    assert gate(worse, baseline=base, max_regression_percent=percent + 0.1).exit_code == 0
    none = policy({"regression": {"max_percent": 0}})
    assert gate(limited(3 * P95), baseline=base, policy=none).exit_code == 0
    assert gate(limited(0.5 * P95), baseline=base, max_regression_percent=50.0).exit_code == 1, "limits stay absolute"


@pytest.mark.parametrize(("factor", "mode", "basis"), read_cases("gate", "drawn"))
def test_monte_carlo_is_drawn_where_it_is_wanted(factor: float, mode: str, basis: str) -> None:
    assert gate(limited(factor * P95), mode=mode).designs[0].basis == basis


# By what is remarked of their geometry, which changes nothing of how far the estimate is off; one is good to 20 %
REMARKED = {
    "projected-overlap": small_design(),
    "flat-structure": yaml.safe_load((EXAMPLES / "gallery" / "flat_plate.yaml").read_text()),
    "small-parallax": yaml.safe_load((EXAMPLES / "gallery" / "narrow_angle.yaml").read_text()),
}


@pytest.mark.parametrize("rule", REMARKED)
def test_first_order_decides_in_the_gate_what_it_decides_in_a_score(rule: str) -> None:
    """Limits of a quantile and of each unit, with the same intervals, and of the mean of the tail."""
    design = REMARKED[rule]
    first = score(load_design(design))
    assert rule in {finding.rule for finding in first.verdict.findings}
    units = {"name": "units", "risk": "per_unit", "min_yield": 0.5}
    for factor in (3.0, 1 / 3):
        limit = factor * first.targets[0].p95_mm
        stated: dict[str, Any] = {"targets": [first.targets[0].name], "limit_mm": limit}
        named = [{"name": "all", **stated}, {**units, **stated}]
        held = {**{name: part for name, part in design.items() if name != "optimise"}, "requirements": named}
        rules = policy({"cvar": {"limit_mm": limit}}, verification={"max_trials": 8192})
        (gated,) = gate(held, mode="analytic", policy=rules).designs
        checks = score(load_design(held)).verdict.checks
        *own, mean = gated.numbers
        assert [(number.status, number.interval) for number in own] == [(c.status, c.interval) for c in checks]
        assert {number.status for number in gated.numbers} == {"pass" if factor > 1 else "fail"}
        assert mean.rule == "cvar"
        assert gate(held, mode="auto", policy=rules).designs[0].basis == "first order"


def test_auto_samples_what_first_order_was_not_calibrated_for() -> None:
    """Nine views: nothing is known of first order there, so no score decides, however far the limit is."""
    design = limited(3 * P95)
    first = {key: value for key, value in design["views"][0].items() if key != "orientation"}
    for k in range(7):
        angle = 0.35 * (k + 1)
        beam = {"beam_direction": [sin(angle), cos(angle), 0.3], "up_direction": [0, 0, 1]}
        design["views"].append({**first, **beam, "name": f"more {k}", "image_size_px": [3000, 3000]})
    assert gate(design, mode="auto").designs[0].basis == "Monte Carlo"
    analytic = gate(design, mode="analytic")
    assert (analytic.verdict, analytic.exit_code) == ("inconclusive", 4)
    assert gate({**design, "views": design["views"][:8]}, mode="auto").designs[0].basis == "first order"


@pytest.mark.parametrize(
    ("body", "kind", "pointer"),
    [
        ({"policy": policy({"not-judged": {"severity": "off"}})}, GateError, "/policy/rules/not-judged/severity"),
        ({"policy": policy({"regression": {"max_percent": -1}})}, GateError, "/policy/rules/regression/max_percent"),
        ({"waivers": waivers(waiver(rule="not-evaluated"))}, GateError, "/waivers/waivers/0/rule"),
        ({"mode": "quick"}, RequestError, "/mode"),
        ({"today": "2026-13-01"}, RequestError, "/today"),
        ({"designs": [{"file": "x"}]}, RequestError, "/designs/0"),
        ({"designs": [{"file": "x", "design": limited(1.0), "class": "none"}]}, RequestError, "/designs/0/class"),
        ({"designs": []}, RequestError, "/designs"),
        ({"designs": [{"file": "x", "design": {"name": "x"}}]}, RefusedAt, "/designs/0/design"),
        ({"designs": [{"file": "d.yaml", "design": limited(1.0)}] * 2}, RequestError, "/designs/1/file"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_at_its_place(
    body: dict[str, Any], kind: type[TailstackError], pointer: str
) -> None:
    complete = {"designs": [{"file": "d.yaml", "design": limited(2 * P95)}], **copy.deepcopy(body)}
    with pytest.raises(kind) as refused:
        admit_gate(complete, today=TODAY)
    assert pointer in [problem.pointer for problem in refused.value.problems]
    assert refused.value.exit_code == 2


def test_rules_policy_and_solver_name_the_same() -> None:
    names = {info.alias or name for name, info in Rules.model_fields.items()}
    assert names == set(RULES) - {"invalid-design", "invalid-input", "not-evaluated"}
    for name, info in Rules.model_fields.items():
        assert getattr(Rules(), name).severity == RULES[info.alias or name].severity
    assert set(get_args(Implausible)) == set(PLAUSIBILITY)


def test_a_limit_that_a_loss_breaks_is_a_finding_where_the_policy_asks() -> None:
    """brute force: the score of the design without the fiducial that is named."""
    whole = score(load_design(limited(1.0))).losses[0]
    assert whole.value < whole.single.value < whole.double.value
    between = (whole.single.value + whole.double.value) / 2
    assert of_rule(gate(limited(between)), "survives-loss") == []
    assert of_rule(gate(limited(between), policy=policy({"survives-loss": {"lost": 1}})), "survives-loss") == []
    record = gate(limited(between), policy=policy({"survives-loss": {"lost": 2}}))
    (finding,) = of_rule(record, "survives-loss")
    assert record.verdict == "fail"
    assert finding.pointer == "/requirements/0/limit_mm"
    assert " and ".join(whole.double.lost) in finding.message
    data = limited(between)
    points = zip(load_design(data).fiducials.labels, data["fiducials"]["points"], strict=True)
    data["fiducials"]["points"] = [point for label, point in points if label not in whole.double.lost]
    assert finding.value == pytest.approx(score(load_design(data)).targets[0].p95_mm, rel=1e-9)
    accepted = waivers(waiver(rule="survives-loss", max_value=2 * finding.value))
    assert gate(limited(between), policy=policy({"survives-loss": {"lost": 2}}), waivers=accepted).verdict != "fail"


def test_a_slip_that_does_much_before_it_is_noticed_is_a_finding_where_the_policy_asks() -> None:
    (worst, *_) = score(load_design(limited(2.0)), reliability=True).reliability
    assert worst.effect_mm is None or worst.effect_mm > 0.01
    (finding,) = of_rule(gate(limited(2.0), policy=policy({"reliability": {"max_effect_mm": 0.01}})), "reliability")
    assert worst.fiducial in finding.message
    assert finding.value == worst.effect_mm
    generous = {"reliability": {"max_effect_mm": 1000.0}}
    assert (of_rule(gate(limited(2.0), policy=policy(generous)), "reliability") == []) == (worst.effect_mm is not None)
    assert of_rule(gate(limited(2.0)), "reliability") == []


def test_an_estimate_that_is_not_known_to_be_good_is_not_called_too_close() -> None:
    """The limit is five metres."""
    design = design_to_data(load_design(EXAMPLES / "small_cluster_far_target.yaml"))
    design["requirements"] = [{"name": "lenient", "limit_mm": 5000.0}]
    for view in design["views"]:
        view["fiducial_noise_px"] = view["target_noise_px"] = 1.2
    (found,) = of_rule(gate(design, mode="analytic"), "inconclusive")
    assert "how far this estimate is from a simulation is not known; gate with --mode auto or verify" in found.message
    assert "too close" not in found.message


def test_what_nobody_stated_is_a_finding_at_the_list_that_a_waiver_accepts() -> None:
    text = data_to_yaml(limited(1.5 * P95, assumed=["/interfaces", "/targets/0/position_mm"]))
    record = gate(text)
    [finding] = of_rule(record, "assumed-values")
    count = len(record.designs[0].assumed)
    assert (record.verdict, record.exit_code, finding.severity) == ("pass", 0, "warning")
    assert (finding.pointer, finding.value, finding.limit) == ("/assumed", count, None)
    assert text.splitlines()[(finding.line or 0) - 1].strip() in ("assumed:", "- /interfaces")
    assert f"{count} values that nobody stated" in finding.message
    assert gate(text, fail_level="warning").exit_code == 1
    assert gate(text, policy=policy({"assumed-values": {"severity": "error"}})).exit_code == 1
    strict = policy({"assumed-values": {"severity": "error", "max_count": count - 1}})
    assert of_rule(gate(text, policy=strict), "assumed-values")[0].limit == count - 1
    lax = policy({"assumed-values": {"severity": "error", "max_count": count}})
    assert of_rule(gate(text, policy=lax), "assumed-values") == []
    for most, code in ((count, 0), (count - 1, 1)):
        accepted = waivers(waiver(rule="assumed-values", max_value=most, designs=["d0.yaml"]))
        severe = policy({"assumed-values": {"severity": "error"}})
        assert gate(text, policy=severe, waivers=accepted).exit_code == code
    assert of_rule(gate(limited(1.5 * P95)), "assumed-values") == []
