"""pydantic's errors in our words, with a pointer and a place in the user's own document."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from ..cures import ask_meant, cure_list, cure_pair, cure_range, cure_text, cure_zone
from ..errors import DesignError, Edit, Problem, read_pointer, write_pointer
from ..field_names import cure_name, is_numeric, write_value
from ..fields import Pose, describe_fields
from .bead_noise import BeadNoise
from .document import VIEW_KINDS, DesignDocument
from .features import FEATURE_KINDS
from .optimise_document import FREE_VIEW_KINDS
from .presets import PRESETS
from .reading import DocumentSource, Limits, Vast, show

_TAGS: dict[str, type[BaseModel] | None] = {
    **VIEW_KINDS, **FREE_VIEW_KINDS, **FEATURE_KINDS, "<pose>": Pose, "<matrix>": None, "<noise>": BeadNoise,
    "<number>": None,
}  # fmt: skip
_WANTED = {
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    "bool_type": "true or false",
    "string_type": "a text",
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "a mapping of fields"),
}
PATTERNS = {  # what a text that does not match does wrong
    r"^[^\x00-\x1f\x7f]*$": "holds a line break or a control character",
    r"^([^*\x00-\x1f\x7f]*\*){0,10}[^*\x00-\x1f\x7f]*$": "holds more than ten *, or a control character",
    r"^\d{4}-\d{2}-\d{2}$": "is not a date of the form YYYY-MM-DD",
}


def place(problem: Problem, source: DocumentSource) -> Problem:
    """The same problem with file, line and column, when the document came as text and it has none yet."""
    if problem.file is not None:
        return problem
    line, column = source.locate(_read_path(problem.pointer), key=problem.code == "unknown-field")
    return replace(problem, file=source.file, line=line, column=column)


def _read_path(pointer: str) -> list[str | int]:
    """The path of a pointer, whose numbers are those of elements."""
    return [int(step) if step.isascii() and step.isdigit() else step for step in read_pointer(pointer)]


def refuse(
    error: ValidationError, source: DocumentSource, limits: Limits, root: type[BaseModel] = DesignDocument
) -> DesignError:
    """A DesignError that says what each of pydantic's errors says, in the order of the document.

    ``root`` is the model that the document was held against."""
    translated = [_translate(entry, root, source.data) for entry in error.errors(include_url=False)]
    problems = _merge([_cure_limits(problem, source.data) for problem in translated])
    added = {edit.path for problem in problems for edit in problem.fix}
    problems = [each for each in problems if each.code != "missing-field" or each.pointer not in added]
    source = source.with_places()
    dropped = len(problems) - limits.problems
    problems = [place(problem, source) for problem in problems[: limits.problems]]
    if dropped > 0:
        detail = f"not listed: {dropped} more problem{'s' * (dropped > 1)}"
        problems.append(Problem("", "and-more", detail, "mend those that are listed and ask again", source.file))
    return DesignError(problems)


_UPPER = ("upper", "max", "plus", "upper_limit", "es")  # ways to call the limits of a zone, without a unit
_LOWER = ("lower", "min", "minus", "lower_limit", "ei")


def _cure_limits(problem: Problem, data: Any) -> Problem:
    """The limits of a zone that were given for a tolerance: what they are as bias and half-width."""
    path = _read_path(problem.pointer)
    if problem.code != "unknown-field" or re.sub(r"_(mm|deg|px)$", "", str(path[-1])) not in (*_UPPER, *_LOWER):
        return problem
    cure = _cure_zone_of(records_on(data, path[:-1])[0])
    return replace(problem, hint=cure, fix=()) if cure else problem


def _cure_zone_of(value: Any) -> str:
    """Two limits of a zone, by their names or in a list, as bias and half-width; empty for anything else."""
    if isinstance(value, dict):
        given = {re.sub(r"_(mm|deg|px)$", "", str(name)): each for name, each in value.items()}
        value = [next((given[name] for name in names if name in given), None) for names in (_UPPER, _LOWER)]
        if "minus" in given and isinstance(value[1], int | float):
            value[1] = -abs(value[1])
    if not isinstance(value, list) or len(value) != 2 or any(isinstance(each, list) for each in value):
        return ""
    if not is_numeric(value) or value[0] == value[1]:
        return ""
    return cure_zone(*map(float, value))


def _merge(problems: list[Problem]) -> list[Problem]:
    """One problem per pointer: the branches of a union each complain about the same value.

    ``expected a number`` and ``expected a list`` become one sentence; where one branch got as far as the
    value's own entries, the branch that wanted something else altogether is silent.
    """
    by_pointer: dict[str, Problem] = {}
    for problem in problems:
        first = by_pointer.setdefault(problem.pointer, problem)
        if first is problem or "; got " not in problem.detail or first.detail == problem.detail:
            continue
        if problem.code == "too-short":  # a list where a list is welcome, too short: says more than its type
            by_pointer[problem.pointer] = problem
        elif problem.code == "wrong-type" and first.code in ("wrong-type", "unknown-value"):
            wanted = first.detail.split("; got ")[0]
            also = problem.detail.split("; got ")[0].removeprefix("expected ")
            if also not in wanted:
                detail = f"{wanted} or {also}; got {problem.detail.split('; got ', 1)[1]}"
                by_pointer[problem.pointer] = replace(first, detail=detail)
    deeper = {parent for pointer in by_pointer for parent in _parents(pointer)}
    shapes = {p.pointer for p in by_pointer.values() if p.hint in _SHAPES.values()}  # say what each row would say again
    return [
        p
        for p in by_pointer.values()
        if (p.pointer not in deeper or p.code not in ("wrong-type", "unknown-value"))
        and not shapes & set(_parents(p.pointer))
    ]


def _parents(pointer: str) -> list[str]:
    steps = pointer.split("/")
    return ["/".join(steps[:count]) for count in range(1, len(steps))]


def _translate(entry: Any, root: type[BaseModel], data: Any) -> Problem:
    raw: tuple[str | int, ...] = entry["loc"]
    # the name of an unknown field is the user's own and may look like anything, a branch included
    known = raw[:-1] if entry["type"] == "extra_forbidden" else raw
    path = [step for step in known if not (isinstance(step, str) and (step in _TAGS or _is_branch(step)))]
    path += raw[len(known) :]
    kind, value, context = entry["type"], entry.get("input"), entry.get("ctx", {})
    if kind == "extra_forbidden":
        return _refuse_unknown(raw, path, value, root, data)
    field = next((step for step in reversed(path) if isinstance(step, str)), "")
    if kind == "missing" and isinstance(path[-1], int):
        count = len(get_args(_kind_at(raw[:-1], root)))
        rule = f"needs {count} entries" if count else "the list has too few entries"
        return Problem(write_pointer(path[:-1]), "too-short", f"{rule}; got {show(value)}", _cure_matrix(field, value))
    if kind == "missing":
        return Problem(write_pointer(path), "missing-field", f"the field {path[-1]!r} is required", _example(raw, root))
    problem, hint = describe_value(entry, path), ""
    if problem.code == "wrong-type" and kind in _WANTED:
        if value in (float("inf"), float("-inf")):
            return Problem(write_pointer(path), "out-of-range", "the number is too large")
        owner = _model_at(raw, root)
        if owner is not None and kind.startswith("model"):
            hint = "fields: " + ", ".join(info.alias or name for name, info in owner.model_fields.items())
            hint = _cure_intrinsics(path[-1], value) or hint
        if kind == "string_type" and isinstance(value, int | float):
            hint = "put it in quotes"
        if isinstance(value, str) and (numbers := _list_numbers(value)):
            hint = hint or _cure_matrix(field, numbers)
        if "half_width" in field:
            hint = hint or _cure_zone_of(value)
    elif kind in ("too_short", "too_long"):
        most = context.get("max_length")
        hint = _cure_matrix(field, value) or (cure_list(value, most) if kind == "too_long" and most else "")
    elif kind in ("wrong-type", "view-geometry", "unknown-value", "feature-kind"):
        arrived = value.get("kind", value) if kind == "feature-kind" and isinstance(value, dict) else value
        problem = replace(problem, detail=f"{problem.detail}; got {show(arrived)}")
    if problem.code == "unknown-value":
        if meant := re.fullmatch(r"did you mean (\S+)\?", problem.hint):
            return replace(problem, fix=(Edit("replace", problem.pointer, meant[1]),))
        info = _field_at(raw, root)
        if not isinstance(value, str) or not problem.hint:
            words = (info and info.description) or ""  # what each word of a choice means, where its field says it
            hint = words if len(re.findall(r"\w+(?: \(default\))?: ", words)) > 1 else ""
            problem = replace(problem, hint="")
    return replace(problem, hint=problem.hint or hint)


def describe_value(entry: Any, path: Sequence[str | int]) -> Problem:
    """What one of pydantic's errors says of a value at a path, in our words: any but a field's absence or name."""
    kind, value, context, at = entry["type"], entry.get("input"), entry.get("ctx", {}), write_pointer(path)
    field = next((step for step in reversed(path) if isinstance(step, str)), "")
    if isinstance(value, Vast):
        return Problem(at, "out-of-range", f"the number is too large; got {show(value)}")
    if kind in _WANTED:
        hint = cure_text(value, field) if isinstance(value, str) and "number" in _WANTED[kind] else ""
        hint = hint or (cure_pair(value, field) if _WANTED[kind] == "a list" else "")
        if _WANTED[kind] == "a whole number" and isinstance(value, float) and value.is_integer():
            hint = f"write {value:.0f}"
        return Problem(at, "wrong-type", f"expected {_WANTED[kind]}; got {show(value)}", hint)
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        word = {"greater_than": "above", "greater_than_equal": "at least", "less_than": "below"}.get(kind, "at most")
        limit = next(context[key] for key in ("gt", "ge", "lt", "le") if key in context)
        limit_text = f"{limit:g}" if isinstance(limit, float) else limit
        hint = cure_range(value, field, **{"most" if kind.startswith("less") else "least": limit})
        return Problem(at, "out-of-range", f"must be {word} {limit_text}; got {show(value)}", hint)
    if kind == "finite_number":
        return Problem(at, "not-finite", f"must be a finite number; got {show(value)}")
    if kind in ("literal_error", "enum"):
        words = str(context.get("expected", ""))
        known = words.replace("'", "").replace(" or ", ", ").split(", ")
        hint = _BEAMS.get(str(value).upper(), "") if field == "orientation" else ""
        if not any(map(str.isdigit, words)):
            hint = hint or ask_meant(str(value), known)
        elif isinstance(value, str) and value.strip() in known:
            hint = f"without quotes: {value.strip()}"
        return Problem(at, "unknown-value", f"must be {words}; got {show(value)}", hint)
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        word = "at least " if kind == "too_short" else "" if context.get("field_type") == "Tuple" else "at most "
        many = f"{word}{bound} {'entry' if bound == 1 else 'entries'}"
        return Problem(at, kind.replace("_", "-"), f"needs {many}; got {show(value)}")
    if kind in ("string_too_short", "string_too_long", "string_pattern_mismatch"):
        most, pattern = context.get("max_length"), str(context.get("pattern"))
        sizes = {"string_too_short": "must not be empty", "string_too_long": f"has at most {most} characters"}
        detail = sizes.get(kind) or PATTERNS.get(pattern, "is not of the form that is asked for")
        return Problem(at, "bad-text", f"the text {detail}; got {show(value)}")
    inside = [step for step in str(context.get("at", "")).split("/") if step]
    return Problem(write_pointer([*path, *inside]), kind.replace("_", "-"), entry["msg"], str(context.get("hint", "")))


_BEAMS = {  # orientations that have no name here
    "PA": "it is AP the other way round: beam_direction: [0, -1, 0] instead of orientation",
}
_SHAPES = {  # of matrices that were written into a field for another, rows and columns
    ("transform", 3, 4): "a transform has four rows: add [0, 0, 0, 1]",
    ("transform", 3, 3): "a rotation goes under rotation: {rotation: [[...], [...], [...]], translation_mm: [x, y, z]}",
    ("projection", 4, 4): "a projection has three rows of four; a pose goes under pose, beside intrinsics",
    ("rotation", 4, 4): "a rotation has three rows of three; give all four rows as the transform itself",
}
_ROWS = {  # of matrices whose number of rows is right, columns
    ("transform", 3): "a row of a transform is [r, r, r, t]: the fourth number is the translation in mm",
    ("projection", 3): "a projection has three rows of four; a matrix of the camera goes under intrinsics",
    ("rotation", 4): "a rotation has three rows of three; the fourth column goes under translation_mm",
}


def _cure_matrix(field: str, value: Any) -> str:
    """What to do with a matrix, or a row of one, of another shape than the field's."""
    if not isinstance(value, list | tuple) or not value:
        return ""
    kind = "transform" if field.startswith("T_") or field == "pose" else field
    if kind == "projection" and _list_widths(value) == [1] * len(value):
        value = [row[0] for row in value]  # a column
    if not any(isinstance(row, list | tuple) for row in value):
        return _cure_flat(kind, value)
    widths = _list_widths(value)
    if kind == "projection" and widths == [3] * 4:
        rows = write_value(list(zip(*value, strict=True)))
        return f"a matrix of 4 x 3 is MATLAB's, for rows (X, Y, Z, 1) on its left: transposed it is {rows}"
    return _SHAPES.get((kind, len(value), widths[0]), "") if len(set(widths)) == 1 else ""


