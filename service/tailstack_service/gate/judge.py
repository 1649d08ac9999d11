"""From designs and what they are judged by to a record: pure functions, without clock, network or chance of their own.

Every design is scored to first order under its own limits and the policy's (`score_designs`), Monte Carlo is drawn
where that cannot decide (`plan_check`, `draw_check`), then the rules are asked, waivers are applied, and what is left
gives the verdict and the exit code (`conclude`).  `judge` does all of it here and now; a job does the same in units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from typing import TYPE_CHECKING

from tailstack.design import Design, compile_design
from tailstack.design.refusals import place
from tailstack.errors import Problem, TailstackError
from tailstack.results import Score, Verification
from tailstack.scoring import score, vector3
from tailstack.version import __version__

from .asked import Fold, Level, Mode
from .baseline import GateBaseline, find_missing_designs, find_other_version, hash_sections
from .case import (
    Case,
    add_policy_limits,
    compare_numbers,
    is_near_limit,
    list_policy_limits,
    list_requirements,
    list_unjudged,
)
from .design_rules import find_idle_processes
from .policy import GatePolicy, Rules, find_idle_classes, find_weak_classes
from .reading import GateDesign, GateInput, Remark, make_finding, place_finding
from .records import (
    WORST_FIRST,
    GatedDesign,
    GateFinding,
    GateProvenance,
    GateRecord,
    GateRequirement,
    GateTarget,
    GateVerdict,
    counts,
    record_unread,
)
from .rules import RULES, find_severity
from .waivers import Acceptance, GateWaivers, describe_waiver, find_waiver, list_waiver_values, review_waivers

if TYPE_CHECKING:
    from tailstack.verification import Sampling

Check = Verification | TailstackError | None  # a design's Monte Carlo, its refusal, or none


@dataclass(frozen=True, slots=True, eq=False)
class Gate:
    """Everything that decides, besides the computing."""

    designs: tuple[GateDesign, ...]
    policy: GatePolicy
    waivers: GateWaivers | None
    baseline: GateBaseline | None
    mode: Mode
    seed: int
    today: date
    fail_level: Level = "error"
    on_inconclusive: Fold | None = None
    max_regression_percent: float | None = None  # None: the policy's
    present: tuple[str, ...] = ()  # files that are not judged now and are still there: not renamed since the baseline


@dataclass(frozen=True, slots=True, eq=False)
class ScoredDesign:
    """A design with its first-order score under its own limits and the policy's, or why there is none."""

    entry: GateDesign
    design_class: str | None
    rules: Rules
    limited: Design | None = None  # the design with the policy's limits among its requirements
    requirements: Mapping[str, GateRequirement] = field(default_factory=dict)  # by their names in it
    score: Score | None = None
    refusal: TailstackError | None = None


def choose_seed(given: int | None, policy: GatePolicy, baseline: GateBaseline | None) -> int:
    """The seed that was asked for, else the baseline's (head and base then share their chance), else the policy's."""
    if given is not None:
        return given
    return policy.document.verification.seed if baseline is None else baseline.record.seed


def judge(gate: Gate, report: Callable[[float, float], None] | None = None) -> GateRecord:
    """The whole gate, Monte Carlo included, here and now.

    report: called on the way with what is done and the total, in designs and parts of designs.
    """
    scored = score_designs(gate)
    plans = [plan_check(gate, design) for design in scored]
    total = sum(plan is not None for plan in plans)
    checks: list[Check] = []
    for design, plan in zip(scored, plans, strict=True):
        before = sum(check is not None for check in checks)

        def tell(done: int, parts: int, before: int = before) -> None:
            if report is not None:
                report(before + done / parts, total)

        checks.append(None if plan is None else draw_check(design, plan, tell))
    return conclude(gate, scored, checks)


# --- numbers ------------------------------------------------------------------------------------------


def score_designs(gate: Gate) -> tuple[ScoredDesign, ...]:
    """Every design's score, or its refusal."""
    return tuple(_score_design(gate, entry) for entry in gate.designs)


def rules_of(gate: Gate, entry: GateDesign) -> tuple[str | None, Rules]:
    """The class of a design that was read, and the rules that it is held to."""
    assert entry.design is not None
    name = gate.policy.choose_class(entry)
    return name, gate.policy.merge_rules(name)


def judges_losses(rules: Rules) -> bool:
    """Whether a score under these rules looks for the worst loss of fiducials."""
    return rules.survives_loss.lost is not None


