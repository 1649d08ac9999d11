"""Documents in an editor: completion, hover and diagnostics from the schema that a document's head line names."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from editing import Editor, editor
from jsonschema import Draft7Validator
from jsonschema_rs import Draft7Validator as QuickDraft7
from jsonschema_rs import Draft202012Validator as QuickDraft2020
from service_scenes import EXAMPLES, check_problem

from tailstack.design import load_design
from tailstack.laws import Law
from tailstack_service.cli.main import main
from tailstack_service.schemas import TITLES, json_schema

DOCUMENTS = sorted(path for path in EXAMPLES.rglob("*.yaml") if not path.name.startswith("."))
HEAD = re.compile(r"# yaml-language-server: \$schema=(\S+)\n")
DEMO = (EXAMPLES / "demo.yaml").read_text(encoding="utf-8")
SCHEMA = "tailstack-design.schema.json"


def named_schema(document: Path) -> Path:
    """The file that the first line of a document names."""
    found = HEAD.match(document.read_text(encoding="utf-8"))
    assert found is not None, f"{document} has no head line"
    return document.parent / found[1]


# --- the schema of draft 7 -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", TITLES)
def test_every_schema_is_published_in_draft_7_too(name: str) -> None:
    schema = json_schema(name, "7")
    assert schema["$schema"] == "http://json-schema.org/draft-07/schema#"
    Draft7Validator.check_schema(schema)
    assert not re.search(r'"(prefixItems|\$defs|unevaluated\w+|dependent\w+)"|#/\$defs', json.dumps(schema))
    references = re.findall(r'"\$ref": "#/definitions/(\w+)"', json.dumps(schema))
    assert set(references) <= set(schema.get("definitions", {}))


def mutations(node: Any) -> Iterator[Any]:
    """The document with one value changed: left out, of another type, negative, too long, or with a field more."""
    if isinstance(node, dict):
        yield {**node, "colour": 1}
        for key, value in node.items():
            yield {name: entry for name, entry in node.items() if name != key}
            for changed in mutations(value):
                yield {**node, key: changed}
    elif isinstance(node, list):
        yield [*node, *node[:1]]
        yield node[1:]
        for k, value in enumerate(node):
            for changed in mutations(value):
                yield [*node[:k], changed, *node[k + 1 :]]
    elif isinstance(node, str):
        yield from (7, node + " else", "")
    else:
        yield from (str(node), -abs(node) - 1e6, None)


@pytest.mark.parametrize("name", ["demo.yaml", "locators_321.yaml", "ci-gate/policy.yaml", "ci-gate/waivers.yaml"])
def test_both_drafts_refuse_the_same(name: str) -> None:
    text = (EXAMPLES / name).read_text(encoding="utf-8")
    document = json.loads(json.dumps(yaml.safe_load(text), default=str))
    kind = re.search(r"^schema: tailstack/(\w+)/1", text, re.MULTILINE)
    newer, older = QuickDraft2020(json_schema(kind[1])), QuickDraft7(json_schema(kind[1], "7"))
    assert newer.is_valid(document)
    assert older.is_valid(document)
    changed = list(mutations(document))
    verdicts = [(newer.is_valid(each), older.is_valid(each)) for each in changed]
    assert [each for each, (first, second) in zip(changed, verdicts, strict=True) if first != second] == []
    assert sum(not first for first, _ in verdicts) > len(verdicts) / 2


def test_draft_7_by_command_file_and_http_is_the_same(tmp_path: Path, call: Any, client: httpx.Client) -> None:
    code, printed, _ = call("schema", "design", "--draft", "7")
    assert code == 0
    for place in (tmp_path, tmp_path / "own.json"):
        assert call("schema", "design", "--draft", "7", "-o", place)[0] == 0
    assert (tmp_path / SCHEMA).read_text() == (tmp_path / "own.json").read_text() == printed
    answer = client.get("/v1/schemas/design", params={"draft": "7"})
    assert answer.headers["content-type"] == "application/schema+json"
    assert answer.json() == json.loads(printed)
    assert client.get("/v1/schemas/design").json() == json_schema("design")
    assert client.get("/v1/schemas/design", params={"draft": ""}).status_code == 422
    (wrong,) = check_problem(client.get("/v1/schemas/design", params={"draft": "4"}), 422, "invalid-request")["errors"]
    assert wrong["pointer"] == "/draft"
    assert "2020-12, 7" in wrong["detail"]


# --- the head line -------------------------------------------------------------------------------------


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(EXAMPLES)))
def test_every_example_names_the_schema_of_this_version(document: Path) -> None:
    kind = yaml.safe_load(document.read_text(encoding="utf-8"))["schema"].split("/")[1]
    schema = named_schema(document)
    assert schema.name == f"tailstack-{kind}.schema.json"
    assert json.loads(schema.read_text(encoding="utf-8")) == json_schema(kind, "7"), (
        f"made anew by: tailstack schema {kind} --draft 7 -o examples"
    )


def convert(source: Path, target: Path) -> None:
    assert main(("convert", str(source), "-o", str(target))) == 0


def test_a_written_design_brings_its_schema_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = EXAMPLES / "demo.yaml"
    (tmp_path / ".git").mkdir()
    convert(source, tmp_path / "a.yaml")
    assert f"wrote {tmp_path / SCHEMA}" in capsys.readouterr().err
    assert named_schema(tmp_path / "a.yaml") == tmp_path / SCHEMA
    assert json.loads((tmp_path / SCHEMA).read_text()) == json_schema("design", "7")
    below = tmp_path / "rev-b" / "draft"
    below.mkdir(parents=True)
    convert(tmp_path / "a.yaml", below / "b.yaml")  # the line of a.yaml would lead nowhere from here
    assert SCHEMA not in capsys.readouterr().err
    assert named_schema(below / "b.yaml") == below / "../.." / SCHEMA
    assert [path.name for path in below.iterdir()] == ["b.yaml"]
    digests = {load_design(path).sha256 for path in (source, tmp_path / "a.yaml", below / "b.yaml")}
    assert len(digests) == 1
    assert (below / "b.yaml").read_text().count("yaml-language-server") == 1


@pytest.mark.parametrize("marked", [True, False], ids=["repository", "folder"])
def test_a_schema_outside_the_repository_is_not_named(tmp_path: Path, marked: bool) -> None:
    (tmp_path / SCHEMA).write_text("{}")
    (tmp_path / "repository" / "designs").mkdir(parents=True)
    if marked:
        (tmp_path / "repository" / ".git").mkdir()
    convert(EXAMPLES / "demo.yaml", tmp_path / "repository" / "designs" / "a.yaml")
    schema = named_schema(tmp_path / "repository" / "designs" / "a.yaml")
    assert schema == tmp_path / "repository" / "designs" / SCHEMA
    assert schema.is_file()


def test_a_link_names_the_schema_of_the_folder_it_leads_to(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "a.yaml").symlink_to(tmp_path / "real" / "a.yaml")
    convert(EXAMPLES / "demo.yaml", tmp_path / "a.yaml")
    assert (tmp_path / "a.yaml").is_symlink()
    assert sorted(path.name for path in (tmp_path / "real").iterdir()) == ["a.yaml", SCHEMA]


@pytest.mark.parametrize("target", ["a.json", "beads.csv", "section.yaml"])
def test_what_is_no_design_in_yaml_gets_no_line(tmp_path: Path, target: str) -> None:
    source = EXAMPLES / ("fiducials/marker8.csv" if target == "section.yaml" else "demo.yaml")
    convert(source, tmp_path / target)
    assert "yaml-language-server" not in (tmp_path / target).read_text()
    assert [path.name for path in tmp_path.iterdir()] == [target]


# --- a real language server ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory, editor_tools: None) -> Iterator[Editor]:
    """An editor on a folder with the demo, as convert writes it, and its schema."""
    folder = tmp_path_factory.mktemp("designs")
    (folder / SCHEMA).write_bytes((EXAMPLES / SCHEMA).read_bytes())
    (folder / "demo.yaml").write_text(DEMO)
    with editor(folder) as opened:
        yield opened


def typed(session: Editor, name: str, text: str) -> Path:
    """A document of that text in the editor's folder."""
    path = session.folder / f"{name}.yaml"
    path.write_text(text)
    return path


