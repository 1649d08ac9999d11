"""What is handed to the gate, and each design's first-order score under the policy's limits."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date

from tailstack.design import Design, load_design
from tailstack.errors import TailstackError
from tailstack.estimation.checks import DETERMINATION
from tailstack.results import Score
from tailstack.scoring import score

from .numbers import near_a_limit, numbers_of, with_policy
from .policy_document import Rules
from .reading import ReadBaseline, ReadPolicy, ReadWaivers
from .records import Fold, GateNumber, Level, Mode
from .waiving import accepted_values

BELIEVED_PERCENT = 5.0  # error of P95 up to which mode auto believes first order


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
    policy: ReadPolicy
    waivers: ReadWaivers | None
    baseline: ReadBaseline | None
    mode: Mode
    seed: int
    today: date
    fail_level: Level = "error"
    on_inconclusive: Fold | None = None
    max_regression_percent: float | None = None  # None: the policy's
    present: tuple[str, ...] = ()  # files that are not judged now and are still there: not renamed since the baseline


@dataclass(frozen=True, slots=True, eq=False)
class Computed:
    """A design with its first-order score, held to the policy's limits too."""

    entry: GateDesign
    design_class: str | None
    rules: Rules
    held: Design | None  # the design with the policy's limits among its requirements
    added: dict[str, str]
    score: Score | None
    refusal: TailstackError | None


def seed_of(given: int | None, policy: ReadPolicy, baseline: ReadBaseline | None) -> int:
    """The seed that was asked for, else the baseline's (head and base then share their chance), else the policy's."""
    if given is not None:
        return given
    return policy.document.verification.seed if baseline is None else baseline.record.seed


def first_order(gate: Gate) -> tuple[Computed, ...]:
    """Every design's score; a refusal is kept as such."""
    return tuple(_first_order(gate, entry) for entry in gate.designs)


def _first_order(gate: Gate, entry: GateDesign) -> Computed:
    if entry.design is None:
        return Computed(entry, entry.design_class, gate.policy.document.rules, None, {}, None, entry.refusal)
    name = gate.policy.class_of(entry.file, entry.design.name, entry.design_class)
    rules = gate.policy.rules_for(name)
    data, added = with_policy(entry.design, rules)
    try:
        held = load_design(data)
        return Computed(entry, name, rules, held, added, score(held), None)
    except TailstackError as error:
        return Computed(entry, name, rules, None, added, None, error)


def held_to(gate: Gate, index: int) -> Design:
    """A design with the policy's limits among its requirements, without its score.  Raises DesignError, LimitError."""
    entry = gate.designs[index]
    assert entry.design is not None
    name = gate.policy.class_of(entry.file, entry.design.name, entry.design_class)
    return load_design(with_policy(entry.design, gate.policy.rules_for(name))[0])


def _believed(score: Score) -> bool:
    """Whether first order may decide a limit that it is far from.

    Its layout is of a class that was calibrated, it is good to a few per cent there, and nothing remarks that the
    geometry hardly determines the answer.
    """
    trust = score.validity
    if not trust.calibrated or trust.expected_error_percent is None or trust.expected_error_percent > BELIEVED_PERCENT:
        return False
    return not any(finding.rule in DETERMINATION for finding in score.verdict.findings)


def wants_check(gate: Gate, computed: Computed) -> bool:
    """Whether Monte Carlo is drawn for a design: never, always, or where first order is not believed or too near to a
    limit."""
    if computed.score is None or gate.mode == "analytic":
        return False
    if gate.mode == "verify":
        return True
    assert computed.held is not None
    numbers = numbers_of(computed.score, None, computed.rules, computed.added, computed.held)
    if numbers and not _believed(computed.score):
        return True
    names = (computed.entry.file, computed.held.name)

    def accepted(number: GateNumber) -> tuple[float, ...]:
        return accepted_values(gate.waivers, gate.today, number.rule, number.target, names)

    return near_a_limit(numbers, gate.policy.document.guard_band_percent, accepted)
