"""From designs, policy and numbers to a verdict: pure functions, without clock, network or randomness of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from tailstack.design import Design, compile_design
from tailstack.design.refusals import place
from tailstack.errors import Problem, TailstackError
from tailstack.results import Score, Severity, Verification
from tailstack.scoring import NOT_INCLUDED, vector3
from tailstack.system import System
from tailstack.version import __version__

from .case import Case
from .checking import looks_of
from .classes import remarks_on_classes
from .designs import Computed, Gate, GateDesign, first_order, wants_check
from .finding_place import finding_at
from .identity import find_earlier, sections_of
from .numbers import numbers_of
from .policy_document import Rules
from .processes import remarks_on_processes
from .records import (
    WORST_FIRST,
    Fold,
    GatedDesign,
    GateFinding,
    GateProvenance,
    GateRecord,
    GateTarget,
    GateVerdict,
)
from .requirements import requirements_of, unjudged
from .rules import RULES
from .waiving import Accepted, accepting, in_words, remarks_on_waivers

MOST_FILES = 3
Progress = Callable[[int, int], None]
Verify = Callable[[Gate, Computed, Progress], Verification]


def judge(gate: Gate, verify: Verify, told: Callable[[float, float], None] | None = None) -> GateRecord:
    """The whole gate; ``verify`` draws Monte Carlo for a design, and may raise TailstackError.

    ``told(done, total)`` is called on the way, in designs and parts of designs.
    """
    checks: list[Verification | TailstackError | None] = []
    scored = first_order(gate)
    wanted = [wants_check(gate, computed) and computed.held is not None for computed in scored]
    for computed, wants in zip(scored, wanted, strict=True):
        check: Verification | TailstackError | None = None
        if wants:
            before = sum(wanted[: len(checks)])

            def tell(done: int, total: int, before: int = before) -> None:
                if told is not None:
                    told(before + done / total, sum(wanted))

            try:
                check = verify(gate, computed, tell)
            except TailstackError as error:
                check = error
        checks.append(check)
    return conclude(gate, scored, checks)


def conclude(
    gate: Gate, scored: Iterable[Computed], checks: Iterable[Verification | TailstackError | None]
) -> GateRecord:
    """The record of a gate whose designs were scored and, where they had to be, checked."""
    accepted: list[Accepted] = []
    cases: list[Case] = []
    findings: list[GateFinding] = []
    designs: list[GatedDesign] = []
    refusals: list[TailstackError] = []
    scored = list(scored)
    for computed, check in zip(scored, checks, strict=True):
        refusal = computed.refusal or (check if isinstance(check, TailstackError) else None)
        if refusal is None and computed.score is not None and not isinstance(check, TailstackError):
            case = _case(gate, computed, computed.score, check)
            cases.append(case)
            refusal = _nothing_to_judge(case)
            said = _findings(gate, case, accepted)
            gated = _gated(case, _verdict(gate, said))
        else:
            said, gated = [], _unread(computed)
        if refusal is not None:
            refusals.append(refusal)
            said = [*refused(computed.entry, refusal), *said]
            gated = replace(gated, verdict="not evaluated")
        findings += said
        designs.append(gated)
    rules = gate.policy.document.rules
    findings += _version_findings(gate, rules.model_version.severity)
    findings += _left_out(gate, cases)
    findings += remarks_on_waivers(gate.waivers, gate.today, rules, accepted, cases)
    findings += remarks_on_processes(gate)
    findings += remarks_on_classes(gate, scored)
    verdicts: set[GateVerdict] = {design.verdict for design in designs} | {_verdict(gate, findings)}
    verdict = next(candidate for candidate in WORST_FIRST if candidate in verdicts)
    return GateRecord(
        schema="tailstack/gate/1",
        verdict=verdict,
        exit_code=_exit_code(gate, verdict, findings, refusals),
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
            not_included=NOT_INCLUDED,
        ),
    )


# --- findings -------------------------------------------------------------------------------------


def _case(gate: Gate, computed: Computed, scored: Score, check: Verification | None) -> Case:
    design = computed.entry.design
    assert design is not None
    assert computed.held is not None
    allowed = gate.max_regression_percent
    system = compile_design(computed.held)
    file, rules = computed.entry.file, computed.rules
    numbers = numbers_of(scored, check, rules, computed.added, computed.held, 1 if check is None else looks_of(gate))
    requirements = requirements_of(design, system, rules)
    names = [target.name for target in system.targets]
    return Case(
        file=file,
        design=design,
        rules=rules,
        score=scored,
        verification=check,
        numbers=numbers,
        added=computed.added,
        targets=_targets(scored, check, system),
        requirements=requirements,
        not_judged=unjudged(requirements, numbers, names, computed.design_class),
        design_class=computed.design_class,
        class_of_name=gate.policy.class_of_name(file, design.name, computed.entry.design_class),
        compared=gate.baseline is not None,
        baseline=_earlier(gate, file, design),
        max_regression_percent=computed.rules.regression.max_percent if allowed is None else allowed,
    )


def _earlier(gate: Gate, file: str, design: Design) -> GatedDesign | None:
    """What the baseline says of a design."""
    if gate.baseline is None:
        return None
    return find_earlier(
        gate.baseline.record.designs, file, design.name, design.sha256, sections_of(design), _present(gate)
    )


def _present(gate: Gate) -> set[str]:
    return {*(entry.file for entry in gate.designs), *gate.present}


def _left_out(gate: Gate, cases: Sequence[Case]) -> list[GateFinding]:
    """Designs of the baseline whose files went and that no design here was: nobody judges them any more."""
    severity = gate.policy.document.rules.not_compared.severity
    if gate.baseline is None or severity == "off":
        return []
    there = _present(gate) | {case.baseline.file for case in cases if case.baseline is not None}
    every = gate.baseline.record.designs
    left = [index for index, entry in enumerate(every) if entry.targets and entry.file not in there]
    if not left:
        return []
    names = ", ".join(every[index].file for index in left[:MOST_FILES])
    more = f" and {len(left) - MOST_FILES} more" if len(left) > MOST_FILES else ""
    new = [case.file for case in cases if case.baseline is None]
    message = f"{names}{more}: judged in the baseline and not here: removed, renamed to what the patterns do not match"
    message += f", or changed beyond recognition and called {new[0]}" if new else ", or left out"
    return [finding_at(gate.baseline, f"/designs/{left[0]}", "not-compared", severity, message)]


def _findings(gate: Gate, case: Case, accepted: list[Accepted]) -> list[GateFinding]:
    findings = []
    for rule in RULES.values():
        severity = severity_of(case.rules, rule.id)
        if rule.find is None or severity == "off":
            continue
        for remark in rule.find(case):
            weight: Severity = "note" if remark.note else _weight(gate, case.rules, rule.id, severity)
            waiver = accepting(gate.waivers, gate.today, rule.id, remark, (case.file, case.design.name))
            if waiver is not None:
                accepted.append(Accepted(waiver, rule.id, remark, case.file))
            placed = place(Problem(remark.pointer, rule.id, remark.message), case.design.source)
            findings.append(
                GateFinding(
                    rule=rule.id,
                    severity=weight,
                    file=case.file,
                    line=placed.line,
                    column=placed.column,
                    pointer=remark.pointer,
                    message=remark.message,
                    value=remark.value,
                    limit=remark.limit,
                    suppressed_by=None if waiver is None or gate.waivers is None else in_words(gate.waivers, waiver),
                )
            )
    return findings


def severity_of(rules: Rules, rule: str) -> Severity | str:
    """The weight that the policy gives a rule; "off" among them."""
    entry = getattr(rules, rule.replace("-", "_"), None)
    return RULES[rule].severity if entry is None else str(entry.severity)


def _weight(gate: Gate, rules: Rules, rule: str, severity: str) -> Severity:
    if rule == "inconclusive":
        return "warning" if fold_of(gate, rules) == "warn" else "error"
    return severity  # type: ignore[return-value]


def fold_of(gate: Gate, rules: Rules) -> Fold | None:
    """What becomes of an open question: the option, else the policy's severity of ``inconclusive``."""
    if gate.on_inconclusive is not None:
        return gate.on_inconclusive
    return "warn" if rules.inconclusive.severity == "warning" else None


