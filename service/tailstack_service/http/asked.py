"""A request for one design: the design and the options beside it, from a JSON body or from YAML and the query."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from starlette.requests import Request

from tailstack.design import Design
from tailstack.design.refusals import pointer
from tailstack.errors import Problem

from ..problems import RequestError
from ..settings import Settings
from .bodies import content_kind, design_of, loaded, parse_json, read_body
from .options import Options, options_of

QUICK_BYTES = 50_000  # of JSON; 500 fiducials take some 5 ms to be checked

O = TypeVar("O", bound=Options)  # noqa: E741


@dataclass(frozen=True, slots=True)
class Asked(Generic[O]):
    """What arrived, options checked, the design not yet looked at."""

    source: dict[str, Any] | bytes  # the JSON body, or the YAML text of a design
    options: O
    prefix: str  # pointer to the design in what was sent
    length: int  # bytes of the body

    @property
    def bare_design(self) -> bool:
        return isinstance(self.source, bytes)

    @property
    def quick_to_read(self) -> bool:
        """Whether :meth:`design` takes milliseconds: YAML is read twenty times more slowly than JSON."""
        return self.length <= QUICK_BYTES and not self.bare_design

    def design(self, settings: Settings) -> Design:
        """The checked design.  Raises Placed, RequestError, MalformedError."""
        if isinstance(self.source, bytes):
            return loaded(self.source, settings, self.prefix)
        return design_of(self.source, settings)

    def data(self, design: Design) -> dict[str, Any]:
        """The design as it was sent, as plain data."""
        data: dict[str, Any] = design.source.data if isinstance(self.source, bytes) else self.source["design"]
        return data


async def read_asked(request: Request, kind: type[O]) -> Asked[O]:
    """Read body and options.  Raises TransportError, MalformedError, RequestError, LimitError."""
    settings: Settings = request.app.state.service.settings
    form = content_kind(request, yaml=True)
    body = await read_body(request, settings)
    if form == "json":
        refuse_query(request, (), "options go into the body, beside the design")
        data = parse_json(body, settings)
        return Asked(data, options_of(kind, data), "/design", len(body))
    return Asked(body, _query_options(kind, request), "", len(body))


def refuse_query(request: Request, known: tuple[str, ...], hint: str = "") -> None:
    """Refuse query parameters that mean nothing here, each with a pointer to its name.  Raises RequestError."""
    if not request.scope["query_string"]:
        return
    for name in request.query_params:
        if name not in known:
            hint = hint or (f"known: {', '.join(known)}" if known else "this operation takes none")
            detail = f"there is no query parameter {name[:60]!r}"
            raise RequestError(Problem(pointer([name[:60]]), "unknown-parameter", detail, hint))


def _query_options(kind: type[O], request: Request) -> O:
    """Options from the query.  Text becomes what the option takes; what cannot is refused like in JSON."""
    known = {name: name for name in kind.model_fields} | kind.in_query()
    refuse_query(request, tuple(known))
    schema = kind.model_json_schema().get("properties", {})
    data: dict[str, Any] = {}
    for name, option in known.items():
        given = request.query_params.getlist(name)
        if not given:
            continue
        if name in kind.in_query():
            data[option] = kind.from_query(option, given)
        elif len(given) > 1:
            raise RequestError(
                Problem(f"/{name}", "bad-parameter", f"{name} is given {len(given)} times; once is enough")
            )
        else:
            data[option] = from_text(given[0], schema[name])
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
