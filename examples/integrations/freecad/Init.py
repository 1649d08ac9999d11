"""FreeCAD runs this at every start, also without a screen; there is nothing to do then."""
