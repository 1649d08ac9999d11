"""What becomes of a design on the workbench, in a real Chromium: opened, linked, saved, undone, read and written.

Expected numbers and hashes are the command's reading of the same text (the page has a reader of its own).
"""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from browsing import DEMO, used
from served import Served
from service_scenes import EXAMPLES

from dicom_files import write_image
from tailstack import Design, load_design, score
from tailstack.effects.image_field import FieldOfView
from tailstack.errors import DesignError, TailstackError
from tailstack_service.cli.main import main

pytestmark = pytest.mark.long
SCRIPT = "state.mjs"
THEATRE = (EXAMPLES / "gallery" / "operating_theatre.yaml").read_text(encoding="utf-8")


def seen(service: Served, scenario: str, design: str = DEMO, **more: Any) -> dict[str, Any]:
    return used(service.url, scenario, design, script=SCRIPT, **more)


def command_reads(text: str) -> Design | None:
    """The design that the command reads of a text; None where it refuses."""
    try:
        return load_design(text)
    except DesignError:
        return None


def with_rotations(value: str) -> str:
    """The demo with something else as the tolerances rx and ry of both seats."""
    text, count = re.subn(r"(?m)^( +)(rx|ry): \{.*$", rf"\1\2: {value}", DEMO)
    assert count == 4
    return text


# --- opened -------------------------------------------------------------------------------------------------------


def test_the_design_that_is_open_is_opened_again_and_keeps_its_numbers(service: Served) -> None:
    found = seen(service, "again", example=yaml.safe_load(DEMO)["name"])
    for after in found["found"]:
        assert (after["current"], after["refused"], after["p95"], after["images"]) == (True, None, "1.14", 2)
    assert [after["steps"] for after in found["found"]] == [1, 2]  # the file has comments that the example has not
    assert "is what is open already" in found["words"]


def test_after_a_link_the_first_edit_and_the_next_file_win(service: Served) -> None:
    tube = (EXAMPLES / "tube_carrier.yaml").read_text(encoding="utf-8")
    found = seen(service, "link", other=tube)
    assert found["linked"] == found["kept"] == found["opened"] == load_design(DEMO).sha256
    assert found["address"] == found["link"]
    assert "#" not in found["cleared"]  # a bookmark of it holds no older design
    assert found["reloaded"] == found["edited"] != found["linked"]
    assert found["last"] == found["other"] == load_design(tube).sha256


# --- read as the command reads ------------------------------------------------------------------------------------

BOMB = "a: &a [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{name}: &{name} [{','.join([f'*{before}'] * 10)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
UNREADABLE = {
    "a: *x\n": "*x stands for nothing",
    BOMB: "at most 50000 values",
    "hello": "This is no design",
    "[" * 3000: "nested too deep",
    "schema: !!str a\n": "YAML tags",
    "1: a\n": "The name of a field is a text",
}


def test_a_text_that_is_no_design_is_explained_however_it_comes(service: Served) -> None:
    for text in UNREADABLE:
        with pytest.raises(TailstackError):
            load_design(text.encode())
    found = seen(service, "unreadable", texts=list(UNREADABLE))
    by_way: dict[str, list[str]] = {}
    for one in found["found"]:
        by_way.setdefault(one["how"], []).append(one["shown"])
    for way in ("link", "file", "saved"):
        for shown, words in zip(by_way[way], UNREADABLE.values(), strict=True):
            assert words in shown, (way, shown[:500])
    for shown in by_way["shape"]:  # what was saved in another shape is left
        assert "drill guide" in shown
    assert found["watched"]["messages"] == []


NO_NUMBERS = [  # where it stands, and as what
    (with_rotations(".nan"), "interfaces › connector_flange › tolerances › rx", ".nan"),
    (DEMO.replace("limit_mm: 1.0", "limit_mm: .inf"), "requirements › tip-accuracy › limit_mm", ".inf"),
    (
        DEMO.replace("tolerances:", "tolerances: .nan\n    notes:", 1),
        "interfaces › structure_connector › tolerances", ".nan",
    ),
    (
        DEMO.replace("half_width_deg: 0.10", "half_width_deg: -.inf"),
        "interfaces › structure_connector › tolerances › rx › half_width_deg", "-.inf",
    ),
]  # fmt: skip
UNUSUAL = [
    DEMO.replace("pivot_mm: [0, 0, -95]", "pivot_mm: null"),  # required
    with_rotations(""),  # half typed
    DEMO.replace("  manufacturing: {", "  manufacturing: null # {"),
    DEMO.replace("coverage_factor: 2", "coverage_factor: ~"),
    re.sub("starts: [0-9]+", "starts: 010", DEMO),
    re.sub("starts: [0-9]+", "starts: 0x10", DEMO),
    DEMO.replace("[-30, -29, -72]", "[-3.e1, -29, -72.]"),
    (EXAMPLES / "gallery" / "kinematic_seat.yaml").read_text(encoding="utf-8"),  # with -0.0
]


