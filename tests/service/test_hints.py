"""What refusals tell people to type exists: commands with their flags, routes, settings, fields and pages.

The texts are taken from the sources themselves, so that a hint nobody thought of here is held to it as well.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from service_scenes import ROOT

from plain_data import places_of, value_at
from tailstack.errors import Problem, TailstackError
from tailstack_service.cli.main import build_parser, verbs
from tailstack_service.console.refusals import NEXT, next_command
from tailstack_service.environment import OTHERS, variable
from tailstack_service.problems import CATALOGUE
from tailstack_service.schemas import TITLES, json_schema
from tailstack_service.settings import GONE, Settings

SOURCES = sorted([*(ROOT / "solver" / "tailstack").rglob("*.py"), *(ROOT / "service").rglob("*.py")])
FILLED = "\N{WHITE SQUARE}"  # stands for what is filled in when the program runs
COMMAND = re.compile(rf"\btailstack ({'|'.join(verbs())})((?: (?!and |or |then )[^\s;,()`—]+)*)")
FIELD = re.compile(r"(?<![\w./{-])[a-z][a-z0-9]*(?:_[a-z0-9]+)+(?![\w/(])")
ROUTE = re.compile(rf"\b(GET|POST|DELETE) (/[\w/{{}}.{FILLED}-]+)")
SETTING = re.compile(r"\bTAILSTACK_[A-Z_]+\b")
PAGE = re.compile(r"\b(?:docs|examples)/[\w/-]+\.\w+")
OF_PROXIES = {"client_header_timeout", "send_timeout"}  # words of nginx's own
OF_FILES = {"x_mm", "y_mm", "z_mm", "label"}  # headings of fiducial files


@cache
def texts(path: Path) -> list[str]:
    """Every text of a source that is no docstring, with what is filled in later as one sign."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [text for node in ast.walk(tree) if not is_docstring(node) for text in text_of(node)]


def is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def text_of(node: ast.AST) -> Iterator[str]:
    """The texts that stand directly in a statement's or an expression's own parts."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.JoinedStr):
            yield joined(child)
        elif isinstance(child, ast.Constant) and isinstance(child.value, str) and not isinstance(node, ast.JoinedStr):
            yield child.value


def joined(node: ast.JoinedStr) -> str:
    return "".join(str(part.value) if isinstance(part, ast.Constant) else FILLED for part in node.values)


@cache
def hints(path: Path) -> list[str]:
    """Texts that a source gives as a hint or a cure."""
    found: list[ast.AST] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            found += [keyword.value for keyword in node.keywords if keyword.arg in ("hint", "cure", "otherwise")]
            found += node.args[3:4] if name == "Problem" else node.args[2:3] if name in ("refusal", "problem") else []
        elif isinstance(node, ast.Assign) and any(getattr(t, "id", "") in ("hint", "cure") for t in node.targets):
            found.append(node.value)
    inside = [part for node in found for part in parts_of(node)]
    whole = [joined(part) for part in inside if isinstance(part, ast.JoinedStr)]
    of_joined = {id(value) for part in inside if isinstance(part, ast.JoinedStr) for value in part.values}
    return whole + [
        part.value
        for part in inside
        if isinstance(part, ast.Constant) and isinstance(part.value, str) and id(part) not in of_joined
    ]


def parts_of(node: ast.AST) -> Iterator[ast.AST]:
    """Everything in an expression but what it compares, which nobody reads."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.Compare):
            yield from parts_of(child)


@cache
def parser_of(verb: str) -> argparse.ArgumentParser:
    return members(build_parser(verb))[verb]


