"""The text of a first design, which scores as it is and whose numbers are there to be corrected."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import ceil, floor, hypot
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tailstack.design.presets import PresetEntry

TEMPLATE = Path(__file__).with_name("first_design.yaml.in")
LENGTH_FIELDS = ("source_isocentre_mm", "pixel_mm")  # of a preset, stated where its source does not state them
Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Wishes:
    """The answers."""

    name: str
    preset: str
    fiducials: int
    size_mm: float
    target: Point
    limit_mm: float
    noise_px: float
    source_isocentre_mm: float | None
    pixel_mm: float | None
    unstated: frozenset[str] = frozenset()  # fields of these that nobody answered


@dataclass(frozen=True, slots=True)
class Beads:
    """Fiducials that are there already, and how the file that they come from is called."""

    labels: tuple[str, ...]
    positions_mm: tuple[Point, ...]
    file: str


STEPS = (0.8191725134, 0.6710436067, 0.5497004779)  # whose multiples, modulo 1, fill a cube evenly
CORNERS = ((-1, -1, -1), (1, 1, 1), (-1, 1, 1), (1, -1, -1), (1, -1, 1), (-1, 1, -1), (1, 1, -1), (-1, -1, 1))
CANDIDATES = 200  # for each fiducial


def spread_fiducials(count: int, size_mm: float) -> list[Point]:
    """So many points in a cube about the origin: near the corners first, opposite ones in turn, then inside.

    Of the candidates for each that one is taken whose images are farthest from those of the points before, seen along
    x and along y, where the views look.
    """
    points: list[Point] = []
    for index in range(count):
        candidates = []
        for at in range(index * CANDIDATES, (index + 1) * CANDIDATES):
            fractions = [(at * step) % 1.0 for step in STEPS]
            if index < len(CORNERS):
                unit = [side * (1 - 0.35 * part) for side, part in zip(CORNERS[index], fractions, strict=True)]
            else:
                unit = [1.9 * (part - 0.5) for part in fractions]
            x, y, z = (round(size_mm / 2 * value, 1 if size_mm >= 20 else 2) for value in unit)
            candidates.append((x, y, z))
        points.append(max(candidates, key=lambda point: closest_images(point, points)))
    return points


def closest_images(point: Point, others: list[Point]) -> float:
    """How far a point is from the others at least, seen along x or y."""
    x, y, z = point
    return min((hypot(min(abs(x - a), abs(y - b)), z - c) for a, b, c in others), default=0.0)


FILLED = 0.45  # of a detector's width, from its middle to what is farthest out: nine tenths of it are used
CLEAR = 20.0  # mm between a structure and the detector


def tenth(value_mm: float) -> float:
    """To a tenth of a millimetre, halves upwards, as the page rounds."""
    return floor(10 * value_mm + 0.5) / 10


def start_lengths(preset: PresetEntry) -> dict[str, float]:
    """What a C-arm is taken for where its source does not state it: a detector of 0.3 m, or pixels of 0.3 mm."""
    width = min(preset.image_size_px or (1000,))
    return {"source_isocentre_mm": 700.0, "pixel_mm": max(0.3, round(300 / width, 1))}


def aim_views(preset: PresetEntry, half_mm: float, target: Point, pixel_mm: float) -> tuple[Point, float]:
    """The middle of fiducials and target, from that of the fiducials, and how far from the source it has to be at least
    for both to be seen along x and along y, mm."""
    ends = [(min(-half_mm, value), max(half_mm, value)) for value in target]
    x, y, z = (tenth((low + high) / 2) for low, high in ends)
    reach = [max(high - at, at - low) for (low, high), at in zip(ends, (x, y, z), strict=True)]
    depth, half_detector = max(reach[:2]), FILLED * pixel_mm * min(preset.image_size_px or (1000,))
    needed = depth + max(reach) * preset.source_detector_mm / half_detector
    return (x, y, z), min(float(ceil(needed)), float(int(preset.source_detector_mm - depth - CLEAR)))


def design_text(wishes: Wishes, beads: Beads | None = None) -> str:
    """The design, with its comments; with beads, everything else is laid about their middle."""
    from tailstack.design.presets import PRESETS
    from tailstack.design.write import dump_flow

    preset = PRESETS[wishes.preset]
    half = wishes.size_mm / 2
    seat, flange = -(half + 15), -(half + 65)
    points, centre, head = list_points(wishes, beads)

    def place(*offset: float) -> str:
        return ", ".join(show_value(round(a + b, 6)) for a, b in zip(centre, offset, strict=True))

    pixel_mm = wishes.pixel_mm or preset.pixel_mm or start_lengths(preset)["pixel_mm"]
    between, farthest = aim_views(preset, half, wishes.target, pixel_mm)
    stated = {field: value for field in LENGTH_FIELDS if (value := getattr(wishes, field)) is not None}
    unstated = wishes.unstated
    if wishes.source_isocentre_mm is None or "source_isocentre_mm" in unstated:
        published = wishes.source_isocentre_mm or preset.source_isocentre_mm or farthest
        if farthest > published:  # nearer to the detector more is seen
            stated = {**stated, "source_isocentre_mm": farthest}
            unstated = unstated | {"source_isocentre_mm"}
    lengths = "".join(f"    {field}: {show_value(value)}\n" for field, value in stated.items())
    spacing = tenth(0.4 * wishes.size_mm / wishes.fiducials ** (1 / 3))
    low, high = (f"[{place(value, value, value)}]" for value in (-half, half))
    guesses = list_guesses(unstated, tuple(stated))
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        head=head, name=dump_flow(wishes.name), preset=wishes.preset, title=preset.title, lengths=lengths,
        isocentre=f"[{place(*between)}]", noise=show_value(wishes.noise_px), points=points, seat=place(0, 0, seat),
        flange=place(0, 0, flange), target=place(*wishes.target), limit=show_value(wishes.limit_mm), low=low, high=high,
        spacing=show_value(spacing), assumed="".join(f"  - {pointer}\n" for pointer in guesses),
    )  # fmt: skip


def list_guesses(unstated: frozenset[str], lengths: tuple[str, ...]) -> list[str]:
    """Pointers of what the text says and nobody stated; ``lengths``: those of the C-arm that the views state."""
    of_view = ["isocentre_mm", *(field for field in ("preset", *lengths) if field in unstated)]
    of_view += ["fiducial_noise_px", "target_noise_px"] if "noise_px" in unstated else []
    return [
        *(f"/views/{k}/{field}" for k in (0, 1) for field in of_view),
        "/fiducials/manufacturing",
        "/interfaces/structure_connector",
        "/interfaces/connector_flange",
        *(["/targets/0/position_mm"] if "target" in unstated else []),
        *(["/requirements/0/limit_mm"] if "limit_mm" in unstated else []),
    ]


def show_value(value: Any) -> str:
    """A number or a point as it stands in a flag or in the text."""
    if isinstance(value, tuple):
        return ",".join(f"{part:g}" for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


HEAD = """\
# A first design, made by tailstack init.  The list `assumed` at its end
# says which values nobody stated; docs/design.md explains the fields.
#
# Frame con (connector): its origin is the middle of the fiducials, z points to the patient.  Lengths in mm.
"""
HEAD_OF_FILE = """\
# A first design about the fiducials of {file}, made by tailstack convert.  The list `assumed` at
# its end says which values nobody stated; docs/design.md explains the fields.
#
# Frame con (connector): that of the file; z is taken to point to the patient.  Lengths in mm.
"""


def list_points(wishes: Wishes, beads: Beads | None) -> tuple[str, Point, str]:
    """The lines of the fiducials, the middle between them, and the head of the text."""
    from tailstack.design.write import dump_flow

    if beads is None:
        points = "".join(
            f"    - {{ label: F{index}, position_mm: [{', '.join(map(show_value, point))}] }}\n"
            for index, point in enumerate(spread_fiducials(wishes.fiducials, wishes.size_mm), 1)
        )
        return points, (0.0, 0.0, 0.0), HEAD
    pairs = zip(beads.labels, beads.positions_mm, strict=True)
    lines = [f"    - {dump_flow({'label': label, 'position_mm': list(position)})}\n" for label, position in pairs]
    x, y, z = (tenth((min(values) + max(values)) / 2) for values in zip(*beads.positions_mm, strict=True))
    return "".join(lines), (x, y, z), HEAD_OF_FILE.format(file=" ".join(beads.file.split()))


def start_wishes(fiducials: int, size_mm: float, target: Point, preset: str) -> Wishes:
    """Answers that nobody gave, with the lengths of a C-arm whose source does not state them."""
    from tailstack.design.presets import PRESETS

    arm = PRESETS[preset]
    stated = {field: value for field, value in start_lengths(arm).items() if field in arm.view_must_state}
    lengths = dict.fromkeys(LENGTH_FIELDS) | stated
    return Wishes("first design", preset, fiducials, size_mm, target, 1.0, 0.3, **lengths, unstated=EVERYTHING)


def design_of_beads(beads: Beads, preset: str = "generic-mobile-c-arm") -> str:
    """A first design about beads that are there already, whichever C-arm sees them; seats like those of ``init``."""
    from tailstack.design.presets import PRESETS

    arm = PRESETS[preset]
    extents = [max(values) - min(values) for values in zip(*beads.positions_mm, strict=True)]
    size = max(20.0, float(ceil(max(extents))))
    half, pixel_mm = size / 2, arm.pixel_mm or start_lengths(arm)["pixel_mm"]
    seen = FILLED * pixel_mm * min(arm.image_size_px or (1000,)) / arm.source_detector_mm  # per mm from the source
    most = 2 * seen * (arm.source_detector_mm - size - CLEAR) - half
    target = (0.0, 0.0, max(half + 10, min(half + 50, float(int(most)))))
    return design_text(start_wishes(len(beads.labels), size, target, preset), beads)


def design_of_shots(seen_mm: float) -> str:
    """A first design for images that show so many mm at the isocentre, whose two views are there to be replaced."""
    size = float(max(10, int(0.4 * seen_mm)))  # fiducials and target are within nine tenths of the image then
    start = start_wishes(12, size, (0.0, 0.0, size / 2 + 10), "generic-mobile-c-arm")
    text = design_text(start).replace("made by tailstack init", "made by tailstack convert")
    return text.replace("name: AP\n", "name: shot1\n").replace("name: LAT\n", "name: shot2\n")


EVERYTHING = frozenset(field.name for field in fields(Wishes))
