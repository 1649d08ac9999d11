"""Convert designs (.yaml, .json), fiducial files (.csv, .fcsv, .mrk.json), balls of STEP files and DICOM headers."""

from __future__ import annotations

import argparse
import base64
import binascii
import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field, create_model

from tailstack.errors import DesignError, LimitError, Problem, TailstackError
from tailstack.results.record import Published

from ..console.command_line import Answer, read_design, read_number
from ..console.files import add_force, keep_inputs, refuse_overwriting, writable
from ..console.flags import NO_FLAG, Flag, add_flags, read_flags
from ..documents import to_json
from ..first_design import Beads, design_of_beads, design_of_shots
from ..operations.editors import write_document
from ..operations.operation import Body, Command, ExampleBody, Operation, Options, Reception, text_reading_seconds
from ..problems import RefusedAt, RequestError
from ..processes.task import RawRequest
from ..rendering.text import draw_table

if TYPE_CHECKING:
    from tailstack.design import Design, Limits
    from tailstack.design.fiducial_files import FiducialList
    from tailstack.integrations.conversion import ConvertedFile
    from tailstack.integrations.step import StepBody, StepSelection, StepTolerance

    from ..settings import Settings

TargetFormat = Literal["csv", "fcsv", "mrk.json", "yaml", "json"]
SourceFormat = Literal["csv", "fcsv", "mrk.json", "yaml", "json", "step", "dicom"]
SOURCES: tuple[SourceFormat, ...] = get_args(SourceFormat)
STEP_MEDIA = ("model/step", "application/step")
IMPLIED: dict[str, SourceFormat] = {"text/csv": "csv", "yaml": "yaml", **dict.fromkeys(STEP_MEDIA, "step")}
DESIGNS = ("yaml", "json")
MOST_SHOTS = 16
BEADS = "label,x_mm,y_mm,z_mm\nF1,0,0,0\nF2,40,0,5\nF3,0,35,-10\n"
Pattern = Annotated[str, Field(min_length=1, max_length=200)]


def _parse_diameter(text: str) -> tuple[float, float]:
    """A diameter and how far one may be from it, as 3±0.1, 3+-0.1, 3+/-0.1 or 3."""
    parts = [read_number(part) for part in re.split(r"±|\+/?-", text.strip().removesuffix("mm"))]
    if len(parts) not in (1, 2) or any(part is None for part in parts):
        raise argparse.ArgumentTypeError(f"expected a diameter in mm like 3±0.1 or 3+-0.1; got {text!r}")
    diameter, *tolerance = (float(part) for part in parts if part is not None)
    if not 0 < diameter <= 1000 or not 0 <= min(tolerance, default=0.0) <= 100:
        raise argparse.ArgumentTypeError(f"expected a diameter above 0, at most 1000 mm; got {text!r}")
    return diameter, tolerance[0] if tolerance else 0.01


STEP, CAGE = "of a STEP file", "of a cage of XMALab"  # headings of flags
BALLS = "balls of this diameter are fiducials, mm: 3±0.1 or 3+-0.1 (default all, if they have one)"
DIAMETER = Flag(BALLS, name="sphere-diameter", metavar="D±T", heading=STEP, parse=_parse_diameter)
NAME = Flag("balls with such a name, like 'BEAD*'", metavar="PATTERN", heading=STEP)
FRAME = Flag("coordinate system or part whose frame is con", heading=STEP)
SEATS = Flag("cylinders or coordinate systems that hold along their axis", metavar="PATTERN", heading=STEP)
PINS = Flag(
    "cylinders or coordinate systems that hold across their axis; with --seats they are the six locators of the "
    "structure",
    metavar="PATTERN",
    heading=STEP,
)
PIN_CLASS = Flag(
    "the seat of the structure is what the tolerances of the file state (AP242): a flat face and two holes, whose pins "
    "are of this class of ISO 286",
    metavar="g6",
    heading=STEP,
)
XMALAB = Flag(
    "the .csv that is read, or else written, is a frame specification in this unit; a .ref beside one that is read is "
    "read too",
    heading=CAGE,
)

HELD = "STEP only: pattern of the names of cylinders and coordinate systems that hold the structure"