def _list_widths(rows: Sequence[Any]) -> list[int]:
    return [len(row) if isinstance(row, list | tuple) else 0 for row in rows]


def _cure_intrinsics(field: str | int, value: Any) -> str:
    """The fields that a camera matrix K is, given row by row, or transposed as MATLAB has it."""
    if field != "intrinsics" or not is_numeric(value) or not isinstance(value, list) or _list_widths(value) != [3] * 3:
        return ""
    rows = [list(row) for row in zip(*value, strict=True)] if value[0][2] == value[1][2] == 0 else value
    (fx, skew, cx), (below, fy, cy), last = rows
    if below or last != [0, 0, 1]:
        return "a camera matrix is [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]; focal_px is [fx, fy]"
    more = f", skew_px: {skew:.12g}" if skew else ""
    return (
        f"a camera matrix is written as its fields: {{focal_px: [{fx:.12g}, {fy:.12g}], principal_point_px: "
        f"[{cx:.12g}, {cy:.12g}]{more}}}"
    )


def _cure_flat(kind: str, value: Sequence[Any]) -> str:
    """What to do with a matrix that is written as one list, or with a row of one."""
    if kind in ("projection", "transform") and len(value) == 11:
        return write_dlt(value, "" if kind == "projection" else " and go under projection, without intrinsics")
    if (kind, len(value)) == ("projection", 16):
        return _SHAPES["projection", 4, 4]
    shape, width = {
        ("projection", 12): ("three rows of four", 4),
        ("transform", 12): ("four rows of four", 4),
        ("transform", 16): ("four rows of four", 4),
        ("rotation", 9): ("three rows of three", 3),
    }.get((kind, len(value)), ("", 1))
    if not shape:
        return _ROWS.get((kind, len(value)), "")
    count, last = len(value) // width, [0, 0, 0, 1]
    ways = {
        "row after row (C, NumPy)": [list(value[width * k : width * (k + 1)]) for k in range(count)],
        "column after column (MATLAB, Fortran)": [list(value[k::count]) for k in range(count)],
    }
    if kind == "transform":
        whole = {way: rows if count == 4 else [*rows, last] for way, rows in ways.items()}
        ways = {way: rows for way, rows in whole.items() if rows[3] == last} or whole
    text = "; ".join(f"{way} it is {write_value(rows)}" for way, rows in ways.items())
    return f"a {kind} has {shape}: written {text}"


