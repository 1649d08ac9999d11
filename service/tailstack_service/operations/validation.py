"""Parse and check designs without computing anything."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from tailstack.errors import TailstackError
from tailstack.results import Finding, GlobalBound, Relaxation, ViewCheck, WorthyPlace
from tailstack.results.record import Published
from tailstack.results.verdicts import assumed_sentence

from ..console.command_line import PASS, Answer, read_design
from ..console.flags import add_flags
from ..documents import to_json
from ..rendering.text import group_findings, spell_count, visible, wrap
from .operation import Command, Operation, Options, Size

if TYPE_CHECKING:
    from tailstack.design import Design

MOST_TOLD = 6  # places
BOUND_SECONDS = 3.0  # for each design; the demo takes 1, one with six uniform half-widths 3


class ValidationOptions(Options):
    """Whether more is asked than that a design can be read, and its geometry is sound."""

    bound: bool = False
    """Say what error no layout within the `optimise` section could undercut, proved of the estimate: whether its limits
    can be kept at all. And where in it fiducials tell most."""

    def seconds(self, sizes: Iterable[Size]) -> float:
        return super().seconds(size._replace(targets=0) for size in sizes) + self.bound * BOUND_SECONDS


@dataclass(frozen=True, slots=True, repr=False)
class Validation(Published):
    """A design that was read and checked, and what it holds.  No error was computed."""

    schema: Literal["tailstack/validation/1"]
    valid: Literal[True]
    """A design that is not valid is answered with a problem document."""
    name: str
    """Name of the design."""
    design_sha256: str
    """SHA-256 of the design's canonical content, fiducials included."""
    views: tuple[str, ...]
    """Names of the views."""
    fiducials: int
    """Number of fiducials."""
    targets: tuple[str, ...]
    """Names of the targets, regions expanded to their samples."""
    requirements: tuple[str, ...]
    """Names of the requirements."""
    visibility: tuple[ViewCheck, ...]
    """Visibility of the fiducials in each view."""
    findings: tuple[Finding, ...]
    """Remarks about the design's geometry."""
    notes: tuple[str, ...]
    """What was done to the design's numbers on the way, and what it leaves open."""
    assumed: tuple[str, ...] = ()
    """What nobody stated: a JSON pointer (RFC 6901) into the design document for each assumed value."""
    bounds: tuple[GlobalBound, ...] = ()
    """For each requirement that its `optimise` section asks for, what no layout undercuts; empty unless asked for."""
    cheapest: Relaxation | None = None
    """What no layout undercuts in cost, with whatever half-widths; null unless asked for, and a cost is made least."""
    places: tuple[WorthyPlace, ...] = ()
    """Where in the envelope fiducials tell most, the most valuable first; empty unless bounds are asked for."""


def validate(design: Design, *, bound: bool = False) -> Validation:
    """Compile the design, check its geometry and count what it holds; ``bound``: and what no layout could undercut.

    Raises DesignError and IllPosedError.
    """
    from tailstack.design import check_design

    system, findings, visibility = check_design(design)
    bounds, cheapest, places = _bound(design) if bound else ((), None, ())
    return Validation(
        schema="tailstack/validation/1",
        valid=True,
        name=design.name,
        design_sha256=design.sha256,
        views=tuple(view.name for view in system.views),
        fiducials=len(system.fiducials_mm),
        targets=tuple(target.name for target in system.targets),
        requirements=tuple(requirement.name for requirement in system.requirements),
        visibility=visibility,
        findings=findings,
        notes=system.notes,
        assumed=system.assumed,
        bounds=bounds,
        cheapest=cheapest,
        places=places,
    )


def _bound(design: Design) -> tuple[tuple[GlobalBound, ...], Relaxation | None, tuple[WorthyPlace, ...]]:
    from tailstack.optimisation.cost_bound import bound_layouts
    from tailstack.optimisation.worth import worthy_places

    return *bound_layouts(design), worthy_places(design)