def place_of(text: str, words: str) -> tuple[int, int]:
    """Line and column, from 0, of the first place where words stand."""
    before = text[: text.index(words)]
    return before.count("\n"), len(before) - before.rfind("\n") - 1


@pytest.mark.long
def test_editor_finds_nothing_wrong_with_the_examples(editor_tools: None) -> None:
    with editor(EXAMPLES) as opened:
        assert {path.name: opened.open(path) for path in DOCUMENTS} == {path.name: [] for path in DOCUMENTS}


def test_editor_shows_unit_and_meaning_of_a_number(session: Editor) -> None:
    path = typed(session, "hover", DEMO)
    session.open(path)
    for field, words in {
        "fiducial_noise_px": "Standard deviation of a fiducial's measured image, per coordinate (not per point), px.",
        "half_width_deg": "Half-width h of the rotation, degrees.",
        "pivot_mm": "Point in con that the displacement is reduced at, mm",
        "limit_mm": "The statistic must not exceed this, mm;",
        "source_isocentre_mm": "Overrides the preset's; required where the preset has none. mm.",
    }.items():
        line, column = place_of(DEMO, field)
        assert words in session.hover(path, line, column + 2), field


def test_editor_completes_fields_with_their_meaning(session: Editor) -> None:
    lines = DEMO.splitlines()
    line, column = place_of(DEMO, "fiducial_noise_px")
    path = typed(session, "fields", "\n".join([*lines[:line], " " * column, *lines[line + 1 :]]))
    session.open(path)
    offered = session.complete(path, line, column)
    assert {"fiducial_noise_px", "principal_point_px"} <= set(offered)
    assert "name" not in offered  # it is there already
    assert "px. Well-segmented 3 mm beads" in offered["fiducial_noise_px"]["documentation"]