class StepOptions(Options):
    """What of a STEP file is wanted; for other formats these are refused."""

    sphere_diameter_mm: Annotated[Annotated[float, Field(gt=0, le=1000)] | None, DIAMETER] = None
    """STEP only: diameter of the balls that are fiducials, mm. Absent: all, if they have one."""
    sphere_tolerance_mm: Annotated[float, Field(ge=0, le=100), NO_FLAG] = 0.01
    """STEP only: how far a diameter may be from sphere_diameter_mm, mm."""
    name: Annotated[Pattern | None, NAME] = Field(None, examples=["BEAD*"])
    """STEP only: pattern of the name of a ball: its own, or that of its part or instance."""
    frame: Annotated[Pattern | None, FRAME] = Field(None, examples=["CONNECTOR"])
    """STEP only: name of the coordinate system, part or instance whose frame becomes con."""
    seats: Annotated[Pattern | None, SEATS] = Field(
        None, description=f"{HELD} along their axis; with pins they become its six locators.", examples=["REST*"]
    )
    pins: Annotated[Pattern | None, PINS] = Field(
        None,
        description=f"{HELD} across their axis: the first both ways, each other one across the line to it.",
        examples=["PIN*"],
    )

    pin_class: Annotated[Annotated[str, Field(min_length=2, max_length=6)] | None, PIN_CLASS] = Field(
        None, examples=["g6"]
    )
    """STEP only: the tolerances that the file states (AP242) of a flat face and two dowel holes become the features of
    the structure's seat, with pins of this class of ISO 286. Balls may lack then, beside a base."""

    def select(self) -> StepSelection:
        """As the solver takes it."""
        from tailstack.integrations.step import StepSelection

        return StepSelection(*(getattr(self, name) for name in StepOptions.model_fields))


class FileOptions(StepOptions):
    """What the files themselves do not say."""

    xmalab: Annotated[Literal["mm", "cm"] | None, XMALAB] = Field(None, examples=["cm"])
    """CSV: it is a frame specification of XMALab, with numbers in this unit: the content, or, if that is no CSV, what
    is made of it."""


class ConversionOptions(FileOptions):
    """The content and what to make of it."""

    format: SourceFormat
    """What the content is; yaml and json are designs."""
    content: Annotated[str, Field(min_length=1)] = Field(examples=["label,x_mm,y_mm,z_mm\nF1,0,0,0\n"])
    """The text of the file; of dicom its bytes in base64, of which the header (the first 100 kB) is enough."""
    to: TargetFormat = "yaml"
    """What to make of it; a design becomes a design, or its fiducials."""
    base: dict[str, Any] | None = None
    """A design whose fiducials, or views, the content replaces; the answer holds it."""
    more: Annotated[list[Annotated[str, Field(min_length=1)]], Field(max_length=MOST_SHOTS - 1)] | None = None
    """dicom: further images in base64; each is a view, in this order."""
    files: dict[str, str] | None = None
    """yaml, json: the text of each file that the design names, by that name; it is read into it."""


_SOURCE = Field(None, description="What the content is; text/csv, model/step and YAML say it themselves.")
BESIDE_FILE: dict[str, Any] = {
    "from": (SourceFormat | None, _SOURCE),
    "to": (TargetFormat, Field("yaml", description="What to make of it.")),
}
FileQuery: Any = create_model("FileQuery", __base__=FileOptions, **BESIDE_FILE)  # beside a file, in the query


@dataclass(frozen=True, slots=True)
class ConvertedPoint:
    label: str
    """Label of the fiducial."""
    position_mm: tuple[float, float, float]
    """Position, con (LPS), mm."""


@dataclass(frozen=True, slots=True)
class ConvertedBody:
    label: str
    """Label of the fiducial that it became; if it was left, its name, which may be empty."""
    path: str
    """Names of the assembly, of its instances and of the body, with slashes between them."""
    position_mm: tuple[float, float, float] | None
    """Centre of its sphere, con, mm; null: it has no sphere, or the file does not say where it is."""
    diameter_mm: float | None
    """Diameter of its sphere, mm; null: it has none, or the file does not say where it is."""
    reason: str
    """Why it was left; empty: it became a fiducial."""


