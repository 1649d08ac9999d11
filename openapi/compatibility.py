"""What a change of the OpenAPI document takes away from the programs that were written against the released one.

``python openapi/compatibility.py OLD.json NEW.json`` prints one line per breaking change and leaves with 1 if there
are any.  Requests may only become wider, responses only narrower or longer; openapi/README.md states the promise.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

Document = Mapping[str, Any]
Direction = Literal["request", "response"]
Change = tuple[str, str]  # place below the one that was asked about, what breaks

METHODS = ("get", "put", "post", "delete", "options", "head", "patch", "trace")
SILENT = frozenset(
    {"title", "description", "examples", "example", "summary", "discriminator", "deprecated", "$comment",
     "contentMediaType", "readOnly", "writeOnly", "externalDocs"}
)  # fmt: skip
LOW, HIGH = ("minLength", "minItems", "minProperties"), ("maxLength", "maxItems", "maxProperties")
SAME = ("pattern", "format", "multipleOf", "uniqueItems", "patternProperties", "propertyNames", "not", "if", "then",
        "else", "dependentRequired", "contains")  # fmt: skip
SHAPE = frozenset(
    {"format", "uniqueItems", "propertyNames", "patternProperties"}
)  # also matter to who reads a response
HANDLED = SILENT | {
    *LOW, *HIGH, *SAME, "type", "enum", "const", "default", "minimum", "maximum", "exclusiveMinimum",
    "exclusiveMaximum", "properties", "required", "additionalProperties", "items", "prefixItems", "anyOf", "oneOf",
    "allOf", "$ref",
}  # fmt: skip
TYPES = ("null", "boolean", "integer", "number", "string", "array", "object")


def breaking_changes(old: Document, new: Document) -> list[str]:
    """One sentence per thing that worked with ``old`` and does not with ``new``; empty if nothing broke.

    Raises ValueError for a schema keyword whose changes nobody has decided about.
    """
    pair, sentences = _Pair(old, new), list[str]()
    for path, methods in old["paths"].items():
        for method in (m for m in METHODS if m in methods):
            name = f"{method.upper()} {path}"
            if method not in new["paths"].get(path, {}):
                sentences.append(f"{name}: the operation is gone")
                continue
            for place, text in pair.operation(path, method):
                sentences.append(f"{name}: {place}{': ' if place else ''}{text}")
    return list(dict.fromkeys(sentences))


class _Pair:
    """Two documents, each with its own references."""

    def __init__(self, old: Document, new: Document) -> None:
        self.old, self.new = old, new
        self.known: dict[tuple[str, str, str], list[Change]] = {}  # by both schemas as written

    def operation(self, path: str, method: str) -> Iterator[Change]:
        old, new = self.old["paths"][path][method], self.new["paths"][path][method]
        if old.get("operationId") != new.get("operationId"):
            yield "", f"operationId {old.get('operationId')} is now {new.get('operationId')}"
        yield from self._parameters(_parameters(self.old, path, method), _parameters(self.new, path, method))
        yield from self._body(_resolved(self.old, old.get("requestBody")), _resolved(self.new, new.get("requestBody")))
        for status, response in old["responses"].items():
            if status not in new["responses"]:
                yield f"response {status}", "is gone"
                continue
            before, after = _resolved(self.old, response), _resolved(self.new, new["responses"][status])
            yield from _below(f"response {status}", self._response(before, after))
        yield from self._security(
            old.get("security", self.old.get("security")), new.get("security", self.new.get("security"))
        )

    def _parameters(self, old: dict[tuple[str, str], Any], new: dict[tuple[str, str], Any]) -> Iterator[Change]:
        for key, parameter in new.items():
            if parameter.get("required") and not old.get(key, {}).get("required"):
                yield f"{key[0]} parameter {key[1]}", "is now required"
        for key, parameter in old.items():
            place = f"{key[0]} parameter {key[1]}"
            if key not in new:
                yield place, "is gone"
            else:
                changes = self.schema(parameter.get("schema", {}), new[key].get("schema", {}), "request")
                yield from _below(place, changes)

    def _body(self, old: Any, new: Any) -> Iterator[Change]:
        if new.get("required") and not old.get("required"):
            yield "request body", "is now required"
        if old and not new:
            yield "request body", "is no longer read"
        elif old:
            yield from _below("request body", self._media(old["content"], new["content"], "request"))

    def _media(self, old: Any, new: Any, direction: Direction) -> Iterator[Change]:
        for media, content in old.items():
            if media not in new:
                yield media, "is gone"
            else:
                yield from _below(
                    media, self.schema(content.get("schema", {}), new[media].get("schema", {}), direction)
                )

    def _response(self, old: Any, new: Any) -> Iterator[Change]:
        yield from self._media(old.get("content", {}), new.get("content", {}), "response")
        headers = {name.lower(): header for name, header in new.get("headers", {}).items()}
        for name, header in old.get("headers", {}).items():
            if name.lower() not in headers:
                yield f"header {name}", "is gone"
                continue
            before, after = _resolved(self.old, header), _resolved(self.new, headers[name.lower()])
            if before.get("required") and not after.get("required"):
                yield f"header {name}", "is no longer always sent"
            yield from _below(
                f"header {name}", self.schema(before.get("schema", {}), after.get("schema", {}), "response")
            )

    def _security(self, old: Any, new: Any) -> Iterator[Change]:
        """Whoever got in before gets in still: each old way in contains some new one."""
        ways = new or [{}]
        for way in old or [{}]:
            if not any(all(s in way and set(scopes) <= set(way[s]) for s, scopes in other.items()) for other in ways):
                yield "security", f"{' and '.join(way) or 'a request without a key'} no longer gets in"
        for scheme in {scheme for way in old or [] for scheme in way}:
            before, after = (
                d.get("components", {}).get("securitySchemes", {}).get(scheme) for d in (self.old, self.new)
            )
            if after is not None and any(
                (before or {}).get(k) != after.get(k) for k in ("type", "in", "name", "scheme")
            ):
                yield "security", f"{scheme} is sent in another way"

    def schema(self, old: Any, new: Any, direction: Direction) -> list[Change]:
        """What breaks between two schemas; those that contain themselves count as equal below themselves."""
        key = (json.dumps(old, sort_keys=True), json.dumps(new, sort_keys=True), direction)
        if key not in self.known:
            self.known[key] = []
            self.known[key] = list(self._variants(old, new, direction))
        return self.known[key]

    def _variants(self, old: Any, new: Any, direction: Direction) -> Iterator[Change]:
        before, after = _variants_of(self.old, old), _variants_of(self.new, new)
        if len(before) == len(after) == 1:
            yield from self._plain(before[0], after[0], direction)
            return
        # a request: each old form is still read by some new one; a response: each new form was known before
        asked, known = (before, after) if direction == "request" else (after, before)
        for form in asked:
            pairs = {id(other): (form, other) if direction == "request" else (other, form) for other in known}
            if any(not list(self._plain(*pair, direction)) for pair in pairs.values()):
                continue
            alike = [other for other in known if _alike(form, other)]
            if not alike and direction == "response" and isinstance(new, dict) and new.get(MORE_VALUES):
                continue
            if len(alike) == 1:
                yield from self._plain(*pairs[id(alike[0])], direction)
            else:
                yield "", f"{'no longer reads' if direction == 'request' else 'may now be'} {_named(form)}"

    def _plain(self, old: Any, new: Any, direction: Direction) -> Iterator[Change]:
        asked = direction == "request"
        wide, narrow = (new, old) if asked else (old, new)  # what must hold: narrow lies within wide
        if "type" in wide and (narrow.get("type") not in (wide["type"], *(["integer"] * (wide["type"] == "number")))):
            yield "", f"type {old.get('type', 'any')} is now {new.get('type', 'any')}"
            return
        yield from _values(old, new, asked)
        yield from _bounds(old, new, asked)
        for keyword in SAME:
            gone_is_fine = asked and keyword not in new
            if old.get(keyword) != new.get(keyword) and not gone_is_fine and (asked or keyword in SHAPE & set(old)):
                yield "", f"{keyword} {json.dumps(old.get(keyword))} is now {json.dumps(new.get(keyword))}"
        if asked and "default" in old and old["default"] != new.get("default", old["default"]):
            yield "", f"default {json.dumps(old['default'])} is now {json.dumps(new['default'])}"
        yield from self._object(old, new, direction)
        yield from self._array(old, new, direction)

    def _object(self, old: Any, new: Any, direction: Direction) -> Iterator[Change]:
        before, after = old.get("properties", {}), new.get("properties", {})
        rest_before, rest_after = old.get("additionalProperties", True), new.get("additionalProperties", True)
        asked = direction == "request"
        for name in before:
            if name in after:
                yield from _below(name, self.schema(before[name], after[name], direction))
            elif not asked or rest_after is False:
                yield name, "is gone"
            elif rest_after is not True:
                yield from _below(name, self.schema(before[name], rest_after, direction))
        if asked:
            yield from ((n, "is now required") for n in new.get("required", ()) if n not in old.get("required", ()))
        else:
            kept = set(after) - set(new.get("required", ()))
            yield from ((n, "is no longer always there") for n in old.get("required", ()) if n in kept)
        if isinstance(rest_before, dict) and rest_after is not False:
            yield from _below("*", self.schema(rest_before, {} if rest_after is True else rest_after, direction))
        elif asked and rest_before is not False and rest_after is not True and old.get("type") == "object":
            yield "", "further properties are no longer read"

    def _array(self, old: Any, new: Any, direction: Direction) -> Iterator[Change]:
        before, after = old.get("prefixItems", []), new.get("prefixItems", [])
        rest_before, rest_after = old.get("items", {}), new.get("items", {})
        for place in range(max(len(before), len(after))):
            one = before[place] if place < len(before) else rest_before
            other = after[place] if place < len(after) else rest_after
            if one is not False and other is not False:
                yield from _below(str(place), self.schema(one, other, direction))
        if isinstance(rest_before, dict) and isinstance(rest_after, dict) and (rest_before or rest_after):
            yield from _below("[]", self.schema(rest_before, rest_after, direction))


def _below(place: str, changes: Any) -> Iterator[Change]:
    for inner, text in changes:
        yield (f"{place}/{inner}" if inner else place), text


def _resolved(document: Document, node: Any) -> Any:
    """The node with its references followed; what stands beside a reference is kept."""
    while isinstance(node, dict) and "$ref" in node:
        place: Any = document
        for step in node["$ref"].removeprefix("#/").split("/"):
            place = place[step.replace("~1", "/").replace("~0", "~")]
        node = {**place, **{key: value for key, value in node.items() if key != "$ref"}}
    return node if node is not None else {}


def _parameters(document: Document, path: str, method: str) -> dict[tuple[str, str], Any]:
    """Parameters by place and name; header names in lower case."""
    item = document["paths"][path]
    listed = [_resolved(document, p) for p in (*item.get("parameters", ()), *item[method].get("parameters", ()))]
    return {(p["in"], p["name"].lower() if p["in"] == "header" else p["name"]): p for p in listed}


def _variants_of(document: Document, schema: Any) -> list[dict[str, Any]]:
    """The forms that a value may take, each with one type at most and no combining keyword left."""
    schema = {} if schema is True else _resolved(document, schema)
    if schema is False:
        return []
    unknown = {keyword for keyword in schema if not keyword.startswith("x-")} - HANDLED
    if unknown:
        raise ValueError(f"openapi/compatibility.py does not know what a change of {sorted(unknown)} means")
    for keyword in ("allOf", "anyOf", "oneOf"):
        if keyword in schema:
            rest = {key: value for key, value in schema.items() if key != keyword}
            if keyword == "allOf":
                merged: dict[str, Any] = rest
                for part in schema[keyword]:
                    merged = _merged(merged, _resolved(document, part))
                return _variants_of(document, merged)
            return [
                form
                for part in schema[keyword]
                for form in _variants_of(document, _merged(rest, _resolved(document, part)))
            ]
    values = schema.get("enum", [schema["const"]] if "const" in schema else None)
    kinds = schema.get("type", sorted({_type_of(v) for v in values}, key=TYPES.index) if values is not None else None)
    if values is not None:
        schema = {**{k: v for k, v in schema.items() if k not in ("enum", "const")}, "enum": values}
    if not isinstance(kinds, list):
        return [schema if kinds is None else {**schema, "type": kinds}]
    forms = [{**schema, "type": kind} for kind in kinds]
    return (
        [{**f, "enum": [v for v in values if _type_of(v) == f["type"]]} for f in forms] if values is not None else forms
    )


def _merged(one: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    both = {**one, **other}
    if "properties" in one and "properties" in other:
        both["properties"] = {**one["properties"], **other["properties"]}
    if "required" in one and "required" in other:
        both["required"] = sorted({*one["required"], *other["required"]})
    return both


def _type_of(value: Any) -> str:
    kinds = {type(None): "null", bool: "boolean", int: "integer", float: "number", str: "string", list: "array"}
    return kinds.get(type(value), "object")


def _alike(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two forms are one thing before and after: type, fixed values, and some property if they have any."""
    names, others = set(one.get("properties", ())), set(other.get("properties", ()))
    return one.get("type") == other.get("type") and _marks(one) == _marks(other) and bool(names & others or not names)


