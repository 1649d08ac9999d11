"""What the name of a field means, and what becomes of a number that stands under another name.

A name is read into its words, its unit, what of a spread it states, and how a matrix or a rotation is ordered.  A name
that differs from a field's in its letters alone is a slip of it.  One that differs in what it means is no slip: its
number is converted, or it is said that it cannot be, and what the field wants.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from math import isclose, pi, sqrt
from operator import mul, neg
from typing import Any, NamedTuple

from .laws import SUMS, count_sigmas
from .tables import read_table
from .units import Unit, read_unit

NOTHING: Any = object()  # the value of a name that stands alone: a column, an option
LARGEST = 1e300  # of numbers that are converted
LONGEST_NAME = 200
LONGEST_LINE = 400  # characters of a value that is printed
_Change = Callable[[Any], Any]

_WORDS = read_table("words")
_SAME: dict[str, str] = _WORDS["same"]  # words of the trade, and of the other side of an ocean
_SPREADS = _WORDS["spreads"]  # what of a spread is stated, by the words that say it
_SIGMAS = {
    "standard deviation": 1.0,
    "twice the standard deviation": 0.5,
    "three times the standard deviation": 1 / 3,
    "width at half maximum": 1 / sqrt(8 * 0.6931471805599453),
}
_MARKS = _WORDS["marks"]  # how numbers are ordered, or turned round
_ROTATIONS = _WORDS["rotations"]  # how a rotation is written
_FILLERS = {"value", "values", "number", "the", "of", "in", "to", "matrix"}
_TURNS = ("un", "non", "in", "im", "ab", "re", "de", "dis", "anti", "semi")  # beginnings that make another word of one
LAW_SIGMAS = {str(law): count_sigmas(law) for law in SUMS}  # standard deviations in a half-width


@dataclass(frozen=True, slots=True)
class NameReading:
    """A name, read."""

    stem: tuple[str, ...]
    unit: Unit | None
    spread: str
    mark: str
    rotation: str


class ValueChange(NamedTuple):
    """One thing that is otherwise under the other name."""

    words: str
    change: _Change | None  # of the value; None: it cannot be computed


class Renaming(NamedTuple):
    """A field that is meant by a name, and what becomes of its value."""

    field: str
    words: str  # what happens to the value; empty: the names differ in letters alone
    value: Any = NOTHING  # what it is then
    sure: bool = True  # the value is what was meant, not one of several, nor one that is supposed


def split_words(name: str) -> list[str]:
    """The words of a name in small letters, however they are joined."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name.replace("MN", "meganewton"))
    words = [word for word in re.split(r"[^\w%\N{DEGREE SIGN}^]+|_", text.casefold()) if word]
    return [each for word in words for each in _SAME.get(word, word).split()]


def _take(words: list[str], table: Mapping[str, Sequence[str]]) -> str:
    """The kind that some of the words say, which are taken out; empty: none."""
    phrases = [(phrase.split(), kind) for kind, said in table.items() for phrase in said]
    for phrase, kind in sorted(phrases, key=lambda each: -len(each[0])):
        for at in range(len(words) - len(phrase) + 1):
            if words[at : at + len(phrase)] == phrase:
                del words[at : at + len(phrase)]
                return kind
    return ""


def _takes_unit(before: list[str]) -> bool:
    """Whether a unit may follow this word: none does in max_of_n, and of deg_mm there is not one."""
    unit = read_unit(before)
    return before != ["of"] and (unit is None or unit.dimension != "angle")


