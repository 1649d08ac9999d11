"""What an editor needs of a document: the line at its head that names the schema, and the schema near it.

The address in the line is relative, so that it holds offline, in a clone and on another machine: the schema stands
beside the document or in a folder above it, and moves with them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from tailstack.results.json_text import write_json

from ..console.files import is_stream, replace_file
from ..console.progress import say
from ..documents import published_schema

HEAD = "# yaml-language-server: $schema="
_HEAD_LINE = re.compile(r"^# yaml-language-server:.*\n", re.MULTILINE)
_KIND = re.compile(r"^schema: tailstack/(design|policy|waivers)/1\b", re.MULTILINE)


def schema_file(name: str) -> str:
    """What the file of a published schema is called, wherever it stands."""
    return f"tailstack-{name}.schema.json"


def schema_text(schema: dict[str, Any]) -> str:
    """A schema as ``tailstack schema`` prints and writes it."""
    return write_json(schema, indent=2) + "\n"


def write_document(path: Path, text: str, *, tell: bool = True) -> None:
    """Write a design, a policy or waivers as the user's own file.  Raises OSError, and then leaves what was there.

    YAML gets a head line with the nearest schema of its kind, in its folder or above it, up to the root of the
    repository (outside one, in its folder only: what lies above may be anybody's); where there is none, the schema is
    put beside it and stderr says so, unless nobody is to be told.
    """
    kind = _KIND.search(text) if path.suffix.lower() in (".yaml", ".yml") else None
    if kind is not None and not is_stream(str(path)):
        text = HEAD + _place_schema(path, kind[1], tell) + "\n" + _HEAD_LINE.sub("", text, count=1)
    replace_file(path, text)


def _place_schema(document: Path, kind: str, tell: bool) -> str:
    """Where the schema is, seen from a document's folder.  Raises OSError."""
    folder = Path(os.path.realpath(document)).parent  # a link is written where it leads
    name = schema_file(kind)
    above = (folder, *folder.parents)
    height = next((up for up, place in enumerate(above) if (place / ".git").exists()), 0)  # of the repository's root
    for up, place in enumerate(above[: height + 1]):
        if (place / name).is_file():
            return "../" * up + name
    beside = document.parent / name
    replace_file(folder / name, schema_text(published_schema(kind, _schema_of(kind), "7")))
    if tell:
        say(f"wrote {beside}, with which editors complete and check YAML (docs/editors.md)")
    return name


def _schema_of(kind: str) -> dict[str, Any]:
    """The schema of a document that people write, in draft 2020-12."""
    if kind == "design":
        from tailstack.design import design_json_schema

        return design_json_schema()
    from ..gate.rules import policy_json_schema
    from ..gate.waivers import waivers_json_schema

    return policy_json_schema() if kind == "policy" else waivers_json_schema()
