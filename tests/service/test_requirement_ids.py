"""Ids of a system of requirements: from the design into every answer, and back by the gate's JUnit, needs and ReqIF.

What those formats are held to is written down here from what their owners publish; no code is shared with the writers.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import pytest
import xsd
from gate_scenes import FAILING, PASSING, SCENES, golden, judge_files, plain_record, policy, waivers
from service_scenes import ROOT, sound_design
from test_report_rendering import Page

from plain_data import read_cases
from tailstack import load_design, score, verify
from tailstack.errors import DesignError
from tailstack_service.documents import to_json
from tailstack_service.gate.formats import render_junit, render_needs, render_reqif
from tailstack_service.gate.records import GateRecord
from tailstack_service.operations.rendering import render
from tailstack_service.schemas import read_record

IDS = ["SRS-014", "SRS-015"]
ASKED = [
    {"name": "tip-accuracy", "limit_mm": FAILING, "ids": IDS},
    {"name": "loose", "limit_mm": PASSING, "ids": ["SRS-016"]},
    {"name": "plain", "limit_mm": PASSING},
]
DESIGN = sound_design(requirements=ASKED, optimise=None)
WANTED = {"tip-accuracy": tuple(IDS), "loose": ("SRS-016",), "plain": ()}


def test_ids_stand_in_every_answer_and_change_no_number() -> None:
    design = load_design(DESIGN)
    first, drawn = score(design), verify(design, trials=4000, seed=1)
    bare = sound_design(requirements=[{k: v for k, v in each.items() if k != "ids"} for each in ASKED], optimise=None)
    for result, without in ((first, score(load_design(bare))), (drawn, verify(load_design(bare), trials=4000, seed=1))):
        assert {check.requirement: check.ids for check in result.verdict.checks} == WANTED
        assert [replace(check, ids=()) for check in result.verdict.checks] == list(without.verdict.checks)
    record = judge_files({"a.yaml": DESIGN})
    assert {number.requirement: number.ids for number in record.designs[0].numbers} == WANTED
    assert {entry.name: entry.ids for entry in record.designs[0].requirements} == WANTED
    page = " ".join(Page(render("score", to_json(first), "html")).texts)
    assert "SRS-014, SRS-015" in page.partition("What matters")[0], "on the first page"


def test_the_hash_of_a_design_without_ids_is_what_it_was() -> None:
    plain = sound_design(requirements=[{"name": "a", "limit_mm": 1.0}], optimise=None)
    stated = sound_design(requirements=[{"name": "a", "limit_mm": 1.0, "ids": []}], optimise=None)
    named = sound_design(requirements=[{"name": "a", "limit_mm": 1.0, "ids": IDS}], optimise=None)
    assert load_design(plain).sha256 == load_design(stated).sha256 != load_design(named).sha256


@pytest.mark.parametrize(
    ("ids", "at"),
    [(["SRS 14"], "/0"), ([""], "/0"), (["A", "B", "A"], "/2"), (["a,b"], "/0"), (["-A"], "/0"), ("SRS-014", ""),
     ([14], "/0"), ([f"A{k}" for k in range(21)], "")],
)  # fmt: skip
def test_what_is_no_id_is_refused_where_it_stands(ids: Any, at: str) -> None:
    with pytest.raises(DesignError) as refused:
        load_design(sound_design(requirements=[{"name": "a", "limit_mm": 1.0, "ids": ids}], optimise=None))
    assert [problem.pointer for problem in refused.value.problems] == [f"/requirements/0/ids{at}"]


# --- the gate: one that fails, one that is accepted, one that is not judged, one that is hostile --------------


def judged(**more: Any) -> GateRecord:
    return judge_files({"a.yaml": DESIGN}, **more)


def off() -> GateRecord:
    return judged(policy=policy({"p95": {"severity": "off"}}))


def accepted() -> GateRecord:
    return judged(waivers=waivers(30, designs=["a.yaml"]))


def hostile() -> GateRecord:
    record = judged()
    name = "[[copy('id')]] `x`_ *|s|* <b>&\x07:role:"
    numbers = tuple(replace(n, requirement=name + n.requirement) for n in record.designs[0].numbers)
    asked = tuple(replace(entry, name=name + entry.name) for entry in record.designs[0].requirements)
    return replace(record, designs=(replace(record.designs[0], numbers=numbers, requirements=asked),))


def test_a_case_of_junit_has_the_ids_of_its_requirement() -> None:
    """published: Xray, "Taking advantage of JUnit XML reports": property requirements of a testcase, by commas."""
    text = render_junit(judged())
    found = {
        case.attrib["name"].partition(": ")[2].partition(",")[0]: [each.attrib for each in case.iter("property")]
        for case in ET.fromstring(text).iter("testcase")
    }
    assert found["tip-accuracy"] == [{"name": "requirements", "value": "SRS-014,SRS-015"}]
    assert found["plain"] == []
    schema = ROOT / "tests" / "data" / "schemas" / "junit-10.xsd"
    wrong = xsd.problems(schema, text.encode(), "testsuites")
    assert len(wrong) == 2, "the schema of Jenkins knows properties of suites alone"
    assert all("holds properties;" in line for line in wrong)
    root = ET.fromstring(text)
    for case in root.iter("testcase"):
        for properties in case.findall("properties"):
            case.remove(properties)
    assert xsd.problems(schema, ET.tostring(root), "testsuites") == []
    assert "SRS-016" in render_junit(off()), "a requirement that is not judged keeps its ids"


# Core fields of a need that needimport takes; of those that a project does not have it warns (sphinx-needs, data.py)
NEED = {"id", "type", "title", "status", "tags", "links", "content"}


def needs_of(record: GateRecord) -> dict[str, dict[str, Any]]:
    """The needs by their titles, as ``needimport`` reads a file."""
    data = json.loads(render_needs(record))
    version = data["versions"][data["current_version"]]
    assert isinstance(data["project"], str)
    assert version["needs_amount"] == len(version["needs"])
    for key, need in version["needs"].items():
        assert need.keys() == NEED
        assert key == need["id"]
        assert re.fullmatch("[A-Z0-9_]{5,}", key), "the form that needs_id_regex asks for by default"
        assert need["type"] == "test"
        assert "[[" not in need["title"], "sphinx-needs would call a function"
        assert not re.search(r"(?<!\\)[`*_|<>{}:]", need["content"].replace("\\\\", "")), "no markup"
    return {need["title"]: need for need in version["needs"].values()}


def objects_of(record: GateRecord) -> list[dict[str, str]]:
    """Attributes of the objects by their long names, as a reader of ReqIF finds them."""
    space = "{http://www.omg.org/spec/ReqIF/20110401/reqif.xsd}"
    root = ET.fromstring(render_reqif(record))
    assert_valid(root, space)
    names = {node.get("IDENTIFIER"): node.get("LONG-NAME") for node in root.iter() if "IDENTIFIER" in node.attrib}
    return [
        {str(names[value[0][0].text]): value.attrib["THE-VALUE"] for value in each.find(f"{space}VALUES") or ()}
        for each in root.iter(f"{space}SPEC-OBJECT")
    ]


# published: OMG, reqif.xsd (20110401), the part that is used: children (a star: any number), attributes asked for
KNOWN = {element: (children, asked) for element, children, asked in read_cases("reqif", "known")}


def assert_valid(root: ET.Element, space: str) -> None:
    """Elements, their order and attributes, identifiers that are XML names and each once, references that lead on."""
    listed = [node.attrib["IDENTIFIER"] for node in root.iter() if "IDENTIFIER" in node.attrib]
    assert len(set(listed)) == len(listed)
    assert all(re.fullmatch(r"[A-Za-z_][\w.-]*", name) for name in listed)
    for node in root.iter():
        tag = node.tag.removeprefix(space)
        if tag.endswith("-REF"):
            (target,) = (each for each in root.iter() if each.get("IDENTIFIER") == node.text)
            assert target.tag.removeprefix(space) == tag.removesuffix("-REF")
        elif tag in KNOWN:
            content, needed = KNOWN[tag]
            pattern = "".join(f"(?:{each.rstrip('*')};){'*' if '*' in each else ''}" for each in content.split())
            assert re.fullmatch(pattern, "".join(f"{child.tag.removeprefix(space)};" for child in node)), tag
            assert set(needed.split()) <= node.attrib.keys() <= {*needed.split(), "LONG-NAME"}, tag
        else:
            assert tag in ("TYPE", "DEFINITION", "OBJECT") or not len(node), tag
    for node in root.iter(f"{space}ATTRIBUTE-VALUE-REAL"):
        float(node.attrib["THE-VALUE"])
    assert [node.text for node in root.iter(f"{space}REQ-IF-VERSION")] == ["1.0"]


@pytest.mark.parametrize("title", [title for title in SCENES if golden(title, "json").exists()])
def test_needs_and_reqif_say_of_every_gate_what_its_record_says(title: str) -> None:
    record: GateRecord = read_record("gate", golden(title, "json").read_bytes())
    plain, needs, objects = plain_record(record), needs_of(record), objects_of(record)
    stated = [each["Status"] for each in objects]
    assert stated == [need["status"] for need in needs.values()]  # without ids: one of each
    assert stated[0] == plain["verdict"]
    if plain["verdict"] == "not evaluated":
        assert set(stated) == {"not evaluated"}
    for design in plain["designs"]:
        for requirement in design["requirements"]:
            worst = [n["status"] for n in design["numbers"] if n["requirement"] == requirement["name"]]
            need = needs[f"{requirement['name']} of {design['file']}"]
            if need["status"] == "pass":
                assert set(worst) == {"pass"}
            elif need["status"] == "accepted":
                assert any(finding["suppressed_by"] for finding in plain["findings"])
            elif need["status"] == "not judged":
                assert not worst
            else:
                assert need["status"] in {"not evaluated", *worst}


def test_a_requirement_goes_back_under_its_ids() -> None:
    record = judged()
    needs, objects = needs_of(record), objects_of(record)
    assert {title: need["links"] for title, need in needs.items() if need["links"]} == {
        "tip-accuracy of a.yaml": IDS, "loose of a.yaml": ["SRS-016"],
    }  # fmt: skip
    number = next(n for n in record.designs[0].numbers if n.requirement == "tip-accuracy")
    own = [each for each in objects if each.get("ReqIF.Name") == "tip-accuracy"]
    assert [each["ReqIF.ForeignID"] for each in own] == IDS
    for each in own:
        assert (each["Status"], each["Design"], each["Unit"]) == ("fail", "a.yaml", "mm")
        numbers = [float(each[name]) for name in ("Value", "Limit", "Margin")]
        assert numbers == [number.value, FAILING, number.margin]
    assert sum("ReqIF.ForeignID" not in each for each in objects) == 2  # the gate itself, and what has no id


def test_a_waiver_accepts_and_a_rule_that_is_off_judges_nothing() -> None:
    need = needs_of(accepted())["tip-accuracy of a.yaml"]
    assert need["status"] == "accepted"
    assert "first article only" in need["content"]
    assert {each["Status"] for each in objects_of(accepted()) if "ReqIF.ForeignID" in each} == {"accepted", "pass"}
    assert needs_of(off())["loose of a.yaml"]["links"] == ["SRS-016"]
    assert needs_of(off())["loose of a.yaml"]["status"] in ("not judged", "not evaluated")


def test_a_name_becomes_no_markup_and_breaks_no_file() -> None:
    assert needs_of(hostile())
    assert "\x07" not in render_reqif(hostile())
    assert objects_of(hostile())


def test_an_identity_hangs_on_no_value_and_no_limit() -> None:
    """So that what links to it in another system goes on to lead there."""
    softer = sound_design(requirements=[{**ASKED[0], "limit_mm": 9.0}, *ASKED[1:]], optimise=None)
    before, after = (needs_of(judge_files({"a.yaml": each})) for each in (DESIGN, softer))
    assert {title: need["id"] for title, need in before.items()} == {title: need["id"] for title, need in after.items()}
    assert before["tip-accuracy of a.yaml"]["status"] != after["tip-accuracy of a.yaml"]["status"]
