"""Mode auto draws as much as the decision needs; a baseline fails what got worse and nothing else."""

from __future__ import annotations

import json
from typing import Any

import pytest
from gate_scenes import TODAY, judge_files, of_rule, plain_record, policy
from service_scenes import limited, sound_design
from test_gate_verdicts import P95, gate, noisier, waiver, waivers
from work_driver import run_job

from tailstack import load_design, score, verification, verify
from tailstack_service.documents import to_json
from tailstack_service.gate.baseline import ROUNDING_PERCENT, read_baseline
from tailstack_service.gate.judge import Gate, judge
from tailstack_service.gate.policy import read_policy
from tailstack_service.gate.reading import GateDesign
from tailstack_service.gate.records import GateRecord
from tailstack_service.gate.request import admit_gate, read_gate

CAP = 2**15
QUICK = {"max_trials": CAP}


@pytest.fixture(scope="module")
def p95() -> float:
    """Of the small design by 2^22 trials of another seed: known to 0.05 %."""
    return verify(load_design(sound_design()), trials=2**22, seed=777).targets[0].p95_mm


def auto(factor: float, p95: float, **more: Any) -> GateRecord:
    rules, cap = more.pop("rules", {}), more.pop("cap", CAP)
    return gate(limited(factor * p95), mode="auto", policy=policy(rules, verification={"max_trials": cap}), **more)


@pytest.mark.long("0.95-fail-1-8192")
@pytest.mark.parametrize(
    ("factor", "verdict", "code", "most"),
    [
        (0.95, "fail", 1, 8192),
        (1.05, "pass", 0, 8192),
        (0.98, "fail", 1, CAP),
        (1.02, "pass", 0, CAP),
        (1.0, "inconclusive", 4, None),
    ],
)
def test_as_many_trials_as_the_decision_needs(
    p95: float, factor: float, verdict: str, code: int, most: int | None
) -> None:
    record = auto(factor, p95, seed=3)
    (design,) = record.designs
    assert (record.verdict, record.exit_code, design.basis) == (verdict, code, "Monte Carlo")
    assert design.trials == CAP if most is None else design.trials <= most
    (number,) = design.numbers
    assert number.error_rate == 0.025
    low, high = number.interval
    assert (high <= number.limit) == (verdict == "pass")
    assert (low > number.limit) == (verdict == "fail")


@pytest.mark.long
def test_verdicts_of_many_seeds_on_and_beyond_the_limit(p95: float) -> None:
    """sampled: 40 gates on the limit, stated at most 2.5 % wrong either way: more than 5 have a probability of 0.014;
    20 gates 4 % beyond it: every one is decided."""
    on = [auto(1.0, p95, seed=seed).exit_code for seed in range(40)]
    assert on.count(4) >= 35
    beyond = [auto(0.96, p95, seed=seed).exit_code for seed in range(20)]
    assert beyond == [1] * 20


def test_confidence_sets_the_error_rate(p95: float) -> None:
    record = auto(1.5, p95, rules={"p95": {"limit_mm": 1.03 * p95, "confidence": 0.99}})
    assert {number.error_rate for number in record.designs[0].numbers} == {0.005}


def test_a_rare_exceedance_is_decided_and_never_passed_for_want_of_trials(p95: float) -> None:
    far = sound_design(requirements=[{"name": "far", "limit_mm": 9.0, "quantile": 0.9999}])
    estimate = score(load_design(far), losses=False).verdict.checks[0].value
    tight = {"exceedance": {"limit_mm": 1.02 * estimate, "max_probability": 0.0001}}
    few = gate(limited(3 * p95), mode="auto", policy=policy(tight, verification={"max_trials": 2000}))
    (number,) = [entry for entry in few.designs[0].numbers if entry.rule == "exceedance"]
    assert few.designs[0].basis == "Monte Carlo"
    assert number.interval[1] is None, "2000 trials have no upper end of a 99.99 % quantile"
    assert (few.exit_code, number.status) == (4, "inconclusive")
    for mode in ("auto", "verify"):
        failing = {"exceedance": {"limit_mm": 0.9 * estimate, "max_probability": 0.0001}}
        record = gate(limited(3 * p95), mode=mode, policy=policy(failing, verification={"max_trials": 2**18}))
        assert record.exit_code == 1, mode


