"""What somebody probably meant: the nearest name, the number behind a comma, a percentage or another unit.

Every refusal of a name or a number asks here, so that a slip gets the same cure in a design, a policy, an option and a
query.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from .field_names import convert_text, cure_name, read_name
from .tables import read_table

_WORDS = read_table("words")
_SYNONYMS: dict[str, str] = _WORDS["synonyms"]  # words of the trade for what a document calls otherwise
_OTHER_LAWS: dict[str, str] = _WORDS["laws"]  # words in the name of a law that none of ours is, and what comes nearest
_COMMA = re.compile(r"\s*([-+]?\d+),(\d+)\s*")
_THOUSANDS = re.compile(r"\s*([-+]?[0-9]{1,3})((?:[ .,'\u2019\u00a0\u202f][0-9]{3})+)(?:([.,])([0-9]+))?\s*")
_ZONE = re.compile(r"\s*([-+]?[0-9.,]+)\s*(?:mm|deg|°|px)?\s*[/;| ]\s*([-+]\s*[0-9.,]+|0)\s*(?:mm|deg|°|px)?\s*")
_EITHER_WAY = re.compile(  # value, half-width, unit
    r"\s*([-+]?[0-9.,]+)?\s*(?:mm|deg|°|px)?\s*(?:±|∓|\+ ?/? ?-|- ?/? ?\+)\s*([0-9.,]+)?\s*(mm|deg|°|px)?\s*"
)
_BOUND = re.compile(  # one number of a drawing: sign, value, unit, and a word
    r"\s*(max\.?|<=?|≤|Ø|⌀)?\s*([0-9.,]+)\s*(mm|deg|°|px)?\s*(max\.?|maximum)?\s*", re.IGNORECASE
)
_QUANTITY = re.compile(r"\s*([-+]?(?:(?:0|[1-9]\d*)\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.,:_][^\d]*?\d?)?\s*")
_PERCENT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+))\s*%\s*")
_DIAMETER = re.compile(  # as a drawing has one: sign, number, fit or maximum material, datums
    r"\s*([Ø⌀])?\s*(\d+(?:\.\d+)?)\s*(?:mm)?\s*(?:(\(M\)|Ⓜ)|([A-Za-z]{1,2}\d{1,2}(?:\s*/\s*[a-z]{1,2}\d{1,2})?))?(?:[\s|]+[A-Z])*\s*"
)
_FRACTION = re.compile(r"""(?:(\d+)[ -])?(\d+)/([1-9]\d*)(?=\s*(?:in\b|["″”]))""")
_MARKS = re.compile(  # of degrees, minutes, seconds or inches
    r"""\s*(?:(\d+(?:\.\d+)?)\s*°)?\s*(?:(\d+(?:\.\d+)?)\s*['′’])?\s*(?:(\d*\.?\d+)\s*["″”])?\s*"""
)
_LENGTH = r"""([-+]?\s*\d*\.?\d+)\s*(mm|in|um|µm|μm|["″”])?"""
_PAIR = re.compile(rf"\s*(±|\+/-)?\s*{_LENGTH}(?:\s*[\s/;,x×*]\s*{_LENGTH})?\s*")
_LIMITS = ("height_mm", "hole_mm", "pin_mm")
_LARGEST_PERCENT = 100.0
_LARGEST_WHOLE = 1e15  # that is written in digits alone
_LONGEST_SLIP = 60  # characters; what is longer is no number that somebody typed


def find_nearest(name: str, known: Iterable[str]) -> list[str]:
    """The name that ``name`` may be a slip of, if one is.  Case, spaces, hyphens and underlines do not count."""
    names: dict[str, str] = {}
    for each in known:
        names.setdefault(_plain(each), each)
    names |= {word: name for word, name in _SYNONYMS.items() if name in names.values() and word not in names}
    plain = _plain(name)
    return [names[each] for each in ([plain] if plain in names else get_close_matches(plain, names, 1))]


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]+", "", name[:200]).casefold() or name


def ask_label(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """``did you mean NAME?`` for what people call things, and for verbs; or what is said where none is near."""
    nearest = find_nearest(name, known)
    return f"did you mean {nearest[0]}?" if nearest else otherwise


def ask_meant(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """``did you mean NAME?`` for a name that means something: a field, an option, a word of a choice.

    One that differs in what it means is not offered as if it were the same: it is said what happens to its number, or
    what is nearest to another law.  ``otherwise``: what is said where none is near."""
    known = list(known)
    plain = {_plain(each): each for each in known}
    if (meant := plain.get(_plain(name), "") or _SYNONYMS.get(_plain(name), "")) in known:
        return f"did you mean {meant}?"
    law = _plain(re.sub("[ _-]*(distribution|distributed|law)$", "", name[:200]))
    if "normal" in known:
        if law in plain:
            return f"did you mean {plain[law]}?"
        for words, said in _OTHER_LAWS.items():
            if any(word in law for word in words.split()):
                return said.replace("WIDEST", "bounded" if "bounded" in known else "uniform")
    text, reading = cure_name(name, known)[0], read_name(name)
    return otherwise if reading.mark and not reading.unit else text or otherwise


def cure_zone(upper: float, lower: float) -> str:
    """A zone between two limits as what a tolerance is here: where its middle is, and half of its width."""
    middle, half = (upper + lower) / 2, abs(upper - lower) / 2
    numbers = f"bias {middle:.12g}, half-width {half:.12g}"
    return f"the middle of the zone into bias, half of it into the half-width: {numbers}"


def _read_decimal(text: str) -> float | None:
    if re.fullmatch(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}", text):  # thousands, or decimals
        return None
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return None


def _cure_zone_text(text: str, field: str) -> str:
    """``+0.1/-0`` and ``±0.05`` as a tolerance is written here; empty for other texts, and for another unit."""
    text, own = text.strip(" ()"), re.search("_(mm|deg|px)$", field)
    if match := _EITHER_WAY.fullmatch(text):
        before, after, unit = match.groups()
        value, half = (None if each is None else _read_decimal(each) for each in (before, after))
        if after is None:  # 0.05 ±
            value, half = None, value
        if half is None or half < 0 or (after and before and value is None):
            return ""
        if own and unit and own[1] != unit.replace("°", "deg"):
            return ""
        if "half_width" in field:
            return f"a half-width stands alone: write {half:.12g}"
        if re.search(r"noise|(^|_)sd(_|$)|std", field):
            return f"if ±{half:.12g} is one standard deviation, write {half:.12g}"
        remark = f"±{half:.12g} is a tolerance, whose place is a half-width: {half:.12g}"
        if value is None:
            return f"{remark}; the value itself goes here"
        return f"the value alone: write {value:.12g}; {remark}"
    if "half_width" in field and (match := _BOUND.fullmatch(text)) and (match[1] or match[4]):
        value, unit = _read_decimal(match[2]), match[3]
        if value is None or (own and unit and own[1] != unit.replace("°", "deg")):
            return ""
        if (match[1] or "").lower() in ("ø", "⌀"):
            return f"a zone of diameter {value:.12g} has the half-width {value / 2:.12g}"
        return f"a half-width is the largest deviation to either side: write {value:.12g}"
    stated = read_name(field)
    if stated.spread in ("", "half-width") and (match := _ZONE.fullmatch(text)):
        first, second = (_read_decimal(each.replace(" ", "")) for each in match.groups())
        return "" if first is None or second is None else cure_zone(max(first, second), min(first, second))
    return ""


def _cure_marks(text: str, field: str) -> str:
    """``6'``, ``0°6'30"`` and ``0.001"`` as numbers of this field's unit, ``Ø6`` without its sign; empty for others."""
    drawn = _DIAMETER.fullmatch(text) if re.search("diameter|true_position", field) else None
    if drawn and (drawn[1] or drawn[3] or drawn[4]):
        rest = "; (M) is at_maximum_material: true" if drawn[3] else ""
        if drawn[4]:
            rest = f"; {drawn[4]} goes under fit, as H7/g6"
        return f"the number alone: write {drawn[2]}{rest}"
    match = _MARKS.fullmatch(text)
    if match is None or not (match[2] or match[3]):
        return ""
    degrees, minutes, seconds = (float(each or 0) for each in match.groups())
    if field.endswith("_deg"):
        return f"it is in deg, and 1' is 1/60 deg: write {degrees + minutes / 60 + seconds / 3600:.9g}"
    inches = field.endswith("_mm") and match[3] and not (match[1] or match[2])
    return f'it is in mm, and 1" is 25.4 mm: write {25.4 * seconds:.9g}' if inches else ""


def cure_pair(value: Any, field: str) -> str:
    """Limits of a drawing (``+0.02/-0``, ``±0.01``) and sides (``80 x 60``), in mm or not, as a list."""
    if field not in ("size_mm", *_LIMITS):
        return ""
    shape = "sides are [along, across]" if field == "size_mm" else "limits are [upper, lower]"
    text = re.sub("[−–]", "-", str(value)[:_LONGEST_SLIP])
    match = _PAIR.fullmatch(text if field == "size_mm" else text.replace(",", "."))
    if match is None or (field == "size_mm" and match[4] is None):
        return f"{shape}, mm"
    unit = match[5] or match[3] or "mm"
    factor = {"m": 1.0, "u": 1e-3, "µ": 1e-3, "μ": 1e-3}.get(unit[0], 25.4)
    first, *others = (factor * float(re.sub(r"\s", "", each)) for each in (match[2], match[4]) if each)
    if field != "size_mm":
        second = others[0] if others else 0.0 if match[2][0] in "+-" and not match[1] else -first
        first, others = max(first, second) + 0.0, [min(first, second) + 0.0]
    said = "" if unit == "mm" else f"1{' ' if unit.isalpha() else ''}{unit} is {factor:g} mm: "
    return f"{shape}: {said}write [{first:.9g}, {others[0]:.9g}]"


def _cure_thousands(text: str) -> str:
    """A number whose thousands are separated; empty where one separator may as well be a decimal point."""
    match = _THOUSANDS.fullmatch(text)
    if match is None:
        return ""
    whole, groups, mark, decimals = match.groups()
    marks = {each for each in groups if not each.isdigit()}
    if len(marks) > 1 or mark in marks or (mark is None and len(groups) == 4 and marks <= {",", "."}):
        return ""
    number = whole + "".join(each for each in groups if each.isdigit()) + (f".{decimals}" if mark else "")
    return f"a number has no separators of thousands: write {number}"


def cure_text(text: str, field: str) -> str:
    """What to write instead of a text where a number is wanted; empty where the text tells nothing or is no slip."""
    if len(text) > _LONGEST_SLIP:
        return ""
    text = _FRACTION.sub(lambda each: f"{int(each[1] or 0) + int(each[2]) / int(each[3]):.9g}", text)
    if cure := _cure_zone_text(text, field) or _cure_thousands(text) or _cure_marks(text, field):
        return cure
    if match := _COMMA.fullmatch(text):
        whole, decimals = match.groups()
        if len(decimals) == 3 and whole.lstrip("+-").strip("0"):
            return f"a number has no comma: write {whole}.{decimals.rstrip('0') or '0'} or {whole}{decimals}"
        return f"write decimals with a point: {whole}.{decimals}"
    unit = read_name(field).unit
    if match := _PERCENT.fullmatch(text):
        value = float(match[1])
        if "percent" in field:
            return f"the field is in per cent: write {value:g}"
        if unit is not None and unit.powers:
            return f"the field is in {unit}, and of what this is a share is not said"
        return f"a fraction is a number without a sign: {value:g} % is {value / 100:.6g}"
    plain = "no quotes, leading zeros or units"
    if match := _QUANTITY.fullmatch(text):
        number, given = match.groups()
        if not given:
            value = float(number)
            spelt_out = "e" in number.lower() and value.is_integer() and abs(value) < _LARGEST_WHOLE
            return f"{plain}: write {f'{value:.0f}' if spelt_out else number}"
        if cure := convert_text(number, given, field):
            return f"{plain}: {cure}"
    return f"{plain}: the unit is in the field's name" if any(map(str.isdigit, text)) else ""


def cure_range(value: Any, field: str, *, least: float | None = None, most: float | None = None) -> str:
    """What to write instead of a number below ``least`` or above ``most``; empty where nothing is likely."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return ""
    if most is not None and most <= 1 < value <= _LARGEST_PERCENT and read_name(field).unit is None:
        return f"it is a fraction: {value:g} % is {value / 100:.6g}"
    if least is not None and field.endswith("_mm") and least >= 1 and least <= 1000 * value < 1000 * least:
        return f"it is in mm: {value:g} m is {value * 1000:g} mm"
    bound = abs(least or 0.0) if most is None else most
    if field.endswith("_mm") and bound >= 1e4 and bound < abs(value) <= 1000 * bound:
        return f"it is in mm: {value:g} \N{MICRO SIGN}m is {value / 1000:g} mm"
    return ""


def cure_list(values: Any, wanted: int) -> str:
    """What to write instead of a list of numbers that has more entries than ``wanted``."""
    if isinstance(values, list | tuple) and wanted < len(values) <= 2 * wanted and {*map(type, values)} == {int}:
        first, second = values[:2]
        if second < 0:  # no decimals have a sign
            return ""
        return f"commas separate entries: if {first},{second} is one number, write it with a point, {first}.{second}"
    return ""
