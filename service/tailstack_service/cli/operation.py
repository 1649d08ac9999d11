"""Verbs of operations: a command of their own, or DESIGN and a flag for each option."""

from __future__ import annotations

import argparse
import sys
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from ..console.answer import Answer
from ..console.arguments import add_details, number, read_design, whole
from ..console.progress import Progress
from ..operations.operation import Call, Operation
from ..operations.registry import FAMILIES, operations_of

Parsers = Any  # what add_subparsers() gives: argparse has no public name for it


def add_verb(parsers: Parsers, verb: str) -> None:
    """The parser of a verb, or of a family of them (``study paper``)."""
    if verb not in FAMILIES:
        _add_operation(parsers, verb, operations_of(verb)[0])
        return
    family = parsers.add_parser(verb, help=FAMILIES[verb], description=FAMILIES[verb], allow_abbrev=False)
    members = family.add_subparsers(dest=verb, metavar=verb.upper(), required=True)
    for operation in operations_of(verb):
        _add_operation(members, operation.verb.partition(" ")[2], operation)


def _add_operation(parsers: Parsers, name: str, operation: Operation) -> None:
    parser = parsers.add_parser(
        name,
        help=operation.summary[0].lower() + operation.summary[1:],
        description=sys.modules[operation.run.__module__].__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    if operation.command is None:
        add_arguments(parser, operation)
        parser.set_defaults(run=lambda arguments: run(operation, arguments), verb=operation.verb)
    else:
        operation.command.add_arguments(parser)
        parser.set_defaults(run=operation.command.run, verb=operation.verb)
    add_details(parser)


# --- the command of an operation that needs no other ------------------------------------------------------


def add_arguments(parser: argparse.ArgumentParser, operation: Operation) -> None:
    """The designs, --json, and a flag for each option and limit."""
    for field, words in operation.designs.items():
        single = len(operation.designs) == 1
        metavar = "DESIGN" if single else field.upper()
        what = "design document, YAML or JSON; - reads stdin" if single else words
        parser.add_argument(field, metavar=metavar, nargs=None if operation.needs_design else "?", help=what)
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the answer as JSON (tailstack schema lists the schemas); a refusal is then a problem document on "
        "stderr",
    )
    exclusive = parser.add_mutually_exclusive_group() if operation.options.exclusive else parser
    for name, option in operation.options.model_fields.items():
        _add_option(exclusive if name in operation.options.exclusive else parser, name, option)
    for name in operation.limits:
        flag = f"--{name.replace('_', '-')}"
        parser.add_argument(flag, dest=name, type=whole(1000), metavar="N", help=LIMITS[name])
    if operation.threads:
        parser.add_argument(
            "--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it"
        )


LIMITS = {
    "max_trials": "give up --precision after so many (default 4194304; a service may be set to another number)",
}


def _add_option(parser: Any, name: str, field: FieldInfo) -> None:
    """A flag by the type and the bounds of an option."""
    flag, words = f"--{name.replace('_', '-')}", (field.description or "").rstrip(".")
    words = words[:1].lower() + words[1:]
    kind, bounds = _kind(field)
    default = None if field.default is None else f" (default {field.default})"
    if kind is bool:
        parser.add_argument(flag, action="store_true", help=words)
    elif get_origin(kind) is Literal:
        parser.add_argument(flag, choices=get_args(kind), default=field.default, help=f"{words}{default or ''}")
    elif kind is int:
        low, high = bounds.get("ge", 0), bounds.get("le")
        parser.add_argument(
            flag, type=whole(low, high), default=field.default, metavar="N", help=words + (default or "")
        )
    elif kind is float:
        parser.add_argument(flag, type=number(bounds), default=field.default, metavar="X", help=words + (default or ""))
    elif kind is str:
        parser.add_argument(flag, default=field.default, metavar="NAME", help=words)
    else:
        raise TypeError(f"{name}: an operation with an option of this kind needs a command of its own")


def _kind(field: FieldInfo) -> tuple[Any, dict[str, Any]]:
    """The type of an option without None, and its bounds by name."""
    annotation: Any = field.annotation
    metadata = list(field.metadata)
    parts = [part for part in get_args(annotation) if part is not NoneType]
    if NoneType in get_args(annotation) and len(parts) == 1:
        annotation = parts[0]
    if hasattr(annotation, "__metadata__"):
        for found in annotation.__metadata__:
            metadata += found.metadata if isinstance(found, FieldInfo) else [found]
        annotation = annotation.__origin__
    names = {Ge: "ge", Gt: "gt", Le: "le", Lt: "lt"}
    return annotation, {names[type(b)]: getattr(b, names[type(b)]) for b in metadata if type(b) in names}


def run(operation: Operation, arguments: argparse.Namespace) -> Answer:
    """Read, compute, print."""
    given = (getattr(arguments, field) for field in operation.designs)
    designs = tuple(read_design(name) for name in given if name is not None)  # refused before the solver is loaded

    from ..documents import to_json

    options = operation.options(**{name: getattr(arguments, name) for name in operation.options.model_fields})
    limits = {name: getattr(arguments, name) for name in operation.limits if getattr(arguments, name) is not None}
    with Progress(operation.verb) as progress:
        call = Call(designs, options, limits, getattr(arguments, "threads", None), progress.report)
        record = operation.run(call)
    code = operation.exit_code(record)
    if arguments.json or operation.text is None:
        return Answer(to_json(record), code)
    return Answer(operation.text(record), code)