def _score_design(gate: Gate, entry: GateDesign) -> ScoredDesign:
    if entry.design is None:
        return ScoredDesign(entry, entry.design_class, gate.policy.document.rules, refusal=entry.refusal)
    name, rules = rules_of(gate, entry)
    limits = list_policy_limits(entry.design, rules)
    try:
        limited = add_policy_limits(entry.design, limits)
        first_order = score(
            limited, losses=judges_losses(rules), reliability=rules.reliability.max_effect_mm is not None
        )
    except TailstackError as error:
        return ScoredDesign(entry, name, rules, refusal=error)
    requirements = list_requirements(entry.design, rules, limits, first_order)
    return ScoredDesign(entry, name, rules, limited, requirements, first_order)


def limit_design(gate: Gate, index: int) -> Design:
    """A design with the policy's limits among its requirements, without its score.  Raises DesignError, LimitError."""
    entry = gate.designs[index]
    assert entry.design is not None
    _, rules = rules_of(gate, entry)
    return add_policy_limits(entry.design, list_policy_limits(entry.design, rules))


def plan_check(gate: Gate, scored: ScoredDesign) -> Sampling | None:
    """How Monte Carlo is drawn for a design that was scored; None: it is not.

    In mode verify it is drawn for every design, to the policy's precision and until every limit is decided.  In mode
    auto it is drawn where first order decides nothing or is too near to a limit, until every limit is decided and no
    longer.  Values up to which waivers accept are limits like others.
    """
    if scored.score is None or scored.limited is None or gate.mode == "analytic":
        return None

    def waived_up_to(rule: str, target: str) -> Iterable[float]:
        return list_waiver_values(gate.waivers, rule, target, scored.entry.known_as).values()

    policy = gate.policy.document
    if gate.mode == "auto":
        numbers = [entry.number for entry in compare_numbers(scored.score, None, scored.requirements)]
        if not is_near_limit(numbers, policy.guard_band_percent, lambda n: [*waived_up_to(n.rule, n.target)]):
            return None

    from tailstack.montecarlo.stopping import CvarQuestion, LimitQuestion
    from tailstack.verification import Sampling

    questions = [
        LimitQuestion(check.target, check.error, check.quantile, value)
        for check in scored.score.verdict.checks
        if check.risk == "pooled"
        for value in waived_up_to(scored.requirements[check.requirement].rule, check.target)
    ]
    means = [
        CvarQuestion(target, value, requirement.confidence)
        for requirement in scored.requirements.values()
        if requirement.rule == "cvar" and requirement.severity != "off"
        for target in requirement.targets
        for value in (requirement.limit, *waived_up_to("cvar", target))
    ]
    auto = gate.mode == "auto"
    return Sampling(
        precision=None if auto else policy.verification.precision,
        seed=gate.seed,
        max_trials=policy.verification.max_trials,
        sequential=auto,
        questions=tuple(questions),
        cvar=tuple(means),
    )


def draw_check(
    scored: ScoredDesign, sampling: Sampling, progress: Callable[[int, int], None] | None = None
) -> Verification | TailstackError:
    """Monte Carlo as it was planned, here and now, or why it was refused."""
    from tailstack.verification import prepare, verify_prepared

    assert scored.limited is not None
    try:
        return verify_prepared(prepare(scored.limited), sampling, progress=progress)
    except TailstackError as error:
        return error


def _count_looks(gate: Gate) -> int:
    """Looks that the checks of a gate are planned with."""
    from tailstack.montecarlo.stopping import decision_looks, precision_looks

    looks = decision_looks if gate.mode == "auto" else precision_looks
    return len(looks(gate.policy.document.verification.max_trials))


# --- the record ---------------------------------------------------------------------------------------