@dataclass(frozen=True, slots=True)
class ConvertedTolerance:
    text: str
    """As on a drawing: `position Ø0.05 (M) | A | B`."""
    kind: str
    """What it is of: flatness, position, diameter, linear distance, ..."""
    unit: Literal["mm", "deg"]
    """Of its numbers."""
    value: float | None
    """Width or diameter of the zone, or the nominal size; null: the file states none."""
    lower: float | None
    """Lower deviation of a size; null: none is stated."""
    upper: float | None
    """Upper deviation of a size; null: none is stated."""
    fit: str
    """Class of ISO 286, such as H7; empty: none."""
    datums: tuple[str, ...]
    """Letters of the datums, in their order."""
    at_mm: tuple[tuple[float, float, float], ...]
    """The middle of each face that it is of, con, mm."""


@dataclass(frozen=True, slots=True, repr=False)
class Conversion(Published):
    """A fiducial file or a design in another format, and the fiducials in it."""

    schema: Literal["tailstack/conversion/1"]
    format: Literal["csv", "fcsv", "mrk.json", "yaml", "json"]
    """Format of `content`."""
    content: str
    """The converted text."""
    fiducials: tuple[ConvertedPoint, ...]
    """The fiducials in it."""
    notes: tuple[str, ...]
    """What was done to the numbers on the way."""
    bodies: tuple[ConvertedBody, ...] = ()
    """Of a STEP file: the balls that became fiducials, and whatever has a spherical face or a name as asked for."""
    tolerances: tuple[ConvertedTolerance, ...] = ()
    """Of a STEP file: the tolerances and dimensions that it states as such (AP242), not those that are only drawn."""


# --- a file into a design or another file -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Wish:
    """A content to convert: names whose endings say what it is and becomes, and what the fiducials go into."""

    content: bytes
    source: str
    target: str
    options: FileOptions
    base: Design | None = None
    base_text: str | None = None  # the YAML of the base, whose comments stay
    more: tuple[tuple[bytes, str], ...] = ()  # content and name of further images
    references: tuple[bytes, str] | None = None  # content and name of the .ref of a cage of XMALab
    files: Mapping[str, bytes] = field(default_factory=dict)  # that came with a design which names them


def convert_wish(wish: Wish, limits: Limits, directory: Path | None = None) -> ConvertedFile:
    """Convert; balls of a STEP file or images without a base get a first design.  Raises DesignError, LimitError.

    directory: what files that a design names are relative to; None: it may name none.
    """
    from tailstack.design import load_design
    from tailstack.design.reading import DOCUMENTS, STEP_FILES
    from tailstack.integrations.calibration_cages import CageForm
    from tailstack.integrations.conversion import convert
    from tailstack.integrations.dicom import Shot, convert_shots, is_dicom

    is_step = wish.source.lower().endswith(STEP_FILES)
    _refuse_unused(wish, is_step)
    starts: list[str] = []

    def begin(fiducials: FiducialList) -> Design:
        starts.append(design_of_beads(Beads(fiducials.labels, fiducials.positions_mm, wish.source)))
        return load_design(starts[0], limits=limits)

    def begin_for_shots(shots: Sequence[Shot]) -> Design:
        starts.append(design_of_shots(min(shot.seen_mm for shot in shots)))
        return load_design(starts[0], limits=limits)

    if is_dicom(wish.content, wish.source):
        files = ((wish.content, wish.source), *wish.more)
        return _complete(convert_shots(files, wish.target, wish.base or begin_for_shots, limits), wish, starts, limits)
    if wish.more:
        detail = "of these files one is converted at a time"
        raise RequestError(Problem("/more", "unused-option", detail, "leave it out"))
    unit = wish.options.xmalab
    begins = is_step and wish.base is None and wish.target.lower().endswith(DOCUMENTS)
    made = convert(
        wish.content, wish.source, wish.target, directory=directory, allow_files=directory is not None,
        files=wish.files, limits=limits, selection=wish.options.select(), base=begin if begins else wish.base,
        cage=None if unit is None else CageForm(unit, wish.references),
    )  # fmt: skip
    if (wish.base is None and not starts) or not wish.target.lower().endswith(DOCUMENTS):
        return replace(made, notes=(*made.notes, *_doubt_balls(made, wish, limits))) if is_step else made
    return _complete(made, wish, starts, limits)


def _complete(made: ConvertedFile, wish: Wish, starts: list[str], limits: Limits) -> ConvertedFile:
    """What was made of a base or of a start, with the comments of that, and notes on what it still needs."""
    from tailstack.design import load_design

    base, text = (load_design(starts[0], limits=limits), starts[0]) if starts else (wish.base, wish.base_text)
    start = [f"{'views' if made.bodies else 'fiducials'}, {START}"] if starts else []
    notes = [*made.notes, *start, *_what_is_missing(made.text, limits)]
    if base is not None and text is not None and not wish.target.lower().endswith(".json"):
        made = replace(made, text=_keep_comments(text, base, made.text, limits))
    return replace(made, notes=tuple(notes))


