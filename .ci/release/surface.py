"""What others build on, as a list: Python's names, fields of records, flags of verbs.

``python .ci/release/surface.py`` writes ``tests/data/stable/surface.json`` anew: what is new is added. What is gone
stays in the list, and a test fails, unless ``--drop`` says that it was deprecated for long enough (docs/stability.md).
Routes are held by ``openapi/released.json``.
"""

from __future__ import annotations

import argparse
import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tailstack
from tailstack.results.json_text import write_json
from tailstack_service.cli.main import build_parser, verbs
from tailstack_service.schemas import RECORDS, json_schema

ROOT = Path(__file__).resolve().parents[2]
PLACE = ROOT / "tests" / "data" / "stable" / "surface.json"
DOCUMENTS = ("design", "policy", "waivers")
OF_OTHERS = {"comparison": 2, "report": 2}  # they hold records of other verbs; this deep they are their own


def python_names() -> dict[str, list[str]]:
    """Public names of the library, each with the parameters that can be named, in no order."""
    return {name: sorted(_parameters(getattr(tailstack, name))) for name in sorted(tailstack.__all__)}


def _parameters(value: Any) -> list[str]:
    if not callable(value) or (isinstance(value, type) and issubclass(value, Exception)):
        return []
    return [
        name
        for name, one in inspect.signature(value).parameters.items()
        if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)
    ]


def list_actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Every argument of a parser and of the parsers below it."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no public name for them
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for below in action.choices.values():
                yield from list_actions(below)
        else:
            yield action


def flags() -> dict[str, list[str]]:
    """Long flags of every verb, and of the verbs below it."""
    return {
        verb: sorted(
            {text for one in list_actions(build_parser(verb)) for text in one.option_strings if text.startswith("--")}
            - {"--help", "--version"}
        )
        for verb in sorted(verbs())
    }


def fields() -> dict[str, list[str]]:
    """Fields of every record and document by their paths: ``targets[].p95_mm``."""
    return {name: fields_in(name) for name in sorted({*RECORDS, *DOCUMENTS})}


def fields_in(name: str) -> list[str]:
    """Fields of one record or document."""
    paths = set(fields_of(json_schema(name)))
    return sorted(path for path in paths if path.count(".") < OF_OTHERS.get(name, 99))


def fields_of(schema: dict[str, Any]) -> Iterator[str]:
    """Paths of the fields of a schema; a type inside itself is walked once."""

    def walk(node: Any, path: str, above: tuple[str, ...]) -> Iterator[str]:
        if not isinstance(node, dict):
            return
        if (reference := node.get("$ref")) and reference not in above:
            target: Any = schema
            for part in reference.removeprefix("#/").split("/"):
                target = target[part]
            yield from walk(target, path, (*above, reference))
        for key in ("anyOf", "oneOf", "allOf"):
            for one in node.get(key, ()):
                yield from walk(one, path, above)
        for name, one in node.get("properties", {}).items():
            yield f"{path}{name}"
            yield from walk(one, f"{path}{name}.", above)
        for one in (node.get("items"), *node.get("prefixItems", ())):
            yield from walk(one, path.removesuffix(".") + "[].", above)
        yield from walk(node.get("additionalProperties"), path.removesuffix(".") + "{}.", above)

    return walk(schema, "", ())


def surface() -> dict[str, dict[str, list[str]]]:
    """All of it, as it is now."""
    return {"python": python_names(), "flags": flags(), "fields": fields()}


def gone(listed: dict[str, dict[str, list[str]]], now: dict[str, dict[str, list[str]]]) -> list[str]:
    """What is listed and is there no more."""
    return [
        f"{kind}: {name}{f' {one}' if one else ''}"
        for kind, entries in listed.items()
        for name, ones in entries.items()
        for one in ([""] if name not in now[kind] else [one for one in ones if one not in now[kind][name]])
    ]


def main(arguments: list[str]) -> int:
    now = surface()
    if PLACE.exists() and "--drop" not in arguments:
        listed = json.loads(PLACE.read_text(encoding="utf-8"))
        if lost := gone(listed, now):
            sys.stderr.write("gone, and kept in the list:\n" + "".join(f"  {one}\n" for one in lost))
            for kind, entries in listed.items():
                for name, ones in entries.items():
                    now[kind][name] = sorted({*now[kind].get(name, ()), *ones})
    PLACE.write_text(write_json(now, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
