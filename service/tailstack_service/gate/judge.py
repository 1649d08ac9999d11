"""From designs and what they are judged by to a record: pure functions, without clock, network or chance of their own.

Every design is scored to first order under its own limits and the policy's, Monte Carlo is drawn where that cannot
decide, the rules are asked, waivers are applied, and what is left gives the verdict and the exit code.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from tailstack.design import Design, compile_design, load_design
from tailstack.design.refusals import place
from tailstack.errors import Problem, TailstackError
from tailstack.estimation.checks import DETERMINATION
from tailstack.results import Score, Severity, Verification
from tailstack.scoring import NOT_INCLUDED, score, vector3
from tailstack.system import System
from tailstack.version import __version__

from .baseline import GateBaseline, find_earlier, hash_sections
from .case import Case, add_policy_limits, collect_numbers, is_near_limit, list_requirements, list_unjudged
from .design_rules import Tolerance, list_tolerances
from .policy import DesignClass, GatePolicy, Process, Rules
from .reading import place_finding
from .records import (
    WORST_FIRST,
    Fold,
    GatedDesign,
    GateFinding,
    GateNumber,
    GateProvenance,
    GateRecord,
    GateTarget,
    GateVerdict,
    Level,
    Mode,
)
from .rules import RULES
from .waivers import Acceptance, GateWaivers, describe_waiver, find_waiver, list_waiver_values, review_waivers

if TYPE_CHECKING:
    from tailstack.verification import Sampling

TRUSTED_PERCENT = 5.0  # error of P95 up to which mode auto believes first order


@dataclass(frozen=True, slots=True, eq=False)
class GateDesign:
    """A design handed to the gate: read, or the reason why it could not be."""

    file: str
    design: Design | None
    refusal: TailstackError | None = None
    design_class: str | None = None  # None: the policy's patterns decide


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
    """A design with its first-order score, held to the policy's limits too."""

    entry: GateDesign
    design_class: str | None
    rules: Rules
    held: Design | None  # the design with the policy's limits among its requirements
    added: dict[str, str]
    score: Score | None
    refusal: TailstackError | None


def choose_seed(given: int | None, policy: GatePolicy, baseline: GateBaseline | None) -> int:
    """The seed that was asked for, else the baseline's (head and base then share their chance), else the policy's."""
    if given is not None:
        return given
    return policy.document.verification.seed if baseline is None else baseline.record.seed


def score_designs(gate: Gate) -> tuple[ScoredDesign, ...]:
    """Every design's score; a refusal is kept as such."""
    return tuple(_score_design(gate, entry) for entry in gate.designs)


def _score_design(gate: Gate, entry: GateDesign) -> ScoredDesign:
    if entry.design is None:
        return ScoredDesign(entry, entry.design_class, gate.policy.document.rules, None, {}, None, entry.refusal)
    name = gate.policy.class_of(entry.file, entry.design.name, entry.design_class)
    rules = gate.policy.rules_for(name)
    data, added = add_policy_limits(entry.design, rules)
    try:
        held = load_design(data)
        return ScoredDesign(entry, name, rules, held, added, score(held), None)
    except TailstackError as error:
        return ScoredDesign(entry, name, rules, None, added, None, error)


def read_with_limits(gate: Gate, index: int) -> Design:
    """A design with the policy's limits among its requirements, without its score.  Raises DesignError, LimitError."""
    entry = gate.designs[index]
    assert entry.design is not None
    name = gate.policy.class_of(entry.file, entry.design.name, entry.design_class)
    return load_design(add_policy_limits(entry.design, gate.policy.rules_for(name))[0])


def _trust_first_order(score: Score) -> bool:
    """Whether first order may decide a limit that it is far from.

    Its layout is of a class that was calibrated, it is good to a few per cent there, and nothing remarks that the
    geometry hardly determines the answer.
    """
    trust = score.validity
    if not trust.calibrated or trust.expected_error_percent is None or trust.expected_error_percent > TRUSTED_PERCENT:
        return False
    return not any(finding.rule in DETERMINATION for finding in score.verdict.findings)


def needs_check(gate: Gate, computed: ScoredDesign) -> bool:
    """Whether Monte Carlo is drawn for a design: never, always, or where first order is not believed or too near to a
    limit."""
    if computed.score is None or gate.mode == "analytic":
        return False
    if gate.mode == "verify":
        return True
    assert computed.held is not None
    numbers = collect_numbers(computed.score, None, computed.rules, computed.added, computed.held)
    if numbers and not _trust_first_order(computed.score):
        return True
    names = (computed.entry.file, computed.held.name)

    def accepted(number: GateNumber) -> tuple[float, ...]:
        return list_waiver_values(gate.waivers, gate.today, number.rule, number.target, names)

    return is_near_limit(numbers, gate.policy.document.guard_band_percent, accepted)


