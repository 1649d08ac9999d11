"""What was sent with a request, read strictly: designs and options, from a JSON body or from YAML and the query.

Every refusal points into what was sent.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from tailstack.design import Design, load_design
from tailstack.design.loading import holds_points
from tailstack.design.reading import (
    DEFAULT_LIMITS,
    LOOKS_LIKE_YAML,
    DocumentSource,
    Limits,
    decode,
    point_list_problem,
    read_text,
    show,
)
from tailstack.design.refusals import describe_value
from tailstack.errors import DesignError, LimitError, Problem, TailstackError, write_pointer
from tailstack.field_names import cure_name, find_renamings
from tailstack.people_tables import KEPT_ENDS, read_plain_number
from tailstack.results.json_text import write_json

from ..console.flags import TypedOption, list_options
from ..environment import variable
from ..problems import MalformedError, RefusedAt, RequestError
from ..processes.task import NAMED, Query, RawRequest
from .content import canonical

if TYPE_CHECKING:
    from ..settings import Settings

O = TypeVar("O", bound=BaseModel)  # noqa: E741
T = TypeVar("T")


class DesignReferenceUnresolved(Exception):
    """The body names a design by its hash, which has to be looked up before the request can be read."""

    def __init__(self, sha256: str) -> None:
        super().__init__(sha256)
        self.sha256 = sha256


@dataclass(frozen=True, slots=True)
class Request:
    """What was sent, read: designs and options."""

    options: Any  # of the operation's class of options
    designs: tuple[Design, ...]
    data: dict[str, dict[str, Any]]  # the designs as they were sent, by field
    prefixes: tuple[str, ...]  # pointers to the designs in what was sent
    bare_design: bool  # the body was the design itself
    patched: bool = False  # the design was put together from another one

    @property
    def design(self) -> Design:
        """The only design."""
        (design,) = self.designs
        return design

    @property
    def nameable(self) -> tuple[tuple[str, bytes], ...]:
        """The designs as later requests may name them: SHA-256 and JSON."""
        pairs = zip(self.designs, self.data.values(), strict=True)
        return tuple((design.sha256, canonical(data)) for design, data in pairs)

    def refuse_by(self, check: Callable[[Design], T], which: int = 0) -> T:
        """What a function finds of a design; what it refuses is placed in what was sent.  Raises RefusedAt."""
        try:
            return check(self.designs[which])
        except TailstackError as error:
            raise self.place(error, which) from None

    def place(self, error: TailstackError, which: int = 0) -> RefusedAt:
        """A refusal of a design, placed in what was sent."""
        return RefusedAt.place(error, self.prefixes[which])


def read_request(
    sent: RawRequest, kind: type[BaseModel], fields: Sequence[str], settings: Settings, *, yaml: bool
) -> Request:
    """Options first, then each design.  kind: of the options; fields: of the designs; yaml: it is read as well.

    Raises MalformedError, RequestError, LimitError, RefusedAt, DesignReferenceUnresolved.
    """
    if sent.form != "json":
        options = options_of_query(kind, sent.query)
        design = load(sent.body, settings, "")
        return Request(options, (design,), {fields[0]: design.source.data}, ("",), True)
    body = parse_json(sent.body, settings, yaml=yaml)
    in_parts = tuple(fields) == ("design",) and bool({NAMED, PATCH} & body.keys())
    if in_parts:
        _refuse_partial(body)
    options = read_options(kind, body, fields if fields != ("design",) else ("design", NAMED, PATCH))
    if in_parts:
        body["design"] = _apply_patch(body, sent)
    designs = tuple(design_of(body, settings, field) for field in fields)
    data = {field: body[field] for field in fields}
    return Request(options, designs, data, tuple(f"/{field}" for field in fields), False, in_parts)


# --- partial documents: a design named by its hash or sent whole, and what differs from it (RFC 7396) -------

PATCH = "patch"  # field of a request, beside ``design`` or NAMED
SHA256 = re.compile("[0-9a-f]{64}")


def merge(target: Any, patch: Any) -> Any:
    """JSON merge patch (RFC 7396): null removes, objects are merged, anything else takes the place of what was there.

    Lists are replaced whole.  ``target`` is left as it is.
    """
    if not isinstance(patch, dict):
        return patch
    merged = dict(target) if isinstance(target, dict) else {}
    for key, value in patch.items():
        if value is None:
            merged.pop(key, None)
        else:
            merged[key] = merge(merged.get(key), value)
    return merged


def _refuse_partial(data: dict[str, Any]) -> None:
    """Refuse what a body has instead of the design, or beside it, where it means none.  Raises RequestError."""
    name, patch = data.get(NAMED), data.get(PATCH, {})
    if NAMED in data and "design" in data:
        detail = f"give design or {NAMED}; both arrived"
        raise RequestError(Problem(f"/{NAMED}", "one-of", detail, "the patch is applied to the one that is given"))
    if NAMED in data and not (isinstance(name, str) and SHA256.fullmatch(name)):
        detail = f"a SHA-256 has 64 hexadecimal digits, in small letters; got {show(name)}"
        raise RequestError(Problem(f"/{NAMED}", "bad-text", detail, f"{NAMED} of an answer is one"))
    if not isinstance(patch, dict):
        detail = f"a patch of a design is an object (JSON merge patch, RFC 7396); got {show(patch)}"
        raise RequestError(Problem(f"/{PATCH}", "wrong-type", detail, 'for example {"name": "another"}'))
    if NAMED not in data and "design" not in data:
        detail = f"there is no design for the patch: give design or {NAMED}"
        raise RequestError(Problem("", "missing-field", detail, f"{NAMED} names a design that was sent before"))


def _apply_patch(body: dict[str, Any], sent: RawRequest) -> Any:
    """The design that a request means.  Raises DesignReferenceUnresolved."""
    if NAMED in body and sent.base is None:
        raise DesignReferenceUnresolved(body[NAMED])
    design = body["design"] if sent.base is None or NAMED not in body else json.loads(sent.base)
    return merge(design, body.get(PATCH, {})) if isinstance(design, dict) else design  # which is refused as it is


# --- options ----------------------------------------------------------------------------------------------


def read_options(kind: type[O], data: dict[str, Any], others: Sequence[str] = ("design",)) -> O:
    """Options from everything in the body but the design.  Raises RequestError."""
    try:
        return kind.model_validate({key: value for key, value in data.items() if key not in others})
    except ValidationError as error:
        known = [*others, *kind.model_fields]
        problems = [_translate(entry, known, kind) for entry in error.errors(include_url=False)]
        problems.sort(key=lambda problem: problem.code != "unknown-field")  # a slip in a name explains what is missing
        raise RequestError(problems[:25]) from None


def _translate(entry: Any, known: list[str], options: type[BaseModel]) -> Problem:
    path, kind = entry["loc"], entry["type"]
    if kind == "extra_forbidden":
        name = str(path[-1])
        hint = ""
        if len(path) > 1:  # inside an option
            known = _fields_inside(options, str(path[0]))
        elif name not in known:
            holders = (own for own in options.model_fields if find_renamings(name, _fields_inside(options, own)))
            hint = next((_example((holder,), options) for holder in holders), "")
        hint = hint or cure_name(name, known, entry.get("input"), otherwise=f"known: {', '.join(known)}")[0]
        return Problem(write_pointer(path), "unknown-field", f"there is no option {show(name)[9:]}", hint)
    if kind == "missing":
        detail = f"the field {str(path[-1])!r} is required"
        hint = _example(path, options) or "GET /openapi.json describes it"
        return Problem(write_pointer(path[:-1]), "missing-field", detail, hint)
    problem = describe_value(entry, path)
    if kind in ("too_short", "too_long", "string_too_short", "string_too_long"):
        return replace(problem, hint=_example(path, options))
    return problem


def _example(path: tuple[str | int, ...], options: type[BaseModel]) -> str:
    """The example of the field at an error's path, to be typed."""
    name = [step for step in path if isinstance(step, str)][-1]
    examples = next((field.examples for field in _fields(options, name) if field.examples), None)
    return f"for example: {write_json({name: examples[0]})}" if examples else ""


