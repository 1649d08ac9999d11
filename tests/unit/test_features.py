"""Seats as drawings state them: ISO 286, and features against contacts: gaps that a torsor must not close.

The contact model below shares no code with the features: it lists surfaces, asks linear programmes how far a part can
move between them, and lets it sit anywhere between them by throwing away what does not fit.
"""

from __future__ import annotations

import copy
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import linprog

from plain_data import EVERY, problems_of, read_cases
from tailstack import score
from tailstack.design import compile_design, load_design
from tailstack.design.features import spread_sum
from tailstack.design.iso286 import BELOW_UM, M_UM, STEPS_MM, WIDTHS_UM, find_deviations

SEAT = EVERY["dowelled_seat"]
PIVOT = np.array(SEAT["interfaces"]["structure_connector"]["pivot_mm"], dtype=float)


def seat_of(stated, **interface):
    """The example with these features."""
    held = {"pivot_mm": PIVOT.tolist(), "features": stated, **interface}
    return SEAT | {"interfaces": {"structure_connector": held}}


def mount_of(features):
    return compile_design(load_design(seat_of(features))).structure_connector


# --- ISO 286 ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tolerance_class", "diameter", "upper", "lower"), read_cases("features", "limits"))
def test_limits_are_those_of_the_standard(tolerance_class, diameter, upper, lower):
    """published: ISO 286-2, tables of limit deviations."""
    limits = find_deviations(tolerance_class, diameter)
    assert limits == pytest.approx((upper / 1000, lower / 1000), abs=1e-12)


def test_tables_follow_the_formulas_of_the_standard():
    """closed_form: ISO 286-1, i = 0.45 D^(1/3) + 0.001 D, deviations by powers of D; what the committee rounded is
    within 8 % or 1.1 um of that, above 3 mm."""
    d = np.array([(low * high) ** 0.5 for low, high in pairwise(STEPS_MM)])
    unit = 0.45 * np.cbrt(d) + 0.001 * d
    factors = zip(WIDTHS_UM, (7, 10, 16, 25, 40, 64, 100), strict=True)
    expected = {str(grade): factor * unit for grade, factor in factors}
    powers = {"d": (16, 0.44), "e": (11, 0.41), "f": (5.5, 0.41), "g": (2.5, 0.34), "h": (0, 1)}
    expected |= {letter: factor * d**power for letter, (factor, power) in powers.items()}
    for name, row in (*((str(grade), row) for grade, row in WIDTHS_UM.items()), *BELOW_UM.items()):
        assert np.all(np.abs(np.array(row[1:]) - expected[name]) <= np.maximum(1.1, 0.08 * expected[name])), name
    m = np.array(WIDTHS_UM[7][1:]) - np.array(WIDTHS_UM[6][1:])
    assert np.abs(np.array(M_UM[1:]) - m).max() <= 1


@pytest.mark.parametrize(("change", "code", "word"), read_cases("features", "features"))
def test_what_no_seat_is_is_refused_with_the_cure(change, code, word):
    data = copy.deepcopy(SEAT)
    data["interfaces"]["structure_connector"]["features"][2] |= change
    problem = next(each for each in problems_of(lambda: compile_design(load_design(data))) if each.code == code)
    assert problem.pointer.startswith("/interfaces/structure_connector/features")
    assert word in f"{problem.detail} {problem.hint}"


def test_one_sided_limits_become_a_middle_and_a_half_width():
    """closed_form: +0.02/0 is 0.01 +- 0.01, and said."""
    system = compile_design(load_design(SEAT))
    assert system.structure_connector.known == pytest.approx([0, 0, 0, 0, 0, 0.01], abs=1e-15)
    assert any("height +0.02/+0 (+0.01 ± 0.01)" in note for note in system.notes)


@pytest.mark.parametrize("ratio", [0.11, 0.2, 0.2357, 0.2886, 0.304, 0.4, 0.41, 0.5, 0.57, 1 / np.sqrt(3)])
def test_sums_have_the_reach_and_the_spread_asked_for(ratio):
    """closed_form: variances h^2 / 3 and h^2 / 6; of a zone whose square is none, nothing."""
    assert spread_sum(1e-300, 1e-300 * ratio) == []
    parts = spread_sum(2.0, 2.0 * ratio)
    assert sum(width for _, width in parts) == pytest.approx(2.0)
    variance = sum(width**2 / (3 if law == "uniform" else 6) for law, width in parts)
    assert variance == pytest.approx((2.0 * ratio) ** 2)
    assert min(width for _, width in parts) > 0


