"""Write the STEP files of scenes.py with OpenCASCADE: ``python occ_files.py``, into files/occ_SCENE.step.

Needs cadquery-ocp-novtk (8.0), in an environment of its own.
"""

from pathlib import Path

from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakeSphere
from OCP.gp import gp_Ax1, gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.IFSelect import IFSelect_RetDone
from OCP.Interface import Interface_Static
from OCP.ShapeUpgrade import ShapeUpgrade_ShapeDivideAngle
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_AsIs
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_EDGE, TopAbs_SHELL
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS
from OCP.XCAFDoc import XCAFDoc_DocumentTool

import scenes

HERE = Path(__file__).resolve().parent
SCHEMES = {"AP203": "AP203", "AP214": "AP214IS", "AP242": "AP242DIS"}


def moved(shape, transform):
    return BRepBuilderAPI_Transform(shape, transform, True).Shape()


def sphere(r, centre=(0.0, 0.0, 0.0), low=None, high=None):
    axes = gp_Ax2(gp_Pnt(*centre), gp_Dir(0, 0, 1))
    if low is None:
        return BRepPrimAPI_MakeSphere(axes, r).Shape()
    return BRepPrimAPI_MakeSphere(axes, r, low, high).Shape()


def box(size, corner):
    return BRepPrimAPI_MakeBox(gp_Pnt(*corner), *size).Shape()


def make_shape(shape, mirror):
    kind, r = shape["kind"], shape.get("radius", 0.0)
    if kind == "ball":
        made = sphere(r, shape["centre"])
        if shape["faces"] > 1:
            divided = ShapeUpgrade_ShapeDivideAngle(6.283185307179586 / shape["faces"] + 1e-9, made)
            divided.Perform()
            made = divided.Result()
        if mirror:
            transform = gp_Trsf()
            transform.SetMirror(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)))
            made = moved(made, transform)
        return made
    if kind == "box":
        return box(shape["size"], shape["corner"])
    if kind == "cylinder":
        return BRepPrimAPI_MakeCylinder(r, shape["height"]).Shape()
    if kind == "dowel":
        made = BRepPrimAPI_MakeCylinder(r, shape["length"]).Shape()
        for z in (0.0, shape["length"]):
            made = BRepAlgoAPI_Fuse(made, sphere(r, (0.0, 0.0, z))).Shape()
        return made
    if kind == "pocket":
        return BRepAlgoAPI_Cut(box((10, 10, 10), (-5, -5, -10)), sphere(r)).Shape()
    if kind == "half":
        return sphere(r, low=0.0, high=1.5707963267948966)
    if kind == "cut":
        return BRepAlgoAPI_Cut(sphere(r), box((10, 10, 10), (-5, -5, r / 2))).Shape()
    if kind == "hollow":
        return BRepAlgoAPI_Cut(sphere(r), sphere(shape["inner"])).Shape()
    if kind == "void":
        return BRepAlgoAPI_Cut(box((10, 10, 10), (-5, -5, -5)), sphere(r)).Shape()
    if kind == "rounded":
        cube = box((shape["size"],) * 3, (0, 0, 0))
        fillet, edges = BRepFilletAPI_MakeFillet(cube), TopExp_Explorer(cube, TopAbs_EDGE)
        while edges.More():
            fillet.Add(r, TopoDS.Edge_s(edges.Current()) if hasattr(TopoDS, "Edge_s") else TopoDS.Edge(edges.Current()))
            edges.Next()
        return fillet.Shape()
    if kind == "lens":
        return BRepAlgoAPI_Common(sphere(r), sphere(r, (0.0, 0.0, r))).Shape()
    if kind == "peanut":
        return BRepAlgoAPI_Fuse(sphere(r), sphere(r, (0.0, 0.0, r))).Shape()
    assert kind == "sheet"
    return TopExp_Explorer(sphere(r), TopAbs_SHELL).Current()


def place(placement):
    (x, y, z), axis, angle = placement
    turn, shift = gp_Trsf(), gp_Trsf()
    turn.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(*axis)), angle * 3.141592653589793 / 180)
    shift.SetTranslation(gp_Vec(x, y, z))
    return TopLoc_Location(shift.Multiplied(turn))


def write(scene):
    tree, options, _ = scenes.SCENES[scene]
    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    parts = {}

    def call(label, name):
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(name, True))

    def define(name, what):
        """The label of a part or assembly."""
        if isinstance(what, dict):
            label = tool.AddShape(make_shape(what, options.get("mirror")), False)
        else:
            label = tool.NewShape()
            for child, placement, inside in what:
                instance = tool.AddComponent(label, part(child, inside), place(placement))
                call(instance, child)
        call(label, name)
        return label

    def part(name, what):
        if not isinstance(what, str):
            return define(name, what)
        if what not in parts:
            parts[what] = define(what, scenes.PARTS[what])
        return parts[what]

    define(tree[0], tree[2])
    tool.UpdateAssemblies()
    Interface_Static.SetCVal_s("write.step.schema", SCHEMES[options.get("schema", "AP214")])
    Interface_Static.SetCVal_s("write.step.unit", options.get("unit", "MM"))
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    assert writer.Transfer(document, STEPControl_AsIs)
    assert writer.Write(str(HERE / "files" / f"occ_{scene}.step")) == IFSelect_RetDone


if __name__ == "__main__":
    (HERE / "files").mkdir(exist_ok=True)
    for each in scenes.SCENES:
        write(each)
