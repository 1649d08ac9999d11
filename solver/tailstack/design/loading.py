"""Load a design from a file, text, bytes or plain data; its canonical text, defaults filled in, gives its hash."""

from __future__ import annotations

import hashlib
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from ..cures import find_nearest
from ..errors import DesignError, LimitError, Problem, TailstackError, write_pointer
from ..field_names import is_numeric
from ..fields import Record
from ..results.json_text import write_json
from .consistency import check_document, check_fiducials
from .document import SCHEMA_NAME, DesignDocument, FiducialOrigin, Interface, Interfaces, LocatorFile, TargetFile
from .fiducial_files import ENDINGS, FiducialList, check_ending, read_fiducials
from .frames import (
    FRAME_FIELDS,
    FileMotion,
    carry,
    compile_transform,
    locators_of,
    motion_of,
    read_surface_of,
    targets_of,
)
from .optimise_document import SearchSurface, put_surface, surfaces_in
from .pointers import EVERY, children_at, find_places, pointer_of, replace_value, suggest, value_at
from .reading import (
    DEFAULT_LIMITS,
    MOST_STEP_BYTES,
    STEP_FILES,
    DocumentSource,
    Format,
    FrozenList,
    Limits,
    decode,
    freeze,
    name_neighbours,
    plain_data,
    point_list_problem,
    read_bytes,
    read_text,
    refuse_foreign,
    show,
)
from .refusals import place, refuse
from .surface_files import ENDING, MOST_BYTES, REPAIR, digest, pack

SEAT_READER = "tailstack.integrations.step.seat"  # found by its name: it lies behind this on the way of the data
_CAME_FROM = ("origin", "target_origins")  # fields that name a file which is not read again
_Filled = TypeVar("_Filled", bound=Record)


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """A design as it was read: the checked document, its fiducials, where everything stands, its hash."""

    document: DesignDocument  # its fields as they were written: lengths in mm, angles in degrees
    fiducials: FiducialList  # labels and positions, con, mm, wherever they were read
    source: DocumentSource  # the plain data, which cannot be changed, and where it came from
    as_written: DesignDocument  # with files of targets and surfaces as its author named them, not what they hold
    sha256: str = field(init=False)  # of the canonical content: defaults filled in, a file replaced by what it holds

    def __post_init__(self) -> None:
        object.__setattr__(self, "sha256", sha256_of(self.document, self.fiducials))

    @property
    def files(self) -> list[str]:
        """The files that it refers to, as it names them."""
        return list(dict.fromkeys(list_files(self.source.data)))

    def __repr__(self) -> str:
        """What it is of, in a line: all that it holds would be three screens of a notebook."""
        counts = {"view": len(self.document.views), "target": len(self.document.targets)}
        words = [f"{len(self.fiducials.labels)} fiducials"]
        words += [f"{count} {what}{'' if count == 1 else 's'}" for what, count in counts.items()]
        return f"<Design {self.name!r}: {', '.join(words)}; sha256 {self.sha256[:12]}>"

    @property
    def name(self) -> str:
        return self.document.name

    def locate(self, pointer: str) -> tuple[str | None, int | None, int | None]:
        """File, line and column (1-based) of a JSON pointer, or of its nearest ancestor that is there."""
        placed = place(Problem(pointer, "located", ""), self.source)
        return placed.file, placed.line, placed.column

    def with_value(self, path: str, value: Any) -> Design:
        """The design with another value at a place, checked anew; this one stays as it is.

        path: a JSON pointer, ``/views/0/fiducial_noise_px``, or names with dots between them,
        ``views.AP.fiducial_noise_px``; ``*`` stands for every element.  value: a number in the unit of the field's
        name, a text, a list or a mapping, as it would stand in the document; a field that the document leaves to its
        default can be set too.  What it changes, or says again, is no longer
        ``assumed``.  Raises DesignError with the pointer of what is wrong, LimitError.
        """
        data = self.source.data
        pointer = pointer_of(data, path)
        places = find_places(data, pointer, make=True)
        if not places:
            hint = suggest(data, pointer)
            if pointer.startswith("/fiducials/points") and self.document.fiducials.file is not None:
                hint = "the points stand in a file: change it, or load design_to_data(design), which holds them"
            raise DesignError(Problem(pointer, "not-found", f"the design as it was written has no {pointer}", hint))
        for each in places:
            changed = replace_value(data, each, value)
            data = changed if each[0] == ASSUMED else follow_changes(data, changed, write_pointer(each))
        return load_design(data, base_directory=self.source.directory)


