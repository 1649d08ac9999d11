"""What the STEP files of this folder hold: trees of parts, from which two CAD programs build and plain arithmetic tells
where every ball is.

FreeCAD 0.20 and OpenCASCADE (cadquery-ocp 8.0) built the files of files.zip from these trees, once; what is expected is
had by multiplying the placements here.  No reader of STEP has a part in it.  readings.json is what OpenCASCADE's own
reader found in the files.

A node is (name, placement, what): what is a list of nodes, the name of a part, or a body.  A placement is
(translation, axis, angle in degrees).  Lengths are in mm, whatever the unit of the file.
"""

import math
import random

HOME = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0)
CORNERS = [(-40.0, -38.0, -72.0), (40.0, -42.0, -66.0), (-44.0, 40.0, -68.0), (38.0, 36.0, -74.0),
           (-38.0, -40.0, 4.0), (42.0, -36.0, 12.0), (-42.0, 38.0, 8.0), (36.0, 42.0, 16.0)]  # fmt: skip


def at(x, y, z, axis=(0.0, 0.0, 1.0), angle=0.0):
    return ((float(x), float(y), float(z)), axis, float(angle))


def ball(radius, centre=(0.0, 0.0, 0.0), faces=1):
    return {"kind": "ball", "radius": radius, "centre": centre, "faces": faces}


def body(kind, **sizes):
    return {"kind": kind, **sizes}


def beads(prefix="BEAD", radius=1.5, points=CORNERS, faces=1):
    """Each ball a part of its own, its centre in its own coordinates."""
    return [(f"{prefix}{k}" if prefix else "", HOME, ball(radius, point, faces)) for k, point in enumerate(points, 1)]


def placed(prefix="BEAD", points=CORNERS):
    """The part called bead at each point, turned in some way."""
    turns = random.Random(7)
    nodes = []
    for k, point in enumerate(points, 1):
        axis = (turns.uniform(-1, 1), turns.uniform(-1, 1), turns.uniform(0.1, 1))
        nodes.append((f"{prefix}{k}" if prefix else "", (point, axis, turns.uniform(-180, 180)), "bead"))
    return nodes


TILT = at(12.5, -7.25, 30.125, (1.0, 2.0, 3.0), 37.0)
TURN = at(-100.0, 250.0, 3.5, (0.0, 1.0, -1.0), 123.456)
BLOCK = ("BLOCK", HOME, body("box", size=(20.0, 30.0, 40.0), corner=(-10.0, -15.0, -200.0)))
NEAR_MISSES = [
    ("DOWEL", at(0, 0, 40), body("dowel", radius=1.5, length=12.0)),
    ("SOCKET", at(30, 0, 40), body("pocket", radius=1.5)),
    ("HALF", at(60, 0, 40), body("half", radius=1.5)),
    ("CUT", at(90, 0, 40), body("cut", radius=1.5)),
    ("HOLLOW", at(0, 60, 40), body("hollow", radius=1.5, inner=1.0)),
    ("VOID", at(30, 60, 40), body("void", radius=1.5)),
    ("ROUNDED", at(60, 60, 40), body("rounded", size=10.0, radius=1.5)),
    ("LENS", at(90, 60, 40), body("lens", radius=1.5)),
    ("PEANUT", at(0, 90, 40), body("peanut", radius=1.5)),
    ("SHEET", at(30, 90, 40), body("sheet", radius=1.5)),
]
REASONS = {
    "DOWEL": "1 cylindrical", "SOCKET": "spherical pocket", "HALF": "1 plane",
    "CUT": "1 plane", "HOLLOW": "hollow", "VOID": "void", "ROUNDED": "6 plane", "LENS": "1 spherical",
    "PEANUT": "1 spherical", "SHEET": "surface, not a solid", "BIG": "diameter",
}  # fmt: skip
SEATS = [("REST1", at(0, 40, -95), body("cylinder", radius=3.0, height=5.0)),
         ("REST2", at(-35, -20, -95), body("cylinder", radius=3.0, height=5.0)),
         ("REST3", at(35, -20, -95), body("cylinder", radius=3.0, height=5.0))]  # fmt: skip
PINS = [("PIN1", at(-30, 0, -100), body("cylinder", radius=2.5, height=10.0)),
        ("PIN2", at(30, 0, -100), body("cylinder", radius=2.5, height=10.0))]  # fmt: skip
PARTS = {
    "bead": ball(1.5, (0.25, -0.5, 0.75)),
    "half carrier": [
        ("LEFT", at(5, 0, 0, (0, 0, 1), 15), "bead"),
        ("RIGHT", at(-5, 8, 2, (1, 0, 0), 60), "bead"),
        BLOCK,
    ],
    "pair": [("A", at(20, 0, 0), "half carrier"), ("B", at(-20, 0, 5, (0, 1, 0), 90), "half carrier")],
}