# --- against contacts --------------------------------------------------------------------------------------

X, Y, Z = ALIGNED = np.eye(3)
TORSOR = np.eye(6)
TURN = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3  # rows: x, y, z of a seat that lies askew
FOOT = np.array([0, 0, -95])

# Surfaces: what a design states of them; sizes (n,) half of what they may be off by, drawn; the largest of these; and
# zones that have this size: contacts, how far off n of them are of the middle, the middle.


def strip(at, way, middle=0.0):
    """The point is off along a direction by the middle +- half."""
    return [(np.array(at, float), np.array(way, float))], lambda off: np.abs(off[:, 0] - middle), middle


def disc(at, ways):
    """The point is within a circle in the plane of two directions."""
    return [(np.array(at, float), way) for way in ways], lambda off: np.hypot(*off.T), 0.0


def sheet(at, a, b, frame):
    """Four corners lie between two planes across a direction that may be anywhere: half their distance."""
    corners = [np.array(at) + np.array([i * a / 2, j * b / 2, 0]) @ frame for i in (-1, 1) for j in (-1, 1)]
    return [(corner, frame[2]) for corner in corners], lambda off: np.ptp(off, axis=1) / 2, 0.0


def always(half, *zones):
    return lambda _, n: np.full(n, half), half, zones


def place(kind, at, frame, **fields):
    return {"kind": kind, "position_mm": [*map(float, at)], "normal": [*frame[2]], "along": [*frame[0]], **fields}


def pad(a, b, t, upper, lower, at=FOOT, frame=ALIGNED, of="flatness_mm"):
    """A face with a height; limits in mm."""
    stated = place("pad", at, frame, size_mm=[a, b], height_mm=[upper, lower]) | {of: t}
    height = always((upper - lower) / 2, strip(at, frame[2], (upper + lower) / 2))
    return [(stated, *always(t / 2, sheet(at, a, b, frame))), (None, *height)]


def fitted(kind, hole_um, pin_um, at, frame=ALIGNED, fit=None, diameter=6.0, length=None):
    """A pin, spigot, bolt or thread; sizes within their limits, lower and upper."""
    each = {"hole_mm": hole_um, "pin_mm": pin_um}
    limits = {"fit": fit} if fit else {name: [um / 1000 for um in reversed(ends)] for name, ends in each.items()}
    stated = place(kind, at, frame, diameter_mm=diameter, **limits) | ({} if length is None else {"length_mm": length})
    ends = [at] if length is None else [np.array(at) + k * length / 2 * frame[2] for k in (1, -1)]
    zones = [strip(at, frame[1])] if kind == "pin_in_slot" else [disc(end, frame[:2]) for end in ends]

    def sizes(rng, n):
        return (rng.uniform(*hole_um, n) - rng.uniform(*pin_um, n)) / 2000

    return [(stated, sizes, (hole_um[1] - pin_um[0]) / 2000, zones)]


def vee(at, along, t=0.004):
    along = along / np.linalg.norm(along)
    flanks = [strip(at, (Z + s * np.cross(Z, along)) / np.sqrt(2)) for s in (1, -1)]
    return [(place("vee", at, [along, None, Z], profile_mm=t), *always(t / 2, *flanks))]


def rest(at, way=Z, t=0.02):
    frame = [np.roll(way, 1) + 0.1 * Y, None, way]
    return [(place("rest", at, frame, height_mm=[t / 2, -t / 2]), *always(t / 2, strip(at, way)))]


def around(radius, *degrees, z=-95):
    """Directions, and places on a circle."""
    ways = [np.array([np.cos(a), np.sin(a), 0]) for a in np.deg2rad(degrees)]
    return [(way, radius * way + [0, 0, z]) for way in ways]


def hole(x, y=0.0, fit="H7/g6", **more):
    return fitted("pin_in_hole", (0, 12), (-12, -4), (x, y, -95), fit=fit, **more)


def slot(x, y=0.0, frame=ALIGNED, **more):
    return fitted("pin_in_slot", (0, 12), (-12, -4), (x, y, -95), frame, fit="H7/g6", **more)


