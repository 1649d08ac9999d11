"""The 3D Slicer module of the examples against stand-ins for Slicer, Qt and VTK; Slicer itself is not run.

The expected positions are those that ``convert`` reads from the same points saved as .mrk.json; the expected numbers
are those of the library.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import httpx
import pytest
from service_scenes import EXAMPLES

from tailstack import load_design, score
from tailstack.integrations.conversion import convert
from waiting import until

FOLDER = EXAMPLES / "integrations" / "slicer"
MODULES = ("ctk", "qt", "slicer", "slicer.ScriptedLoadableModule", "slicer.util")
EVENTS = ("PointModified", "PointAdded", "PointRemoved", "PointPositionDefined", "PointPositionUndefined")


class Node:
    """A point list as vtkMRMLMarkupsFiducialNode shows it: RAS, mm."""

    def __init__(self, points: list[tuple[str, list[float], int]]) -> None:
        self.points = points
        self.observers: dict[int, Callable[..., None]] = {}
        for number, name in enumerate(EVENTS, 19000):
            setattr(self, f"{name}Event", number)

    def GetNumberOfControlPoints(self) -> int:
        return len(self.points)

    def GetNthControlPointLabel(self, number: int) -> str:
        return self.points[number][0]

    def GetNthControlPointPosition(self, number: int) -> list[float]:
        return self.points[number][1]

    def GetNthControlPointPositionStatus(self, number: int) -> int:
        return self.points[number][2]

    def drag(self, number: int, position: list[float]) -> None:
        label, _, status = self.points[number]
        self.points[number] = (label, position, status)
        self.observers[19000](self, "PointModifiedEvent")


class Widget:
    """A widget that remembers its connections; text and paths are plain attributes."""

    def __init__(self) -> None:
        self.connected: dict[str, Callable[..., None]] = {}
        self.text = self.currentPath = ""
        self.node: Any = None

    def connect(self, signal: str, slot: Callable[..., None]) -> None:
        self.connected[signal] = slot

    def currentNode(self) -> Any:
        return self.node

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None


class Observing:
    """VTKObservationMixin, as far as the module uses it."""

    def __init__(self) -> None:
        self.observed: list[Node] = []

    def addObserver(self, node: Node, event: int, slot: Callable[..., None]) -> None:
        node.observers[event] = slot
        self.observed.append(node)

    def removeObservers(self) -> None:
        for node in self.observed:
            node.observers.clear()
        self.observed = []


class ScriptedModule:
    def __init__(self, parent: Any = None) -> None:
        self.parent, self.layout = parent, Widget()

    def setup(self) -> None:
        """Slicer's own makes the reload buttons here."""


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The module, loaded as Slicer loads it: its folder on the path, its programs' modules there."""
    stand_ins = {name: ModuleType(name) for name in MODULES}
    stand_ins["ctk"].__dict__.update(ctkPathLineEdit=Widget)
    stand_ins["qt"].__dict__.update(QFormLayout=Widget, QLineEdit=Widget, QLabel=Widget, QTimer=Widget)
    stand_ins["slicer"].__dict__.update(qMRMLNodeComboBox=Widget, mrmlScene=None)
    stand_ins["slicer.util"].__dict__.update(VTKObservationMixin=Observing)
    names = ("ScriptedLoadableModule", "ScriptedLoadableModuleLogic", "ScriptedLoadableModuleWidget")
    stand_ins["slicer.ScriptedLoadableModule"].__dict__.update(
        {name: type(name, (ScriptedModule,), {}) for name in names}
    )
    for name, stand_in in stand_ins.items():
        monkeypatch.setitem(sys.modules, name, stand_in)
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    own = ("Tailstack", "tailstack_markups", "tailstack_http")
    for name in own:
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module("Tailstack")
    for name in own:
        sys.modules.pop(name, None)