START = "seats, targets, limit and tolerances are a start like that of tailstack init: correct them"


def _refuse_unused(wish: Wish, is_step: bool) -> None:
    """Raises RequestError for options that say nothing about this content."""
    unused = sorted(wish.options.model_fields_set & StepOptions.model_fields.keys()) if not is_step else []
    unused = [name for name in unused if getattr(wish.options, name) is not None]
    if unused:
        detail = f"{unused[0]} is for STEP files; the content is {wish.source.rpartition('.')[2]}"
        raise RequestError(Problem(f"/{unused[0]}", "unused-option", detail, "leave it out"))
    endings = [name.rpartition(".")[2].lower() for name in (wish.source, wish.target)]
    if wish.files and endings[0] not in DESIGNS:
        detail = f"files go with a design that names them; the content is {endings[0]}"
        raise RequestError(Problem("/files", "unused-option", detail, "leave it out"))
    if wish.options.xmalab is not None and "csv" not in endings:
        detail = f"xmalab is for CSV files; {endings[0]} becomes {endings[1]}"
        raise RequestError(Problem("/xmalab", "unused-option", detail, "leave it out"))


def _what_is_missing(text: str, limits: Limits) -> list[str]:
    """Why a design does not score yet, and what of it is hardly meant, in words."""
    from tailstack.design import check_design, load_design
    from tailstack.design.plausibility import PLAUSIBILITY

    try:
        _, findings, _ = check_design(load_design(text, limits=limits))
    except TailstackError as error:
        return [f"the design does not score yet: {problem}" for problem in error.problems[:5]]
    return [finding.message for finding in findings if finding.rule in PLAUSIBILITY]


def _doubt_balls(made: ConvertedFile, wish: Wish, limits: Limits) -> list[str]:
    """What ``validate`` would say of a design with the balls of a STEP file about their size: a slip of unit."""
    from tailstack.design import load_design
    from tailstack.design.plausibility import explain_refusal

    try:
        beads = Beads(made.fiducials.labels, made.fiducials.positions_mm, wish.source)
        return [problem.detail for problem in explain_refusal(load_design(design_of_beads(beads), limits=limits))]
    except TailstackError:
        return []


def _keep_comments(text: str, base: Design, made: str, limits: Limits) -> str:
    """The text of the base with what is new in the other text, if that can be done; else the other text."""
    from tailstack.design import design_to_data, load_design
    from tailstack.design.yaml_text import revise_yaml

    wanted = load_design(made, limits=limits)
    with suppress(TailstackError):
        revised = revise_yaml(text, design_to_data(base, inline=False), design_to_data(wanted))
        if load_design(revised, limits=limits).sha256 == wanted.sha256:
            return revised
    return made


# --- over HTTP ------------------------------------------------------------------------------------------


def receive(sent: RawRequest, settings: Settings) -> Reception:
    """The converted text, the fiducials in it, and what was done to the numbers.  Raises RefusedAt, RequestError."""
    from ..operations.request import cure_line_ends, design_of, limits_of, options_of_query, parse_json, read_options

    if sent.form == "json":
        data = parse_json(sent.body, settings)
        options: Any = read_options(ConversionOptions, data, ())
        base = None if options.base is None else design_of(data, settings, "base")
        source, place = options.format, "/content"
        content = _decode(options.content, place) if source == "dicom" else _encode(options.content)
        more = tuple((_decode(text, f"/more/{k}"), f"more.{k + 1}.dicom") for k, text in enumerate(options.more or ()))
        files = {name: _encode(text) for name, text in (options.files or {}).items()}
    else:
        options, base, content, place, more = options_of_query(FileQuery, sent.query), None, sent.body, "", ()
        files = {}
        source = getattr(options, "from") or IMPLIED.get(sent.form)
        if source is None:
            detail, hint = "text/plain does not say which format it is", f"add ?from= one of {', '.join(SOURCES)}"
            raise RequestError(Problem("/from", "missing-parameter", detail, hint))
    wish = Wish(content, f"content.{source}", f"converted.{options.to}", options, base, None, more, files=files)
    try:
        made = convert_wish(wish, limits_of(settings))
    except (DesignError, LimitError) as error:
        if not place and isinstance(error, DesignError):
            error = cure_line_ends(error, sent.body)
        raise RefusedAt.place(error, place) from None
    stated = [each.name for each in fields(ConvertedTolerance)][:-1]  # the last is where its faces are
    record = Conversion(
        schema="tailstack/conversion/1",
        format=options.to,
        content=made.text,
        fiducials=tuple(map(ConvertedPoint, made.fiducials.labels, made.fiducials.positions_mm)),
        notes=made.notes,
        bodies=tuple(ConvertedBody(*astuple(body)) for body in made.bodies),
        tolerances=tuple(
            ConvertedTolerance(
                **{name: getattr(each, name) for name in stated}, at_mm=tuple(face.place for face in each.faces)
            )
            for each in made.tolerances
        ),
    )
    return Reception(answer=to_json(record))