BIG = {"hole_um": (0, 21), "pin_um": (-20, -7), "fit": "H7/g6", "diameter": 25}
ASKEW, ASIDE = np.array([10, 20, -60]), np.array([10, 20, -60]) + 40 * TURN[0]
TURNED, WALL = np.array([Y, -X, Z]), np.array([Y, Z, X])  # what runs along y, and stands on its edge
SOCKET = [(way + Z) / np.sqrt(2) for way, _ in around(1, 90, 210, 330)]
FLAT = pad(80, 60, 0.02, 0.01, -0.01)
SEATS = {
    "plate on two dowels": [
        *pad(80, 50, 0.03, 0.02, -0.01, (5, 0, -95)), *hole(-30),
        *fitted("pin_in_slot", (0, 22), (-28, -13), (30, 0, -95), fit="H8/f7", diameter=8),
    ],
    "askew, on a spigot": [
        *pad(60, 40, 0.02, 0.01, -0.01, ASKEW, TURN, "parallelism_mm"),
        *fitted("spigot", (10, 30), (-10, 0), ASKEW, TURN, diameter=40),
        *fitted("pin_in_slot", (10, 22), (-8, 0), ASIDE, TURN, fit="F7/h6"),
    ],
    "long spigot, shoulder and key": [
        *fitted("spigot", at=(0, 0, -100), length=30, **BIG), *rest((0, 0, -80)),
        *fitted("pin_in_slot", (0, 18), (-38, -20), (20, 0, -100), fit="H8/e8", diameter=5),
    ],
    "three balls in three vees": [each for way, at in around(45, 90, 210, 330) for each in vee(at, way)],
    "three vees at other angles": [each for way, at in around(30, 0, 100, 240) for each in vee(at, way, 0.01)],
    "socket, vee and flat": [
        *(each for way in SOCKET for each in rest((40, 0, -95), way, 0.006)),
        *vee((-20, 35, -95), Y - X), *rest((-20, -35, -95)),
    ],
    "six stops, 3-2-1": [
        *rest((30, 30, -95)), *rest((-30, 30, -95)), *rest((0, -35, -95)),
        *rest((-25, 40, -80), Y), *rest((25, 40, -80), Y), *rest((45, 0, -80), X),
    ],
    "three pads and two dowels": [
        *rest((35, 25, -95)), *rest((-35, 25, -95)), *rest((0, -30, -95)), *hole(-30), *slot(30),
    ],
    "dowels along y": [*FLAT, *hole(0, -25), *slot(0, 25, TURNED)],
    "dowels near each other": [*FLAT, *hole(-6), *slot(8, 3)],
    "spigot and pin": [*FLAT, *fitted("spigot", at=FOOT, **BIG), *slot(24)],
    "two bolts in clearance holes": [
        *FLAT, *fitted("pin_in_hole", (500, 720), (-180, 0), (-25, 0, -95)),
        *fitted("pin_in_slot", (500, 720), (-180, 0), (25, 0, -95)),
    ],
    "thread and shoulder, keyed": [  # pitch diameters of M20 x 1.5: 6H 0/+212, 6g -172/-32
        *FLAT, *fitted("spigot", (0, 212), (-172, -32), FOOT, diameter=19.026), *slot(25),
    ],
    "taper": [  # tight at one end, half the error of its angle at the other
        *fitted("spigot", (3, 4), (0, 1), (0, 0, -90), diameter=30),
        *fitted("spigot", (6, 8), (0, 2), (0, 0, -130), diameter=27),
        *rest((0, 0, -90), t=0.03), *slot(20),
    ],
    "taper with a face": [*FLAT, *fitted("spigot", (3, 4), (0, 1), FOOT, diameter=24), *slot(35)],
    "tongue in a groove, with a stop": [*FLAT, *slot(-30), *slot(30), *rest((45, 0, -90), X)],
    "rod in two vees": [*vee((-40, 0, -95), X), *vee((40, 0, -95), X), *rest((45, 0, -95), X), *rest((0, 30, -95))],
    "plate against two edges": [*FLAT, *rest((-25, 32, -90), Y), *rest((25, 32, -90), Y), *rest((42, 0, -90), X)],
    "wall with two dowels": [
        *pad(60, 50, 0.02, 0.0, -0.03, (40, 0, -60), WALL),
        *fitted("pin_in_hole", (0, 12), (-12, -4), (40, -20, -60), WALL, fit="H7/g6"),
        *fitted("pin_in_slot", (0, 12), (-12, -4), (40, 20, -60), WALL, fit="H7/g6"),
    ],
    "narrow rail": [*pad(120, 12, 0.01, 0.01, 0.0), *hole(-55), *slot(55)],
}  # fmt: skip