def plan_sampling(gate: Gate, computed: ScoredDesign) -> Sampling:
    """How a design that was scored is checked: in mode auto until every limit is decided and no longer, in mode verify
    to the policy's precision as well.  Values up to which waivers accept are limits like others.
    """
    from tailstack.montecarlo.stopping import CvarQuestion, Question
    from tailstack.verification import Sampling

    assert computed.score is not None
    assert computed.held is not None
    names = (computed.entry.file, computed.held.name)
    wanted = gate.policy.document.verification
    questions = [
        Question(check.target, check.error, check.quantile, value)
        for check in computed.score.verdict.checks
        if check.risk == "pooled"
        for value in list_waiver_values(
            gate.waivers, gate.today, computed.added.get(check.requirement, "p95"), check.target, names
        )
    ]
    cvar, means = computed.rules.cvar, []
    if cvar.limit_mm is not None and cvar.severity != "off":
        for target in computed.score.targets:
            values = list_waiver_values(gate.waivers, gate.today, "cvar", target.name, names)
            means += [CvarQuestion(target.name, limit, cvar.confidence) for limit in (cvar.limit_mm, *values)]
    auto = gate.mode == "auto"
    return Sampling(
        precision=None if auto else wanted.precision,
        seed=gate.seed,
        max_trials=wanted.max_trials,
        sequential=auto,
        questions=tuple(questions),
        cvar=tuple(means),
    )


def draw_check(gate: Gate, computed: ScoredDesign, progress: Progress | None = None) -> Verification:
    """Monte Carlo as the policy says, here and now.  Raises TailstackError."""
    from tailstack.verification import prepare, verify_prepared

    assert computed.held is not None
    return verify_prepared(prepare(computed.held), plan_sampling(gate, computed), progress=progress)


def count_looks(gate: Gate) -> int:
    """Looks that the checks of a gate are planned with."""
    from tailstack.montecarlo.stopping import decision_looks, precision_looks

    looks = decision_looks if gate.mode == "auto" else precision_looks
    return len(looks(gate.policy.document.verification.max_trials))


_LIMITS = ("limit_mm", "min_mm", "max_probability", "min_yield")


def find_weak_classes(gate: Gate, scored: list[ScoredDesign]) -> list[GateFinding]:
    """What classes that designs of this gate are in switch off or weaken, at its place in the policy."""
    policy = gate.policy.document
    severity = policy.rules.class_relaxed.severity
    if severity == "off":
        return []
    findings = []
    for index, entry in enumerate(policy.classes):
        inside = [computed.entry.file for computed in scored if computed.design_class == entry.name]
        for rule, field, words, lost in _list_weaker(policy.rules, entry) if inside else ():
            message = f"class {entry.name}: {rule} {words}; in it {_count_files(inside)}"
            pointer = f"/classes/{index}/rules/{rule}/{field}"
            findings.append(place_finding(gate.policy, pointer, "class-relaxed", severity if lost else "note", message))
    return findings


def _list_weaker(rules: Rules, entry: DesignClass) -> Iterator[tuple[str, str, str, bool]]:
    """Rule, field, words, and whether the rule is lost altogether."""
    for name in sorted(entry.rules.model_fields_set):
        own, before = getattr(entry.rules, name), getattr(rules, name)
        if before.severity != "error":
            continue
        rule = Rules.model_fields[name].alias or name
        if "severity" in own.model_fields_set and own.severity != "error":
            lost = own.severity == "off"
            words = "is off, an error for all others" if lost else f"is a {own.severity}, an error for all others"
            yield rule, "severity", words, lost
        for field in _LIMITS:
            if field in own.model_fields_set and getattr(own, field) is None and getattr(before, field) is not None:
                yield rule, field, f"has no {field}, {getattr(before, field):g} for all others", True
        if "processes" in own.model_fields_set and not own.processes and before.processes:
            yield rule, "processes", "has no processes, unlike for all others", True


