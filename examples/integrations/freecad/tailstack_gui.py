"""The buttons, the observer of documents and the timer.  Needs FreeCAD with a screen."""

from __future__ import annotations

import contextlib
import os
from typing import Any

import FreeCAD
import FreeCADGui
import tailstack_document as cad
import tailstack_session
from PySide import QtCore
from tailstack_http import Latest, Refusal, Service

LOOK_MS = 100  # how often the loop looks for answers
REST_MS = 50  # how long a document has to rest before it is scored: a drag changes it many times a second

ICONS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "icons")

_sessions: dict[str, tailstack_session.Session] = {}  # by name of the document
_optima: dict[str, Latest] = {}


def find_session(document: Any) -> tailstack_session.Session:
    """The session of a document."""
    if document.Name not in _sessions:
        _sessions[document.Name] = tailstack_session.Session(document)
    return _sessions[document.Name]


def _icon(name: str) -> str:
    return os.path.join(ICONS, f"{name}.svg")


class Observer:
    """Hears of every change; asks for a score of the documents that are followed, when they rest."""

    def __init__(self) -> None:
        self.followed: set[str] = set()
        self._rest = QtCore.QTimer()
        self._rest.setSingleShot(True)
        self._rest.timeout.connect(self._refresh)
        self._look = QtCore.QTimer()
        self._look.timeout.connect(self._collect)
        self._look.start(LOOK_MS)

    def slotChangedObject(self, item: Any, _property: str) -> None:
        self._notice(item.Document)

    def slotDeletedObject(self, item: Any) -> None:
        self._notice(item.Document)

    def slotUndoDocument(self, document: Any) -> None:
        self._notice(document)

    def slotRedoDocument(self, document: Any) -> None:
        self._notice(document)

    def slotDeletedDocument(self, document: Any) -> None:
        self.followed.discard(document.Name)
        _sessions.pop(document.Name, None)
        _optima.pop(document.Name, None)

    def _notice(self, document: Any) -> None:
        if document is not None and document.Name in self.followed:
            self._rest.start(REST_MS)

    def _refresh(self) -> None:
        for name in sorted(self.followed):
            with contextlib.suppress(NameError):  # the document was closed meanwhile
                find_session(FreeCAD.getDocument(name)).refresh()

    def _collect(self) -> None:
        for session in list(_sessions.values()):
            session.collect()
        for name, latest in list(_optima.items()):
            for request, optimum in latest.take():
                _finish_optimisation(FreeCAD.getDocument(name), request, optimum)


def _finish_optimisation(document: Any, request: Any, optimum: Any) -> None:
    try:
        if isinstance(optimum, Exception):
            raise optimum
        FreeCAD.Console.PrintMessage(f"tailstack: {cad.move_beads(document, request, optimum)}\n")
    except Refusal as refusal:
        FreeCAD.Console.PrintError(f"tailstack: {refusal}\n")
        return
    find_session(document).refresh()


observer = Observer()
FreeCAD.addDocumentObserver(observer)


class Start:
    """Makes the sheet, and the beads of its design where the document has none."""

    def GetResources(self) -> dict[str, Any]:
        return {"Pixmap": _icon("start"), "MenuText": "Start", "ToolTip": self.__doc__}

    def IsActive(self) -> bool:
        return True

    def Activated(self) -> None:
        document = FreeCAD.ActiveDocument or FreeCAD.newDocument()
        document.openTransaction("Tailstack: start")
        try:
            cad.make_sheet(document)
            own, _ = cad.read_rows(document)
            if not cad.has_beads(document):
                folder = document.FileName.replace("\\", "/").rpartition("/")[0]
                cad.draw_beads(document, Service(own["service"]).read_design(own["design"], folder))
            document.commitTransaction()
        except Refusal as refusal:
            document.commitTransaction()
            FreeCAD.Console.PrintError(f"tailstack: {refusal}\n")
            return
        find_session(document).refresh(again=True)


class Score:
    """Scores the document: P95, budget and what each bead costs go into the sheet."""

    def GetResources(self) -> dict[str, Any]:
        return {"Pixmap": _icon("score"), "MenuText": "Score", "ToolTip": self.__doc__}

    def IsActive(self) -> bool:
        return FreeCAD.ActiveDocument is not None

    def Activated(self) -> None:
        find_session(FreeCAD.ActiveDocument).refresh(again=True)


class Follow:
    """Scores the document whenever a bead or the sheet changes, until pressed again."""

    def GetResources(self) -> dict[str, Any]:
        looks = {"Pixmap": _icon("follow"), "MenuText": "Follow changes", "ToolTip": self.__doc__}
        return {**looks, "Checkable": False}  # a button that stays pressed; at first it is not

    def IsActive(self) -> bool:
        return FreeCAD.ActiveDocument is not None

    def Activated(self, checked: int = 0) -> None:
        name = FreeCAD.ActiveDocument.Name
        if checked:
            observer.followed.add(name)
            find_session(FreeCAD.ActiveDocument).refresh()
        else:
            observer.followed.discard(name)


class Optimise:
    """Asks for the cheapest design within the limit and moves the beads there; one undo takes it back."""

    def GetResources(self) -> dict[str, Any]:
        return {"Pixmap": _icon("optimise"), "MenuText": "Optimise", "ToolTip": self.__doc__}

    def IsActive(self) -> bool:
        document = FreeCAD.ActiveDocument
        return document is not None and not (document.Name in _optima and _optima[document.Name].is_busy)

    def Activated(self) -> None:
        document = FreeCAD.ActiveDocument
        try:
            request = cad.read_request(document)
        except Refusal as refusal:
            FreeCAD.Console.PrintError(f"tailstack: {refusal}\n")
            return
        latest = _optima.setdefault(document.Name, Latest(lambda asked: iter([tailstack_session.optimise(asked)])))
        latest.ask(request)
        FreeCAD.Console.PrintMessage("tailstack: the optimiser works; go on, but leave the beads where they are\n")


COMMANDS = {"Tailstack_Start": Start(), "Tailstack_Score": Score(), "Tailstack_Follow": Follow(),
            "Tailstack_Optimise": Optimise()}  # fmt: skip
for name, command in COMMANDS.items():
    FreeCADGui.addCommand(name, command)