def state(surfaces):
    """As a design has them."""
    return [{"name": f"S{k}"} | stated for k, (stated, *_) in enumerate(surfaces) if stated]


def draw_zones(surfaces, rng, n):
    """With sizes of their own, and the largest of each."""
    drawn = [(sizes(rng, n), largest, zone) for _, sizes, largest, zones in surfaces for zone in zones]
    return [(contacts, measure, half, middle) for half, _, (contacts, measure, middle) in drawn], [
        each for _, each, _ in drawn
    ]


def displacement_rows(contacts):
    """(m, 6) of the torsor (w, t) at the pivot: n . (t + w x (p - pivot))."""
    return np.array([[*np.cross(point - PIVOT, way), *way] for point, way in contacts])


def find_supports(zones, largest, ways=TORSOR):
    """(m, 2) least and largest along ways (m, 6) of torsors, by linear programmes: circles as 64 planes, a sheet with
    its own height as an unknown."""
    rows, limits, floating = [], [], sum(len(zone[0]) > 2 for zone in zones)
    heights = iter(np.eye(floating))
    for (contacts, _, _, middle), half in zip(zones, largest, strict=True):
        base = displacement_rows(contacts)
        block = np.vstack([base, -base])
        bounds = [half + middle] * len(base) + [half - middle] * len(base)
        if len(contacts) == 2:
            angles = np.arange(64) * np.pi / 32
            block = np.column_stack([np.cos(angles), np.sin(angles)]) @ base
            bounds = [half] * 64
        free = next(heights) if len(contacts) > 2 else np.zeros(floating)
        sign = np.concatenate([-np.ones(len(base)), np.ones(len(base))]) if len(contacts) > 2 else np.zeros(len(block))
        rows.append(np.hstack([block, np.outer(sign, free)]))
        limits += bounds
    matrix, ends_um = np.vstack(rows), np.array(limits) * 1000  # unknown in mrad and um
    ends = []
    for component in np.hstack([ways, np.zeros((len(ways), floating))]):
        pair = [linprog(s * component, matrix, ends_um, bounds=(None, None), method="highs") for s in (1, -1)]
        assert all(each.success for each in pair), pair
        ends.append([pair[0].fun, -pair[1].fun])
    return np.array(ends) / 1000


def settle(zones, largest, rng, n):
    """(n, 6) torsors, each anywhere alike between the surfaces of its own sizes: of what is even in a box about them,
    in how far contacts are off, what fits."""
    each = [(displacement_rows(contacts), contacts) for contacts, *_ in zones]
    ways = np.vstack([rows if len(contacts) < 3 else rows[1:3] - rows[0] for rows, contacts in each])
    box, back = find_supports(zones, largest, ways), np.linalg.inv(ways).T
    torsors, waiting = np.empty((n, 6)), np.arange(n)
    while waiting.size:
        tried = rng.uniform(box[:, 0], box[:, 1], (waiting.size, 6)) @ back
        fits = np.ones(waiting.size, dtype=bool)
        for (rows, _), (_, measure, half, _) in zip(each, zones, strict=True):
            fits &= measure(tried @ rows.T) <= half[waiting]
        torsors[waiting[fits]] = tried[fits]
        waiting = waiting[~fits]
    return torsors