def write_dlt(coefficients: Sequence[Any], more: str = "") -> str:
    """Eleven DLT coefficients as the projection that they are."""
    rows = write_value([coefficients[:4], coefficients[4:8], [*coefficients[8:], 1]])
    return f"eleven DLT coefficients are three rows of four whose last number is 1{more}: {rows}"


def _list_numbers(text: str) -> list[float]:
    """The numbers of a text that holds nothing else."""
    try:
        return [float(each) for each in re.split(r"[\s,;\[\]()]+", text.strip(" \n,;[]()"))]
    except ValueError:
        return []


def _is_branch(step: str) -> bool:
    """Steps that pydantic adds for the branch of a union; no field of ours looks like one."""
    return "[" in step or step.startswith(("constrained-", "tuple", "function-")) or step in ("float", "int", "str")


def _model_at(raw: Sequence[str | int], root: type[BaseModel]) -> type[BaseModel] | None:
    """The class of the record at an error's path, tags included."""
    here = _kind_at(raw, root)
    return here if isinstance(here, type) and issubclass(here, BaseModel) else None


def _kind_at(raw: Sequence[str | int], root: type[BaseModel]) -> Any:
    """What stands at an error's path, tags included; None where no record has such a field."""
    here: Any = root
    for step in raw:
        if isinstance(step, str) and step in _TAGS:
            here = _TAGS[step]
        elif isinstance(here, type) and issubclass(here, BaseModel):
            fields = {(info.alias or name): info for name, info in here.model_fields.items()}
            if step not in fields:
                return None
            here = fields[str(step)].annotation
        else:
            inside = get_args(here) if isinstance(step, int) else ()
            here = inside[0] if inside else None
        here = _unwrap(here)
    return here