def members(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    action = next((each for each in parser._actions if isinstance(each, argparse._SubParsersAction)), None)
    return {} if action is None else dict(action.choices)


@pytest.mark.long
def test_commands_in_texts_exist_with_their_flags() -> None:
    found = [(path.name, match) for path in SOURCES for text in texts(path) for match in COMMAND.finditer(text)]
    commands = sorted({(file, match[1], match[2].strip()) for file, match in found})
    assert len(commands) > 60
    wrong = []
    for file, verb, rest in commands:
        words = rest.split()
        parser, own = parser_of(verb), members(parser_of(verb))
        if own and words and words[0].isalpha() and words[0].islower():
            if words[0] not in own:
                wrong.append(f"{file}: tailstack {verb} {rest}: there is no {words[0]}")
                continue
            parser = own[words[0]]
        known = {flag for action in parser._actions for flag in action.option_strings}
        flags = [word.partition("=")[0].rstrip(".:'\"]") for word in words if re.match(r"--?[a-z]", word)]
        wrong += [f"{file}: tailstack {verb} {rest}: there is no {flag}" for flag in flags if flag not in known]
    assert wrong == []


parser_with = cache(build_parser)  # the same few verbs are advised again and again


@pytest.mark.parametrize("verb", verbs())
def test_the_next_command_can_be_typed(verb: str, tmp_path: Path) -> None:
    """After every class of refusal, for every verb: the command parses as it is printed."""
    design = str(tmp_path / "design.yaml")
    for slug in [*NEXT, "unheard-of"]:
        error = TailstackError(Problem("", "x", "x"))
        error.slug = slug
        told = next_command(error, argparse.Namespace(verb=verb, design=design)).removeprefix("next: ")
        command = told.partition("   (")[0].removeprefix("mend it, then ")
        if not command.startswith("tailstack "):
            assert command in (
                "install it, then repeat the command",
                "make room or name another place, then repeat the command",
            )
            continue
        _, *words = command.split()
        if words[-1] == "--help":
            assert words[0] in verbs()
        else:
            parsed = parser_with(words[0]).parse_args(words)
            assert design in (parsed.design if isinstance(parsed.design, list) else [parsed.design])


def test_routes_in_texts_exist() -> None:
    paths = json.loads((ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8"))["paths"]
    patterns = [
        (re.compile(re.sub(r"\\\{[^}]*\\\}", r"[^/]+", re.escape(path)) + r"\Z"), entry)
        for path, entry in paths.items()
    ]
    told = {match.groups() for path in SOURCES for text in texts(path) for match in ROUTE.finditer(text)}
    told |= {match.groups() for kind in CATALOGUE.values() for match in ROUTE.finditer(kind.cure)}
    assert len(told) >= 5
    for method, path in told:
        path = path.rstrip(".").replace(FILLED, "x")
        found = [entry for pattern, entry in patterns if pattern.match(path)]
        assert any(method.lower() in entry for entry in found), f"{method} {path}"


def test_settings_and_pages_in_texts_exist() -> None:
    known = {variable(name) for name in Settings.model_fields} | {*OTHERS, *GONE}
    told = {name for path in SOURCES for text in texts(path) for name in SETTING.findall(text)}
    ours = {name for name in told if not name.endswith("_") and not name.startswith("TAILSTACK_TESTS")}
    assert ours - known <= read_from_environment()
    told = {page for path in SOURCES for text in texts(path) for page in PAGE.findall(text)}
    assert told
    assert [page for page in sorted(told) if not (ROOT / page).exists()] == []


def read_from_environment() -> set[str]:
    """Names that a source reads from the environment itself, besides the settings."""
    reading = re.compile(
        r"environ(?:\.get\(|\[)\s*\"(TAILSTACK_[A-Z_]+)\"|^[A-Z_]+ = \"(TAILSTACK_[A-Z_]+)\"", re.MULTILINE
    )
    return {name for path in SOURCES for groups in reading.findall(path.read_text(encoding="utf-8")) for name in groups}


def property_names(schema: Any) -> Iterator[str]:
    """Names of fields, and words that a field takes."""
    for path in places_of(schema):
        match path[-2:]:
            case ("properties", str(name)):
                yield name
            case ("enum", int()):
                yield str(value_at(schema, path))


@pytest.mark.long
def test_fields_in_hints_exist() -> None:
    """A hint that names a field names one that a document, an option, a record or a setting has."""
    known = {name for title in TITLES for name in property_names(json_schema(title))}
    known |= set(property_names(json.loads((ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8"))))
    known |= {*Settings.model_fields, *OF_PROXIES, *OF_FILES}
    told = {
        (path.name, field)
        for path in SOURCES
        for text in hints(path)
        if not SETTING.search(text)
        for field in FIELD.findall(text)
    }
    assert len(told) > 25
    assert sorted((file, field) for file, field in told if field not in known) == []


def test_there_is_a_hint_to_hold() -> None:
    """The collector itself: it finds the hint of a refusal where one is known to stand."""
    refusals = ROOT / "solver" / "tailstack" / "design" / "consistency.py"
    assert "leave out count, or □" in hints(refusals)
    assert any(
        text.startswith("tailstack verify {file} --trials")
        for text in texts(ROOT / "service" / "tailstack_service" / "console" / "refusals.py")
    )