def test_up_to_where_a_waiver_accepts_is_decided_too(p95: float) -> None:
    """The limit is missed at the first look; whether the waiver covers it takes more trials."""
    close = waivers(waiver(max_value=1.01 * p95))
    plain, waived = auto(0.93, p95, cap=2**18), auto(0.93, p95, cap=2**18, waivers=close)
    assert (plain.exit_code, plain.designs[0].trials) == (1, 8192)
    assert waived.exit_code == 0
    assert (waived.designs[0].trials or 0) > 8192
    far = gate(limited(0.5 * p95), mode="auto", policy=policy(verification=QUICK), waivers=waivers(waiver()))
    assert far.designs[0].basis == "first order"
    near = auto(0.5, p95, cap=2**18, waivers=close)
    assert (near.designs[0].basis, near.exit_code) == ("Monte Carlo", 0)


def test_the_mean_of_the_tail_is_decided_too(p95: float) -> None:
    record = auto(1.05, p95, rules={"cvar": {"limit_mm": 1.2 * p95}})
    numbers = {number.rule: number for number in record.designs[0].numbers}
    assert numbers["cvar"].status == "pass"
    assert numbers["cvar"].error_rate == 0.025
    assert numbers["p95"].status == "pass"


def test_a_job_gives_the_very_record_of_the_sequential_test(p95: float) -> None:
    decided = {"name": "decided", "files": ["far.yaml"], "rules": {"cvar": {"limit_mm": 9 * p95}}}
    request = admit_gate(
        {
            "designs": [
                {"file": "on.yaml", "design": limited(p95)},
                {"file": "near.yaml", "design": limited(0.98 * p95)},
                {"file": "far.yaml", "design": limited(3 * p95)},
            ],
            "policy": policy({"cvar": {"limit_mm": 1.12 * p95}}, verification=QUICK, classes=[decided]),
            "waivers": waivers(waiver(max_value=1.01 * p95)),
            "mode": "auto",
            "seed": 11,
        },
        today=TODAY,
    ).content
    outcome, recorded = run_job("gate", request, shuffle=9)
    here = judge(read_gate(request))
    assert outcome.answer == to_json(here)
    assert here.designs[0].trials == CAP
    assert {json.loads(unit.spec)["of"] for unit in recorded} == {0, 1}


def test_missed_beads_are_simulated_where_the_estimate_cannot_tell(p95: float) -> None:
    """Of shots that miss one bead or two the estimate knows; of one in ten, which miss more, nobody does."""
    design = limited(3 * p95)
    design["fiducials"]["points"][0]["loss_probability"] = 0.5
    rules = policy({"cvar": {"limit_mm": 9 * p95}}, verification=QUICK)
    for mode in ("auto", "analytic"):
        (judged,) = gate(design, mode=mode, policy=policy(verification=QUICK)).designs
        assert (judged.verdict, judged.trials) == ("pass", None)
    assert gate(design, mode="auto", policy=rules).designs[0].trials is not None
    (open_one,) = of_rule(gate(design, mode="analytic", policy=rules), "inconclusive")
    assert "CVaR95" in open_one.message
    assert "missed" in open_one.message
    del design["fiducials"]["points"][0]["loss_probability"]
    design["fiducials"]["loss_probability"] = 0.1
    assert gate(design, mode="auto", policy=policy(verification=QUICK)).designs[0].trials is not None
    record = gate(design, mode="analytic")
    assert (record.verdict, record.exit_code) == ("inconclusive", 4)
    assert "miss more fiducials than are looked at" in of_rule(record, "inconclusive")[0].message
    assert record.designs[0].targets[0].first_order_p95_mm < 3 * p95
    (open_one,) = of_rule(gate(design, mode="auto", policy=rules), "inconclusive")  # no number of trials decides it
    assert "however many are drawn" in open_one.message
    assert "max_trials" not in open_one.message
    design["fiducials"]["loss_probability"] = 1e-3  # no shot without an answer is drawn, and one is possible
    (open_one,) = of_rule(gate(design, mode="verify", policy=rules), "inconclusive")
    assert "however many are drawn" in open_one.message


def test_a_quantile_that_the_shots_of_a_unit_do_not_reach_is_told_as_that(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verification, "MOST_SHOTS", verification.FEWEST_SHOTS)
    design = sound_design()
    stated = {"name": "deep", "risk": "per_unit", "min_yield": 0.8, "quantile": 0.9999, "limit_mm": 1.8 * P95}
    design["requirements"] = [stated]
    rules = policy(verification={"max_trials": 2**17})  # below 43,819
    (open_one,) = of_rule(gate(design, mode="verify", policy=rules), "inconclusive")
    assert "too few for its P99.99" in open_one.message
    assert "max_trials" not in open_one.message


