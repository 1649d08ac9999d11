"""Verbs of operations: a command of their own, or DESIGN and a flag for each option."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from tailstack.extras import require_extras

from ..console.command_line import Answer, add_details, add_json, read_design, whole
from ..console.files import writable, write_and_tell
from ..console.flags import add_flags
from ..console.progress import Progress
from ..documents import to_json
from ..operations.operation import Call, Operation, refuse_unknown_target
from ..operations.registry import FAMILIES, operations_of

if TYPE_CHECKING:
    from tailstack.design import Design

Parsers = Any  # what add_subparsers() gives: argparse has no public name for it


def add_verb(parsers: Parsers, verb: str) -> None:
    """The parser of a verb, or of a family of them (``study views``)."""
    if verb not in FAMILIES:
        _add_operation(parsers, verb, operations_of(verb)[0])
        return
    family = parsers.add_parser(verb, help=FAMILIES[verb], description=FAMILIES[verb])
    members = family.add_subparsers(dest=verb, metavar=verb.upper(), required=True)
    for operation in operations_of(verb):
        _add_operation(members, operation.verb.partition(" ")[2], operation)


def _add_operation(parsers: Parsers, name: str, operation: Operation) -> None:
    parser = parsers.add_parser(
        name,
        help=operation.summary[0].lower() + operation.summary[1:],
        description=sys.modules[operation.options.__module__].__doc__,
    )
    if operation.command is None:
        add_arguments(parser, operation)
        parser.set_defaults(run=lambda arguments: run(operation, arguments), verb=operation.verb)
    else:
        operation.command.add_arguments(parser)
        parser.set_defaults(run=operation.command.run, verb=operation.verb)
    if operation.threads:
        parser.add_argument(
            "--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it"
        )
    add_details(parser)


# --- the command of an operation that needs no other ------------------------------------------------------


def add_arguments(parser: argparse.ArgumentParser, operation: Operation) -> None:
    """The designs, the forms of the answer, a flag for each option, and what else the operation states."""
    for field, words in operation.designs.items():
        single = len(operation.designs) == 1
        metavar = "DESIGN" if single else field.upper()
        what = "design document, YAML or JSON; - reads stdin" if single else words
        parser.add_argument(field, metavar=metavar, help=what)
    form = parser.add_mutually_exclusive_group()
    add_json(form)
    if operation.csv is not None:
        form.add_argument("--csv", action="store_true", help=f"print one line of CSV for each {operation.csv.line}")
    add_flags(parser, operation.options)
    if operation.target:
        parser.add_argument("--target", metavar="NAME", help="target that is shown (default: the largest P95)")
    if operation.figure is not None:
        parser.add_argument("--figure", metavar="FILE", help=f"draw {operation.figure.words} (.svg)")


def run(operation: Operation, arguments: argparse.Namespace) -> Answer:
    """Read, compute, draw, print."""
    given = (getattr(arguments, field) for field in operation.designs)
    designs = tuple(read_design(name) for name in given if name is not None)  # refused before the solver is loaded

    options = operation.options.of_flags(arguments)
    choice = _choose_target(arguments, designs[0]) if operation.target else ()
    file = None
    if getattr(arguments, "figure", None) is not None:
        require_extras("report")  # or nothing can draw it
        file = writable(arguments.figure, (".svg",))
    with Progress(operation.verb) as progress:
        call = Call(designs, options, getattr(arguments, "threads", None), progress.report, typed=True)
        if file is not None and operation.figure is not None:
            operation.figure.check(call)
        record = operation.run(call)
    if file is not None and operation.figure is not None:
        write_and_tell(file, operation.figure.draw(record, *choice))
    code = operation.exit_code(record)
    if arguments.json:
        return Answer(to_json(record), code)
    if operation.csv is not None and arguments.csv:
        return Answer(operation.csv.write(record), code)
    return Answer(operation.write(record, *choice), code)


def _choose_target(arguments: argparse.Namespace, design: Design) -> tuple[str | None]:
    """Raises RequestError for a target that the design does not have."""
    from tailstack.design import compile_design

    refuse_unknown_target(arguments.target, [target.name for target in compile_design(design).targets])
    return (arguments.target,)