def conclude(gate: Gate, scored: Iterable[ScoredDesign], checks: Iterable[Check]) -> GateRecord:
    """The record of a gate whose designs were scored and, where they had to be, checked."""
    scored = list(scored)
    present = {*(entry.file for entry in gate.designs), *gate.present}
    accepted: list[Acceptance] = []
    cases: list[Case] = []
    findings: list[GateFinding] = []
    designs: list[GatedDesign] = []
    refusals: list[TailstackError] = []
    for entry, check in zip(scored, checks, strict=True):
        refusal = check if isinstance(check, TailstackError) else entry.refusal
        own: list[GateFinding] = []
        design = entry.entry.design
        record = record_unread(entry.entry.file, design, entry.design_class)
        if refusal is None and not isinstance(check, TailstackError):
            case = _make_case(gate, entry, check, present)
            cases.append(case)
            own = _apply_rules(gate, case, accepted)
            record = _record_design(case, _reach_verdict(gate, own))
            refusal = _refuse_unjudged(case)
        if refusal is not None:
            refusals.append(refusal)
            own = [*report_refusal(entry.entry, refusal), *own]
            record = replace(record, verdict="not evaluated")
        findings += own
        designs.append(record)
    findings += _review_inputs(gate, scored, cases, accepted, present)
    verdicts: set[GateVerdict] = {design.verdict for design in designs} | {_reach_verdict(gate, findings)}
    verdict = next(candidate for candidate in WORST_FIRST if candidate in verdicts)
    return GateRecord(
        schema="tailstack/gate/1",
        verdict=verdict,
        exit_code=_choose_exit_code(gate, verdict, findings, refusals),
        mode=gate.mode,
        seed=gate.seed,
        fail_level=gate.fail_level,
        on_inconclusive=gate.on_inconclusive,
        max_regression_percent=gate.max_regression_percent,
        findings=tuple(findings),
        designs=tuple(designs),
        provenance=GateProvenance(
            tailstack_version=__version__,
            policy_name=gate.policy.document.name,
            policy_sha256=gate.policy.sha256,
            waivers_sha256=None if gate.waivers is None else gate.waivers.sha256,
            baseline_sha256=None if gate.baseline is None else gate.baseline.sha256,
            today=gate.today.isoformat(),
            not_included=tuple(
                dict.fromkeys(line for entry in scored if entry.score for line in entry.score.provenance.not_included)
            ),
        ),
    )


def _make_case(gate: Gate, scored: ScoredDesign, check: Verification | None, present: set[str]) -> Case:
    file, design, rules = scored.entry.file, scored.entry.design, scored.rules
    assert design is not None
    assert scored.score is not None
    comparisons = compare_numbers(scored.score, check, scored.requirements, 1 if check is None else _count_looks(gate))
    requirements = tuple(scored.requirements.values())
    targets = _record_targets(scored, check)
    names = (file, *scored.entry.known_as, *scored.entry.earlier)
    allowed = gate.max_regression_percent
    return Case(
        file=file,
        names=scored.entry.known_as,
        earlier=scored.entry.earlier,
        design=design,
        rules=rules,
        score=scored.score,
        verification=check,
        comparisons=comparisons,
        targets=targets,
        requirements=requirements,
        not_judged=list_unjudged(requirements, comparisons, [each.name for each in targets], scored.design_class),
        design_class=scored.design_class,
        compared=gate.baseline is not None,
        baseline=None if gate.baseline is None else gate.baseline.find_earlier(names, design, present),
        max_regression_percent=rules.regression.max_percent if allowed is None else allowed,
    )


def _record_targets(scored: ScoredDesign, check: Verification | None) -> tuple[GateTarget, ...]:
    assert scored.score is not None
    assert scored.limited is not None
    targets = []
    for index, place_of in enumerate(compile_design(scored.limited).targets):
        first, drawn = scored.score.targets[index], None if check is None else check.targets[index]
        targets.append(
            GateTarget(
                name=first.name,
                first_order_p95_mm=first.p95_mm,
                p95_mm=None if drawn is None else drawn.p95_mm,
                p95_interval_mm=None if drawn is None else drawn.p95_interval_mm,
                cvar95_mm=(drawn or first).cvar95_mm,
                position_mm=vector3(place_of.position_mm),
            )
        )
    return tuple(targets)


def _record_design(case: Case, verdict: GateVerdict) -> GatedDesign:
    check = case.verification
    return GatedDesign(
        file=case.file,
        name=case.design.name,
        sha256=case.design.sha256,
        design_class=case.design_class,
        verdict=verdict,
        basis="first order" if check is None else "Monte Carlo",
        trials=None if check is None else check.trials,
        targets=case.targets,
        numbers=tuple(comparison.number for comparison in case.comparisons),
        requirements=case.requirements,
        not_judged=case.not_judged,
        sections=hash_sections(case.design),
        assumed=case.score.provenance.assumed,
    )


# --- findings -----------------------------------------------------------------------------------------


def _apply_rules(gate: Gate, case: Case, accepted: list[Acceptance]) -> list[GateFinding]:
    """What the rules find in a design; what waivers accept of it is added to ``accepted``."""
    findings = []
    for rule in RULES.values():
        severity = find_severity(case.rules, rule.id)
        if rule.find is None or severity == "off":
            continue
        if rule.id == "inconclusive":
            warn = severity == "warning" if gate.on_inconclusive is None else gate.on_inconclusive == "warn"
            severity = "warning" if warn else "error"
        for remark in rule.find(case):
            waiver = find_waiver(gate.waivers, rule.id, remark, case.names)
            suppressed_by = None
            if waiver is not None and gate.waivers is not None:
                accepted.append(Acceptance(waiver, remark))
                suppressed_by = describe_waiver(gate.waivers, waiver)
            findings.append(place_finding(case.design.source, case.file, rule.id, severity, remark, suppressed_by))
    return findings


