"""The workbench in FreeCAD's list; its buttons are loaded when it is chosen."""

from __future__ import annotations

import FreeCADGui


class TailstackWorkbench(FreeCADGui.Workbench):
    """P95 of an X-ray reference structure while it is drawn."""

    MenuText = "Tailstack"
    ToolTip = "Beads of an X-ray reference structure: score them, and move them where the optimiser says"

    def Initialize(self):
        import tailstack_gui

        self.appendToolbar("Tailstack", list(tailstack_gui.COMMANDS))
        self.appendMenu("Tailstack", list(tailstack_gui.COMMANDS))

    def GetClassName(self):
        return "Gui::PythonWorkbench"


FreeCADGui.addWorkbench(TailstackWorkbench())
