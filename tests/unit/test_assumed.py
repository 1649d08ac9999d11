"""What nobody stated: every pointer leads somewhere, stating a value takes it off, whatever the field, and every answer
says how many there are."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
import yaml

from plain_data import DEMO, EXAMPLES, problems_of, read_cases
from tailstack import DesignError, load_design, score
from tailstack.design import Revision, compile_design, design_to_data, design_to_yaml, revise_design
from tailstack.design.loading import follow_changes, list_assumed
from tailstack.design.yaml_text import revise_yaml
from tailstack.results.verdicts import assumed_sentence, rest_of

DESIGNS = sorted(path for path in EXAMPLES.rglob("*.yaml") if "tailstack/design/1" in path.read_text())


def assuming(*pointers: str, data: dict[str, Any] = DEMO) -> dict[str, Any]:
    return {**data, "assumed": list(pointers)}


def walk(node: Any, pointer: str = "") -> list[tuple[str, Any]]:
    """Every place of a document by itself: what the module under test must know of, written once more."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    ways = [(f"{pointer}/{str(key).replace('~', '~0').replace('/', '~1')}", child) for key, child in items]
    return [*ways, *(below for way, child in ways for below in walk(child, way))]


def is_leaf(value: Any) -> bool:
    return not isinstance(value, dict) and not (isinstance(value, list) and any(isinstance(e, dict) for e in value))


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_every_place_of_every_example_can_be_assumed_and_is_taken_off_where_it_is_stated(path: Path) -> None:
    data = yaml.safe_load(path.read_text())
    places = [(at, value) for at, value in walk(data) if at not in ("/schema",)]
    pointers = [at for at, _ in places]
    listed = list_assumed(assuming(*pointers[:900], data=data))
    assert set(listed) <= set(pointers)
    for at, value in places:
        if not is_leaf(value):
            continue
        document = assuming(at, data=data)
        assert list_assumed(document) == (at,)
        assert "assumed" not in follow_changes(document, document, stated=at)
        top = "/" + at.split("/")[1]
        whole = list_assumed(assuming(top, data=data))
        left = list_assumed(follow_changes(assuming(top, data=data), assuming(top, data=data), stated=at))
        assert list(left) == [each for each in whole if not f"{at}/".startswith(f"{each}/")], (
            "the rest of the section stays assumed"
        )


def test_a_pointer_to_a_section_covers_each_number_and_text_written_back_says_the_same() -> None:
    seats = list_assumed(assuming("/interfaces"))
    numbers = {at for at, value in walk(DEMO["interfaces"], "/interfaces") if is_leaf(value)}
    texts = {at for at, value in walk(DEMO["interfaces"], "/interfaces") if isinstance(value, str)}
    elements = {at for at in numbers if at.rsplit("/", 1)[0] in numbers}
    assert set(seats) == numbers - texts - elements
    assert list_assumed(assuming("/views/0/name")) == ("/views/0/name",)
    data = assuming("/interfaces", "/views/0/fiducial_noise_px")
    assert yaml.safe_load(design_to_yaml(load_design(data)))["assumed"] == data["assumed"]


@pytest.mark.parametrize(("pointer", "hint"), read_cases("design", "assumed"))
def test_what_leads_nowhere_is_refused_and_its_cure_is_accepted(pointer: str, hint: str) -> None:
    problem = problems_of(load_design, assuming("/views/0/isocentre_mm", pointer), error=DesignError)[0]
    assert (problem.pointer, problem.code) == ("/assumed/1", "not-found")
    assert hint in problem.hint
    if problem.hint.startswith("did you mean "):
        meant = problem.hint.removeprefix("did you mean ").removesuffix("?").split(", ")
        assert load_design(assuming(*meant)).document.assumed == meant


def test_with_value_takes_off_what_it_states_and_nothing_else() -> None:
    design = load_design(assuming("/views/0/fiducial_noise_px", "/views/1", "/interfaces"))
    again = design.with_value("views.AP.fiducial_noise_px", 0.3)
    assert again.document.assumed == ["/views/1", "/interfaces"], "a value that is said again is stated, too"
    changed = design.with_value("/interfaces/structure_connector/tolerances/rx/half_width_deg", 0.07)
    before, after = set(list_assumed(design.source.data)), set(list_assumed(changed.source.data))
    assert before - after == {"/interfaces/structure_connector/tolerances/rx/half_width_deg"}
    assert after < before
    moved = design.with_value("/views/1", {**DEMO["views"][1], "target_noise_px": 0.111})
    left = set(list_assumed(moved.source.data))
    assert before - left == {"/views/1/target_noise_px"}, "what a new section leaves as it was is still assumed"
    emptied = load_design(assuming("/views/0/fiducial_noise_px")).with_value("/views/0/fiducial_noise_px", 0.3)
    assert emptied.sha256 == load_design(DEMO).sha256, "a design whose every value is stated is that design"