def _unwrap(kind: Any) -> Any:
    """Strip Annotated and None; a union of several records stays for its tag to decide."""
    while True:
        if get_origin(kind) is Annotated:
            kind = get_args(kind)[0]
        elif get_origin(kind) in (Union, type(int | str)):
            rest = [part for part in get_args(kind) if part is not type(None)]
            if len(rest) != 1:
                return kind
            kind = rest[0]
        else:
            return kind


def _refuse_unknown(
    raw: Sequence[str | int], path: list[str | int], value: Any, root: type[BaseModel], data: Any
) -> Problem:
    name, fix = str(path[-1]), None
    owner = _model_at(raw[:-1], root)
    fields = [] if owner is None else [info.alias or key for key, info in owner.model_fields.items()]
    others = {field for kind in VIEW_KINDS.values() for field in kind.model_fields}
    if name.isdecimal() and value is None:
        hint = "if it is the decimals of the number before it, write that number with a point, as in 0.05"
    elif name == "<<":
        hint = "merge keys are not part of YAML 1.2: write the fields out"
    elif owner in VIEW_KINDS.values() and name in others:
        kind = next(tag for tag, view in VIEW_KINDS.items() if view is owner).strip("<>")
        hint = f"a view by {kind} does not take it: give one kind of geometry"
    else:
        known = "fields known here: " + ", ".join(fields) if fields else ""
        own, around = records_on(data, path[:-1])
        hint, fix = cure_name(name, fields, value, own, around, known)
    edits: tuple[Edit, ...] = ()
    if fix is not None:
        edits = (Edit("remove", write_pointer(path)), Edit("add", write_pointer([*path[:-1], fix.field]), fix.value))
    detail = f"unknown field {name[:60]!r}; got {show(value)}"
    return Problem(write_pointer(path), "unknown-field", detail, hint, fix=edits)


