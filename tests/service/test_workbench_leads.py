"""How the workbench leads, in a real Chromium: from points of one's own to a verified optimum, without help."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
import yaml
from browsing import DEMO, demo_with, used
from served import Served
from service_scenes import EXAMPLES, ROOT, ask

from tailstack import load_design, score
from tailstack.design.loading import list_assumed
from tailstack_service.first_design import Beads, design_of_beads

SCRIPT = "leads.mjs"
POINTS: list[tuple[str, tuple[float, float, float]]] = [
    (point["label"], (float(x), float(y), float(z)))
    for point in yaml.safe_load(DEMO)["fiducials"]["points"]
    for x, y, z in [point["position_mm"]]
]
CSV = "label,x_mm,y_mm,z_mm\n" + "".join(f"{label},{x},{y},{z}\n" for label, (x, y, z) in POINTS)


def led(service: Served, scenario: str, design: str = DEMO, **more: Any) -> dict[str, Any]:
    return used(service.url, scenario, design, script=SCRIPT, **more)


# --- points of one's own --------------------------------------------------------------------------------------------


@pytest.mark.long
def test_points_of_ones_own_become_the_first_design_that_the_command_makes_of_them(service: Served) -> None:
    """But for its name, the limit and the C-arm, which are chosen on the page."""
    markups = [{"label": label, "position": at} for label, at in POINTS]
    slicer = json.dumps({"markups": [{"coordinateSystem": "LPS", "controlPoints": markups}]})
    step = (EXAMPLES / "integrations" / "step" / "carrier.step").read_text(encoding="utf-8")
    files = [
        {"name": "beads.csv", "text": CSV},
        {"name": "beads.mrk.json", "text": slicer, "arm": "siemens-cios-fusion"},
        {"name": "carrier.step", "text": step},
    ]
    csv, markup, balls = led(service, "doors", files=files)["found"]
    beads = Beads(tuple(label for label, _ in POINTS), tuple(at for _, at in POINTS), "beads.csv")
    wanted = yaml.safe_load(design_of_beads(beads))
    wanted["requirements"][0]["limit_mm"] = 1.5
    wanted["assumed"].remove("/requirements/0/limit_mm")  # which was typed
    assert csv["wrong"][0].startswith("95 % of all errors within: “abc” is not a number in mm")
    assert "1500 or 1.500" in csv["wrong"][4]
    assert {csv["wrong"][k] for k in (1, 3, 5)} == {""}  # nothing is begun with another limit than is asked for
    made = yaml.safe_load(csv["text"])
    assert made.pop("name") == "first design of beads.csv"
    del wanted["name"]
    assert made == wanted
    assert csv["status"] == score(load_design(csv["text"])).verdict.status
    assert "12 fiducials of beads.csv" in csv["words"]
    assert "assumed" in csv["words"]
    for each in (csv, markup, balls):
        count = len(list_assumed(yaml.safe_load(each["text"])))
        assert each["rests"] == [f"on {k} assumed values" for k in (count, count - 1, count)]
    made = yaml.safe_load(markup["text"])
    assert {view.pop("preset") for view in made["views"]} == {"siemens-cios-fusion"}
    assert {view.pop("source_isocentre_mm") for view in made["views"]} == {700}  # which its source does not state
    for view in wanted["views"]:
        del view["preset"]
    assert (made["views"], made["fiducials"]) == (wanted["views"], wanted["fiducials"])
    assert "not published" in markup["text"]
    labels = [point["label"] for point in yaml.safe_load(balls["text"])["fiducials"]["points"]]
    assert labels == [f"BEAD{k}" for k in range(1, 9)]


@pytest.mark.long
@pytest.mark.parametrize("by", ["keyboard", "touch"])
def test_from_a_list_of_beads_to_a_verified_optimum_and_its_report_by_what_the_strip_offers(
    service: Served, by: str
) -> None:
    """The finger is one on a phone of 390 pixels; by the mouse the strip is used by the tests of what it shows."""
    found = led(service, "job", file={"name": "beads.csv", "text": CSV}, by=by, name=f"job_{by}")
    assert found["first"]["badge"].startswith(("Fail", "Pass", "Not decided"))
    assert len({found["first"]["sha"], found["taken"]}) == 2
    (take,) = found["seen"]
    assert re.fullmatch(r"Take the optimum: (cost [\d.]+ → [\d.]+, )?P95 [\d.]+ → [\d.]+ mm by estimate", take)
    assert found["last"]["sha"] == found["taken"]
    assert found["last"]["badge"].endswith("verified by simulation")
    assert "report" in found["title"]
    assert found["start"] == [[], 0]
    assert (found["last"]["axe"], found["last"]["wide"]) == ([], 0)
    assert found["watched"]["messages"] == []


# --- numbers --------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_page_shows_as_many_digits_as_the_command(service: Served, call: Any) -> None:
    names = ["demo", "tube_carrier", "gallery/long_tool", "gallery/per_unit_limit", "paper/c_arm"]
    paths = [EXAMPLES / f"{name}.yaml" for name in names]
    found = led(service, "digits", designs=[path.read_text(encoding="utf-8") for path in paths])["found"]
    assert len({len(shown["p95"]) for shown in found}) > 1
    for path, shown in zip(paths, found, strict=True):
        said = set(call("score", path)[1].split())
        assert {shown["p95"], shown["mean"], *shown["without"]} <= said, path
        if shown["row"]:  # found, between and limit
            assert set(re.findall(r"\d+\.\d+", " ".join(shown["row"]))) <= said, path


# --- what a change comes to, and what to do next --------------------------------------------------------------------


@pytest.mark.long
def test_a_change_is_seen_against_the_state_before_and_what_to_do_next_says_what_it_comes_to(service: Served) -> None:
    found = led(service, "next")
    first = found["begin"].pop("value")
    assert found["begin"] == {"numbers": "1.14 mm", "outlines": 0, "deltas": 0, "states": 0}
    for state in ("held", "dropped"):
        was, now, arrow, by = re.fullmatch(
            r"([\d.]+) → ([\d.]+) mm \(([▲▼]) ([\d.]+)\)", found[state]["numbers"]
        ).groups()  # type: ignore[union-attr]
        assert was == "1.144"  # one decimal more than without a change: what is written adds up
        assert f"{abs(float(now) - float(was)):.3f}" == by
        assert float(by) == pytest.approx(abs(found[state]["value"] - first), abs=0.001)
        assert (arrow == "▼") == (found[state]["value"] < first)
        assert found[state]["outlines"] == 5  # in two images and three elevations
        assert found[state]["deltas"] > 0
    assert found["dropped"]["states"] == 2
    assert found["back"] is True
    tighten = r"Tighten connector on flange rx, ry to ([\d.]+)° → ([\d.]+) mm by estimate, pass"
    advice = re.fullmatch(tighten, found["advice"])
    assert advice is not None, found["advice"]
    width, value = map(float, advice.groups())
    data = yaml.safe_load(DEMO)
    for axis in ("rx", "ry"):
        data["interfaces"]["connector_flange"]["tolerances"][axis]["half_width_deg"] = width
    assert yaml.safe_load(found["text"]) == data
    assert found["status"] == "pass" == score(load_design(data)).verdict.status
    assert found["value"] == pytest.approx(value, abs=0.005)


@pytest.mark.long
def test_a_design_that_says_nothing_of_an_optimum_is_optimised_from_a_box_round_its_beads(service: Served) -> None:
    design = demo_with("optimise")
    found = led(service, "unasked", design)
    assert found["title"] == "from: a box round the beads, seats ± 50 %"
    assert found["unchanged"] is True  # nothing is added before it is taken
    taken = yaml.safe_load(found["text"])
    assert taken["optimise"]["box"] == {"min_mm": [-30, -30, -74], "max_mm": [30, 30, -20]}
    free = {(each["interface"], each["component"]): each for each in taken["optimise"]["tolerances"]}
    assert len(free) == 12
    assert (free["connector_flange", "rx"]["min_deg"], free["connector_flange", "rx"]["max_deg"]) == (0.1, 0.3)
    for (interface, component), each in free.items():
        unit = "deg" if component[0] == "r" else "mm"
        width = taken["interfaces"][interface]["tolerances"][component][f"half_width_{unit}"]
        assert each[f"min_{unit}"] <= width <= each[f"max_{unit}"]
    assert found["p95"] < score(load_design(design)).targets[0].p95_mm


@pytest.mark.long
def test_the_buttons_of_the_strip_are_a_few_presses_of_tab_away(service: Served) -> None:
    """But for a message that stands there for a while."""
    stops = [stop for stop in led(service, "tabs")["stops"] if stop != "Close the message"]
    assert stops.index("Verify this design") < 5
    assert stops.index("Optimise this design") < 5


@pytest.mark.long
def test_the_page_fills_the_window_of_a_laptop_and_the_number_stays_in_sight_at_twice_the_size(service: Served) -> None:
    found = led(service, "screen")
    assert found["scrolls"] is False
    assert max(found["windows"]) <= 2  # one scroll of a column to its end
    assert max(found["ends"]) <= 800  # all pictures are seen at once
    assert (found["wide"], found["axe"]) == (0, [])
    first, moved, dragged, again = found["panes"]
    assert first["panes"] == ["X-ray images", "In space", "Elevations"]
    assert moved["panes"] == ["In space"]
    assert moved["split"] == first["split"] - 6
    assert moved["width"] < first["width"] < dragged["width"] == pytest.approx(moved["width"] + 200, abs=10)
    assert again == dragged  # it is remembered
    zoomed = found["zoomed"]
    assert (zoomed["top"], zoomed["height"] < 100) == (0, True)
    assert (zoomed["wide"], zoomed["axe"]) == (0, [])


# --- the first minute -----------------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_drill_guide_shows_in_a_minute_how_it_is_done_and_does_not_ask_again(service: Served) -> None:
    found = led(service, "minute", example=yaml.safe_load(DEMO)["name"])
    assert [words[:6] for words in found["words"]] == ["1 of 3", "2 of 3", "2 of 3", "3 of 3"]  # the second: reloaded
    assert found["ringed"] == ["F10"] * 5  # in every picture
    assert (found["ended"], found["again"]) == (0, 0)
    assert found["offered"] == 0  # at 0.3 mm, which no tightening keeps
    assert (found["axe"], found["wide"]) == ([], 0)


# --- words --------------------------------------------------------------------------------------------------------


def test_words_on_the_page_are_those_of_the_glossary() -> None:
    """Its sentences, to the letter, without the marks of Markdown."""
    plain = " ".join(
        (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").replace("*", "").replace("`", "").split()
    )
    source = (ROOT / "service" / "workbench" / "src" / "glossary.ts").read_text(encoding="utf-8")
    words = re.findall(r'^  "?([\w-]+)"?: "(.+)",$', source, re.M)
    assert len(words) > 20
    for word, meaning in words:
        assert f"- {word}: {meaning}" in plain, word


@pytest.mark.long
def test_words_are_explained_by_mouse_and_by_keyboard_and_an_answer_of_another_version_is_told(service: Served) -> None:
    found = led(service, "words")
    assert "95 % of shots do not exceed" in found["hovered"]
    assert "half the width of a tolerance zone" in found["focused"]
    assert found["left"] == 0
    assert "trace of the covariance" in found["list"]
    assert (found["axe"], found["manual"], found["closed"]) == ([], [], 0)
    assert len(found["pages"]) > 40
    assert {ask("GET", page).status_code for page in found["pages"]} == {200}
    assert "another version" in found["strip"]
    assert "reload" in found["strip"]