def _fields(options: type[BaseModel], name: str) -> Iterator[FieldInfo]:
    """Fields of that name, of the options and of the models inside them."""
    for own, field in options.model_fields.items():
        if own == name:
            yield field
        for inside in _models(field.annotation):
            yield from _fields(inside, name)


def _fields_inside(options: type[BaseModel], option: str) -> list[str]:
    """Names of the fields of an option that is a record, or a list of them."""
    return [name for model in _models(options.model_fields[option].annotation) for name in model.model_fields]


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


# --- the query ------------------------------------------------------------------------------------------


def refuse_query(query: Query, known: tuple[str, ...], hint: str = "") -> None:
    """Refuse query parameters that mean nothing here, each with a pointer to its name.  Raises RequestError."""
    for name, text in query:
        if name not in known:
            otherwise = f"known: {', '.join(known)}" if known else "this operation takes none"
            hint = hint or cure_name(name, known, read_plain_number(text), otherwise=otherwise)[0]
            detail = f"there is no query parameter {name[:60]!r}"
            raise RequestError(Problem(write_pointer([name[:60]]), "unknown-parameter", detail, hint))


def single(query: Query, name: str) -> str | None:
    """A query parameter that may be given once.  Raises RequestError."""
    given = [value for key, value in query if key == name]
    if len(given) > 1:
        raise RequestError(Problem(f"/{name}", "bad-parameter", f"{name} is given {len(given)} times; once is enough"))
    return given[0] if given else None


def options_of_query(kind: type[O], query: Query) -> O:
    """Options from the query.  Text becomes what the option takes; what cannot is refused like in JSON."""
    known = {option.query_name: option for option in list_options(kind)}
    refuse_query(query, tuple(known))
    schema = kind.model_json_schema().get("properties", {})
    data: dict[str, Any] = {}
    for name, option in known.items():
        if option.listed:
            if given := [value for key, value in query if key == name]:
                data[option.name] = _read_list(option, given)
        elif (text := single(query, name)) is not None:
            data[option.name] = from_text(text, schema[option.name])
    return read_options(kind, data)