@lru_cache(4096)
def read_name(name: str) -> NameReading:
    """What a name says: its words without unit and order, the unit at its end (or at its beginning), and so on."""
    words = split_words(name)
    rotation = _take(words, _ROTATIONS)
    spread = _take(words, _SPREADS)
    whole, mark = list(words), _take(words, _MARKS)
    if mark in ("swapped", "in order") and "image" not in words:  # its words say something else: the shape of a noise
        words, mark = whole, ""
    unit = None
    for at in range(0 if spread or rotation or mark or "per" in words else 1, len(words)):
        if _takes_unit(words[at - 1 : at]) and (unit := read_unit(words[at:])) is not None:
            del words[at:]
            break
    else:
        if len(words) > 1 and words[0] in ("mm", "cm", "um", "px", "deg", "rad", "mrad"):
            unit = read_unit(words[:1])
            del words[0]
    stem = tuple(word for word in words if word not in _FILLERS) or tuple(words) or ((rotation,) if rotation else ())
    if stem in ((), ("pixel",), ("pixels",)) and unit is not None and dict(unit.powers).get("length"):
        per_pixel = dict(unit.powers).get("image", 0) or "pixel" in "".join(stem)
        if per_pixel:  # of the pitch: mm, mm/px and px/mm are of one kind
            power = dict(unit.powers)["length"]
            return NameReading(("pixel",), unit._replace(powers=(("length", power),)), "", mark, "")
    if spread == "variance" and unit is not None and all(power % 2 == 0 for _, power in unit.powers):
        powers = tuple((each, power // 2) for each, power in unit.powers)
        unit = Unit(tuple(word.rstrip("2") for word in unit.words), sqrt(unit.factor), powers)
    if unit is None and stem == ("matrix",) and "stiff" in name.casefold():
        stem = ("stiffness",)  # whose unit would say that it is an inverse
    if not spread and "noise" in stem:
        spread = "standard deviation"
    return NameReading(stem, unit, spread, mark, rotation)


def is_slip(word: str, meant: str) -> bool:
    """Whether two words differ as slips of the finger do: by few letters, and in no number."""
    if word == meant:
        return True
    if sorted(filter(str.isdigit, word)) != sorted(filter(str.isdigit, meant)):
        return False
    if len(meant) <= 3:  # a code: of its letters each counts
        return sorted(word) == sorted(meant) and not meant.isalpha()
    if any(word.startswith(each) != meant.startswith(each) for each in _TURNS):
        return False
    return _distance(word, meant) <= max(1, len(meant) // 4)


def _distance(first: str, second: str) -> int:
    """Letters to add, leave out, change or swap with their neighbour, so that one word becomes the other."""
    before: list[int] = []
    row = list(range(len(second) + 1))
    for i, letter in enumerate(first, 1):
        last, row = row, [i]
        for j, other in enumerate(second, 1):
            least = min(row[-1] + 1, last[j] + 1, last[j - 1] + (letter != other))
            if i > 1 and j > 1 and letter == second[j - 2] and first[i - 2] == other:
                least = min(least, before[j - 2] + 1)
            row.append(least)
        before = last
    return row[-1]


def _likeness(stem: Sequence[str], meant: Sequence[str]) -> int | None:
    """0: the same words; 1: with slips; 2: some are left out; None: others."""
    if tuple(stem) == tuple(meant) or sorted(stem) == sorted(meant) or "".join(stem) == "".join(meant):
        return 0
    if len(stem) == len(meant) and all(map(is_slip, stem, meant)):
        return 1
    if len(stem) != len(meant) and min(map(len, meant), default=0) > 3 and _distance("".join(stem), "".join(meant)) < 2:
        return 1
    rest = list(meant)
    for word in stem:
        found = next((each for each in rest if is_slip(word, each) or (len(word) > 2 and each.startswith(word))), None)
        if found is None:
            return None
        rest.remove(found)
    return 2 if stem and (rest or len(stem) == len(meant)) else None


def _letters_of(name: str) -> str:
    """Of a name, however its words are joined and written."""
    return re.sub(r"[\W_]+", "", name).casefold()


def _is_whole_slip(words: Sequence[str], meant: Sequence[str]) -> bool:
    """Whether two names are the same but for slips, their units included, which are never slipped into another."""
    if "".join(words) == "".join(meant):
        return True
    return len(words) == len(meant) and all(map(is_slip, words, meant))


# --- what becomes of a value ------------------------------------------------------------------------------


def _each(change: Callable[[float], float]) -> _Change:
    """A change of each number of a value."""

    def apply(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [apply(entry) for entry in value]
        return change(value)

    return apply


def is_numeric(value: Any) -> bool:
    """Whether a value is a number that can be computed with, or lists of such numbers."""
    if isinstance(value, list | tuple):
        return bool(value) and all(map(is_numeric, value))
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST


def write_value(value: Any, digits: int = 12) -> str:
    """A value as a design has it, numbers with so many digits."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(write_value(each, digits) for each in value)}]"
    if not is_numeric(value):
        return str(value)
    text = f"{value + 0.0:.{digits}g}"
    return text if "." in text else text.replace("e", ".0e")  # 2e-06 is a text in YAML


def _round(value: Any) -> Any:
    """As it is written."""
    if isinstance(value, list | tuple):
        return [_round(entry) for entry in value]
    return value if isinstance(value, int) else float(f"{value + 0.0:.12g}")


def _invert(value: Any) -> Any:
    """One over a number; the inverse of a matrix.  Raises ValueError."""
    import numpy as np

    matrix = np.array(value, float)
    if matrix.ndim == 0:
        if not matrix:
            raise ValueError("no inverse")
        return 1 / float(matrix)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or np.linalg.cond(matrix) > 1e12:
        raise ValueError("no inverse")
    return np.linalg.inv(matrix).tolist()


def _transpose(value: Any) -> Any:
    if not isinstance(value, list | tuple) or not all(isinstance(row, list | tuple) for row in value):
        raise ValueError("no matrix")
    return [list(row) for row in zip(*value, strict=True)]


def _swap(value: Any) -> Any:
    first, second = value
    return [second, first]


def _change_unit(
    mine: Unit | None, theirs: Unit | None, field: str, value: Any, beside: Mapping[str, Any]
) -> list[ValueChange]:
    """From the unit of a name to that of a field."""
    if theirs is None and mine is not None and not mine.powers:
        if isclose(mine.factor, 1):
            return []
        return [ValueChange(f"1 {mine} is {mine.factor:.9g}", _each(partial(mul, mine.factor)))]
    if theirs is None:
        return [] if mine is None else [ValueChange(f"{field} is not in {mine}", None)]
    if mine is None:
        return [ValueChange(f"if its numbers are in {theirs}", _each(lambda x: x))]
    back = mine.invert()
    for unit, inverse in ((mine, False), (back, True)):
        powers, factor = unit.powers, unit.factor / theirs.factor
        if not (powers or inverse) and "per" in unit.words and theirs.dimension == "angle":  # a slope, mm_per_m
            powers, factor = theirs.powers, unit.factor * 180 / pi / theirs.factor
        if powers != theirs.powers:
            continue
        step = ValueChange(f"it is in {theirs}, and 1 {unit} is {factor:.9g} {theirs}", _each(partial(mul, factor)))
        if isclose(factor, 1, rel_tol=1e-12):
            step = ValueChange(f"it is in {theirs}, and 1 {unit} is as much", _each(lambda x: x))
        if not inverse:
            return [] if factor == 1 and unit.words == theirs.words else [step]
        what = "invert the matrix" if isinstance(value, list | tuple) else "take one over it"
        turn = ValueChange(f"{mine} is the inverse of {unit}: {what}", _invert)
        return [turn] if factor == 1 else [turn, step]
    pair = (mine.dimension, theirs.dimension)
    if pair in (("length", "image"), ("image", "length")):
        given = beside.get("pixel_mm")
        pixel = float(given) if isinstance(given, int | float) and not isinstance(given, bool) and given > 0 else None
        by = "pixel_mm, the pitch of the pixels" if pixel is None else f"pixel_mm, {pixel:.12g}"
        if field == "principal_point_px":
            return [_place_foot(mine.factor, pixel, beside.get("image_size_px"))]
        if pair[0] == "length":
            words = f"it is in px: as a length at the detector, {'' if mine.factor == 1 else 'in mm, '}divide by {by}"
            return [ValueChange(words, None if pixel is None else _each(partial(mul, mine.factor / pixel)))]
        words = f"it is in {theirs}: of a length at the detector, multiply by {by}"
        return [ValueChange(words, None if pixel is None else _each(partial(mul, pixel / theirs.factor)))]
    if set(pair) == {"angle", "length"}:
        words = f"it is in {theirs}: an angle cannot be converted into a length, nor a length into an angle"
        return [ValueChange(words, None)]
    return [ValueChange(f"it is in {theirs}, and {mine} cannot be converted into that", None)]


def _place_foot(factor: float, pixel: float | None, size: Any) -> ValueChange:
    """The principal point, of lengths from the image's corner or from its centre."""
    words = "it is in px, counted from the first pixel: divide by pixel_mm"
    if pixel is None or not isinstance(size, list | tuple) or len(size) != 2 or not is_numeric(size):
        return ValueChange(f"{words}; from the image's centre, add that", None)
    times = factor / pixel

    def change(value: Any) -> Any:
        found = [times * each for each in value]
        central = any(each < extent / 4 for each, extent in zip(found, size, strict=True))
        return [each + (extent - 1) / 2 * central for each, extent in zip(found, size, strict=True)]

    return ValueChange(f"{words}, {pixel:.12g}; what is small counts from the image's centre, as it seems", change)


def _change_spread(mine: str, theirs: str, beside: Mapping[str, Any]) -> list[ValueChange]:
    """From the spread that a name states to that of a field."""
    if mine == theirs or (not mine and theirs == "full width"):
        return []
    if not mine or not theirs:
        said = f"says nothing of a {mine}" if mine else f"is a {theirs}"
        return [ValueChange(f"the field {said}", None)]
    extents = {"half-width": 1.0, "full width": 2.0}
    if mine in extents and theirs in extents:
        times = extents[theirs] / extents[mine]
        return [ValueChange(f"{'half' if times < 1 else 'twice'} of it", _each(partial(mul, times)))]
    if mine == "variance":
        return [ValueChange("the root of it", _each(sqrt)), *_change_spread("standard deviation", theirs, beside)]
    if theirs == "standard deviation" and mine in _SIGMAS:
        return [ValueChange(f"{_SIGMAS[mine]:.6g} of it", _each(partial(mul, _SIGMAS[mine])))]
    law = beside.get("distribution")
    coverage = beside.get("coverage_factor", 2.0) if law == "normal" else LAW_SIGMAS.get(str(law))
    if isinstance(coverage, int | float) and "half-width" in (mine, theirs) and {mine, theirs} & _SIGMAS.keys():
        times = coverage * _SIGMAS.get(mine, 1.0) if mine in _SIGMAS else 1 / coverage
        words = f"of the law {law}, the half-width is {coverage:.9g} standard deviations"
        return [ValueChange(words, _each(partial(mul, times)))]
    if (mine, theirs) == ("root mean square", "standard deviation"):
        return [ValueChange("of each coordinate it is the same, of whole points divide by the root of 2", None)]
    if mine == "tolerance":
        return [ValueChange("to either side it is the same number, of a whole zone half of it", None)]
    return [ValueChange(f"a {mine} is not a {theirs}, and the law between them is not stated", None)]


def _change_mark(mine: str, theirs: str) -> list[ValueChange]:
    changes: dict[str, tuple[str, _Change]] = {
        "inverse": ("invert it", _invert),
        "transposed": ("transpose it, rows into columns", _transpose),
        "swapped": ("width first", _swap),
        "negative": ("with the other sign", _each(neg)),
    }
    return [ValueChange(*changes[mark]) for mark in (mine, theirs) if mark in changes] if mine != theirs else []


# --- rotations --------------------------------------------------------------------------------------------


def _rename_rotation(form: str, unit: Unit | None, value: Any, fields: Sequence[str]) -> Renaming | None:
    """A rotation in another form, as the quaternion that it is."""
    field = "quaternion_wxyz"
    if field not in fields:
        return None
    scale = (unit.factor if unit is not None and unit.dimension == "angle" else 1.0) * pi / 180
    words = _WORDS["rotation words"][form]
    count = 4 if form in ("wxyz", "xyzw", "quaternion") else 3
    if form == "euler":
        return Renaming("rotation_deg", words, sure=False)
    if not isinstance(value, list | tuple) or len(value) != count or not all(map(is_numeric, value)):
        return Renaming(field, words)
    if count == 4:
        turned = [*value[3:], *value[:3]] if form == "xyzw" else list(value)
        return Renaming(field, words, turned, form != "quaternion")
    if unit is None:
        return Renaming(field, f"{words}, once it is in degrees or radians")
    from scipy.spatial.transform import Rotation  # late: few names are those of a rotation

    angles = [scale * entry for entry in (value if form != "ypr" else value[::-1])]
    turn = Rotation.from_rotvec(angles) if form == "vector" else Rotation.from_euler("xyz", angles)  # about fixed axes
    return Renaming(field, words, _round(turn.as_quat(scalar_first=True).tolist()))


# --- the field that is meant ------------------------------------------------------------------------------


def find_renamings(
    name: str, fields: Iterable[str], value: Any = NOTHING, beside: Mapping[str, Any] | None = None
) -> list[Renaming]:
    """The fields that a name may be meant for, alike in likelihood, with what becomes of its value; empty: none.

    ``beside``: what stands in the same record, and in those around it: a pitch of pixels, a law.
    """
    name, known, beside = name[:LONGEST_NAME], list(fields), beside or {}
    mine, words = read_name(name), split_words(name)
    if mine.rotation and (found := _rename_rotation(mine.rotation, mine.unit, value, known)):
        return [found]
    ranked: list[tuple[tuple[int, int, int], Renaming]] = []
    for field in known:
        theirs = read_name(field)
        if sorted(filter(str.isdigit, "".join(mine.stem))) != sorted(filter(str.isdigit, "".join(theirs.stem))):
            continue
        between, likeness = _change_ends(mine, theirs, beside), _likeness(mine.stem, theirs.stem)
        turned = _change_frames(name, field)
        if turned or between:
            likeness = 0
        if _is_whole_slip(words, split_words(field)) or _letters_of(name) == _letters_of(field):
            ranked.append(((0 if words == split_words(field) else 1, 0, 0), Renaming(field, "", value)))
            continue
        if likeness is None or (not mine.stem and not mine.spread):
            continue
        if likeness == 2 and theirs.unit is None and not theirs.stem[0].startswith(mine.stem[0]):
            continue  # the end of a word of a choice is no abbreviation of it
        steps = _change_spread(mine.spread, theirs.spread, beside)
        steps += _change_unit(mine.unit, theirs.unit, field, value, beside)
        steps += between or turned or _change_mark(mine.mark, theirs.mark)
        if likeness == 2 and mine.spread and not theirs.spread:
            continue
        lost = sum(step.change is None for step in steps) + (theirs.unit is None and mine.unit is not None)
        ranked.append(((likeness, lost, len(steps)), _apply(field, steps, value)))
    best = min((rank for rank, _ in ranked), default=None)
    return [found for rank, found in ranked if rank == best]


def _apply(field: str, steps: Sequence[ValueChange], value: Any) -> Renaming:
    words = "; ".join(step.words for step in steps)
    sure = "if its numbers" not in words and "as it seems" not in words
    if any(step.change is None for step in steps):
        return Renaming(field, words, sure=False)
    if value is NOTHING or not steps:
        return Renaming(field, words, value, sure)
    if not is_numeric(value):
        return Renaming(field, words)
    try:
        for step in steps:
            assert step.change is not None
            value = step.change(value)
    except (ValueError, OverflowError, ZeroDivisionError, TypeError):
        return Renaming(field, f"{words}, which this value does not allow", sure=False)
    value = _round(value)
    if field.startswith("image_size"):
        value = [round(each) for each in value] if isinstance(value, list) else value
    return Renaming(field, words, value, sure)


def _change_ends(mine: NameReading, theirs: NameReading, beside: Mapping[str, Any]) -> list[ValueChange]:
    """A distance between other ends than the field's: from the isocentre to the detector."""
    ends = [set(reading.stem) for reading in (mine, theirs)]
    if ends != [{"isocentre", "detector"}, {"source", "isocentre"}]:
        return []
    whole = beside.get("source_detector_mm")
    if not isinstance(whole, int | float) or isinstance(whole, bool):
        return [ValueChange("source_detector_mm less it", None)]
    return [ValueChange(f"source_detector_mm, {whole:.12g}, less it", _each(lambda x: whole - x))]


def _change_frames(name: str, field: str) -> list[ValueChange]:
    """``T_ab`` for ``T_ba``."""
    mine, theirs = name.split("_"), field.split("_")
    if len(theirs) == 3 and theirs[0] == "T" and [mine[0].upper(), *mine[1:]] == ["T", theirs[2], theirs[1]]:
        return [ValueChange(f"{field} maps the other way: invert the matrix", _invert)]
    return []


def cure_name(
    name: str,
    fields: Iterable[str],
    value: Any = NOTHING,
    own: Mapping[str, Any] | None = None,
    around: Mapping[str, Any] | None = None,
    otherwise: str = "",
) -> tuple[str, Renaming | None]:
    """``did you mean NAME?``, what happens to the value, and the new line; the one renaming that can be carried out.

    ``own``: what stands in the same record; ``around``: that, and what the records around it say.
    """
    found = find_renamings(name, fields, value, around)
    if not found:
        return otherwise, None
    names, first = " or ".join(each.field for each in found[:3]), found[0]
    if len(found) > 1:
        return f"did you mean {names}?", None
    if first.field in (own or {}):
        return f"did you mean {names}, which stands there, too? Leave one of them", None
    return say_renaming(first, names), first if first.sure and first.value is not NOTHING else None


def say_renaming(renaming: Renaming, called: str) -> str:
    """``did you mean CALLED?``, what happens to the value, and the new line where it is known."""
    text, words = f"did you mean {called}?", renaming.words
    if words:
        text += " " + (words if "_" in words.split()[0] else words[0].upper() + words[1:])
        line = "" if renaming.value in (NOTHING, None) else write_value(renaming.value)
        if 0 < len(line) <= LONGEST_LINE:
            text += f": {called}: {line}"
        elif renaming.sure:
            text += ": convert the number, do not only rename it"
    return text


def convert_text(number: str, unit: str, field: str) -> str:
    """What to write for a number with a unit behind it, or why it cannot be converted; empty: it is no known unit."""
    mine, theirs = read_unit(split_words(unit.replace("/", " per "))), read_name(field).unit
    if mine is None:
        return ""
    steps = _change_unit(mine, theirs, field, 0.0, {})
    words = [step.words for step in steps]
    if all(step.change is not None for step in steps):
        words.append(f"write {write_value(_apply(field, steps, float(number)).value)}")
    return "; ".join(words)