def _count_files(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


_WORDS = {"deg": "rotations", "mm": "lengths"}


def find_idle_processes(gate: Gate) -> list[GateFinding]:
    """Patterns of process-capability that judge no tolerance of any design that they were held against.

    Nothing is said where a design could not be read, for it may have what the pattern is for.
    """
    severity = gate.policy.document.rules.process_unused.severity
    if severity == "off" or any(entry.design is None for entry in gate.designs):
        return []
    held: dict[str, list[Design]] = defaultdict(list)  # pointer to a list of processes: designs
    for entry in gate.designs:
        assert entry.design is not None
        name = gate.policy.class_of(entry.file, entry.design.name, entry.design_class)
        if gate.policy.rules_for(name).process_capability.severity != "off":
            held[_point_at_processes(gate, name)].append(entry.design)
    findings = []
    for pointer, designs in held.items():
        tolerances = [tolerance for design in designs for tolerance in list_tolerances(design)]
        for index, process in enumerate(_processes_at(gate, pointer)):
            for number, pattern in enumerate(process.tolerances):
                if (said := _explain_idle(process, pattern, tolerances, len(designs))) is not None:
                    findings.append(
                        place_finding(
                            gate.policy, f"{pointer}/{index}/tolerances/{number}", "process-unused", severity, said
                        )
                    )
    return findings


def _point_at_processes(gate: Gate, design_class: str | None) -> str:
    """Where the processes of a class stand: its own go before the policy's."""
    for index, entry in enumerate(gate.policy.document.classes):
        own = entry.rules.process_capability
        if entry.name == design_class and "processes" in own.model_fields_set:
            return f"/classes/{index}/rules/process-capability/processes"
    return "/rules/process-capability/processes"


def _processes_at(gate: Gate, pointer: str) -> list[Process]:
    policy = gate.policy.document
    rules = policy.rules if pointer.startswith("/rules") else policy.classes[int(pointer.split("/")[2])].rules
    return rules.process_capability.processes


def _explain_idle(process: Process, pattern: str, tolerances: list[Tolerance], designs: int) -> str | None:
    """Why a pattern judges nothing; None if it does."""
    least = {"deg": process.min_half_width_deg, "mm": process.min_half_width_mm}
    matched = [tolerance for tolerance in tolerances if fnmatchcase(tolerance.name, pattern)]
    if any(least[tolerance.unit] is not None for tolerance in matched):
        return None
    if matched:
        unit = matched[0].unit
        return (
            f"process {process.name}: {pattern!r} matches only {_WORDS[unit]} ({matched[0].name}), and the process "
            f"states no min_half_width_{unit}: nothing is judged by it"
        )
    of = "the design" if designs == 1 else f"the {designs} designs"
    close = get_close_matches(pattern, sorted({tolerance.name for tolerance in tolerances}), 1)
    meant = f"; did you mean {close[0]}?" if close else ""
    return f"process {process.name}: {pattern!r} matches no tolerance of {of} held to it{meant}"


MOST_FILES = 3
Progress = Callable[[int, int], None]
Verify = Callable[[Gate, ScoredDesign, Progress], Verification]


def judge(gate: Gate, verify: Verify, told: Callable[[float, float], None] | None = None) -> GateRecord:
    """The whole gate; ``verify`` draws Monte Carlo for a design, and may raise TailstackError.

    ``told(done, total)`` is called on the way, in designs and parts of designs.
    """
    checks: list[Verification | TailstackError | None] = []
    scored = score_designs(gate)
    wanted = [needs_check(gate, computed) and computed.held is not None for computed in scored]
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
    gate: Gate, scored: Iterable[ScoredDesign], checks: Iterable[Verification | TailstackError | None]
) -> GateRecord:
    """The record of a gate whose designs were scored and, where they had to be, checked."""
    accepted: list[Acceptance] = []
    cases: list[Case] = []
    findings: list[GateFinding] = []
    designs: list[GatedDesign] = []
    refusals: list[TailstackError] = []
    scored = list(scored)
    for computed, check in zip(scored, checks, strict=True):
        refusal = computed.refusal or (check if isinstance(check, TailstackError) else None)
        if refusal is None and computed.score is not None and not isinstance(check, TailstackError):
            case = _make_case(gate, computed, computed.score, check)
            cases.append(case)
            refusal = _check_something_judged(case)
            said = _apply_rules(gate, case, accepted)
            gated = _record_design(case, _reach_verdict(gate, said))
        else:
            said, gated = [], _record_unread(computed)
        if refusal is not None:
            refusals.append(refusal)
            said = [*report_refusal(computed.entry, refusal), *said]
            gated = replace(gated, verdict="not evaluated")
        findings += said
        designs.append(gated)
    rules = gate.policy.document.rules
    findings += _find_other_version(gate, rules.model_version.severity)
    findings += _find_missing_designs(gate, cases)
    findings += review_waivers(gate.waivers, gate.today, rules, accepted, cases)
    findings += find_idle_processes(gate)
    findings += find_weak_classes(gate, scored)
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
            not_included=NOT_INCLUDED,
        ),
    )


# --- findings -------------------------------------------------------------------------------------