def test_a_text_is_read_as_by_the_command_and_a_number_that_is_none_refused_before_anything_is_sent(
    service: Served,
) -> None:
    forged = f"{DEMO}__proto__: {{ a: 1 }}\n"
    texts = [UNUSUAL[0], *(text for text, _, _ in NO_NUMBERS), *UNUSUAL[1:], forged]
    assert DEMO not in texts
    first, *found = seen(service, "typed", texts=texts)["found"]  # after one that is refused nothing is asked ahead
    for (text, place, number), after in zip(NO_NUMBERS, found, strict=False):
        assert command_reads(text) is None
        assert (after["sha"], after["bodies"], after["runs"]) == (None, [], 0)  # nor is a verification begun
        assert place in after["strip"]
        assert f"must be a finite number; got {number}" in after["strip"]
    *read, last = found[len(NO_NUMBERS) :]
    for text, after in zip(UNUSUAL, [first, *read], strict=True):
        expected = command_reads(text)
        assert after["sha"] == (expected and expected.sha256)
        assert after["p95"] == (expected and score(expected).targets[0].p95_mm)
        assert (after["refused"] is None) == (expected is not None)
    assert "without a value" in read[0]["words"]  # and it is remarked where
    assert "connector_flange › tolerances › rx" in read[0]["words"]
    assert command_reads(forged) is None
    assert "no field __proto__" in last["words"]  # the design before is still there


# --- written ------------------------------------------------------------------------------------------------------


def test_a_field_behind_an_alias_changes_by_itself(service: Served) -> None:
    """The text says what the slider showed, one undo brings the old one back, and the other view keeps its field."""
    pointers = [f"views/{view}/image_field/half_widths_px/3" for view in (1, 0)]
    found = seen(service, "alias", THEATRE, pointers=pointers)
    assert found["before"] == found["after"] == THEATRE
    for view, after in zip((1, 0), found["found"], strict=True):
        wanted = yaml.safe_load(THEATRE)
        widths = [list(one["image_field"]["half_widths_px"]) for one in wanted["views"]]
        widths[view][3] = after["value"]
        read = load_design(after["text"])
        fields = [cast(FieldOfView, one).image_field for one in read.document.views]
        assert [list(one.half_widths_px) for one in fields if one] == widths
        assert after["steps"] == 2
        assert after["p95"] == score(read).targets[0].p95_mm
        assert "views › 1 › image_field: an alias" in after["words"]
        assert after["text"].count("#") == THEATRE.count("#")


def test_a_move_changes_one_line_and_a_lost_bead_takes_its_own(service: Served) -> None:
    found = seen(service, "written")
    before, moved, lost = (found[name].splitlines() for name in ("before", "moved", "lost"))
    assert len(before) == len(moved)
    changed = [k for k, line in enumerate(before) if line != moved[k]]
    assert [before[k].split(",")[0].strip() for k in changed] == ["- { label: F10"]
    assert "[ " not in found["lost"]  # lists are spaced as the author spaces them
    assert set(moved) - set(lost) == {line for line in moved if "label: F3," in line}


# --- kept ---------------------------------------------------------------------------------------------------------


def test_runs_of_two_tabs_are_all_kept(service: Served) -> None:
    found = seen(service, "tabs")
    assert (found["live"], found["removed"], found["third"]) == ([2, 2], 1, 1)


def test_a_tab_that_is_duplicated_leaves_the_first_its_design_and_what_was_undone_can_be_done_again(
    service: Served,
) -> None:
    found = seen(service, "twice")
    assert found["found"] == [["27.25", 1, 3], ["27.25", 1, 3], ["29", 2, 3]]
    assert found["places"] == 2


def test_text_that_is_no_design_yet_stays_until_it_is_one_or_is_left(service: Served) -> None:
    found = seen(service, "draft")
    assert found["found"] == [[True, 1]] * 3 + [[False, 0]]
    assert "27.25" in found["kept"]
    assert found["shown"].startswith(DEMO.splitlines()[0])


def test_what_was_run_is_gone_back_to_with_the_versions_that_were_kept_since(service: Served) -> None:
    found = seen(service, "back")
    after = yaml.safe_load(found["after"])
    (kept,) = after.pop("review")["versions"]
    assert after == yaml.safe_load(found["before"])
    assert "27.25" in kept["text"]


def test_presses_in_a_row_are_one_step_and_the_first_design_is_never_out_of_reach(service: Served) -> None:
    found = seen(service, "presses")
    assert found["found"] == [2, 3, 4, 300]
    assert found["reloaded"] == found["last"]
    assert found["kept"] > 41
    assert found["size"] < 1_000_000
    assert found["undone"] == found["first"] == load_design(DEMO).sha256


def test_a_full_storage_loses_no_move_and_one_that_refuses_is_told_after_the_reload_too(service: Served) -> None:
    full, refuses = seen(service, "full")["found"]
    assert full["after"] == full["before"]
    assert (full["told"], full["toldAgain"]) == (0, 0)
    assert refuses["after"] == refuses["before"]
    assert (refuses["told"], refuses["toldAgain"]) == (1, 1)