@contextmanager
def locate_refusals(design: Design) -> Iterator[None]:
    """Refusals with their place in the user's document."""
    try:
        yield
    except TailstackError as error:
        raise type(error)([place(problem, design.source) for problem in error.problems]) from None


def load_design(
    source: str | bytes | Path | Mapping[str, Any] | DocumentSource,
    *,
    form: Format = "auto",
    base_directory: Path | None = None,
    allow_files: bool = True,
    files: Mapping[str, bytes] | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Design:
    """Load and check a design document.

    source: a path; or a text with a line break or a leading ``{``, or bytes: the document itself; or plain
    data; or a source that was read before.  ``base_directory`` is what a ``fiducials/file`` is relative to when the
    document did not come from a file.  ``allow_files=False`` refuses such references (a service must not read its own
    disk for a stranger).  ``files``: what those hold that are not read from a disk, by the names that the document has.
    Raises DesignError or LimitError; each problem has a pointer and, from text, a line.
    """
    read = read_source(source, form=form, base_directory=base_directory, limits=limits)
    return _check(_FileReader(read, allow_files, limits, files or {}))


def read_source(
    source: str | bytes | Path | Mapping[str, Any] | DocumentSource,
    *,
    form: Format = "auto",
    base_directory: Path | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> DocumentSource:
    """The plain data of a document, not yet checked against the schema."""
    if isinstance(source, DocumentSource):
        return source
    if isinstance(source, Mapping):
        return DocumentSource(plain_data(source, limits), None, base_directory)
    # no design fits on one short line, and no path has a line break
    if isinstance(source, str) and len(source) <= 1000 and not re.search(r"[\n\r]|^\s*{", source):
        source = Path(source)
    if isinstance(source, Path):
        name = str(source)
        content = read_bytes(source, limits.document_bytes, name, document=True)
        if form == "auto" and name.lower().endswith(".json"):
            form = "json"
        return read_text(decode(content, name), limits, file=name, directory=source.parent, form=form)
    if isinstance(source, bytes):
        refuse_foreign(source, None)
        if len(source) > limits.document_bytes:
            raise LimitError(Problem("", "too-large", f"the document is longer than {limits.document_bytes} bytes"))
        source = decode(source, None)
    if not isinstance(source, str):
        raise DesignError(Problem("", "wrong-type", f"a design is a path, a text or a mapping; got {show(source)}"))
    return read_text(source, limits, file=None, directory=base_directory, form=form)


def _check(reader: _FileReader) -> Design:
    source, limits = reader.source, reader.limits
    data = source.data
    _check_schema_name(source)
    try:
        document = DesignDocument.model_validate(data)
    except ValidationError as error:
        raise refuse(error, source, limits) from None
    written = document
    document = reader.with_drawn_seats(document)
    if document.point_files:  # what they hold is judged with the rest of the document
        document = reader.with_points_of_files(document)
    document = reader.with_pose_pairs(reader.with_arm(document))
    for pointer, surface in surfaces_in(document.optimise).items():
        section = put_surface(document.optimise, pointer, reader.with_content(surface, pointer))
        document = document.model_copy(update={"optimise": section})
    _refuse_all([*check_document(document, limits), *check_assumed(data)], source, limits)
    fiducials, _ = reader.fiducials(document)
    _refuse_all(check_fiducials(document, fiducials), source, limits)
    _freeze_lists(written)
    if document is not written:
        _freeze_lists(document)
    return Design(document, fiducials, replace(source, data=freeze(data)), written)


def _check_schema_name(source: DocumentSource) -> None:
    data = source.data
    if holds_points(data):
        raise DesignError(place(point_list_problem(source.file), source))
    if not isinstance(data, dict):
        detail = f"a design is a mapping of fields; got {show(data)}"
        raise DesignError(place(Problem("", "wrong-type", detail, "start from `tailstack example demo`"), source))
    if "$schema" in data and "schema" not in data:
        detail = "this is a JSON schema, the rules for designs and not a design"
        hint = "editors use it; tailstack init makes a design, tailstack example prints others"
        raise DesignError(place(Problem("", "schema-file", detail, hint), source))
    if data.get("schema") != SCHEMA_NAME:
        at, got = ("/schema", show(data["schema"])) if "schema" in data else ("", "no schema")
        detail, cure = f"this version reads {SCHEMA_NAME}; got {got}", f"schema: {SCHEMA_NAME}"
        cure = _name_other(data.get("schema")) or cure
        raise DesignError(place(Problem(at, "unsupported-schema", detail, cure), source))


def _name_other(schema: Any) -> str:
    """What a document of another of our schemas is for; empty for one that may be a design."""
    if not isinstance(schema, str) or not schema.startswith("tailstack/") or schema.startswith("tailstack/design/"):
        return ""
    kind = schema.split("/")[1]
    if kind in ("policy", "waivers"):
        return f"it goes beside designs: tailstack gate DESIGN --{kind} FILE"
    return "it is no design; if tailstack wrote it, it is a result: tailstack report FILE"


def holds_points(data: Any) -> bool:
    """Whether plain data is a list of points: as 3D Slicer writes it, or one that somebody wrote."""
    if isinstance(data, dict):
        return "schema" not in data and bool({"markups", "controlPoints", "points"} & data.keys())
    kinds = {type(each) for each in data} if isinstance(data, list) else set()
    return kinds == {list} or (kinds == {dict} and all("position_mm" in each or "position" in each for each in data))


def _refuse_all(problems: list[Problem], source: DocumentSource, limits: Limits) -> None:
    if not problems:
        return
    source = source.with_places()
    placed = [place(problem, source) for problem in problems[: limits.problems]]
    if all(problem.code == "too-many" for problem in problems):
        raise LimitError(placed)
    raise DesignError(placed)


def list_files(data: Any) -> Iterator[str]:
    """The files that plain data of a design names, not those that what stands in it came from."""
    if isinstance(data, dict):
        if isinstance(data.get("file"), str) and data.get("content") is None:
            yield data["file"]
        data = [each for name, each in data.items() if name not in _CAME_FROM]
    for each in data if isinstance(data, list) else ():
        yield from list_files(each)


def _fill_in(record: _Filled, named: str, **read: Any) -> _Filled:
    """A record with what a file says, which was judged, in place of the field that named it."""
    filled = record.model_copy(update={named: None, **read})
    filled.model_fields_set.discard(named)  # nobody stated that there is none
    return filled


def _put(
    document: DesignDocument, section: str, field: str, record: Record, moved: tuple[str, str] | None = None
) -> DesignDocument:
    """The document with another record in a section; ``moved``: what was assumed of a field of it, which named a file,
    is assumed of the field that it was read into."""
    changes: dict[str, Any] = {section: getattr(document, section).model_copy(update={field: record})}
    if document.assumed and moved is not None:
        named, into = (f"/{section}/{field}/{each}" for each in moved)
        changes[ASSUMED] = [into if f"{each}/".startswith(f"{named}/") else each for each in document.assumed]
    return document.model_copy(update=changes)


def _origin_of(file: str, content: bytes, remarks: Sequence[str]) -> FiducialOrigin:
    """Of what is read otherwise than as points: the file, and what is to be known of it."""
    kept = [each[:400] for each in remarks[:20]]
    sha256 = hashlib.sha256(content).hexdigest()
    return FiducialOrigin(file=file, sha256=sha256, coordinate_system="LPS", remarks=kept)


@dataclass(frozen=True, slots=True)
class _FileReader:
    """Reads the files that a document refers to."""

    source: DocumentSource
    allow_files: bool
    limits: Limits
    files: Mapping[str, bytes]  # that came with the document, by their names in it

    def read(self, name: str, pointer: str) -> FiducialList:
        """The points of a file, as they stand there.  Raises DesignError, LimitError."""
        with self._placing(pointer):
            inline = "put the points inline (points:, targets:, locators:)"
            content = self.read_content(name, ENDINGS, self.limits.fiducial_file_bytes, inline)
            return read_fiducials(content, name, self.limits)

    def read_content(self, name: str, endings: tuple[str, ...], most_bytes: int, inline: str) -> bytes:
        """What a file that is there holds; ``inline``: what to do where none can be."""
        path = None if name in self.files else _find_file(name, self.source, self.allow_files, inline)
        if endings == ENDINGS:
            check_ending(name)
        if path is None:
            return self.files[name]
        if not path.exists():
            raise DesignError(_describe_missing(name, path, self.source, endings))
        return read_bytes(path, most_bytes, name)

    def fiducials(self, document: DesignDocument) -> tuple[FiducialList, FileMotion | None]:
        """In con, and how those of a file were carried there."""
        stated = document.fiducials
        if stated.points is not None:
            labels = tuple([point.label or f"F{number}" for number, point in enumerate(stated.points, 1)])
            return FiducialList(labels, tuple([point.position_mm for point in stated.points]), stated.origin), None
        read = self.read(stated.file or "", "/fiducials/file")
        with self._placing():
            motion = motion_of(stated, "/fiducials", read)
        return carry(read, motion), motion

    def with_points_of_files(self, document: DesignDocument) -> DesignDocument:
        """The document with targets and locators in place of files of them."""
        _, shared = self.fiducials(document)
        targets, origins = list(document.targets), []
        files: dict[str, list[tuple[LocatorFile, FiducialList]]] = defaultdict(list)
        for pointer, each in document.point_files.items():
            read = self.read(each.file, f"{pointer}/file")
            with self._placing():
                read = carry(read, shared if each.as_fiducials else motion_of(each, pointer, read))
                if isinstance(each, TargetFile):
                    targets += targets_of(each, pointer, read)
                else:
                    files[pointer.split("/")[2]].append((each, read))
            origins.append(read.origin)
        with self._placing():
            locators = {name: locators_of(own, f"/interfaces/{name}/locator_files") for name, own in files.items()}
        document = document.model_copy(update={"targets": targets, "target_files": None, "target_origins": origins})
        for name, contacts in locators.items():
            held = _fill_in(getattr(document.interfaces, name), "locator_files", locators=contacts)
            document = _put(document, "interfaces", name, held)
        return document

    def with_drawn_seats(self, document: DesignDocument) -> DesignDocument:
        """The document with the features that files of drawings state."""
        for name, interface in document.interfaces.by_name.items():
            if (drawing := interface.drawing) is None:
                continue
            with self._placing(f"/interfaces/{name}/drawing"):
                inline = "state its features inline (tailstack convert does)"
                content = self.read_content(drawing.file, STEP_FILES, MOST_STEP_BYTES, inline)
                reader = import_module(SEAT_READER)
                read = reader.read_drawn_seat(content, drawing.file, drawing.pin_class, drawing.frame)
                origin = _origin_of(drawing.file, content, read.remarks)
                stated = {key: value for key, value in self.source.data["interfaces"][name].items() if key != "drawing"}
                try:
                    seat = Interface.model_validate(stated | {"features": read.features, "origin": origin})
                except ValidationError as error:
                    raise refuse(error, self.source, self.limits, Interface) from None
            document = _put(document, "interfaces", name, seat, ("drawing", "features"))
        return document

    def with_arm(self, document: DesignDocument) -> DesignDocument:
        """The document with the joints of the robot in place of a file of them."""
        robot = getattr(document.execution, "robot", None)
        if robot is None or robot.urdf is None:
            return document
        from . import urdf_files  # late: of few designs

        with self._placing("/execution/robot/urdf"):
            inline, endings = "put its joints into joints", (urdf_files.ENDING,)
            content = self.read_content(robot.urdf.file, endings, urdf_files.MOST_BYTES, inline)
            read = _fill_in(robot, "urdf", joints=urdf_files.read_urdf(content, robot.urdf))
        return _put(document, "execution", "robot", read, ("urdf", "joints"))

    def with_pose_pairs(self, document: DesignDocument) -> DesignDocument:
        """The document with the tolerances of the hand-eye calibration in place of a file of its poses."""
        hand_eye = document.execution.hand_eye
        if hand_eye is None or hand_eye.pose_pairs is None:
            return document
        from . import hand_eye_files  # late: of few designs

        with self._placing():
            to_tcp = compile_transform(document.transforms.T_tcp_flange, "/transforms/T_tcp_flange", [])
        name, inline = hand_eye.pose_pairs.file, "put their covariance into tolerances.covariance_deg_mm"
        with self._placing("/execution/hand_eye/pose_pairs"):
            content = self.read_content(name, hand_eye_files.ENDINGS, hand_eye_files.MOST_BYTES, inline)
            pivot_mm, tolerances, remark = hand_eye_files.read_pose_pairs(content, name, to_tcp)
        origin = _origin_of(name, content, [remark])
        read = _fill_in(hand_eye, "pose_pairs", pivot_mm=tuple(pivot_mm.tolist()), tolerances=tolerances, origin=origin)
        return _put(document, "execution", "hand_eye", read, ("pose_pairs", "tolerances"))

    def with_content(self, surface: SearchSurface, pointer: str) -> SearchSurface:
        """A surface with what its file holds, which can be read, and has the side that is asked for."""
        name = surface.file or "the surface"
        with self._placing(f"{pointer}/file" if surface.content is None else f"{pointer}/content"):
            if surface.content is None:
                content = self.read_content(name, (ENDING,), MOST_BYTES, "put its bytes, in base64, into content")
                surface = surface.model_copy(update={"content": pack(content, name)})
            read = read_surface_of(surface)
        with self._placing():
            compile_transform(surface.T_con_file, f"{pointer}/T_con_file", [])
            if surface.side != "both" and read.not_closed:
                detail = f"{name} is not closed, and has no {surface.side}: {read.not_closed}"
                raise DesignError(Problem(f"{pointer}/side", "not-closed", detail, REPAIR))
        return surface

    @contextmanager
    def _placing(self, pointer: str | None = None) -> Iterator[None]:
        """Refusals with their place; with the pointer to the field that led to a file, which keeps its own line."""
        try:
            yield
        except (DesignError, LimitError) as error:
            placed = self.source.with_places()
            problems = [each if pointer is None else replace(each, pointer=pointer) for each in error.problems]
            raise type(error)([place(problem, placed) for problem in problems]) from None


def _describe_missing(name: str, path: Path, source: DocumentSource, endings: tuple[str, ...]) -> Problem:
    """A file that is not there: the folder that was searched, and what may have been meant."""
    assert source.directory is not None
    folder = str(source.directory / Path(name).parent)
    folder = "the folder of the design" if folder == "." else folder
    hint = name_neighbours(path, name, endings) or "it stands beside the design, or in a folder below it"
    return Problem("", "file-not-found", f"no such file: {name}; looked in {folder}", hint)


def _find_file(name: str, source: DocumentSource, allow_files: bool, inline: str) -> Path:
    """The file a design refers to: relative, and below the design's own directory."""

    def refuse_file(detail: str, cure: str = "") -> DesignError:
        return DesignError(Problem("", "file-refused", detail, cure))

    if not allow_files:
        raise refuse_file(f"files are not read here; got {show(name)}", inline)
    if source.directory is None:
        detail = "the document did not come from a file: there is no directory to look in"
        raise refuse_file(detail, f"{inline}, or load the design from its file")
    if "\0" in name or "\\" in name or Path(name).is_absolute() or ":" in name[:2]:
        raise refuse_file(f"a file is named by a relative path with /; got {show(name)}")
    try:
        base = source.directory.resolve()
        path = (base / name).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise refuse_file(f"cannot follow {show(name)}: {error}") from None
    if not path.is_relative_to(base):
        raise refuse_file(f"{show(name)} leads out of the design's directory", "move the file beside it")
    return path


# the points are hashed apart, in con, wherever they were read
_ELSEWHERE: Any = {"fiducials": {"points", "file", "origin", *FRAME_FIELDS}, "target_origins": True, "review": True,
                   "interfaces": {name: {"origin"} for name in Interfaces.model_fields},
                   "execution": {"hand_eye": {"origin"}}}  # fmt: skip
_OF_SURFACE = ("file", "content")  # likewise, by what the file holds


def sha256_of(document: DesignDocument, fiducials: FiducialList) -> str:
    """The hash of a design, 64 hexadecimal digits: of its canonical text and its fiducials, wherever they were read."""
    content = document.model_dump(mode="json", by_alias=True, exclude_none=True, exclude=_ELSEWHERE)
    points: list[Any] = [fiducials.labels, fiducials.positions_mm]
    for pointer, surface in surfaces_in(document.optimise).items():
        stated = value_at(content, find_places(content, pointer)[0])
        for name in _OF_SURFACE:
            stated.pop(name, None)
        points.append(digest(surface.content or ""))
    # with spaces, unlike everything else: the hashes of designs that are in the field were made so
    spaced = json.dumps(points, ensure_ascii=False, allow_nan=False)  # noqa: TID251
    return hashlib.sha256(f"{write_json(content)}\n{spaced}".encode()).hexdigest()


def _freeze_lists(record: Any) -> None:
    """Make the lists of a record of pydantic, and of the records in it, such as cannot be changed."""
    fields = record.__dict__
    for name, value in fields.items():
        if type(value) is list:
            fields[name] = FrozenList(value)
        for each in value if isinstance(value, list) else (value,):
            if isinstance(each, BaseModel):
                _freeze_lists(each)


# --- what nobody stated: ``assumed``, JSON pointers into the same document --------------------------------
# A pointer to a mapping, or to a list of mappings, covers every number below it.  A value is a number or a vector or
# matrix of numbers; a text (a preset, a law) counts where a pointer names it itself.

ASSUMED = "assumed"
_NO_VALUES = ("schema", "document", ASSUMED)  # fields of a design that say nothing of what is computed


def list_assumed(data: dict[str, Any]) -> tuple[str, ...]:
    """A pointer to each assumed value of a document whose list is in order, in the order of the list."""
    found: list[str] = []
    for pointer in data.get(ASSUMED, ()):
        found += [*_numbers_below(value_at(data, find_places(data, pointer)[0]), pointer)] or [pointer]
    return tuple(dict.fromkeys(found))


def check_assumed(data: dict[str, Any]) -> Iterator[Problem]:
    """Every pointer of the list leads to something that the document says."""
    for index, pointer in enumerate(data.get(ASSUMED, ())):
        steps = pointer.split("/")
        if not (find_places(data, pointer) and EVERY not in steps and steps[1] not in _NO_VALUES):
            detail = f"the design as it was written has no value at {pointer or 'an empty pointer'}"
            yield Problem(f"/{ASSUMED}/{index}", "not-found", detail, _suggest(data, pointer))


def _suggest(data: dict[str, Any], pointer: str) -> str:
    found = find_places(data, pointer_of(data, pointer))
    places = [write_pointer(place) for place in found if place[0] not in _NO_VALUES]
    if not places and pointer.split("/")[1:2] and pointer.split("/")[1] not in _NO_VALUES:
        places = find_nearest(pointer, _all_pointers(data, ""))
    cure = "take it off the list: what the design leaves to its default is not listed"
    return f"did you mean {', '.join(places[:8])}?" if places else cure


def _all_pointers(node: Any, pointer: str) -> Iterator[str]:
    for child, way in _children(node, pointer):
        if way.split("/")[1] not in _NO_VALUES:
            yield way
            yield from _all_pointers(child, way)


def follow_changes(before: dict[str, Any], after: dict[str, Any], stated: str = "") -> dict[str, Any]:
    """The changed document, in which what is not as it was before is assumed no longer, and so is a value at a pointer
    that somebody ``stated``, as it was or not.  What else a pointer of the list covers stays on it."""
    if ASSUMED not in before:
        return after
    left = list(before[ASSUMED])
    for pointer in list_assumed(before):
        place, there = find_places(before, pointer)[0], find_places(after, pointer)
        if not there or value_at(after, there[0]) != value_at(before, place):
            left = _leave(before, left, pointer)
    if (places := find_places(before, stated)) and _is_value(value_at(before, places[0])):
        left = _leave(before, left, stated)
    rest = {name: value for name, value in after.items() if name != ASSUMED}
    return {**rest, ASSUMED: left} if left else rest


def _leave(data: Any, pointers: Iterable[str], stated: str) -> list[str]:
    left = []
    for pointer in pointers:
        if _covers(stated, pointer):
            continue
        node = value_at(data, find_places(data, pointer)[0])
        if not _covers(pointer, stated):
            left.append(pointer)
        elif not _is_value(node):
            inner = [way for child, way in _children(node, pointer) if any(_numbers_below(child, way))]
            left += _leave(data, inner, stated)
    return left


def _covers(pointer: str, other: str) -> bool:
    return other == pointer or other.startswith(f"{pointer}/")


def _numbers_below(node: Any, pointer: str) -> Iterator[str]:
    if _is_value(node):
        if is_numeric(node):
            yield pointer
        return
    for child, way in _children(node, pointer):
        yield from _numbers_below(child, way)


def _children(node: Any, pointer: str) -> list[tuple[Any, str]]:
    return [(child, pointer + write_pointer([key])) for key, child in children_at(node, EVERY)]


def _is_value(node: Any) -> bool:
    """Whether it is stated as a whole: neither a mapping nor a list of mappings."""
    return not isinstance(node, dict) and not (isinstance(node, list) and any(isinstance(each, dict) for each in node))