def test_editor_completes_values(session: Editor) -> None:
    text = DEMO.replace("preset: siemens-cios-fusion\n", "preset: \n", 1)
    path = typed(session, "values", text)
    session.open(path)
    line, column = place_of(text, "preset: \n")
    offered = session.complete(path, line, column + len("preset: "))
    assert set(offered) == {entry["const"] for entry in json_schema("presets")["oneOf"]}


@pytest.mark.parametrize(
    ("right", "wrong", "place", "words"),
    [
        ("fiducial_noise_px: 0.3", "fiducial_noise_mm: 0.3", "fiducial_noise_mm", "not allowed"),
        ("target_noise_px: 0.3", "target_noise_px: '0.3'", "'0.3'", 'Expected "number"'),
        ("half_width_deg: 0.10", "half_width_deg: -0.10", "-0.10", "below the minimum of 0"),
        ("distribution: normal", "distribution: gauss", "gauss", ", ".join(f'"{law}"' for law in Law)),
        ("isocentre_mm: [0, 0, 0]", "isocentre_mm: [0, 0]", "[0, 0]", "Expected 3"),
        ("preset: siemens-cios-fusion", "preset: simens", "simens", '"siemens-cios-fusion"'),
    ],
)
def test_editor_underlines_the_wrong_field(session: Editor, right: str, wrong: str, place: str, words: str) -> None:
    text = DEMO.replace(right, wrong, 1)
    assert text != DEMO
    path = typed(session, re.sub(r"\W", "-", wrong), text)
    found = session.open(path)
    line, column = place_of(text, wrong)
    starts = {(each["range"]["start"]["line"], each["range"]["start"]["character"]): each["message"] for each in found}
    assert words in starts.get((line, column + wrong.index(place)), ""), found


@pytest.mark.long
def test_a_folder_of_examples_stands_by_itself_in_an_editor(tmp_path: Path, editor_tools: None) -> None:
    """Policy and waivers, too: each line leads to a schema in the folder, and nothing is wrong."""
    folder = tmp_path / "gate"
    assert main(("example", "ci-gate", "-o", str(folder))) == 0
    documents = sorted(folder.glob("[!.]*.yaml"))
    assert {named_schema(path).name for path in documents} == {
        f"tailstack-{kind}.schema.json" for kind in ("design", "policy", "waivers")
    }
    assert all(named_schema(path).parent == folder for path in documents)
    with editor(folder) as opened:
        assert [opened.open(path) for path in documents] == [[]] * len(documents)
