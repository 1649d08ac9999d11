"""Processes of a policy that hold nothing: a slip in a pattern would be a tolerance that nobody judges."""

from __future__ import annotations

from collections import defaultdict
from difflib import get_close_matches
from fnmatch import fnmatchcase

from tailstack.design import Design

from .designs import Gate
from .finding_place import finding_at
from .layout_rules import Tolerance, tolerances_of
from .policy_document import Process
from .records import GateFinding

RULE = "process-unused"
_WORDS = {"deg": "rotations", "mm": "lengths"}


def remarks_on_processes(gate: Gate) -> list[GateFinding]:
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
            held[_pointer(gate, name)].append(entry.design)
    findings = []
    for pointer, designs in held.items():
        tolerances = [tolerance for design in designs for tolerance in tolerances_of(design)]
        for index, process in enumerate(_processes(gate, pointer)):
            for number, pattern in enumerate(process.tolerances):
                if (said := _unused(process, pattern, tolerances, len(designs))) is not None:
                    findings.append(
                        finding_at(gate.policy, f"{pointer}/{index}/tolerances/{number}", RULE, severity, said)
                    )
    return findings


def _pointer(gate: Gate, design_class: str | None) -> str:
    """Where the processes of a class stand: its own go before the policy's."""
    for index, entry in enumerate(gate.policy.document.classes):
        own = entry.rules.process_capability
        if entry.name == design_class and "processes" in own.model_fields_set:
            return f"/classes/{index}/rules/process-capability/processes"
    return "/rules/process-capability/processes"


def _processes(gate: Gate, pointer: str) -> list[Process]:
    policy = gate.policy.document
    rules = policy.rules if pointer.startswith("/rules") else policy.classes[int(pointer.split("/")[2])].rules
    return rules.process_capability.processes


def _unused(process: Process, pattern: str, tolerances: list[Tolerance], designs: int) -> str | None:
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
