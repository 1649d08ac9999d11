"""What an edit on the page takes off the list of what nobody stated: the same as in Python, whatever is edited."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import yaml
from page_modules import call_page
from service_scenes import EXAMPLES

from tailstack.design.assumed import follow_changes, list_assumed

DEMO: dict[str, Any] = yaml.safe_load((EXAMPLES / "demo.yaml").read_text(encoding="utf-8"))
LISTS = (
    ["/views", "/interfaces", "/targets/0/position_mm"],
    ["/fiducials", "/views/1/fiducial_noise_px"],
    ["/execution"],
)
SCRIPT = """
const { stating, confirming, listAssumed } = require("./assumed"), { withEdits } = require("./document");
answer(asked.map(({ data, edits, confirm }) => {
  const after = withEdits(data, confirm ? confirming(data, confirm) : stating(data, edits));
  return { after, listed: listAssumed(after) };
}));
"""


def leaves(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[tuple[Any, ...], Any]]:
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    if not isinstance(node, dict | list):
        return [(path, node)]
    return [leaf for key, child in items for leaf in leaves(child, (*path, key))]


def changed(data: Any, path: tuple[Any, ...], value: Any) -> Any:
    made = copy.deepcopy(data)
    node = made
    for step in path[:-1]:
        node = node[step]
    node[path[-1]] = value
    return made


def test_every_edit_of_the_page_takes_off_what_the_library_takes_off(tmp_path: Path) -> None:
    """Each number of the demo set anew, and each said again as it is, under three lists."""
    asked, wanted = [], []
    for pointers in LISTS:
        data = {**DEMO, "assumed": pointers}
        for path, value in leaves(DEMO):
            pointer = "".join(f"/{step}" for step in path)
            for new in {value, value + 0.125 if isinstance(value, float | int) else "other"}:
                asked.append({"data": data, "edits": [{"path": path, "value": new}]})
                wanted.append(follow_changes(data, changed(data, path, new), pointer))
    found = call_page(tmp_path, ("assumed", "document"), SCRIPT, asked)
    assert [each["after"] for each in found] == wanted
    assert [each["listed"] for each in found] == [list(list_assumed(each)) for each in wanted]
    assert len({str(each.get("assumed")) for each in wanted}) > 60


def test_an_item_that_goes_leaves_the_others_assumed_where_they_are_then(tmp_path: Path) -> None:
    """independent: values are told by what they are, which is different everywhere."""
    data = copy.deepcopy(DEMO)
    for k, view in enumerate(data["views"]):
        view["fiducial_noise_px"] = 0.5 + k
    data["views"].append({**data["views"][1], "name": "third", "fiducial_noise_px": 2.5})
    data["assumed"] = ["/views/0/fiducial_noise_px", "/views/1/fiducial_noise_px", "/views/2", "/fiducials/points"]
    asked = [{"data": data, "edits": [{"path": ["views", k]}]} for k in range(3)]
    asked.append({"data": data, "edits": [{"path": ["fiducials", "points", 0]}]})
    for k, found in enumerate(call_page(tmp_path, ("assumed", "document"), SCRIPT, asked)):
        after, listed = found["after"], found["listed"]
        assert list(list_assumed(after)) == listed
        noises = {
            after["views"][int(at.split("/")[2])]["fiducial_noise_px"] for at in listed if at.endswith("l_noise_px")
        }
        assert noises == {0.5, 1.5, 2.5} - ({0.5 + k} if k < 3 else set())
        assert sum(at.startswith("/fiducials/points") for at in listed) == len(after["fiducials"]["points"])


def test_a_word_that_it_is_so_takes_off_one_value_and_changes_nothing_else(tmp_path: Path) -> None:
    data = {**DEMO, "assumed": LISTS[0]}
    values = list(list_assumed(data))
    found = call_page(tmp_path, ("assumed", "document"), SCRIPT, [{"data": data, "confirm": at} for at in values])
    for at, each in zip(values, found, strict=True):
        assert each["listed"] == [other for other in values if other != at]
        assert {**each["after"], "assumed": None} == {**data, "assumed": None}
