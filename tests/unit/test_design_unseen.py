"""What a reviewer takes for a remark is no part of a document: the parser sees no lines that Git does not show."""

from __future__ import annotations

import sys
import unicodedata

import pytest

from tailstack.design import DEFAULT_LIMITS
from tailstack.design.reading import read_text
from tailstack.design.write import data_to_yaml, dump_flow
from tailstack.errors import DesignError

# Every character that is not shown as a sign of its own, with neighbours of every kind
UNSEEN = [
    chr(number)
    for number in range(sys.maxunicode + 1)
    if unicodedata.category(chr(number)) in ("Cc", "Cf", "Zl", "Zp", "Zs") or number in (0xFFFE, 0xFFFF)
]
ENDS = ("\n", "\r")  # of lines, in YAML 1.2
REFUSED = [
    *"\x85\u2028\u2029",
    *map(chr, (0x200E, 0x200F, 0x061C, 0xFEFF, *range(0x202A, 0x202F), *range(0x2066, 0x206A))),
]
OUTSIDE = {
    "a remark": ("a: 1\n# x{}b: 2\n", {"a": 1}),
    "a remark behind a value": ("a: 1 # x{}b: 2\n", {"a": 1}),
    "a remark in brackets": ("a: [1, # x{}2,\n 3]\n", {"a": [1, 3]}),
    "a remark at the end": ("a: 1\n# x{}", {"a": 1}),
}
TEXTS = {
    "plain": ("a: x{}y\nb: 2\n", ""),
    "single quotes": ("a: 'x{}y'\nb: 2\n", "'"),
    "double quotes": ('a: "x{}y"\nb: 2\n', '"'),
    "a key": ("{{'x{}y': 1,\n b: 2}}\n", "'"),
    "a block": ("a: |-\n  x{}y\nb: 2\n", ""),
    "a folded block": ("a: >-\n  x{}y\nb: 2\n", ""),
}


def read(text: str):  # type: ignore[no-untyped-def]
    """The document, or its refusal, which names the character and its place."""
    try:
        return read_text(text, DEFAULT_LIMITS, file="d.yaml", directory=None, form="yaml")
    except DesignError as error:
        (problem,) = error.problems
        if problem.code == "unseen-character":
            at = next(
                k for k, c in enumerate(text) if f"U+{ord(c):04X} " in problem.detail and text[k : k + 2] != "\r\n"
            )
            before = text[:at].split("\n")
            assert (problem.line, problem.column) == (len(before), len(before[-1]) + 1)
            assert problem.hint
        return problem.code


@pytest.mark.parametrize("place", OUTSIDE)
def test_nothing_in_a_remark_is_live(place):
    pattern, meant = OUTSIDE[place]
    for sign in sorted({*UNSEEN, *REFUSED} - set("\n")):
        found = read(pattern.format(sign))
        assert found == "unseen-character" or (sign not in REFUSED and found.data == meant), ascii(sign)


@pytest.mark.parametrize("place", TEXTS)
def test_a_text_is_what_stands_there(place):
    """In quotes it holds what it holds, and outside of them what is not shown is refused."""
    pattern, quote = TEXTS[place]
    for sign in sorted({*UNSEEN, *REFUSED, *"é\ue000\U0001f4a9"} - set(ENDS)):
        found = read(pattern.format(sign))
        if found == "unseen-character":
            assert not (quote and sign in "\x85\u2028\u2029"), ascii(sign)
            continue
        assert quote or sign not in REFUSED, ascii(sign)
        values = [*found.data, *found.data.values()]
        assert f"x{sign}y" in values, ascii(sign)
        assert found.locate(("b",), key=True)[0] == (3 if "block" in place else 2)


def test_line_ends_are_those_of_yaml_and_git():
    for end in ("\n", "\r\n", "\r"):
        source = read(f"a: 1{end}# x{end}b: [1,{end} 2]{end}")
        assert source.locate(("b", 1)) == (4, 2)
    for text in ("a: 1\n# x\rb: 2\n", "a: 'x\ry'\nb: 1\n", "a: 1\r\n# x\rb: 2\r\n"):
        assert read(text) == "unseen-character"


def test_as_many_stand_ins_as_are_wanted():
    """Characters that a text holds already are not taken for those that it must not be read by."""
    taken = "".join(map(chr, range(0xE000, 0xF900)))
    assert read(f'a: "{taken}\u2028{taken}\x85"\n').data == {"a": f"{taken}\u2028{taken}\x85"}


def test_json_is_read_as_json_and_has_places():
    text = '{"a": "x\u2028y\x85",\n "b": 1}'
    source = read_text(text, DEFAULT_LIMITS, file="d.json", directory=None, form="json")
    assert source.data == {"a": "x\u2028y\x85", "b": 1}
    assert source.locate(("b",)) == (2, 7)


def test_what_is_not_shown_is_written_as_an_escape_and_comes_back():
    for sign in sorted({*UNSEEN, *REFUSED} - {"\n"}):
        for value in (f"x{sign}y", sign, f"{sign} x ", [f"x{sign}", "y"], {f"k{sign}": f"{sign}"}):
            for text in (data_to_yaml({"a": value}), f"a: {dump_flow(value)}\n"):
                assert read(text).data == {"a": value}, ascii(text)
                assert not set(text) & {*REFUSED}, ascii(text)
