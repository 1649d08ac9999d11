"""The limit as a handle on the workbench: the cheapest half-widths follow the hand.

What the page writes is held against ``score`` of its text and ``allocate``, which tests/unit/test_allocation.py
holds against the search of the optimiser."""

from __future__ import annotations

import math
import os
import signal
from pathlib import Path
from typing import Any

import pytest
import yaml
from browsing import DEMO, asked, playing, used
from served import Served, served
from service_scenes import EXAMPLES

from plain_data import value_at
from tailstack import Design, allocate, load_design, score

pytestmark = pytest.mark.long
SCRIPT = "limit.mjs"


def text_of(name: str) -> str:
    return (EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8")


def worst(design: Design, requirement: str) -> tuple[float, float]:
    """What a requirement comes to by estimate, and its limit."""
    checks = [each for each in score(design, losses=False).verdict.checks if each.requirement == requirement]
    most = max(checks, key=lambda check: check.value)
    return most.value, most.limit


LOCKED = {
    f"structure connector (carrier on two dowel pins), {axis}": f"structure_connector.{axis}" for axis in ("rx", "ry")
}
USUAL = {"of": "limit", "requirement": "tip-accuracy"}
CASES: dict[str, dict[str, Any]] = {
    "one requirement": {"name": "demo", "to": 0.55},
    "what it comes to": {"name": "demo", "of": "value", "to": 0.6},
    "locked rows": {"name": "first_carrier", "to": 0.75, "lock": list(LOCKED)},
    "two requirements, one per unit": {"name": "locators_321", "to": 0.6, "requirement": "unit-yield"},
    "a mean of the tail": {"name": "mean_and_tail", "to": 0.7, "requirement": "tail"},
    "wide errors of the estimate": {"name": "reworked_carrier", "to": 0.8},
}


@pytest.mark.parametrize("case", CASES)
def test_the_cheapest_half_widths_follow_the_hand(service: Served, case: str) -> None:
    """Held still, the text is that of the drag, and let go it is one step; undo brings the text back to the letter."""
    asks = {**USUAL, **CASES[case]}
    text, of, requirement = text_of(asks["name"]), asks["of"], asks["requirement"]
    found = used(service.url, "drag", text, script=SCRIPT, **{**asks, "name": case, "axe": case == "one requirement"})
    before, after = load_design(text), load_design(found["after"]["text"])
    assert found["clicked"] == found["before"]
    assert found["held"]["text"] == text  # until it is let go
    assert (found["after"]["steps"], found["undone"]["text"], found["wide"]) == (2, text, 0)
    assert found.get("axe", []) == []
    value, limit = worst(after, requirement)
    assert [found[when]["value"] for when in ("held", "after")] == pytest.approx([value, value], rel=1e-5)
    assert value <= limit
    assert limit == (found["after"]["limit"] if of == "limit" else worst(before, requirement)[1])
    names = [LOCKED[name] for name in asks.get("lock", [])]
    least = allocate(before, limit=value, requirement=requirement, locked=names)
    assert allocate(after, locked=names).cost_before == pytest.approx(least.cost_after, rel=2e-4)
    for name in names:
        seat, component = name.split(".")
        kept, stated = (
            getattr(getattr(each.document.interfaces, seat).tolerances, component) for each in (after, before)
        )
        assert kept == stated
    assert str(least.moved_most) in found["after"]["words"]
    assert found["watched"]["messages"] == []


def test_the_limit_moves_by_keys_and_is_kept_by_a_press(service: Served) -> None:
    """Keys that follow one another are one step; Escape gives up; where the hand cannot go the page says who holds it:
    `independent` by the shares of ``score`` with every free half-width at its least."""
    found = used(service.url, "keys", DEMO, script=SCRIPT)
    assert [found[when]["limit"] for when in ("left", "given", "typed")] == [0.96, 1, 0.9]
    assert [found[when]["steps"] for when in ("left", "home")] == [2, 2]
    assert found["given"]["text"] == DEMO
    typed = load_design(found["typed"]["text"])  # a limit that is out of reach stays, and so do the half-widths
    assert load_design(found["beyond"]["text"]).sha256 == typed.with_value("/requirements/0/limit_mm", 0.2).sha256
    for when in ("left", "typed"):
        checks = score(load_design(found[when]["text"]), losses=False).verdict.checks
        assert [check.status for check in checks] == ["pass"]
    least = load_design(DEMO)
    for seat, component in ((seat, axis) for seat in ("structure_connector", "connector_flange") for axis in "xyz"):
        least = least.with_value(f"/interfaces/{seat}/tolerances/r{component}/half_width_deg", 0.01)
    target = score(least, losses=False).targets[0]
    assert target.p95_mm < found["home"]["limit"] < 1.001 * target.p95_mm
    most = max((each for each in target.contributors if each.component == "all"), key=lambda each: each.variance_share)
    assert f"as {most.label} has" in found["home"]["words"]


def test_the_limit_is_dragged_by_a_finger_on_a_small_screen(service: Served) -> None:
    found = used(service.url, "touch", DEMO, script=SCRIPT, to=0.5, width=390, height=844)
    after = found["after"]
    assert (after["steps"], found["wide"], found["scrolled"], found["axe"]) == (2, 0, 0, [])
    assert after["limit"] == pytest.approx(0.5 * 1.35 * worst(load_design(DEMO), "tip-accuracy")[0], abs=0.02)
    assert all(min(size) >= 24 for size in found["sizes"])


RX = "interfaces/connector_flange/tolerances/rx/half_width_deg"


def kept(text: str, pointer: str, requirement: str) -> tuple[float, float]:
    """The limit of a design, whose half-width is the largest of three digits that keeps it with what the estimate may
    be off by; and that half-width."""
    design, width = load_design(text), value_at(yaml.safe_load(text), pointer.split("/"))
    step = 10.0 ** (math.floor(math.log10(width)) - 2)
    value, limit = worst(design, requirement)
    check = score(load_design(DEMO), losses=False).verdict.checks[0]
    assert check.interval[1] is not None
    share = check.value / check.interval[1]
    assert value <= limit * share < worst(design.with_value(f"/{pointer}", width + step), requirement)[0]
    assert score(design, losses=False).verdict.status == "pass"
    return limit, width


@pytest.mark.parametrize("by", ["pointer", "finger"])
def test_the_crossing_of_a_curve_moves_the_limit_and_its_half_width_follows(service: Served, by: str) -> None:
    """Nothing else of the design changes, and let go it is one step."""
    small = {"finger": True, "width": 390, "height": 844} if by == "finger" else {}
    found = used(service.url, "curve", DEMO, script=SCRIPT, pointer=RX, by=24, name=f"curve_{by}", **small)
    after = found["after"]
    limit, width = kept(after["text"], RX, "tip-accuracy")
    assert (limit, after["steps"], found["held"]["text"]) == (after["limit"], 2, DEMO)
    assert limit > 1.05
    assert after["says"] == f"{limit} mm is kept up to {width}°"
    assert found["held"]["says"].startswith(f"{limit} mm is kept up to ")
    assert width == pytest.approx(float(found["held"]["says"].split()[-1].rstrip("°")), rel=0.015)
    changed, first = yaml.safe_load(after["text"]), yaml.safe_load(DEMO)
    first["interfaces"]["connector_flange"]["tolerances"]["rx"]["half_width_deg"] = width
    first["requirements"][0]["limit_mm"] = limit
    assert changed == first
    assert (found["axe"], found["held"]["wide"]) == ([], 0)
    if by == "finger":
        return
    assert (found["given"]["text"], found["away"]) == (DEMO, DEMO)
    assert kept(found["keys"]["text"], RX, "tip-accuracy")[0] == pytest.approx(1.021)
    assert (found["keys"]["position"], found["focus"]) == (1, "crossing")
    least = load_design(found["home"]["text"])
    smallest = worst(least.with_value(f"/{RX}", 1e-3), "tip-accuracy")[0]
    assert 0 < worst(least, "tip-accuracy")[1] - smallest < 0.03


def test_tables_of_grades_are_not_dragged_and_the_page_says_so(service: Served) -> None:
    text = text_of("tube_carrier")
    found = used(service.url, "barred", text, script=SCRIPT)
    assert "bought from tables of grades" in found["words"]
    assert (found["text"], found["asks"], found["disabled"], found["locks"]) == (text, 0, True, 0)


def test_a_service_that_is_killed_in_a_drag_leaves_no_number_as_current(tmp_path: Path, browser: None) -> None:
    with served(tmp_path) as running, playing(SCRIPT, **asked(running.url, "killed")) as page:
        assert page.said() == "kill"
        os.kill(running.pid, signal.SIGKILL)
        found = page.found()
    assert (found["shown"], found["same"], found["steps"]) == ("false", True, 0)
    assert "does not answer" in found["words"]
