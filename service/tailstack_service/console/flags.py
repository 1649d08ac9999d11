"""Flags that follow from options: name, metavar, type, bounds and help are those of the field, or said beside it.

``Annotated[int, Field(ge=1), Flag("of each point")]`` is all that an option needs: the flag of the command, the
parameter of the query and what is read from either follow.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tailstack.fields import describe_fields

from .command_line import number, whole

BOUNDS = {Ge: "ge", Gt: "gt", Le: "le", Lt: "lt"}
METAVARS = {int: "N", float: "X", str: "NAME"}


@dataclass(frozen=True, slots=True)
class Flag:
    """How an option is typed, on the command line or in a query, where its field does not say so by itself."""

    help: str = ""  # in place of the description; the default is added, unless "(default" stands in it
    name: str = ""  # in place of the field's, without dashes; one of a yes or no that is on by default begins with no-
    metavar: str = ""
    heading: str = ""  # under which --help lists it
    parse: Callable[[str], Any] | None = None  # the value of a text, or of a list one entry; ArgumentTypeError
    repeats: bool = False  # a list is given by a flag for each entry, not by one flag with commas between them
    of_file: bool = False  # it names a file whose content the option is; no query holds that
    in_query: str = ""  # name of a list in the query, where it is repeated
    text: Mapping[str, Any] = field(default_factory=dict)  # JSON Schema of what ``parse`` takes, beside type: string


NO_FLAG = object()  # beside an option that has none: the command finds it out in another way


@dataclass(frozen=True, slots=True)
class TypedOption:
    """An option, and all that follows from its field for whoever types it."""

    name: str
    field: FieldInfo
    flag: Flag
    kind: Any  # its type; of a list that of an entry
    bounds: Mapping[str, Any]  # ge, gt, le, lt
    listed: bool  # whether it is a list
    has_flag: bool

    @property
    def spelling(self) -> str:
        """The flag as it is typed."""
        negated = self.kind is bool and self.field.default is True
        return "--" + (self.flag.name or ("no-" if negated else "") + self.name.replace("_", "-"))

    @property
    def in_query(self) -> bool:
        """Whether it can be typed in a query."""
        return self.has_flag and not self.flag.of_file

    @property
    def query_name(self) -> str:
        """What it is called in a query."""
        return self.flag.in_query or self.name

    @property
    def help(self) -> str:
        """What --help says of it."""
        words, default = self.flag.help, self.field.default
        if not words:
            words = (self.field.description or "").rstrip(".")
            words = words[:1].lower() + words[1:]
        shows_default = type(default) in (int, float, str) and "(default" not in words
        return f"{words} (default {default})" if shows_default else words

    def read(self, text: str) -> Any:
        """The value of a text; of a list its entries.  Raises ArgumentTypeError."""
        if self.listed:
            return [self._parse(text)] if self.flag.repeats else self._read_list(text)
        return self._parse(text)

    def _parse(self, text: str) -> Any:
        if self.flag.parse is not None:
            return self.flag.parse(text)
        if self.kind is int:
            return whole(self.bounds.get("ge", 0), self.bounds.get("le"))(text)
        return number(dict(self.bounds))(text) if self.kind is float else text

    def _read_list(self, text: str) -> list[Any]:
        parts = [part.strip() for part in text.split(",")]
        if self.kind not in (int, float):
            if get_origin(self.kind) is Literal and not set(parts) <= set(get_args(self.kind)):
                raise argparse.ArgumentTypeError(f"expected {', '.join(get_args(self.kind))}; got {text!r}")
            return parts
        try:
            values = [self.kind(part) for part in parts]
            if all(map(isfinite, values)):
                return values
        except ValueError:
            pass
        like = ",".join(f"{value:g}" for value in (self.field.examples or [[1, 2, 3]])[0])
        numbers = "whole numbers" if self.kind is int else "numbers"
        raise argparse.ArgumentTypeError(f"expected {numbers} with commas between them like {like}; got {text!r}")

    def text_schema(self) -> dict[str, Any]:
        """The JSON Schema of a text in the query that gives entries of a list."""
        choices = {"enum": list(get_args(self.kind))} if get_origin(self.kind) is Literal else {}
        return {"type": "string", **choices, **self.flag.text}


def list_options(options: type[BaseModel]) -> list[TypedOption]:
    """The options of a class, in the order of its fields."""
    typed_options, own = [], getattr(options, "flags", {})
    for name, each in describe_fields(options).items():
        annotation, metadata = _open(each.annotation, list(each.metadata))
        listed = get_origin(annotation) is list
        if listed:
            annotation, _ = _open(get_args(annotation)[0], [])
        bounds = {BOUNDS[type(b)]: getattr(b, BOUNDS[type(b)]) for b in metadata if type(b) in BOUNDS}
        flag = next((b for b in (own.get(name), *metadata) if isinstance(b, Flag)), Flag())
        has_flag = not any(b is NO_FLAG for b in metadata)
        typed_options.append(TypedOption(name, each, flag, annotation, bounds, listed, has_flag))
    return typed_options


def _open(annotation: Any, metadata: list[Any]) -> tuple[Any, list[Any]]:
    """A type without None and without what stands beside it, which is added to the metadata."""
    parts = [part for part in get_args(annotation) if part is not NoneType]
    if NoneType in get_args(annotation) and len(parts) == 1:
        annotation = parts[0]
    if hasattr(annotation, "__metadata__"):
        for entry in annotation.__metadata__:
            metadata += entry.metadata if isinstance(entry, FieldInfo) else [entry]
        annotation = annotation.__origin__
    return annotation, metadata


# --- on the command line ----------------------------------------------------------------------------------


def add_flags(parser: argparse.ArgumentParser, options: type[BaseModel], *names: str) -> None:
    """A flag for each of these options, or for all whose flags the parser does not have yet."""
    have = {action.dest for action in parser._actions}  # noqa: SLF001 - argparse has no public name for them
    typed = {option.name: option for option in list_options(options) if option.has_flag}
    exclusive: Any = None
    for name in names or [name for name in typed if name not in have]:
        place: Any = parser
        if heading := typed[name].flag.heading:
            groups = parser._action_groups  # noqa: SLF001
            existing = next((group for group in groups if group.title == heading), None)
            place = existing or parser.add_argument_group(heading)
        elif name in getattr(options, "exclusive", ()):
            place = exclusive = exclusive or parser.add_mutually_exclusive_group()
        _add_flag(place, typed[name])


def _add_flag(place: Any, option: TypedOption) -> None:
    """What is not given stays None, so that the options' own defaults hold."""
    kind: dict[str, Any] = {"type": option.read, "metavar": option.flag.metavar or METAVARS.get(option.kind)}
    if option.kind is bool:
        kind = {"action": "store_const", "const": option.field.default is not True}
    elif get_origin(option.kind) is Literal and not option.listed:
        kind = {"choices": get_args(option.kind)}
    elif option.listed and option.flag.repeats:
        kind["action"] = "extend"
    if option.field.is_required():
        kind["required"] = True
    place.add_argument(option.spelling, dest=option.name, default=None, help=option.help, **kind)


def read_flags(options: type[BaseModel], arguments: argparse.Namespace) -> dict[str, Any]:
    """The options that were given, by name."""
    given = {option.name: getattr(arguments, option.name, None) for option in list_options(options) if option.has_flag}
    return {name: value for name, value in given.items() if value is not None}


def fill_defaults(options: type[BaseModel], arguments: argparse.Namespace) -> None:
    """Let the arguments say what holds where an option was not given."""
    for option in list_options(options):
        if option.has_flag and getattr(arguments, option.name) is None:
            setattr(arguments, option.name, option.field.default)
