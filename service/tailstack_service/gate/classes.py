"""What classes of the policy take away from the rules of all other designs."""

from __future__ import annotations

from collections.abc import Iterator

from .designs import Computed, Gate
from .finding_place import finding_at
from .policy_document import DesignClass, Rules
from .records import GateFinding

RULE = "class-relaxed"
_LIMITS = ("limit_mm", "min_mm", "max_probability", "min_yield")


def remarks_on_classes(gate: Gate, scored: list[Computed]) -> list[GateFinding]:
    """What classes that designs of this gate are in switch off or weaken, at its place in the policy."""
    policy = gate.policy.document
    severity = policy.rules.class_relaxed.severity
    if severity == "off":
        return []
    findings = []
    for index, entry in enumerate(policy.classes):
        inside = [computed.entry.file for computed in scored if computed.design_class == entry.name]
        for rule, field, words, lost in _weaker(policy.rules, entry) if inside else ():
            message = f"class {entry.name}: {rule} {words}; in it {_files(inside)}"
            pointer = f"/classes/{index}/rules/{rule}/{field}"
            findings.append(finding_at(gate.policy, pointer, RULE, severity if lost else "note", message))
    return findings


def _weaker(rules: Rules, entry: DesignClass) -> Iterator[tuple[str, str, str, bool]]:
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


def _files(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
