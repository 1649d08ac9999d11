"""Read the STEP files back with OpenCASCADE's reader: ``python occ_reading.py``, which wrote readings.json.

A ball is here a solid whose area and volume are those of the sphere that its faces lie on.  Centres are in mm of the
file's own frame.  Needs cadquery-ocp-novtk (8.0), in an environment of its own.
"""

import json
import math
from pathlib import Path

from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepGProp import BRepGProp
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_RetDone
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_FACE, TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

HERE = Path(__file__).resolve().parent
face_of = getattr(TopoDS, "Face_s", None) or TopoDS.Face


def explore(shape, kind):
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def measure(shape):
    area, volume = GProp_GProps(), GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, area)
    BRepGProp.VolumeProperties_s(shape, volume)
    return area.Mass(), abs(volume.Mass())


def balls(path):
    reader = STEPControl_Reader()
    assert reader.ReadFile(str(path)) == IFSelect_RetDone
    reader.TransferRoots()
    for solid in explore(reader.OneShape(), TopAbs_SOLID):
        surfaces = [BRepAdaptor_Surface(face_of(face)) for face in explore(solid, TopAbs_FACE)]
        if any(surface.GetType() != GeomAbs_SurfaceType.GeomAbs_Sphere for surface in surfaces):
            continue
        sphere = surfaces[0].Sphere()
        area, volume = measure(solid)
        r, centre = sphere.Radius(), sphere.Location()
        if math.isclose(area, 4 * math.pi * r**2, rel_tol=1e-6) and math.isclose(
            volume, 4 / 3 * math.pi * r**3, rel_tol=1e-6
        ):
            yield {"position_mm": [centre.X(), centre.Y(), centre.Z()], "diameter_mm": 2 * r}


if __name__ == "__main__":
    found = {path.name: list(balls(path)) for path in sorted((HERE / "files").glob("*.step"))}
    (HERE / "readings.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