@pytest.mark.hostile
@pytest.mark.parametrize("name", SEATS)
def test_features_are_what_contacts_leave(name, run_seed):
    """sampled: standard deviations within 2 %, of 20,000 seats each (an error of 0.5 % at one sigma: four of them);
    reaches by linear programmes within 0.3 % (circles as 64 planes) along the axes of the seat."""
    rng, n = np.random.default_rng(run_seed), 20_000
    zones, largest = draw_zones(SEATS[name], rng, n)
    mount = mount_of(state(SEATS[name]))
    supports = find_supports(zones, largest)
    torsors = settle(zones, largest, rng, n)
    covariance = (mount.sources.direction * mount.sources.std**2) @ mount.sources.direction.T
    assert np.sqrt(covariance.diagonal()) == pytest.approx(torsors.std(axis=0), rel=0.02)
    scale = torsors.std(axis=0)
    np.testing.assert_allclose(
        np.cov(torsors.T) / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=0.04
    )
    reach = np.abs(mount.sources.direction) @ mount.sources.half_width
    widest = (supports[:, 1] - supports[:, 0]) / 2
    assert mount.known == pytest.approx(supports.mean(axis=1), abs=1e-9)
    if name.startswith(("askew", "wall")):  # round reaches at an angle to the axes: up to sqrt(2) further than circles
        assert np.all(reach >= widest * 0.997)
        assert np.all(reach <= widest * np.sqrt(2) * 1.003)
    else:
        assert reach == pytest.approx(widest, rel=0.003)


@pytest.mark.parametrize(("law", "over", "cone"), [("uniform", 12, 1 / 16), ("triangular", 24, 3 / 80)])
def test_a_position_zone_grows_at_maximum_material(law, over, cone):
    """closed_form: E[(t + b)^2] / 16 with b uniform on (0, 0.012), beside the clearance's own E[c^2] / 16; triangular
    sizes vary by half of that, and a cone of radius R by 3 R^2 / 20 along each axis."""
    features = copy.deepcopy(SEAT["interfaces"]["structure_connector"]["features"])
    features[1] |= {"true_position_mm": 0.05, "at_maximum_material": True, "distribution": law}
    sources = mount_of(features).sources
    t, b = 0.05, 0.012
    zone, clearance = ((t + b / 2) ** 2 + b**2 / over) * cone, (0.014**2 + (0.012**2 + 0.008**2) / over) / 16
    for item, variance, reach in (("position", zone, (t + b) / 2), ("fit", clearance, 0.012)):
        own = [k for k, name in enumerate(sources.names) if name.startswith(f"pin 1 {item}")]
        assert (sources.direction[3, own] ** 2 * sources.std[own] ** 2).sum() == pytest.approx(variance)
        assert (np.abs(sources.direction[3, own]) * sources.half_width[own]).sum() == pytest.approx(reach)


def test_a_bounded_seat_reaches_no_further_than_an_octagon_about_its_circle():
    """closed_form: 1 along the axes, 1 / cos(22.5 deg) in between."""
    features = copy.deepcopy(SEAT["interfaces"]["structure_connector"]["features"])
    for feature in features:
        feature["distribution"] = "bounded"
    at_the_pin = seat_of(features, pivot_mm=features[1]["position_mm"])
    sources = compile_design(load_design(at_the_pin)).structure_connector.sources
    own = [k for k, name in enumerate(sources.names) if name.startswith("pin 1 fit")]
    angles = np.linspace(0, np.pi, 721)
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    reach = np.abs(ways @ sources.direction[3:5, own]) @ sources.half_width[own] / 0.012
    assert reach.min() == pytest.approx(1)
    assert reach.max() == pytest.approx(1 / np.cos(np.pi / 8))


def test_a_drawn_seat_gives_the_p95_of_its_torsors_stated_by_hand():
    """independent: the torsors that contacts leave, as a covariance in deg and mm that somebody worked out; laws
    differ, of a fifth of the variance, by less than 1 % of P95.  2,000 seats err by 0.3 % of it at one sigma."""
    rng, n = np.random.default_rng(8), 2_000
    surfaces = SEATS["plate on two dowels"]
    zones, largest = draw_zones(surfaces, rng, n)
    torsors = settle(zones, largest, rng, n)
    torsors[:, :3] = np.rad2deg(torsors[:, :3])
    by_hand = {"features": None, "tolerances": {"covariance_deg_mm": np.cov(torsors.T).tolist()}}
    by_hand["bias"] = {"tz_mm": 0.005}
    designs = [load_design(seat_of(state(surfaces), **each)) for each in ({}, by_hand)]
    p95 = [score(each, losses=False).targets[0].p95_mm for each in designs]
    assert p95[0] == pytest.approx(p95[1], rel=0.01)