def _nothing_to_judge(case: Case) -> TailstackError | None:
    """A design that nothing was held against does not pass, whoever switched off what would have judged it."""
    if case.numbers:
        return None
    detail = "nothing was judged: the design states no requirement and the policy sets no limit"
    hint = "state a requirement in the design, or rules: {p95: {limit_mm: ...}} in the policy"
    if rules := sorted({entry.rule for entry in case.requirements}):
        several = len(rules) > 1
        detail = (
            f"nothing was judged: {' and '.join(rules)} {'are' if several else 'is'} off, and no other limit is set"
        )
        hint = "severity: warning or note judges without failing the gate"
    return NothingToJudge(Problem("", "nothing-to-judge", detail, hint))


class NothingToJudge(TailstackError):
    """No limit was judged: none is set, or the rules that judge them are off."""

    slug = "not-evaluated"
    title = "There is nothing to judge"
    exit_code = 3


def refused(entry: GateDesign, refusal: TailstackError) -> list[GateFinding]:
    """A refusal as findings: one for each of its problems."""
    rule = "invalid-design" if refusal.exit_code == 2 else "not-evaluated"
    source = None if entry.design is None else entry.design.source.placed()
    findings = []
    for problem in refusal.problems:
        placed = problem if source is None else place(problem, source)
        foreign = placed.file if placed.file not in (None, entry.file) and entry.design is None else entry.file
        findings.append(
            GateFinding(
                rule=rule,
                severity="error",
                file=foreign or entry.file,
                line=placed.line,
                column=placed.column,
                pointer=problem.pointer,
                message=problem.detail + (f" — {problem.hint}" if problem.hint else ""),
                value=None,
                limit=None,
                suppressed_by=None,
            )
        )
    return findings