def _encode(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _decode(text: str, place: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        detail = "an image is sent as base64; this is none"
        raise RequestError(Problem(place, "not-base64", detail, "base64 -w0 FILE")) from None


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "file to read: .yaml, .json, .csv, .fcsv, .mrk.json, .step, .stp; or .dcm, of which each is a view"
    parser.add_argument("design", metavar="IN", nargs="+", help=words)
    parser.add_argument(
        "-o", "--output", metavar="OUT", required=True, help="file to write; its ending decides the format"
    )
    add_force(parser)
    parser.add_argument("--base", metavar="DESIGN", help="design whose fiducials, or views, are those of IN then")
    add_flags(parser, StepOptions)
    cage = parser.add_argument_group(CAGE)
    add_flags(parser, FileOptions)
    cage.add_argument("--references", metavar="LABEL,...", help="beads that are marked: writes the .ref, too")


def _run(arguments: argparse.Namespace) -> Answer:
    from tailstack.design.fiducial_files import FORMATS
    from tailstack.design.reading import DEFAULT_LIMITS, DOCUMENTS
    from tailstack.integrations.conversion import read_source_file

    from ..operations.request import read_options
    from ..operations.revision import own_text

    given = read_flags(FileOptions, arguments)
    if "sphere_diameter_mm" in given:
        given |= dict(zip(("sphere_diameter_mm", "sphere_tolerance_mm"), given["sphere_diameter_mm"], strict=True))
    source, *others = map(Path, arguments.design)
    keep_inputs(arguments.output, arguments.design)
    target = writable(arguments.output, (*FORMATS, *DOCUMENTS))
    refuse_overwriting([target], force=arguments.force, own=arguments.base)
    base = None if arguments.base is None else read_design(arguments.base)
    options = read_options(FileOptions, given, ())
    text = None if base is None else own_text(base)
    references = _read_references(source) if arguments.xmalab else None
    more = tuple((read_source_file(file), file.name) for file in others)
    wish = Wish(read_source_file(source), source.name, target.name, options, base, text, more, references)
    made = convert_wish(wish, DEFAULT_LIMITS, source.parent)
    beside = _write_references(arguments, source, target, made)
    refuse_overwriting(beside, force=arguments.force)
    files = {target: made.text, **beside}
    for note in made.notes:
        print(f"note: {note}", file=sys.stderr)
    for file, content in files.items():
        try:
            write_document(file, content)
        except OSError as error:
            detail = f"cannot write {file}: {error.strerror}"
            raise DesignError(Problem("", "file-unwritable", detail)) from None
        print(f"wrote {file}", file=sys.stderr)
    return Answer(describe_bodies(made.bodies) + describe_tolerances(made.tolerances))


def _read_references(source: Path) -> tuple[bytes, str] | None:
    """Content and name of the references beside a frame specification, if there are any."""
    from tailstack.design.reading import DEFAULT_LIMITS, read_bytes

    file = source.with_suffix(".ref")
    if source.suffix.lower() != ".csv" or not file.is_file():
        return None
    return read_bytes(file, DEFAULT_LIMITS.fiducial_file_bytes, str(file)), file.name


def _write_references(
    arguments: argparse.Namespace, source: Path, target: Path, made: ConvertedFile
) -> dict[Path, str]:
    """The references to write beside a frame specification that is written, as wished.  Raises RequestError."""
    from tailstack.integrations.calibration_cages import write_references

    writes_cage = arguments.xmalab and target.suffix.lower() == ".csv" and source.suffix.lower() != ".csv"
    if arguments.references is None:
        if writes_cage:
            print("note: XMALab wants a .ref, too: name the marked beads with --references", file=sys.stderr)
        return {}
    if not writes_cage:
        detail = "--references go beside a frame specification that is written"
        raise RequestError(Problem("", "unused-option", detail, "with --xmalab, and -o ending in .csv"))
    file = target.with_suffix(".ref")
    marked = tuple(label.strip() for label in arguments.references.split(","))
    return {file: write_references(made.fiducials, marked, file.name)}


LISTED = 30  # bodies that were left, on the page


def describe_bodies(bodies: Sequence[StepBody]) -> str:
    """What was taken of a STEP file, and what was left and why, as tables; those alike are one line."""

    def place(body: StepBody) -> list[str]:
        numbers = ["", "", ""] if body.position_mm is None else [f"{value:.3f}" for value in body.position_mm]
        return [*numbers, "" if body.diameter_mm is None else f"{body.diameter_mm:.3f}"]

    if not bodies:
        return ""
    columns = ["x\nmm", "y\nmm", "z\nmm", "diameter\nmm"]
    rows = [[body.label, *place(body), body.path] for body in bodies if not body.reason]
    header = ["fiducial", *columns, "in the file"]
    text = f"{len(rows)} balls became fiducials:\n\n{draw_table(header, rows, names=[5])}\n"
    left: dict[tuple[str, str], list[StepBody]] = {}
    for body in bodies:
        if body.reason:
            left.setdefault((body.path, body.reason), []).append(body)
    if not left:
        return text
    rows = []
    for (path, reason), alike in list(left.items())[:LISTED]:
        rows.append([path, reason + (f" ({len(alike)} times)" if len(alike) > 1 else ""), *place(alike[0])])
    more = f"and {len(left) - LISTED} more\n" if len(left) > LISTED else ""
    return f"{text}\n{len(left)} were left:\n\n{draw_table(['in the file', 'because', *columns], rows, left=2)}\n{more}"


def describe_tolerances(tolerances: Sequence[StepTolerance]) -> str:
    """What a STEP file states of its drawing, as a table; those alike are one line."""
    alike: dict[tuple[str, str], list[StepTolerance]] = {}
    for each in tolerances:
        surfaces = Counter(face.surface for face in each.faces)
        of = ", ".join(f"{count} {name} faces" if count > 1 else name for name, count in surfaces.items())
        alike.setdefault((each.text, of or "no face"), []).append(each)
    if not alike:
        return ""
    rows = []
    for (text, of), own in alike.items():
        place = [f"{value:.3f}" for value in own[0].faces[0].place] if own[0].faces else ["", "", ""]
        rows.append([text, of, f"{len(own)}", *place])
    header = ["tolerance", "of", "times", "x\nmm", "y\nmm", "z\nmm"]
    return f"\n{len(tolerances)} tolerances and dimensions of the drawing:\n\n{draw_table(header, rows, left=2)}\n"


CSV = ExampleBody("Csv", "The file itself", BEADS)
BALL = ExampleBody(
    "Step", "A STEP file with one ball", Path(__file__).with_name("ball.step").read_text(encoding="ascii")
)

OPERATION = Operation(
    name="conversion",
    verb="convert",
    path="/v1/conversions",
    summary="Convert designs, fiducial files, STEP and DICOM, by their endings",
    description="In memory: no file is read, nothing is fetched. With text/plain, from says what the text is. Balls of "
    "a STEP file are fiducials; what was taken and what was left is in bodies. Headers of DICOM images are views.",
    title="answer of convert over HTTP",
    options=ConversionOptions,
    designs={},
    example={"format": "csv", "content": BEADS, "to": "yaml"},
    record=lambda: Conversion,
    immediate=True,
    body=Body(
        receive=receive,
        query=lambda: FileQuery.model_json_schema()["properties"],
        media=("text/csv", "text/plain", *STEP_MEDIA),
        samples={"text/csv": CSV, "text/plain": CSV, **dict.fromkeys(STEP_MEDIA, BALL)},
        hint="format and to go into the body, beside the content",
        kernels=False,
        reading_seconds=text_reading_seconds,
    ),
    example_title="A CSV file to the fiducials of a design",
    command=Command(_add_arguments, _run),
)