def _marks(form: dict[str, Any]) -> list[tuple[str, str]]:
    fixed = {"const", "enum"}
    properties = form.get("properties", {})
    return sorted((n, json.dumps(s.get("const", s.get("enum")))) for n, s in properties.items() if fixed & set(s))


def _named(form: dict[str, Any]) -> str:
    return str(form.get("title") or (json.dumps(form["enum"]) if "enum" in form else form.get("type", "anything")))


MORE_VALUES = "x-more-values"  # of a property in answers: values that are not listed yet may come


def _values(old: Any, new: Any, asked: bool) -> Iterator[Change]:
    """Listed values: none may go; in a response none may come, for a reader has no word for it.

    Except where the schema says that more may come.
    """
    before, after = old.get("enum"), new.get("enum")
    if before is None and after is not None and asked:
        yield "", f"is now one of {json.dumps(after)}"
    elif before is not None and after is None and not asked:
        yield "", f"is no longer one of {json.dumps(before)}"
    elif before is not None and after is not None:
        yield from (("", f"{json.dumps(value)} is gone") for value in before if value not in after)
        if not asked and not new.get(MORE_VALUES):
            yield from (("", f"may now be {json.dumps(value)}") for value in after if value not in before)


def _bounds(old: Any, new: Any, asked: bool) -> Iterator[Change]:
    """Bounds: tighter ones in requests, and another length of a list in responses."""
    infinity = float("inf")
    for plain, strict, sign in (("minimum", "exclusiveMinimum", 1), ("maximum", "exclusiveMaximum", -1)):
        ends = []
        for schema in (old, new):
            ends.append(max((sign * schema[plain], 0) if plain in schema else (-infinity, 0),
                            (sign * schema[strict], 1) if strict in schema else (-infinity, 0)))  # fmt: skip
        if asked and ends[1] > ends[0]:
            yield "", f"{plain} is now {'beyond ' if ends[1][1] else ''}{sign * ends[1][0]:g}"
    for keyword, missing, sign in (*((k, 0, 1) for k in LOW), *((k, infinity, -1) for k in HIGH)):
        before, after = sign * old.get(keyword, missing), sign * new.get(keyword, missing)
        if (asked and after > before) or (not asked and after < before and keyword in ("minItems", "maxItems")):
            yield "", f"{keyword} {old.get(keyword, 'none')} is now {new.get(keyword, 'none')}"


def main(arguments: list[str]) -> int:
    """Command line: OLD.json NEW.json."""
    if len(arguments) != 2:
        print("usage: python openapi/compatibility.py OLD.json NEW.json", file=sys.stderr)
        return 2
    old, new = (json.loads(Path(name).read_text(encoding="utf-8")) for name in arguments)
    found = breaking_changes(old, new)
    print("\n".join(found) if found else "nothing breaks")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