def _make_case(gate: Gate, computed: ScoredDesign, scored: Score, check: Verification | None) -> Case:
    design = computed.entry.design
    assert design is not None
    assert computed.held is not None
    allowed = gate.max_regression_percent
    system = compile_design(computed.held)
    file, rules = computed.entry.file, computed.rules
    numbers = collect_numbers(
        scored, check, rules, computed.added, computed.held, 1 if check is None else count_looks(gate)
    )
    requirements = list_requirements(design, system, rules)
    names = [target.name for target in system.targets]
    return Case(
        file=file,
        design=design,
        rules=rules,
        score=scored,
        verification=check,
        numbers=numbers,
        added=computed.added,
        targets=_record_targets(scored, check, system),
        requirements=requirements,
        not_judged=list_unjudged(requirements, numbers, names, computed.design_class),
        design_class=computed.design_class,
        class_of_name=gate.policy.class_of_name(file, design.name, computed.entry.design_class),
        compared=gate.baseline is not None,
        baseline=_find_earlier(gate, file, design),
        max_regression_percent=computed.rules.regression.max_percent if allowed is None else allowed,
    )


def _find_earlier(gate: Gate, file: str, design: Design) -> GatedDesign | None:
    """What the baseline says of a design."""
    if gate.baseline is None:
        return None
    return find_earlier(
        gate.baseline.record.designs, file, design.name, design.sha256, hash_sections(design), _list_present(gate)
    )


def _list_present(gate: Gate) -> set[str]:
    return {*(entry.file for entry in gate.designs), *gate.present}


def _find_missing_designs(gate: Gate, cases: Sequence[Case]) -> list[GateFinding]:
    """Designs of the baseline whose files went and that no design here was: nobody judges them any more."""
    severity = gate.policy.document.rules.not_compared.severity
    if gate.baseline is None or severity == "off":
        return []
    there = _list_present(gate) | {case.baseline.file for case in cases if case.baseline is not None}
    every = gate.baseline.record.designs
    left = [index for index, entry in enumerate(every) if entry.targets and entry.file not in there]
    if not left:
        return []
    names = ", ".join(every[index].file for index in left[:MOST_FILES])
    more = f" and {len(left) - MOST_FILES} more" if len(left) > MOST_FILES else ""
    new = [case.file for case in cases if case.baseline is None]
    message = f"{names}{more}: judged in the baseline and not here: removed, renamed to what the patterns do not match"
    message += f", or changed beyond recognition and called {new[0]}" if new else ", or left out"
    return [place_finding(gate.baseline, f"/designs/{left[0]}", "not-compared", severity, message)]


def _apply_rules(gate: Gate, case: Case, accepted: list[Acceptance]) -> list[GateFinding]:
    findings = []
    for rule in RULES.values():
        severity = find_severity(case.rules, rule.id)
        if rule.find is None or severity == "off":
            continue
        for remark in rule.find(case):
            weight: Severity = "note" if remark.note else _weight(gate, case.rules, rule.id, severity)
            waiver = find_waiver(gate.waivers, gate.today, rule.id, remark, (case.file, case.design.name))
            if waiver is not None:
                accepted.append(Acceptance(waiver, rule.id, remark, case.file))
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
                    suppressed_by=None
                    if waiver is None or gate.waivers is None
                    else describe_waiver(gate.waivers, waiver),
                )
            )
    return findings


def find_severity(rules: Rules, rule: str) -> Severity | str:
    """The weight that the policy gives a rule; "off" among them."""
    entry = getattr(rules, rule.replace("-", "_"), None)
    return RULES[rule].severity if entry is None else str(entry.severity)


def _weight(gate: Gate, rules: Rules, rule: str, severity: str) -> Severity:
    if rule == "inconclusive":
        return "warning" if choose_fold(gate, rules) == "warn" else "error"
    return severity  # type: ignore[return-value]


def choose_fold(gate: Gate, rules: Rules) -> Fold | None:
    """What becomes of an open question: the option, else the policy's severity of ``inconclusive``."""
    if gate.on_inconclusive is not None:
        return gate.on_inconclusive
    return "warn" if rules.inconclusive.severity == "warning" else None


def _check_something_judged(case: Case) -> TailstackError | None:
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


def report_refusal(entry: GateDesign, refusal: TailstackError) -> list[GateFinding]:
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


def _find_other_version(gate: Gate, severity: str) -> list[GateFinding]:
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


def _reach_verdict(gate: Gate, findings: list[GateFinding]) -> GateVerdict:
    if any(_counts(gate, finding) and finding.rule != "inconclusive" for finding in findings):
        return "fail"
    if any(finding.rule == "inconclusive" and finding.suppressed_by is None for finding in findings):
        return "inconclusive"
    return "pass"


def _choose_exit_code(
    gate: Gate, verdict: GateVerdict, findings: list[GateFinding], refusals: list[TailstackError]
) -> int:
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


def _record_targets(scored: Score, check: Verification | None, system: System) -> tuple[GateTarget, ...]:
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
        numbers=case.numbers,
        requirements=case.requirements,
        not_judged=case.not_judged,
        sections=hash_sections(case.design),
    )


def _record_unread(computed: ScoredDesign) -> GatedDesign:
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
