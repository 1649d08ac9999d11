"""What the workbench shows: the bead that is pressed, the verdict and its basis, and what is no longer current."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pytest
import yaml
from browsing import DEMO, demo_with, used
from served import Served
from service_scenes import EXAMPLES, ROOT

from tailstack import load_design, score
from tailstack.results.verdicts import decisive_check

UNITS = EXAMPLES / "gallery" / "per_unit_limit.yaml"
ROTATIONS = {"min_deg": 0.01, "max_deg": 0.5}
BUILT = ROOT / "service" / "tailstack_service" / "workbench"


def shown(service: Served, scenario: str, design: str = DEMO, **more: Any) -> dict[str, Any]:
    return used(service.url, scenario, design, script="shown.mjs", **more)


# --- which bead is pressed ---------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_press_at_the_centre_of_a_mark_takes_that_bead_and_its_name_is_shown_before(service: Served) -> None:
    found = shown(service, "press")
    assert len(found["found"]) == 60
    assert [entry for entry in found["found"] if not entry[1] == entry[2] == entry[3]] == []
    assert found["steps"] == 0  # a press that moves nothing is no change


@pytest.mark.long
def test_presses_at_one_place_take_one_bead_after_the_other_and_a_drag_the_one_that_is_chosen(service: Served) -> None:
    design = yaml.safe_load(DEMO)
    design["fiducials"]["points"][6]["position_mm"] = [-29, 30, -24]  # F7 behind F5, as seen from the front
    found = shown(service, "below", yaml.safe_dump(design, sort_keys=False), labels=["F5", "F7"])
    first, second, third = found["chosen"]
    assert {first, second} == {"F5", "F7"}
    assert third == first
    assert f"Below it {second}" in found["said"]
    assert found["moved"] == f"Undo: Move {first}"


@pytest.mark.long
def test_a_finger_scrolls_over_beads_and_drags_the_one_that_was_chosen(service: Served) -> None:
    found = shown(service, "finger")
    assert found["first"]["scrolled"] > 50
    assert found["first"]["steps"] == 0
    assert found["chosen"] == "F9"
    assert found["second"]["steps"] == 1


# --- the verdict, and what it rests on -----------------------------------------------------------------------------


@pytest.mark.long
def test_a_verification_speaks_in_the_strip_while_the_design_is_the_verified_one(service: Served) -> None:
    """The limit is nearer to the estimate than 1 %: only a simulation decides."""
    design = yaml.safe_load(DEMO)
    design["requirements"][0]["limit_mm"] = 1.145
    found = shown(service, "verified", yaml.safe_dump(design, sort_keys=False))
    assert found["inside"]["y"] < 300  # the button is in the first window of the page
    for state in ("before", "changed"):
        assert found[state]["basis"] == "estimate"
        assert "Not decided" in found[state]["words"]
    for state in ("after", "undone"):
        assert found[state]["basis"] == "simulation"
        assert found[state]["words"].startswith(found["run"])  # the verdict of the run
        assert re.search(r"Verified: [\d,]+ simulated shots", found[state]["words"])
    assert f"\t{found['run']}\t" in found["rows"]
    assert found["offered"] == 0  # nobody is asked to do again what was done
    assert not any("tailstack" in found[state]["words"] for state in ("before", "after", "changed", "undone"))


def test_an_optimum_that_is_taken_ends_with_the_verdict_of_its_verification(service: Served) -> None:
    found = shown(service, "optimum")
    assert (found["basis"], found["badge"].split("\n")[0]) == ("simulation", "Pass")
    assert any(re.search(r"bounds, can cost less than [\d.]+; this one costs", note) for note in found["notes"])


@pytest.mark.long
def test_strip_run_slack_and_versions_speak_of_the_requirement_that_decides(service: Served) -> None:
    estimate = decisive_check(score(load_design(UNITS)).verdict.checks)
    assert estimate is not None
    assert (estimate.requirement, estimate.status) == ("every-unit", "fail")
    text = UNITS.read_text(encoding="utf-8")
    found = shown(service, "units", text.replace("name: every-unit,", "name: every-unit, ids: [SRS-016],"))
    assert found["p95"] == f"{estimate.value:.3f}"
    assert len(found["versions"]) == 2  # now, and A
    for row in found["versions"]:
        assert row.split("\t")[1:5] == ["Fail by estimate", f"{found['p95']} mm", "–", "0.600 mm"]
        assert "every-unit at tip" in row
    assert found["opened"] is True  # the run is looked at where runs are
    assert "every-unit at tip" in found["said"]
    slack = [re.match(r"([\d.]+) → at most ([\d.]+) ", cell) for cell in found["slack"]]
    assert any(slack)
    assert all(float(each[1]) > float(each[2]) for each in slack if each)  # nothing is loosened where the design fails
    assert len(found["listed"]) == 2
    assert ["SRS-016" in row for row in found["listed"]].count(True) == 1
    assert found["listed"] == found["rows"]
    assert found["verified"] in found["listed"][1]
    assert "succeeded" not in found["head"]
    assert "each unit" in found["caption"]


# --- what is no longer current -------------------------------------------------------------------------------------


@pytest.mark.long
def test_what_is_not_of_the_design_on_the_page_is_grey(service: Served) -> None:
    found = shown(service, "grey")
    numbers = ("sentence", "p95", "badge", "budget", "rows")
    for state, shade in (("current", 1), ("awaited", 0.62), ("answered", 1)):
        assert {name: found[state][name] for name in numbers} == dict.fromkeys(numbers, shade), state
        assert found[state]["word"].startswith("Fail")  # the badge keeps its word during a drag
        assert found[state]["picture"] == 1  # a bead is drawn where it is
    assert "fail" not in found["awaited"]["colours"]
    assert (found["own"], found["other"]) == (1, 0.62)  # a run of this design, and of another state
    assert found["refused"]["pictures"] == [0.62, 0.62]
    assert found["refused"]["p95"] == 0.62


@pytest.mark.long
def test_a_requirement_is_denied_only_where_the_design_states_none(service: Served) -> None:
    fiducials = yaml.safe_load(DEMO)["fiducials"]
    few = demo_with(fiducials={**fiducials, "points": fiducials["points"][:2]})
    found = shown(service, "none", refused=few, without=demo_with("requirements", "optimise"))
    assert "states no requirement" not in found["refused"]
    assert "states no requirement" not in found["waiting"]
    assert "warming up" in found["waiting"]
    assert "states no requirement" in found["without"]


@pytest.mark.long
def test_a_service_that_is_back_is_asked_at_once(service: Served) -> None:
    found = shown(service, "back")
    waited = [milliseconds for milliseconds in found["waited"] if milliseconds]  # what is typed may be asked for twice
    assert waited == [waited[0] * 2**k for k in range(len(waited))]
    assert len(waited) >= 3  # the next would come after those 10 s: only the look at its health is sooner
    assert found["current"] is True


# --- in the way ------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_what_is_said_is_in_sight_and_moves_nothing(service: Served) -> None:
    step = (EXAMPLES / "integrations" / "step" / "carrier.step").read_text(encoding="utf-8")
    found = shown(service, "near", file="carrier.step", step=step)
    assert found["inside"] is True
    assert found["shifted"] == 0
    assert "carrier.step is being read" in found["working"]
    assert found["done"] == 0


@pytest.mark.long
def test_numbers_are_understood_or_refused_where_they_are_typed(service: Served) -> None:
    found = shown(service, "numbers", axis="/views/0/fiducial_noise_px")
    understood = {"27,5": 27.5, "28 mm": 28, "29mm": 29, "−3.5": -3.5, "1e2": 100}
    for typed, entry in found["found"].items():
        if typed in understood:
            assert float(entry["value"]) == understood[typed]
            assert (entry["wrong"], entry["invalid"]) == ([], "false")
        else:  # abc, 0x10, 12 px
            assert entry["shown"] == typed  # it stands there to be mended
            assert typed in entry["wrong"][0]
            assert entry["invalid"] == "true"
            assert float(entry["value"]) == -3.5  # of before
    assert "0,1" in found["refused"]
    assert [float(value) for value in found["sweep"]] == pytest.approx([0.2, 0.2828, 0.4])
    assert {"views › AP › fiducial_noise_px", "fiducials › F2 › position_mm › 0"}.issubset(
        " › ".join(words for words in name.split(" › ") if words != "points") for name in found["offered"]
    )
    assert not any(name.startswith("/") for name in found["offered"])
    assert found["head"] == "views.AP.fiducial_noise_px, px"


@pytest.mark.long
def test_a_sweep_is_a_plot_with_limit_and_the_design_as_it_was_and_a_table_to_take_from(service: Served) -> None:
    """Places in the plot go with scores of changed documents, which are linear in it, and with logarithms of what is
    swept, whose names and bounds are those of the list and of its optimisation."""
    name = "connector flange (connector on flange, spigot and four bolts), rx, °"
    found = shown(service, "sweep", axis=name)
    pointer = "/interfaces/connector_flange/tolerances/rx/half_width_deg"
    assert (found["offered"], found["head"][:3]) == (["0.01", "0.5"], [name, "tip", "Status"])
    values = [float(row[0]) for row in found["rows"]]
    assert values == pytest.approx(np.geomspace(0.01, 0.5, 7), rel=1e-3)
    scores = [score(load_design(DEMO).with_value(pointer, value), losses=False) for value in values]
    p95 = [each.targets[0].p95_mm for each in scores]
    assert [row[1] for row in found["rows"]] == [f"{value:.2f}" for value in p95]
    (points,) = found["points"]
    along = np.polynomial.Polynomial.fit(np.log(values), [at for at, _ in points], 1)
    up = np.polynomial.Polynomial.fit(p95, [at for _, at in points], 1)
    assert along(np.log(values)) == pytest.approx([at for at, _ in points], abs=0.01)
    assert up(np.array(p95)) == pytest.approx([at for _, at in points], abs=0.01)
    assert (found["limits"], found["now"]) == ([pytest.approx(up(1.0))], [pytest.approx(along(np.log(0.2)))])
    assert found["rings"] == sum(each.verdict.status == "fail" for each in scores)
    assert name in found["words"]
    for taken, value in (("keys", values[1]), ("pressed", values[2])):
        assert yaml.safe_load(found[taken]["text"]) == load_design(DEMO).with_value(pointer, value).source.data
    assert found["keys"]["now"].split()[-1] == "now"
    assert (found["old"], found["axe"], found["steps"]) == (False, [], 3)


@pytest.mark.long
def test_diagnostics_keep_the_policy_of_the_page_and_tab_leaves_the_editor(service: Served) -> None:
    texts = {
        "range": "name: [1, 2\nviews: {\n",
        "point": "a: 1\nb: {x: 1",
        "refusal": DEMO.replace("limit_mm: 1.0", "limit_mm: -1"),
    }
    found = shown(service, "editor", texts=texts)
    assert all(found["seen"].values())
    assert "-1" in found["seen"]["refusal"]
    assert found["breaches"] == []
    assert (found["left"], found["same"]) == (True, True)
    assert "Tab" in found["hint"]


@pytest.mark.long
def test_keys_in_either_case_focus_after_a_choice_and_regions_that_are_told_apart(service: Served) -> None:
    found = shown(service, "marks", example=yaml.safe_load(DEMO)["name"])
    assert found["focus"] == "verdict"
    assert found["keys"] == ["F1", "F2", "F1"]
    assert found["twice"] == []
    assert (found["wide"], found["cut"]) == (0, 0)  # no column of the budget is cut
    lock = json.loads((ROOT / "service" / "workbench" / "package-lock.json").read_text(encoding="utf-8"))
    contained = {path: entry for path, entry in lock["packages"].items() if path and not entry.get("dev")}
    assert {"node_modules/preact", "node_modules/yaml", "node_modules/@codemirror/view"} <= set(contained)
    parts = found["licences"].split("-" * 80)
    assert len(parts) == len(contained)
    for (path, entry), part in zip(contained.items(), parts, strict=True):
        name = path.rpartition("node_modules/")[2]
        assert f"{name} {entry['version']} ({entry['license']})" in part
        assert "Copyright" in part
        assert "THE SOFTWARE IS PROVIDED" in part
    (file,) = BUILT.glob("assets/licences-*.txt")  # in the package, and so in the wheel
    assert file.read_text(encoding="utf-8") == found["licences"]


@pytest.mark.long
def test_with_many_targets_or_requirements_the_strip_stays_a_strip(service: Served) -> None:
    targets = [{"name": f"target {k}", "position_mm": [k - 6, 5, 40 + 5 * k]} for k in range(12)]
    found = shown(service, "tall", demo_with(targets=targets))
    assert found["height"] <= 145
    assert "tip-accuracy at target 11: " in found["words"]  # one requirement, kept or not, however many targets it has
    screw = (EXAMPLES / "pedicle_screw.yaml").read_text(encoding="utf-8")
    found = shown(service, "tall", screw)
    assert found["height"] <= 145
    (line,) = (line for line in found["words"].splitlines() if "position, tip" in line)  # one of all that do not decide
    assert re.search(r"position, tip: 1\.\d\d mm of 2\.00 mm.*breach, entry to tip: 0\.\d\d % of 1 %", line)
    assert shown(service, "phone", screw)["height"] < 844 / 3
    words = shown(service, "tall", (EXAMPLES / "radiostereometry.yaml").read_text(encoding="utf-8"))["words"]
    assert "open by estimate" in words  # of a rotation no error of the estimate is known, and none is promised
    assert "The estimate is within" not in words


@pytest.mark.long
def test_the_first_page_is_one_press_away_and_nothing_is_lost_by_going_there(service: Served) -> None:
    """By button, keys, and back and forward of the browser; what is begun or opened there is a step like any other."""
    corners = [(30 * (-1) ** k + k, 25 * (-1) ** (k // 2), 10 * k - 60) for k in range(8)]
    beads = "x_mm,y_mm,z_mm\n" + "".join(f"{x},{y},{z}\n" for x, y, z in corners)
    found = shown(service, "doors", example="pedicle screw", beads=beads)
    there, here = {"strip": 0, "begins": 1, "focus": "main"}, {"strip": 1, "begins": 0, "focus": "verdict"}
    assert [found[state] for state in ("first", "back", "again")] == [there] * 3
    assert [found[state] for state in ("on", "forward")] == [here] * 2
    assert found["opened"] == {**here, "other": True}
    assert found["reloaded"]["begins"] == 1
    assert (found["axe"], found["draft"], found["same"], found["undone"]) == ([], "half a comment", True, True)
    assert found["begun"].startswith("# A first design about the fiducials of beads.csv")


@pytest.mark.long
def test_on_a_phone_what_is_found_stays_in_sight_and_no_name_pushes_the_page_wider(service: Served) -> None:
    targets = [
        {"name": "Clivus – unterster noch erreichbarer Punkt (Plan B)", "position_mm": [0, 0, 70]},
        {"name": "Sella, Mitte", "position_mm": [2, 5, 60]},
    ]
    requirements = [
        {"name": "every-target", "limit_mm": 5.0},
        {"name": "sella-99-percent-of-all-shots-for-the-file", "limit_mm": 0.2, "targets": ["Sella, Mitte"]},
    ]
    design = demo_with(targets=targets, requirements=requirements, optimise={"rotation_bounds": ROTATIONS})
    found = shown(service, "phone", design)
    assert found["wide"] == 0
    assert (found["top"], found["height"] < 100) == (0, True)
    assert found["words"].startswith("Fail")
    assert f"{found['value']} mm" in found["words"]
    decisive = decisive_check(score(load_design(design)).verdict.checks)
    assert decisive is not None
    assert found["said"].startswith(
        f"1 of 2 requirements kept; what decides is {decisive.requirement} at {decisive.target}: "
    )


@pytest.mark.long
@pytest.mark.parametrize("name", ["gallery/operating_theatre", "slicer_markups"])
def test_an_example_is_opened_as_it_was_written(service: Served, name: str) -> None:
    path = EXAMPLES / f"{name}.yaml"
    written, design = path.read_text(encoding="utf-8"), load_design(path)
    found = shown(service, "example", example=design.name)
    assert found["sha"] == design.sha256
    lines = [line for line in written.splitlines() if not line.startswith("# yaml-language-server")]
    if design.document.fiducials.file is None:
        assert found["text"].splitlines() == lines
    comments = [line for line in lines if line.lstrip().startswith("#")]
    assert len(comments) > 1
    assert [line for line in found["text"].splitlines() if line.lstrip().startswith("#")] == comments
