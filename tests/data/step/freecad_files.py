"""Write the STEP files of scenes.py with FreeCAD: ``freecadcmd freecad_files.py``, into files/freecad_SCENE.step.

FreeCAD reads unit and schema when its module Part is loaded, so that every file is written by a process of its own.
"""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(os.environ.get("STEP_FOLDER", ".")).resolve()
sys.path.insert(0, str(HERE))
import scenes  # noqa: E402

UNITS = {"MM": 0, "M": 1, "INCH": 2}
SCHEMES = {"AP203": "AP203", "AP214": "AP214IS", "AP242": "AP242DIS"}


def make_shape(shape, mirror):
    import FreeCAD
    import Part

    vector, kind = FreeCAD.Vector, shape["kind"]
    r = shape.get("radius", 0.0)
    if kind == "ball":
        if shape["faces"] == 1:
            made = Part.makeSphere(r, vector(*shape["centre"]))
        else:
            centre = vector(*shape["centre"])
            pieces = [Part.makeSphere(r, centre, vector(0, 0, 1), low, low + 90, 360) for low in (-90, 0)]
            if shape["faces"] == 8:
                whole = Part.makeSphere(r, centre)
                corners = [vector(x, y, z) for x in (-9, 0) for y in (-9, 0) for z in (-9, 0)]
                pieces = [whole.common(Part.makeBox(9, 9, 9, centre + corner)) for corner in corners]
            made = pieces[0].multiFuse(pieces[1:]).Solids[0]
            assert len(made.Faces) == shape["faces"], len(made.Faces)
        return made.mirror(vector(0, 0, 0), vector(1, 0, 0)) if mirror else made
    if kind == "box":
        return Part.makeBox(*shape["size"], vector(*shape["corner"]))
    if kind == "cylinder":
        return Part.makeCylinder(r, shape["height"])
    if kind == "dowel":
        ends = [Part.makeSphere(r, vector(0, 0, z)) for z in (0, shape["length"])]
        return Part.makeCylinder(r, shape["length"]).multiFuse(ends).removeSplitter()
    big = vector(-5, -5, -10)
    if kind == "pocket":
        return Part.makeBox(10, 10, 10, big).cut(Part.makeSphere(r))
    if kind == "half":
        return Part.makeSphere(r, vector(), vector(0, 0, 1), 0, 90)
    if kind == "cut":
        return Part.makeSphere(r).cut(Part.makeBox(10, 10, 10, vector(-5, -5, r / 2)))
    if kind == "hollow":
        return Part.makeSphere(r).cut(Part.makeSphere(shape["inner"]))
    if kind == "void":
        return Part.makeBox(10, 10, 10, vector(-5, -5, -5)).cut(Part.makeSphere(r))
    if kind == "rounded":
        box = Part.makeBox(shape["size"], shape["size"], shape["size"])
        return box.makeFillet(r, box.Edges)
    if kind == "lens":
        return Part.makeSphere(r).common(Part.makeSphere(r, vector(0, 0, r)))
    if kind == "peanut":
        return Part.makeSphere(r).fuse(Part.makeSphere(r, vector(0, 0, r)))
    assert kind == "sheet"
    return Part.makeSphere(r).Shells[0]


def write(scene):
    import FreeCAD

    tree, options, _ = scenes.SCENES[scene]
    settings = FreeCAD.ParamGet("User parameter:BaseApp/Preferences/Mod/Part/STEP")
    settings.SetInt("Unit", UNITS[options.get("unit", "MM")])
    settings.SetString("Scheme", SCHEMES[options.get("schema", "AP214")])
    import Import
    import Part  # noqa: F401

    document = FreeCAD.newDocument("Scene")
    parts = {}

    def place(placement):
        translation, axis, angle = placement
        return FreeCAD.Placement(FreeCAD.Vector(*translation), FreeCAD.Rotation(FreeCAD.Vector(*axis), angle))

    def build(name, placement, what):
        if isinstance(what, str):
            if what not in parts:
                parts[what] = build(what, scenes.HOME, scenes.PARTS[what])
            made = document.addObject("App::Link", "Link")
            made.LinkedObject = parts[what]
        elif isinstance(what, dict):
            made = document.addObject("Part::Feature", "Body")
            made.Shape = make_shape(what, options.get("mirror"))
        else:
            made = document.addObject("App::Part", "Assembly")
            for child in what:
                made.addObject(build(*child))
        made.Label = name
        made.Placement = place(placement)
        return made

    root = build(tree[0], tree[1], tree[2])
    document.recompute()

    Import.export([root], str(HERE / "files" / f"freecad_{scene}.step"))


if "STEP_SCENE" in os.environ:
    write(os.environ["STEP_SCENE"])
else:
    (HERE / "files").mkdir(exist_ok=True)
    for each in scenes.SCENES:
        environment = {**os.environ, "STEP_SCENE": each, "STEP_FOLDER": str(HERE)}
        subprocess.run(["freecadcmd", str(HERE / "freecad_files.py")], env=environment, check=True)
