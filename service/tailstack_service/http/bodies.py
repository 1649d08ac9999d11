"""What stands in a body: read strictly, with every problem at its place in what was sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from tailstack.design import Design, load_design
from tailstack.design.reading import DEFAULT_LIMITS, Limits, Source, decode, read_text, shown
from tailstack.errors import DesignError, LimitError, Problem, TailstackError

from ..problems import MalformedError, RequestError
from ..settings import Settings, variable

# What the reader of documents says about text that is not a document at all.
SYNTAX = frozenset(
    {
        "bad-key", "duplicate-key", "empty-document", "json-syntax", "not-text", "several-documents", "yaml-alias",
        "yaml-syntax", "yaml-tag",
    }
)  # fmt: skip
SETTING_OF = {"/views": "max_views", "/fiducials/points": "max_fiducials", "/targets": "max_targets",
              "/requirements": "max_targets"}  # fmt: skip


class Placed(Exception):
    """A refusal that belongs to the design, with the pointer to the design in the body."""

    def __init__(self, error: TailstackError, prefix: str) -> None:
        super().__init__(str(error))
        self.error, self.prefix = error, prefix


def limits_of(settings: Settings) -> Limits:
    """Bounds for the reader of designs."""
    return replace(
        DEFAULT_LIMITS,
        document_bytes=settings.max_body_bytes,
        fiducials=settings.max_fiducials,
        targets=settings.max_targets,
        views=settings.max_views,
    )


def parse_json(body: bytes, settings: Settings) -> dict[str, Any]:
    """The body as a mapping.  Raises MalformedError, RequestError (not a mapping), LimitError (too deep)."""
    try:
        text = decode(body, None)
        data = read_text(text, limits_of(settings), file=None, directory=None, form="json").data
    except DesignError as error:
        raise MalformedError(error.problems) from None
    if not isinstance(data, dict):
        hint = 'send {"design": {...}}'
        raise RequestError(Problem("", "wrong-type", f"the body is a JSON object; got {shown(data)}", hint))
    return data


def design_of(data: dict[str, Any], settings: Settings, field: str = "design") -> Design:
    """The design in a field of a JSON body.  Raises RequestError, or Placed around DesignError and LimitError."""
    if field not in data:
        if str(data.get("schema", "")).startswith("tailstack/design/"):
            hint = f'the body looks like the design itself: send {{"{field}": <it>}}'
        else:
            hint = "the design document goes here: GET /v1/schemas/design"
        raise RequestError(Problem("", "missing-field", f"the field {field!r} is required", hint))
    if not isinstance(data[field], dict):
        problem = Problem("", "wrong-type", f"a design is a mapping of fields; got {shown(data[field])}")
        raise Placed(DesignError(problem), f"/{field}")
    return loaded(Source(data[field], None, None), settings, f"/{field}")  # read strictly with the body: plain data


def loaded(source: Source | bytes, settings: Settings, prefix: str) -> Design:
    """A checked design from what was read, or from YAML.  Raises Placed, MalformedError for what is not YAML at all."""
    form: Any = "yaml" if isinstance(source, bytes) else "auto"
    try:
        return load_design(source, form=form, allow_files=False, limits=limits_of(settings))
    except DesignError as error:
        if isinstance(source, bytes) and all(p.code in SYNTAX and not p.pointer for p in error.problems):
            raise MalformedError(error.problems) from None
        raise Placed(error, prefix) from None
    except LimitError as error:
        raise Placed(LimitError(_with_settings(error.problems)), prefix) from None


def _with_settings(problems: Sequence[Problem]) -> list[Problem]:
    """Say which setting raises a limit."""
    return [
        replace(p, hint=f"send fewer, or start the service with a higher {variable(SETTING_OF[p.pointer])}")
        if p.code == "too-many" and p.pointer in SETTING_OF
        else p
        for p in problems
    ]