def _version_findings(gate: Gate, severity: str) -> list[GateFinding]:
    if gate.baseline is None or severity == "off":
        return []
    version = gate.baseline.record.provenance.tailstack_version
    if version == __version__:
        return []
    placed = place(Problem("/provenance/tailstack_version", "model-version", ""), gate.baseline.source)
    return [
        GateFinding(
            rule="model-version",
            severity=severity,  # type: ignore[arg-type]
            file=gate.baseline.file,
            line=placed.line,
            column=placed.column,
            pointer=placed.pointer,
            message=f"the baseline was computed by tailstack {version}, this is {__version__}: numbers may differ for "
            "that reason; write a new baseline",
            value=None,
            limit=None,
            suppressed_by=None,
        )
    ]


# --- what it comes to -----------------------------------------------------------------------------


def _counts(gate: Gate, finding: GateFinding) -> bool:
    """Whether a finding fails the gate by its weight."""
    heavy = ("error",) if gate.fail_level == "error" else ("error", "warning")
    return finding.suppressed_by is None and finding.severity in heavy


def _verdict(gate: Gate, findings: list[GateFinding]) -> GateVerdict:
    if any(_counts(gate, finding) and finding.rule != "inconclusive" for finding in findings):
        return "fail"
    if any(finding.rule == "inconclusive" and finding.suppressed_by is None for finding in findings):
        return "inconclusive"
    return "pass"


def _exit_code(gate: Gate, verdict: GateVerdict, findings: list[GateFinding], refusals: list[TailstackError]) -> int:
    """Bad documents (2) before designs that were not evaluated (3) before failures (1) before open questions (4)."""
    if refusals:
        return min(2 if refusal.exit_code == 2 else 3 for refusal in refusals)
    if verdict != "inconclusive":
        return {"pass": 0, "fail": 1, "not evaluated": 3}[verdict]
    open_ones = [finding for finding in findings if finding.rule == "inconclusive" and finding.suppressed_by is None]
    if not any(_counts(gate, finding) for finding in open_ones):
        return 0
    # with --fail-level warning, a question that was folded into a warning fails like any other warning
    folded = all(finding.severity == "warning" for finding in open_ones)
    return 1 if gate.on_inconclusive == "fail" or folded else 4


def _targets(scored: Score, check: Verification | None, system: System) -> tuple[GateTarget, ...]:
    targets = []
    for index, first in enumerate(scored.targets):
        drawn = None if check is None else check.targets[index]
        targets.append(
            GateTarget(
                name=first.name,
                first_order_p95_mm=first.p95_mm,
                p95_mm=None if drawn is None else drawn.p95_mm,
                p95_interval_mm=None if drawn is None else drawn.p95_interval_mm,
                cvar95_mm=first.cvar95_mm if drawn is None else drawn.cvar95_mm,
                position_mm=vector3(system.targets[index].position_mm),
            )
        )
    return tuple(targets)


def _gated(case: Case, verdict: GateVerdict) -> GatedDesign:
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
        numbers=case.numbers,
        requirements=case.requirements,
        not_judged=case.not_judged,
        sections=sections_of(case.design),
    )


def _unread(computed: Computed) -> GatedDesign:
    design = computed.entry.design
    return GatedDesign(
        file=computed.entry.file,
        name=None if design is None else design.name,
        sha256=None if design is None else design.sha256,
        design_class=computed.design_class,
        verdict="not evaluated",
        basis="none",
        trials=None,
        targets=(),
        numbers=(),
    )
