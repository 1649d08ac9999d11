"""What was sent with a request: the design and the options beside it, from a JSON body or from YAML and the query."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from tailstack.design import Design
from tailstack.design.refusals import pointer
from tailstack.errors import Problem

from ..problems import RequestError
from ..settings import Settings
from .bodies import design_of, loaded, parse_json
from .options import Options, options_of

O = TypeVar("O", bound=Options)  # noqa: E741


Query = Sequence[tuple[str, str]]  # names and values, in the order in which they were sent


@dataclass(frozen=True, slots=True)
class Sent:
    """A body that has arrived, not yet looked into, and the query beside it."""

    form: str  # json, yaml, or the media type of something else that the operation takes
    body: bytes
    query: Query = ()


@dataclass(frozen=True, slots=True)
class Asked(Generic[O]):
    """What arrived, options checked, the design not yet looked at."""

    source: dict[str, Any] | bytes  # the JSON body, or the YAML text of a design
    options: O
    prefix: str  # pointer to the design in what was sent

    @property
    def bare_design(self) -> bool:
        return isinstance(self.source, bytes)

    def design(self, settings: Settings) -> Design:
        """The checked design.  Raises Placed, RequestError, MalformedError."""
        if isinstance(self.source, bytes):
            return loaded(self.source, settings, self.prefix)
        return design_of(self.source, settings)

    def data(self, design: Design) -> dict[str, Any]:
        """The design as it was sent, as plain data."""
        data: dict[str, Any] = design.source.data if isinstance(self.source, bytes) else self.source["design"]
        return data


def read_asked(sent: Sent, kind: type[O], settings: Settings) -> Asked[O]:
    """Read the options, and the body if it is JSON.  Raises MalformedError, RequestError, LimitError."""
    if sent.form == "json":
        data = parse_json(sent.body, settings)
        return Asked(data, options_of(kind, data), "/design")
    return Asked(sent.body, _query_options(kind, sent.query), "")


def refuse_query(query: Query, known: tuple[str, ...], hint: str = "") -> None:
    """Refuse query parameters that mean nothing here, each with a pointer to its name.  Raises RequestError."""
    for name, _ in query:
        if name not in known:
            hint = hint or (f"known: {', '.join(known)}" if known else "this operation takes none")
            detail = f"there is no query parameter {name[:60]!r}"
            raise RequestError(Problem(pointer([name[:60]]), "unknown-parameter", detail, hint))


def single(query: Query, name: str) -> str | None:
    """A query parameter that may be given once.  Raises RequestError."""
    given = [value for key, value in query if key == name]
    if len(given) > 1:
        raise RequestError(Problem(f"/{name}", "bad-parameter", f"{name} is given {len(given)} times; once is enough"))
    return given[0] if given else None


def _query_options(kind: type[O], query: Query) -> O:
    """Options from the query.  Text becomes what the option takes; what cannot is refused like in JSON."""
    known = {name: name for name in kind.model_fields} | kind.in_query()
    refuse_query(query, tuple(known))
    schema = kind.model_json_schema().get("properties", {})
    data: dict[str, Any] = {}
    for name, option in known.items():
        if name in kind.in_query():
            if given := [value for key, value in query if key == name]:
                data[option] = kind.from_query(option, given)
        elif (text := single(query, name)) is not None:
            data[option] = from_text(text, schema[name])
    return options_of(kind, data)


def from_text(text: str, schema: dict[str, Any]) -> Any:
    """A query value as the type that the schema asks for, or the text itself, which the check then refuses."""
    types = {entry.get("type") for entry in (schema, *schema.get("anyOf", ()))}
    if "boolean" in types and text in ("true", "false"):
        return text == "true"
    if "integer" in types and re.fullmatch(r"[+-]?[0-9]{1,19}", text):
        return int(text)
    if "number" in types and re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?", text):
        return float(text)
    return text
