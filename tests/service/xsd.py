"""A document against an XML Schema, for the few constructs that junit-10.xsd is written in.

Elements by reference, sequences and choices, attributes, mixed content and patterns; a construct that is not known here
stops the reading, so that nothing is passed over.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

XS = "{http://www.w3.org/2001/XMLSchema}"


@dataclass
class Kind:
    """What an element may hold."""

    content: str = ""  # regular expression over "name;" of the children
    text: bool = False
    pattern: str | None = None
    attributes: dict[str, tuple[str | None, bool]] = field(default_factory=dict)  # name: pattern, required
    local: dict[str, Kind] = field(default_factory=dict)


def problems(schema: Path, document: bytes, root: str) -> list[str]:
    """What is wrong with a document whose root element is to be ``root``."""
    elements = _elements(ET.parse(schema).getroot())
    top = ET.fromstring(document)
    if top.tag != root:
        return [f"the root is {top.tag}"]
    return list(_wrong(top, elements[root], elements, f"/{root}"))


def _wrong(node: ET.Element, kind: Kind, elements: dict[str, Kind], path: str) -> list[str]:
    found = []
    names = "".join(f"{child.tag};" for child in node)
    if not re.fullmatch(kind.content, names):
        found.append(f"{path}: holds {names or 'nothing'}")
    text = (node.text or "") + "".join(child.tail or "" for child in node)
    if text.strip() and not kind.text:
        found.append(f"{path}: holds text")
    if kind.pattern is not None and not re.fullmatch(kind.pattern, text):
        found.append(f"{path}: {text!r}")
    for name, value in node.attrib.items():
        if name not in kind.attributes:
            found.append(f"{path}: unknown attribute {name}")
        elif (pattern := kind.attributes[name][0]) is not None and not re.fullmatch(pattern, value):
            found.append(f"{path}/@{name}: {value!r}")
    found += [
        f"{path}: no attribute {name}"
        for name, (_, needed) in kind.attributes.items()
        if needed and name not in node.attrib
    ]
    for place, child in enumerate(node):
        inner = kind.local.get(child.tag) or elements.get(child.tag)
        if inner is not None:
            found += _wrong(child, inner, elements, f"{path}/{child.tag}[{place}]")
    return found


def _elements(schema: ET.Element) -> dict[str, Kind]:
    patterns: dict[str, str | None] = {"xs:string": None}
    complex_types: dict[str, ET.Element] = {}
    for node in schema:
        if node.tag == f"{XS}simpleType":
            patterns[node.attrib["name"]] = _pattern(node)
        elif node.tag == f"{XS}complexType":
            complex_types[node.attrib["name"]] = node
        elif node.tag != f"{XS}element":
            raise NotImplementedError(node.tag)

    def kind_of(node: ET.Element) -> Kind:
        name = node.attrib.get("type")
        if name in patterns:
            return Kind(text=True, pattern=patterns[name])
        return _complex(complex_types[name] if name else node[0], patterns, kind_of)

    return {node.attrib["name"]: kind_of(node) for node in schema if node.tag == f"{XS}element"}


def _pattern(node: ET.Element) -> str:
    ((restriction,), (pattern,)) = list(node), list(node[0])
    if pattern.tag != f"{XS}pattern" or restriction.attrib["base"] != "xs:string":
        raise NotImplementedError(pattern.tag)
    return pattern.attrib["value"]


def _complex(node: ET.Element, patterns: dict[str, str | None], kind_of: object) -> Kind:
    kind = Kind(text=node.attrib.get("mixed") == "true")
    for part in node:
        if part.tag == f"{XS}attribute":
            kind.attributes[part.attrib["name"]] = (patterns[part.attrib["type"]], part.attrib.get("use") == "required")
        else:
            kind.content += _content(part, kind, kind_of)
    return kind


def _content(node: ET.Element, kind: Kind, kind_of: object) -> str:
    if node.tag == f"{XS}element":
        name = node.attrib.get("ref") or node.attrib["name"]
        if "ref" not in node.attrib:
            kind.local[name] = kind_of(node)  # type: ignore[operator]
        inner = re.escape(name) + ";"
    elif node.tag in (f"{XS}sequence", f"{XS}choice"):
        inner = ("|" if node.tag == f"{XS}choice" else "").join(_content(part, kind, kind_of) for part in node)
    else:
        raise NotImplementedError(node.tag)
    low, high = node.attrib.get("minOccurs", "1"), node.attrib.get("maxOccurs", "1")
    return f"(?:{inner}){{{low},{'' if high == 'unbounded' else high}}}"