def test_what_the_optimiser_sets_is_stated_and_the_rest_stays_assumed() -> None:
    design = load_design(assuming("/interfaces", "/fiducials/points", "/views/0/fiducial_noise_px"))
    wide = {("structure_connector", "rx"): 0.03}
    revised = revise_design(design, Revision(half_width=wide))
    gone = set(list_assumed(design.source.data)) - set(list_assumed(revised.source.data))
    assert gone == {"/interfaces/structure_connector/tolerances/rx/half_width_deg"}
    fewer = design.fiducials.labels[1:]
    positions = compile_design(design).fiducials_mm[1:]
    left = revise_design(design, Revision(labels=fewer, fiducials_mm=positions))
    assert not [at for at in left.document.assumed if at.startswith("/fiducials/points")]


def test_points_of_a_file_stay_assumed_where_they_are_written_out(tmp_path: Path) -> None:
    (tmp_path / "beads.csv").write_text(
        "label,x_mm,y_mm,z_mm\nA,1,2,3\nB,30,2,9\nC,4,33,2\nD,9,8,41\nE,3,5,60\nF,9,40,3\n"
    )
    data = {name: value for name, value in DEMO.items() if name != "optimise"}
    data = assuming("/fiducials/file", data={**data, "fiducials": {"file": "beads.csv"}})
    inline = design_to_data(load_design(data, base_directory=tmp_path))
    assert inline["assumed"] == ["/fiducials/points"]
    assert len(list_assumed(load_design(inline).source.data)) == 6


def test_no_number_depends_on_the_list_and_the_answer_names_each_value() -> None:
    stated, assumed = score(load_design(DEMO)), score(load_design(assuming("/interfaces", "/targets/0/position_mm")))
    assert assumed.targets == stated.targets
    assert stated.provenance.assumed == ()
    assert assumed.provenance.assumed == list_assumed(assuming("/interfaces", "/targets/0/position_mm"))
    assert assumed.provenance.design_sha256 != stated.provenance.design_sha256, "a verdict is that of its document"
    count = len(assumed.provenance.assumed)
    assert rest_of(assumed.provenance.assumed) == f"on {count} assumed values"
    assert rest_of(("/targets/0/position_mm",)) == "on 1 assumed value"
    assert f"{count} values that nobody stated ({count - 1} in interfaces, 1 in targets)" in assumed._repr_html_()
    assert assumed_sentence(()) == rest_of(()) == ""


def test_an_optimum_is_written_into_its_authors_text_comments_and_all() -> None:
    data = assuming("/interfaces", "/views/0/fiducial_noise_px")
    text = (EXAMPLES / "demo.yaml").read_text() + "\nassumed: # ask the workshop\n  - /interfaces\n"
    text += "  - /views/0/fiducial_noise_px # measured in May?\n"
    design = load_design(text)
    assert design.document.assumed == data["assumed"]
    revised = revise_design(design, Revision(half_width={("structure_connector", "rx"): 0.001}))
    written = revise_yaml(text, design_to_data(design, inline=False), design_to_data(revised))
    assert load_design(written).sha256 == revised.sha256
    assert "# ask the workshop" in written
    assert written.count("#") >= text.count("#") - 1


def test_statements_in_any_order_leave_nothing() -> None:
    """All values of a design stated one after another, in ten orders that are drawn once (seed 7)."""
    numbers = list_assumed(assuming("/views", "/interfaces", "/targets", "/fiducials"))
    for seed in range(10):
        order = random.Random(f"7.{seed}").sample(numbers, len(numbers))
        data = assuming("/views", "/interfaces", "/targets", "/fiducials")
        for k, at in enumerate(order, 1):
            data = follow_changes(data, data, stated=at)
            assert set(list_assumed(data)) == set(order[k:])
        assert "assumed" not in data


# --- the title block ----------------------------------------------------------------------------------------------


def test_the_title_block_is_in_every_answer_and_in_no_number() -> None:
    block = {"number": "DG-1042", "revision": "C", "date": "2026-11-28", "author": "M. Keller"}
    signed = score(load_design({**DEMO, "document": block}))
    assert signed.targets == score(load_design(DEMO)).targets
    assert signed.to_dict()["provenance"]["document"] == {**block, "checker": "", "approver": ""}
    text = "document: {number: 0815, revision: C, date: 2026-11-28}\n" + (EXAMPLES / "demo.yaml").read_text()
    assert load_design(text).document.document.date == "2026-11-28"  # type: ignore[union-attr]