def _read_list(option: TypedOption, given: Sequence[str]) -> list[Any]:
    """The entries of texts in the query.  Raises RequestError."""
    try:
        return [entry for text in given for entry in option.read(text)]
    except argparse.ArgumentTypeError as error:
        raise RequestError(Problem(write_pointer([option.query_name]), "bad-parameter", str(error))) from None


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


# --- bodies and designs --------------------------------------------------------------------------------

# What the reader of documents says about text that is not a document at all.
SYNTAX = frozenset(
    {
        "bad-key", "duplicate-key", "empty-document", "json-syntax", "not-text", "several-documents", "yaml-alias",
        "yaml-syntax", "yaml-tag",
    }
)  # fmt: skip
LONGEST_LINE = 60  # bytes, of a text without line ends that nobody had to send with them
SETTING_OF = {"/views": "max_views", "/fiducials/points": "max_fiducials", "/targets": "max_targets",
              "/requirements": "max_targets"}  # fmt: skip


def limits_of(settings: Settings) -> Limits:
    """Bounds for the reader of designs."""
    return replace(
        DEFAULT_LIMITS,
        document_bytes=settings.max_body_bytes,
        fiducials=settings.max_fiducials,
        targets=settings.max_targets,
        views=settings.max_views,
    )


def parse_json(body: bytes, settings: Settings, *, yaml: bool = True) -> dict[str, Any]:
    """The body as a mapping.  Raises MalformedError, RequestError (not a mapping), LimitError (too deep).

    ``yaml``: the operation reads YAML as well, which the cure of a body that is YAML then says.
    """
    try:
        text = decode(body, None)
        data = read_text(text, limits_of(settings), file=None, directory=None, form="json").data
    except DesignError as error:
        cure = "it looks like YAML: " + ("send Content-Type: application/yaml" if yaml else "this operation takes JSON")
        problems = [replace(p, hint=cure) if p.hint == LOOKS_LIKE_YAML else p for p in error.problems]
        if not problems[0].hint and body.strip()[:1] not in (b"{", b"["):
            problems[0] = replace(problems[0], hint="it is no JSON: say in Content-Type what it is")
        raise MalformedError(problems) from None
    if not isinstance(data, dict):
        hint = 'send {"design": {...}}'
        raise RequestError(Problem("", "wrong-type", f"the body is a JSON object; got {show(data)}", hint))
    return data


def design_of(data: dict[str, Any], settings: Settings, field: str = "design") -> Design:
    """The design in a field of a JSON body.  Raises RequestError, RefusedAt for what the design is refused for."""
    if field not in data:
        if str(data.get("schema", "")).startswith("tailstack/design/"):
            hint = f'the body looks like the design itself: send {{"{field}": <it>}}'
        else:
            hint = "the design document goes here: GET /v1/schemas/design"
        raise RequestError(Problem("", "missing-field", f"the field {field!r} is required", hint))
    if not isinstance(data[field], dict):
        problem = Problem("", "wrong-type", f"a design is a mapping of fields; got {show(data[field])}")
        if holds_points(data[field]):
            problem = point_list_problem(None)
        raise RefusedAt.place(DesignError(problem), f"/{field}")
    source = DocumentSource(data[field], None, None)  # read strictly with the body: plain data
    return load(source, settings, f"/{field}")


def cure_line_ends(error: DesignError, body: bytes) -> DesignError:
    """A refusal of a text, with how to send it if it came as one line, longer than any that is a text by itself."""
    text = body.strip()
    if len(text) <= LONGEST_LINE or text.startswith(b"{") or b"\n" in text or b"\r" in text:
        return error
    if error.problems[0].code == "not-text":  # a workbook, say, which has no lines to lose
        return error
    return DesignError([replace(error.problems[0], hint=KEPT_ENDS)])


def load(source: DocumentSource | bytes, settings: Settings, prefix: str) -> Design:
    """A checked design from what was read, or YAML.  Raises RefusedAt, MalformedError for what is not YAML at all."""
    form: Any = "yaml" if isinstance(source, bytes) else "auto"
    try:
        return load_design(source, form=form, allow_files=False, limits=limits_of(settings))
    except DesignError as error:
        if isinstance(source, bytes) and b'"design"' in source and error.problems[0].code == "unsupported-schema":
            hint = "the design stands inside this body: send Content-Type: application/json"
            error = DesignError([replace(error.problems[0], hint=hint)])
        if isinstance(source, bytes):
            error = cure_line_ends(error, source)
        if isinstance(source, bytes) and all(p.code in SYNTAX for p in error.problems):
            raise MalformedError(error.problems) from None
        raise RefusedAt.place(error, prefix) from None
    except LimitError as error:
        raise RefusedAt.place(LimitError(_name_settings(error.problems)), prefix) from None


def _name_settings(problems: Sequence[Problem]) -> list[Problem]:
    """Say which setting raises a limit."""
    return [
        replace(p, hint=f"send fewer, or start the service with a higher {variable(SETTING_OF[p.pointer])}")
        if p.code == "too-many" and p.pointer in SETTING_OF
        else p
        for p in problems
    ]