# --- baseline -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{"name": "another"}, {}], ids=["of another name", "a copy beside its original"])
def test_a_new_design_is_noted_and_held_to_its_limits_alone(changes: dict[str, Any]) -> None:
    base = plain_record(gate(limited(3 * P95)))
    record = judge_files({"d0.yaml": limited(3 * P95), "new.yaml": noisier(2, **changes)}, baseline=base)
    (note,) = of_rule(record, "not-compared")
    assert (note.file, note.severity, record.exit_code) == ("new.yaml", "note", 0)
    assert "nothing was compared" in note.message
    failing = judge_files({"d0.yaml": limited(3 * P95), "new.yaml": limited(0.5 * P95, name="another")}, baseline=base)
    assert failing.exit_code == 1


def test_a_target_that_the_baseline_does_not_have_is_noted() -> None:
    targets = [{"name": "tip", "position_mm": [0.0, 0.0, 70.0]}, {"name": "shaft", "position_mm": [0.0, 0.0, 40.0]}]
    record = judge_files({"d0.yaml": limited(3 * P95, targets=targets)}, baseline=plain_record(gate(limited(3 * P95))))
    (note,) = of_rule(record, "not-compared")
    assert (note.severity, note.pointer) == ("note", "/targets/1")
    assert "shaft" in note.message


def test_the_last_digits_of_another_machine_are_no_regression() -> None:
    base = plain_record(gate(limited(3 * P95)))
    base["designs"][0]["targets"][0]["first_order_p95_mm"] *= 1 - 1e-11
    assert not of_rule(judge_files({"d0.yaml": limited(3 * P95)}, baseline=base), "regression")
    base["designs"][0]["targets"][0]["first_order_p95_mm"] *= 1 - 2 * ROUNDING_PERCENT / 100
    assert judge_files({"d0.yaml": limited(3 * P95)}, baseline=base).exit_code == 1


def test_chance_is_no_regression() -> None:
    """A design that is better by 0.1 % and draws other deviates, for it has one contributor more."""
    before = limited(3 * P95)
    after = noisier(0.99)
    after["execution"] = {"repeatability": {"half_width_mm": 0.001, "distribution": "uniform"}}
    assert load_design(after).document.execution is not None
    for mode in ("verify", "auto"):
        for seed in range(4):
            base = plain_record(gate(before, mode=mode, seed=seed, policy=policy(verification=QUICK)))
            record = judge_files({"d0.yaml": after}, baseline=base, mode=mode, policy=policy(verification=QUICK))
            assert record.seed == seed
            assert not of_rule(record, "regression"), (mode, seed)


def test_where_first_order_is_not_trusted_monte_carlo_is_compared() -> None:
    strict = policy({"first-order-gap": {"max_percent": 0.1, "severity": "note"}}, verification={"max_trials": 8192})
    base = plain_record(gate(noisier(1.0), mode="verify", seed=5, policy=strict))
    record = judge_files({"d0.yaml": noisier(1.4)}, baseline=base, mode="verify", policy=strict)
    (finding,) = of_rule(record, "regression")
    assert "P95 (Monte Carlo) rose" in finding.message
    then, now = base["designs"][0]["targets"][0]["p95_mm"], record.designs[0].targets[0].p95_mm
    assert finding.value == pytest.approx(100 * (now / then - 1), rel=1e-12)
    same = judge_files({"d0.yaml": noisier(1.0)}, baseline=base, mode="verify", policy=strict)
    assert not of_rule(same, "regression")


def test_a_baseline_of_another_version_is_remarked_at_its_line(tmp_path: Any) -> None:
    base = plain_record(gate(limited(3 * P95)))
    base["provenance"]["tailstack_version"] = "0.0.1"
    path = tmp_path / "base.json"
    path.write_text(json.dumps(base, indent=2), encoding="utf-8")
    entry = GateDesign("d0.yaml", load_design(limited(3 * P95)))
    given = Gate((entry,), read_policy(policy()), None, read_baseline(path), "analytic", 0, TODAY)
    (finding,) = of_rule(judge(given), "model-version")
    assert finding.severity == "warning"
    assert path.read_text().splitlines()[(finding.line or 0) - 1].strip().startswith('"tailstack_version": "0.0.1"')