def _review_inputs(
    gate: Gate, scored: list[ScoredDesign], cases: list[Case], accepted: list[Acceptance], present: set[str]
) -> Iterator[GateFinding]:
    """Findings about the baseline, the waivers and the policy themselves, by the policy's general rules."""
    rules = gate.policy.document.rules

    def weigh(document: GateInput, remarks: Iterable[tuple[str, Remark]]) -> Iterator[GateFinding]:
        for rule, remark in remarks:
            if (severity := find_severity(rules, rule)) != "off":
                yield place_finding(document.source, document.file, rule, severity, remark)

    if gate.baseline is not None:
        yield from weigh(gate.baseline, find_other_version(gate.baseline))
        yield from weigh(gate.baseline, find_missing_designs(gate.baseline, cases, present))
    read = [(entry, entry.entry.design) for entry in scored if entry.entry.design is not None]
    every = len(read) == len(scored)  # a design that could not be read may have what a pattern is for
    if gate.waivers is not None:
        names = [entry.entry.known_as for entry in scored] if every else []
        yield from weigh(gate.waivers, review_waivers(gate.waivers, rules.waiver_wide, accepted, cases, names))
    members: dict[str | None, list[str]] = {}
    for scored_design in scored:
        members.setdefault(scored_design.design_class, []).append(scored_design.entry.file)
    if every:
        held = [(entry.design_class, design) for entry, design in read]
        yield from weigh(gate.policy, find_idle_processes(gate.policy, held))
    yield from weigh(gate.policy, find_weak_classes(gate.policy.document, members))
    if every:
        yield from weigh(gate.policy, find_idle_classes(gate.policy, gate.designs))


def _refuse_unjudged(case: Case) -> TailstackError | None:
    """A design that nothing was held against does not pass, whoever switched off what would have judged it."""
    if case.comparisons:
        return None
    detail = "nothing was judged: the design states no requirement and the policy sets no limit"
    hint = "state a requirement in the design, or rules: {p95: {limit_mm: ...}} in the policy"
    if rules := sorted({entry.rule for entry in case.requirements}):
        verb = "are" if len(rules) > 1 else "is"
        detail = f"nothing was judged: {' and '.join(rules)} {verb} off, and no other limit is set"
        hint = "severity: warning or note judges without failing the gate"
    return NothingToJudge(Problem("", "nothing-to-judge", detail, hint))


class NothingToJudge(TailstackError, slug="not-evaluated", title="There is nothing to judge"):
    """No limit was judged: none is set, or the rules that judge them are off."""


def report_refusal(entry: GateDesign, refusal: TailstackError) -> list[GateFinding]:
    """A refusal as findings: one for each of its problems."""
    rule = "invalid-design" if refusal.exit_code == 2 else "not-evaluated"
    if entry.design is not None:
        source = entry.design.source.with_places()
        return [make_finding(rule, "error", entry.file, place(problem, source)) for problem in refusal.problems]
    # what is wrong may stand in the file of the fiducials
    return [make_finding(rule, "error", problem.file or entry.file, problem) for problem in refusal.problems]


# --- what it comes to ---------------------------------------------------------------------------------


def _is_open(finding: GateFinding) -> bool:
    return finding.rule == "inconclusive" and finding.suppressed_by is None


def _reach_verdict(gate: Gate, findings: list[GateFinding]) -> GateVerdict:
    if any(counts(finding, gate.fail_level) and finding.rule != "inconclusive" for finding in findings):
        return "fail"
    return "inconclusive" if any(_is_open(finding) for finding in findings) else "pass"


def _choose_exit_code(
    gate: Gate, verdict: GateVerdict, findings: list[GateFinding], refusals: list[TailstackError]
) -> int:
    """Bad documents (2) before designs that were not evaluated (3) before failures (1) before open questions (4)."""
    if refusals:
        return min(2 if refusal.exit_code == 2 else 3 for refusal in refusals)
    if verdict != "inconclusive":
        return {"pass": 0, "fail": 1, "not evaluated": 3}[verdict]
    open_ones = [finding for finding in findings if _is_open(finding)]
    if not any(counts(finding, gate.fail_level) for finding in open_ones):
        return 0
    # with --fail-level warning, a question that was folded into a warning fails like any other warning
    folded = all(finding.severity == "warning" for finding in open_ones)
    return 1 if gate.on_inconclusive == "fail" or folded else 4
