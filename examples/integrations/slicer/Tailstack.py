"""3D Slicer scripted module: P95 of an X-ray reference structure while its beads are dragged."""

from __future__ import annotations

from typing import Any

import ctk
import qt
import slicer
import tailstack_markups
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleWidget,
)
from slicer.util import VTKObservationMixin

LOOK_MS = 100  # how often the answer is looked for


class Tailstack(ScriptedLoadableModule):
    """The entry in Slicer's list of modules."""

    def __init__(self, parent: Any) -> None:
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "Tailstack"
        parent.categories = ["IGT"]
        parent.dependencies = []
        parent.contributors = ["the tailstack contributors"]
        parent.helpText = (
            "Observes a point list, the beads of an X-ray reference structure, and shows P95 of the error at the tool "
            "and the worst bead. Needs a running service: tailstack serve"
        )


class TailstackWidget(ScriptedLoadableModuleWidget, VTKObservationMixin):
    """A point list, a design, and two lines of text that follow every drag."""

    def __init__(self, parent: Any = None) -> None:
        ScriptedLoadableModuleWidget.__init__(self, parent)
        VTKObservationMixin.__init__(self)

    def setup(self) -> None:
        """Make the widgets; Slicer calls it once."""
        ScriptedLoadableModuleWidget.setup(self)
        self.logic = TailstackLogic()
        form = qt.QFormLayout()
        self.points = slicer.qMRMLNodeComboBox()
        self.points.nodeTypes = ["vtkMRMLMarkupsFiducialNode"]
        self.points.addEnabled = self.points.removeEnabled = False
        self.points.noneEnabled = True
        self.points.setMRMLScene(slicer.mrmlScene)
        self.design = ctk.ctkPathLineEdit()
        self.design.nameFilters = ["designs (*.yaml *.yml *.json)"]
        self.address = qt.QLineEdit()
        self.address.placeholderText = "http://127.0.0.1:8321"
        self.said = qt.QLabel()
        self.said.wordWrap = True
        for name, widget in (("Beads", self.points), ("Design", self.design), ("Service", self.address)):
            form.addRow(name, widget)
        form.addRow(self.said)
        self.layout.addLayout(form)
        self.points.connect("currentNodeChanged(vtkMRMLNode*)", self.choose)
        self.design.connect("currentPathChanged(QString)", self.refresh)
        self.address.connect("editingFinished()", self.refresh)
        self.timer = qt.QTimer()
        self.timer.setInterval(LOOK_MS)
        self.timer.connect("timeout()", self.show_answer)
        self.timer.start()

    def cleanup(self) -> None:
        """Slicer closes the module."""
        self.timer.stop()
        self.removeObservers()

    def choose(self, node: Any) -> None:
        """Observe another point list."""
        self.removeObservers()
        if node is not None:
            for event in self.logic.list_events(node):
                self.addObserver(node, event, self.refresh)
        self.refresh()

    def refresh(self, *_: Any) -> None:
        """Something changed: ask for the score of what is there now."""
        node = self.points.currentNode()
        if node is not None:
            self.logic.follow(node, self.design.currentPath, self.address.text)

    def show_answer(self) -> None:
        """Show what has been answered."""
        self.logic.follower.collect()
        text = "\n".join(self.logic.follower.lines)
        if text != self.said.text:
            self.said.text = text


class TailstackLogic(ScriptedLoadableModuleLogic):
    """What can be used without the panel, from a script or the Python console."""

    def __init__(self) -> None:
        ScriptedLoadableModuleLogic.__init__(self)
        self.follower = tailstack_markups.Follower()

    def list_events(self, node: Any) -> list[int]:
        """What of a point list changes its score."""
        return [
            node.PointModifiedEvent,
            node.PointAddedEvent,
            node.PointRemovedEvent,
            node.PointPositionDefinedEvent,
            node.PointPositionUndefinedEvent,
        ]

    def follow(self, node: Any, design: str, address: str) -> None:
        """Ask for the score of a point list in a design; an empty design is the example first_carrier."""
        self.follower.address = address
        self.follower.design_name = design or "example:first_carrier"
        self.follower.refresh(node)