def validation_text(file: str, validation: Validation) -> str:
    """``file: valid`` and what the design holds."""
    counts = (
        f"{validation.fiducials} fiducials; views {_list_names(validation.views)}; targets "
        f"{_list_names(validation.targets)}; requirements {_list_names(validation.requirements)}"
    )
    lines = [wrap(f"{file}: valid, {visible(validation.name)}"), wrap(counts, first="  ", indent="  ")]
    lines += [
        wrap(sentence, first=f"  {finding.severity}: ", indent="    ")
        for finding, sentence in group_findings(validation.findings)
    ]
    lines += [
        wrap(f"view {view.view}: outside the image: {', '.join(view.outside)}", first="  warning: ", indent="    ")
        for view in validation.visibility
        if view.outside
    ]
    lines += [wrap(note, first="  note: ", indent="    ") for note in validation.notes]
    lines += [
        wrap(f"{each.requirement}: {each.statement}", first="  bound: ", indent="    ") for each in validation.bounds
    ]
    if validation.cheapest is not None:
        lines.append(wrap(f"cost: {validation.cheapest.statement}", first="  bound: ", indent="    "))
    if validation.places:
        first = "; ".join(", ".join(f"{x:.0f}" for x in place.position_mm) for place in validation.places[:MOST_TOLD])
        lines.append(wrap(f"fiducials tell most about x, y, z = {first} mm", first="  places: ", indent="    "))
    if validation.assumed:
        lines.append(wrap(f"{assumed_sentence(validation.assumed)}:", first="  assumed: ", indent="    "))
        lines += [f"    {visible(pointer)}" for pointer in validation.assumed]
    return "\n".join(lines) + "\n"


def _list_names(names: tuple[str, ...]) -> str:
    shown = ", ".join(f'"{visible(name)}"' if "," in name else visible(name) for name in names[:6])
    return (shown + (f" and {len(names) - 6} more" if len(names) > 6 else "")) or "none"


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("design", metavar="DESIGN", nargs="+", help="design documents, YAML or JSON; - reads stdin")
    words = (
        "print a line of JSON for each design that is valid (tailstack schema validation); a refusal is then a problem "
        "document, one line on stderr for each design"
    )
    parser.add_argument("--json", action="store_true", help=words)
    add_flags(parser, ValidationOptions)


def _run(arguments: argparse.Namespace) -> Answer:
    from ..console.refusals import name_stdin, next_command, problems_text, report_error

    lines, records, codes = [], [], []
    options = ValidationOptions.of_flags(arguments)
    for name in arguments.design:
        try:
            validation = validate(read_design(name), bound=options.bound)
            if arguments.json:
                records.append(to_json(validation) + b"\n")
            else:
                lines.append(validation_text(name, validation))
        except TailstackError as error:
            codes.append(error.exit_code)
            if arguments.json:
                report_error(error, argparse.Namespace(verb="validate", design=name, json=True))
                continue
            print("\n".join(problems_text(name_stdin(error.problems, name))), file=sys.stderr)
            print(next_command(error, argparse.Namespace(verb="validate", design=name)), file=sys.stderr)
            lines.append(f"{name}: not valid, {spell_count(len(error.problems), 'problem')}\n")
    # a document that breaks the rules (2) counts before one that is ill-posed (3)
    return Answer(b"".join(records) if arguments.json else "".join(lines), min(codes, default=PASS))


OPERATION = Operation(
    name="validation",
    verb="validate",
    path="/v1/validations",
    summary="Parse and check, no computing",
    description="Reads the design, checks its geometry and says what it holds. No error is computed. A design that is "
    "not valid is answered with 422 and everything that is wrong with it.",
    title="answer of validate: what a design holds, and remarks",
    options=ValidationOptions,
    record=lambda: Validation,
    run=lambda call: validate(call.design, bound=call.options.bound),
    immediate=True,
    command=Command(_add_arguments, _run),
)