# name: (tree, options of the file, selection).  Options: unit, schema, mirror (x becomes -x in the bodies).
SCENES = {
    "flat": (("Carrier", HOME, [*beads(), BLOCK]), {}, {"diameter_mm": 3.0}),
    "tilted": (("Carrier", HOME, [("Beads", TILT, beads()), BLOCK]), {}, {"diameter_mm": 3.0}),
    "three_levels": (
        ("Station", HOME, [("Arm", TURN, [("Carrier", TILT, [("Beads", TURN, beads()), BLOCK])])]),
        {}, {"diameter_mm": 3.0}),
    "instances": (("Carrier", HOME, [("Plate", TILT, placed()), BLOCK]), {}, {"diameter_mm": 3.0}),
    "twice": (("Carrier", HOME, [("P", TILT, "pair"), ("Q", TURN, "pair")]), {}, {"diameter_mm": 3.0}),
    "mirrored": (("Carrier", HOME, [("Beads", TILT, beads())]), {"mirror": True}, {"diameter_mm": 3.0}),
    "inch": (("Carrier", HOME, [("Beads", TILT, beads()), BLOCK]), {"unit": "INCH"}, {"diameter_mm": 3.0}),
    "metre": (("Carrier", HOME, [("Beads", TILT, placed())]), {"unit": "M"}, {"diameter_mm": 3.0}),
    "unnamed": (("", HOME, beads("")), {}, {"diameter_mm": 3.0}),
    "names": (("Träger 'A' / \\B", HOME, [
        (name, HOME, ball(1.5, point)) for name, point in
        zip(["Kugel Ö", "bead's", "a\\b", "球1", "Ω-3 ½", "x\"y", "#9=(;)", "/* no */"], CORNERS, strict=False)]), {},
        {"diameter_mm": 3.0}),
    "ap203": (("Carrier", HOME, [("Beads", TILT, beads()), BLOCK]), {"schema": "AP203"}, {"diameter_mm": 3.0}),
    "ap242": (("Carrier", HOME, [("Beads", TILT, placed()), BLOCK]), {"schema": "AP242"}, {"diameter_mm": 3.0}),
    "near_misses": (
        ("Carrier", HOME, [*beads(), ("Others", TILT, NEAR_MISSES), ("BIG", at(0, 0, 80), ball(3.0))]), {},
        {"diameter_mm": 3.0, "tolerance_mm": 0.1}),
    "near_misses_inch": (
        ("Carrier", HOME, [("Others", TURN, NEAR_MISSES), *placed()]), {"unit": "INCH"}, {"name": "BEAD*"}),
    "faces": (
        ("Carrier", HOME, [
            ("Two", TILT, beads("TWO", 1.5, CORNERS[:4], 2)), ("Eight", TURN, beads("EIGHT", 2.0, CORNERS[4:], 8))]),
        {}, {"diameter_mm": 3.5, "tolerance_mm": 0.5}),
    "frame": (
        ("Carrier", HOME, [("Beads", TILT, beads()), ("CONNECTOR", at(3, 4, -90, (1, 1, 0), 45), [BLOCK])]), {},
        {"diameter_mm": 3.0, "frame": "CONNECTOR"}),
    "seats": (
        ("Station", HOME, [("Carrier", TILT, [*beads(), *SEATS, *PINS])]), {},
        {"name": "BEAD*", "seats": "REST*", "pins": "PIN*"}),
}  # fmt: skip


# --- where everything is -----------------------------------------------------------------------------------


def matrix(placement):
    """The 4x4 matrix of a placement, by Rodrigues' formula."""
    translation, axis, angle = placement
    size = math.sqrt(sum(value * value for value in axis))
    x, y, z = (value / size for value in axis)
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    rows = [[c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
            [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
            [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)]]  # fmt: skip
    return [[*row, shift] for row, shift in zip(rows, translation, strict=False)] + [[0.0, 0.0, 0.0, 1.0]]


def multiply(first, second):
    return [[sum(first[i][k] * second[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def apply(transform, point, direction=False):
    return [
        sum(transform[i][k] * point[k] for k in range(3)) + (0.0 if direction else transform[i][3]) for i in range(3)
    ]


def invert(rigid):
    turned = [[rigid[j][i] for j in range(3)] for i in range(3)]
    shift = [-sum(turned[i][k] * rigid[k][3] for k in range(3)) for i in range(3)]
    return [[*row, value] for row, value in zip(turned, shift, strict=False)] + [[0.0, 0.0, 0.0, 1.0]]


def walk(node, above=None):
    """(name, matrix, body) of every body, and (name, matrix, None) of everything with a name."""
    name, placement, what = node
    here = matrix(placement) if above is None else multiply(above, matrix(placement))
    yield name, here, None
    what = PARTS[what] if isinstance(what, str) else what
    if isinstance(what, dict):
        yield name, here, what
        return
    for child in what:
        yield from walk(child, here)


def expect(scene):
    """Balls that are to be found, with labels, in con; contacts; and why others are left."""
    tree, options, selection = SCENES[scene]
    nodes = list(walk(tree))
    to_con = matrix(HOME)
    if "frame" in selection:
        to_con = invert(next(m for name, m, b in nodes if name == selection["frame"]))
    sign = -1.0 if options.get("mirror") else 1.0
    balls, left, contacts = [], [], []
    for name, here, shape in nodes:
        if shape is None:
            continue
        here = multiply(to_con, here)
        if shape["kind"] == "ball":
            x, y, z = shape["centre"]
            centre = apply(here, (sign * x, y, z))
            wanted = selection.get("diameter_mm")
            if wanted is not None and abs(2 * shape["radius"] - wanted) > selection.get("tolerance_mm", 0.01):
                left.append([name, REASONS[name]])
            else:
                balls.append({"label": name, "position_mm": centre, "diameter_mm": 2 * shape["radius"]})
        elif name in REASONS:
            left.append([name, REASONS[name]])
        elif shape["kind"] == "cylinder":
            middle = apply(here, (0.0, 0.0, shape["height"] / 2))
            contacts.append({"name": name, "position_mm": middle, "axis": apply(here, (0.0, 0.0, 1.0), True)})
    return {"selection": selection, "balls": balls, "left": left, "contacts": contacts}