def records_on(data: Any, path: Sequence[str | int]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The record at a path, and what it and those around it say: the nearest counts, a preset says what it states."""
    own: dict[str, Any] = {}
    around: dict[str, Any] = {}
    for step in (None, *path):
        try:
            data = data if step is None else data[step]
        except (KeyError, IndexError, TypeError):
            return {}, around
        own = data if isinstance(data, dict) else {}
        if isinstance(preset := own.get("preset"), str) and preset in PRESETS:
            around |= {name: each for name in _OF_PRESETS if (each := getattr(PRESETS[preset], name)) is not None}
        around |= own
    return own, around


_OF_PRESETS = ("source_detector_mm", "source_isocentre_mm", "pixel_mm", "image_size_px")


def _example(raw: Sequence[str | int], root: type[BaseModel]) -> str:
    """What to write in the field at an error's path."""
    info = _field_at(raw, root)
    return "" if info is None else f"{raw[-1]}: {info.examples[0]}" if info.examples else info.description or ""


def _field_at(raw: Sequence[str | int], root: type[BaseModel]) -> FieldInfo | None:
    """The field at an error's path, or that which holds what is there."""
    for end in range(len(raw), 0, -1):
        owner = _model_at(raw[: end - 1], root)
        for key, info in describe_fields(owner).items() if owner is not None else ():
            if (info.alias or key) == raw[end - 1]:
                return info
    return None