def wait_for(widget: Any, words: str) -> str:
    """What the panel says once it says so; its timer ticks meanwhile."""

    def ticked() -> bool:
        widget.timer.connected["timeout()"]()
        return words in widget.said.text

    until(lambda: words in widget.said.text or ticked(), says=lambda: widget.said.text)
    return str(widget.said.text)


def test_points_of_the_scene_are_the_beads_of_the_saved_file(module: ModuleType) -> None:
    node = Node([("A", [1.5, -2.0, 3.0], 2), ("preview", [9.0, 9.0, 9.0], 1), ("B", [0.0, 4.0, -5.0], 2)])
    words = {0: "undefined", 1: "preview", 2: "defined"}
    saved = {"markups": [{"type": "Fiducial", "coordinateSystem": "RAS", "coordinateUnits": "mm", "controlPoints": [
        {"label": label, "position": position, "positionStatus": words[status]}
        for label, position, status in node.points]}]}  # fmt: skip
    read = json.loads(convert(json.dumps(saved).encode(), "beads.mrk.json", "beads.json").text)["fiducials"]["points"]
    found = importlib.import_module("tailstack_markups").read_beads(node)
    assert [{"label": label, "position_mm": list(position)} for label, position in found] == read


@pytest.mark.long
def test_a_drag_in_the_scene_changes_p95_and_the_worst_bead_is_named(module: ModuleType, client: httpx.Client) -> None:
    design = client.get("/v1/examples/first_carrier").json()
    points = design["fiducials"]["points"]
    node = Node([(p["label"], [-p["position_mm"][0], -p["position_mm"][1], p["position_mm"][2]], 2) for p in points])
    widget = shown(module, str(client.base_url).rstrip("/"), node)
    said = wait_for(widget, "Worst to lose")
    assert f"P95 at tip {score(load_design(design)).targets[0].p95_mm:.3f} mm, limit 1 mm: fail" in said
    costs = {}
    for number, point in enumerate(points):
        fiducials = {**design["fiducials"], "points": points[:number] + points[number + 1 :]}
        costs[point["label"]] = score(load_design({**design, "fiducials": fiducials})).targets[0].p95_mm
    worst = max(costs, key=lambda label: costs[label])
    assert f"Worst to lose: {worst} (P95 {costs[worst]:.3f} mm without it)" in said

    node.drag(0, [40.0, 40.0, -80.0])  # RAS
    points[0]["position_mm"] = [-40.0, -40.0, -80.0]
    wait_for(widget, f"P95 at tip {score(load_design(design)).targets[0].p95_mm:.3f} mm")
    widget.cleanup()
    assert node.observers == {}


def shown(module: ModuleType, address: str, *nodes: Node) -> Any:
    """A widget with this address, which shows these lists one after another."""
    widget = module.TailstackWidget()
    widget.setup()
    widget.address.text = address
    for node in nodes:
        widget.points.node = node
        widget.choose(node)
    return widget


def test_another_list_is_observed_in_place_of_the_first(module: ModuleType) -> None:
    first, second = Node([("A", [0.0, 0.0, 0.0], 2)]), Node([("A", [0.0, 0.0, 1.0], 2)])
    widget = shown(module, "http://127.0.0.1:1", first, second)
    assert (len(first.observers), len(second.observers)) == (0, len(EVENTS))
    assert "start it with: tailstack serve" in wait_for(widget, "no tailstack service")
    widget.cleanup()


def test_points_that_share_a_name_are_refused(module: ModuleType) -> None:
    node = Node([("A", [0.0, 0.0, 0.0], 2), ("A", [1.0, 0.0, 0.0], 2)])
    widget = shown(module, "http://127.0.0.1:1", node)
    assert "several points are called A" in wait_for(widget, "several points")
    widget.cleanup()


def test_slicer_lists_the_module_with_what_it_needs(module: ModuleType) -> None:
    parent = SimpleNamespace()
    module.Tailstack(parent)
    assert parent.title == "Tailstack"
    assert "tailstack serve" in parent.helpText