# --- files, runs, keys --------------------------------------------------------------------------------------------


def test_files_are_taken_or_it_is_said_what_to_do(service: Served, tmp_path: Path) -> None:
    points = "label,x_mm,y_mm,z_mm\n" + "".join(f"B{k},{20 * k - 50},{(-1) ** k * 25},{7 * k - 60}\n" for k in range(7))
    umlaut = DEMO.replace("drill guide", "Führung", 1)
    step = (EXAMPLES / "integrations" / "step" / "carrier.step").read_bytes()
    files = {
        "beads.csv": points.encode(), "latin.yaml": umlaut.encode("latin-1"),
        "latin.csv": points.replace("B1", "Bé").encode("latin-1"), "marked.yaml": umlaut.encode("utf-16"),
        "photo.png": b"\x89PNG\r\n\x1a\n", "part.obj": b"v 0 0 0\nf 1 2 3\n",
        "housing.step": (EXAMPLES / "gallery" / "seat_from_cad_carrier.step").read_bytes(),
    }  # fmt: skip
    sent = [{"name": name, "base64": base64.b64encode(content).decode()} for name, content in files.items()]
    carrier = {"name": "carrier.step", "base64": base64.b64encode(step).decode()}
    shots = [write_image(), write_image(PositionerPrimaryAngle=87, DistanceSourceToDetector=1234)]
    images = [base64.b64encode(content).decode() for content in shots]
    named = {  # designs and the last of the files that they name
        "seat_from_cad.yaml": ("seat_from_cad_carrier.step", "seat_from_cad_connector.step"),
        "robot_arm.yaml": ("ur5e.urdf",),
        "hand_eye_poses.yaml": ("hand_eye_poses.csv",),
    }
    gallery = [EXAMPLES / "gallery" / name for one, others in named.items() for name in (one, *others)]
    beside = [{"name": file.name, "base64": base64.b64encode(file.read_bytes()).decode()} for file in gallery]
    found = seen(service, "files", files=[*sent, carrier, *beside], images=images)["found"]
    assert "7 fiducials of beads.csv are in a first design" in found["empty beads.csv"]["words"]
    for page in ("empty", "design"):
        assert "not UTF-8" in found[f"{page} latin.yaml"]["words"]
        assert "Führung" in found[f"{page} marked.yaml"]["text"]
        for other in ("photo.png", "part.obj"):
            assert "the surface of a part (.stl)" in found[f"{page} {other}"]["words"]
        housing = found[f"{page} housing.step"]["words"]
        assert housing.startswith("housing.step holds no ball")
        assert "export it as STL" in housing
        assert "�" not in "".join(one["text"] for one in found.values())
    assert "UTF-8" in found["design latin.csv"]["words"]
    assert "7 fiducials" in found["design beads.csv"]["words"]
    taken = yaml.safe_load(found["design beads.csv"]["text"])["fiducials"]["points"]
    assert [point["label"] for point in taken] == [f"B{k}" for k in range(7)]
    words = found["design carrier.step"]["words"]  # what is said of a design that a file starts is not said of this one
    assert "8 fiducials" in words
    assert "tailstack init" not in words
    assert "limit" not in words
    for page in ("empty", "design"):  # files that a design names are read as beside the command
        assert "names seat_from_cad_connector.step, too" in found[f"{page} seat_from_cad_carrier.step"]["words"]
        for one, (*_, last) in named.items():
            alone = load_design(found[f"{page} {last}"]["text"].encode(), allow_files=False)
            assert alone.sha256 == load_design(EXAMPLES / "gallery" / one).sha256
    (tmp_path / "a.dcm").write_bytes(shots[0])
    (tmp_path / "b.dcm").write_bytes(shots[1])
    main(["convert", str(tmp_path / "a.dcm"), str(tmp_path / "b.dcm"), "-o", str(tmp_path / "made.yaml")])
    texts = [found["2 images"]["text"], (tmp_path / "made.yaml").read_text(encoding="utf-8"), found["1 images"]["text"]]
    begun, made, again = map(yaml.safe_load, texts)
    assert begun == made
    distances = [view["source_detector_mm"] for view in again["views"]]
    assert distances == [1234, 1234]  # the first view is another now, and nothing else
    assert {**again, "views": again["views"][1:]} == {**begun, "views": begun["views"][1:]}
    assert "isocentre" in found["2 images"]["words"]
    assert found["away"]["words"].startswith("beads.csv was not read: the service does not answer.")
    assert found["away"]["text"] == found["1 images"]["text"]


def test_a_run_whose_result_is_gone_says_so(service: Served) -> None:
    found = seen(service, "gone")
    assert (found["state"], found["links"]) == ("gone", 0)
    assert "no longer has its result" in found["shown"]
    assert "run it again" in found["shown"]
