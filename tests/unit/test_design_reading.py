"""The reader of YAML and JSON: scalars by YAML 1.2, refusals and their places, bounds; nothing live is unseen.  And its
writer: of a text with some numbers changed those numbers, and not one character more."""

from __future__ import annotations

import copy
import difflib
import json
import math
import sys
import unicodedata
from functools import partial
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from plain_data import EXAMPLES, problems_of, read_cases
from tailstack.design import design_to_data, load_design
from tailstack.design.reading import DEFAULT_LIMITS, Limits, decode, plain_data, read_text, read_yaml, show
from tailstack.design.write import data_to_yaml, dump_flow
from tailstack.design.yaml_text import revise_yaml
from tailstack.errors import DesignError, LimitError


def read(text, form="auto", limits=DEFAULT_LIMITS):
    return read_text(text, limits, file="d.yaml", directory=None, form=form)


def refused(text, form="auto"):
    return problems_of(read, text, form)[0]


LOOP: dict[str, Any] = {}
LOOP["a"] = LOOP


# published: YAML 1.2.2, section 10.3.2, core schema; leading zeros and underscores are text here on purpose
SCALARS = {
    "0": 0, "-19": -19, "+12": 12, "0.": 0.0, "-0.0": -0.0, ".5": 0.5, "+12e03": 12000.0, "-2E+05": -2e5, "1e3": 1e3,
    "~": None, "null": None, "Null": None, "true": True, "False": False, "yes": "yes", "No": "No", "on": "on",
    "1:30": "1:30", "1_000": "1_000", "010": "010", "0o14": "0o14", "0x1F": "0x1F", "2001-12-14": "2001-12-14",
    "'1'": "1", '"true"': "true", "1.2.3": "1.2.3", ".": ".", "e5": "e5",
}  # fmt: skip


@pytest.mark.parametrize("text", SCALARS)
def test_scalars(text):
    value = read(f"a: {text}").data["a"]
    assert (value, type(value)) == (SCALARS[text], type(SCALARS[text]))


def test_infinities_arrive_as_such_and_are_refused_later():
    data = read("[.inf, -.Inf, .nan, 1e999, " + "9" * 5000 + "]").data
    assert [math.isfinite(value) for value in data] == [False] * 5


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [*read_cases("documents", "reading"), ("a:\n  ? " + "k" * 101 + "\n  : 1\n", "key-too-long", 2)],
)
def test_refusals(text, code, line):
    problem = refused(text)
    assert problem.code == code
    assert line is None or problem.line == line
    assert problem.file == "d.yaml"
    assert "\t" not in text or "tab" in problem.hint
    assert "examples/" not in problem.hint, "who installed it has none"


def test_json_has_lines_and_columns_and_is_read_as_json():
    problem = refused('{"a": 1,\n  "b": }', form="json")
    assert (problem.code, problem.line, problem.column) == ("json-syntax", 2, 8)
    text = '{"a": "x\u2028y\x85",\n "b": 1}'
    source = read_text(text, DEFAULT_LIMITS, file="d.json", directory=None, form="json")
    assert source.data == {"a": "x\u2028y\x85", "b": 1}
    assert source.locate(("b",)) == (2, 7)


def test_places_are_lines_and_columns_of_values_and_keys():
    source = read("a:\n  - b: 1\n    c: [1, 2]\n")
    assert source.locate(("a", 0, "c", 1)) == (3, 12)
    assert source.locate(("a", 0, "c"), key=True) == (3, 5)
    assert source.locate(("a", 0, "missing", 7)) == (2, 5)  # the nearest ancestor that is there
    assert read('{"a": [1,\n 2]}').locate(("a", 1)) == (2, 2)


@pytest.mark.parametrize(
    "content", [b"a: \xff\xfe", b"PK\x03\x04\x00\x00", "a: 1".encode("utf-16-le"), b"\xff\xfe\x00"]
)
def test_bytes_that_are_no_text(content):
    assert problems_of(decode, content, "f", error=DesignError)[0].code == "not-text"


@pytest.mark.parametrize(
    "nest",
    [
        lambda n: "[" * n + "]" * n,
        lambda n: '{"a":' * n + "1.5" + "}" * n,
        lambda n: '[{"a": [1, 2], "b":' * (n // 2) + '"x"' + "}]" * (n // 2),
    ],
)
def test_json_is_as_deep_and_as_large_as_plain_data_may_be(nest):
    """independent: the same data handed over, value by value."""

    def outcome(call):
        try:
            return call()
        except LimitError as error:
            return error.problems[0].detail

    for depth in range(2, 12):
        text = nest(depth)
        for limits in (Limits(depth=6), Limits(nodes=9), Limits(depth=6, nodes=9)):
            expected = outcome(partial(plain_data, json.loads(text), limits))
            assert outcome(partial(lambda *given: read(*given).data, text, "json", limits)) == expected


def test_keys_and_texts_of_json_are_as_those_of_plain_data():
    for text, code in (
        ('[{"a": {"' + "k" * 101 + '": 1}}]', "key-too-long"),
        ('{"a": ["\\ud800"]}', "not-text"),
        ('{"\\udfff": 1}', "not-text"),
    ):
        assert refused(text, "json").code == code
    longest = "k" * 100
    assert read(f'{{"{longest}": "\\ud83d\\ude00"}}', "json").data == {longest: "😀"}


@pytest.mark.parametrize(
    ("digits", "told"),
    [
        (21, "1" + "0" * 20),
        (30, "1" + "0" * 29),
        (31, "1" + "0" * 23 + "... (31 digits)"),
        (401, "1" + "0" * 23 + "... (401 digits)"),
        (5001, "an integer of more than 4300 digits"),
    ],
)
def test_whole_numbers_beyond_every_range_are_infinite_and_told_as_they_came(digits, told):
    number = 10 ** (digits - 1)
    handed_over, negative = plain_data({"a": [number, -number]}, DEFAULT_LIMITS)["a"]
    assert (handed_over, show(handed_over), negative) == (math.inf, told, -math.inf)
    assert show(negative) == (told if digits > 4300 else "-" + told)
    if digits < 4000:
        for form in ("json", "yaml"):
            read = read_text(f'{{"a": [{number}]}}', DEFAULT_LIMITS, file=None, directory=None, form=form).data["a"][0]
            assert (read, show(read)) == (handed_over, told)


def test_limits_are_stated_and_an_alias_bomb_is_counted_not_built():
    with pytest.raises(LimitError, match="1000 characters"):
        read("a: " + "x" * 2000, limits=Limits(document_bytes=1000))
    with pytest.raises(LimitError, match="more than 10 values"):
        read("[" + "1," * 20 + "]", limits=Limits(nodes=10))
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [" + ", ".join([f"*a{i - 1}"] * 9) + "]" for i in range(1, 12)]
    assert refused("\n".join(lines)).code == "too-complex"
    assert read("a: &x {h: 1}\nb: *x\n").data == {"a": {"h": 1}, "b": {"h": 1}}


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ({"a": [1, 2.5, None, True, {"b": []}], "c": {}}, {"a": [1, 2.5, None, True, {"b": []}], "c": {}}),
        ({"a": (1, 2.0), "b": 2**63}, {"a": [1, 2.0], "b": 2**63}),
        ({"a": np.float64(1.5), "b": np.arange(3)}, {"a": 1.5, "b": [0, 1, 2]}),
        ({"a": 10**30, "b": [-(10**30)]}, {"a": math.inf, "b": [-math.inf]}),
        ([], []),
        ("text", "text"),
        (3, 3),
    ],
)
def test_a_copy_is_plain_and_shares_nothing_with_the_caller(data, expected):
    copied = plain_data(data, DEFAULT_LIMITS)
    assert copied == expected
    if isinstance(data, dict):
        assert copied is not data
        assert all(copied[key] is not value for key, value in data.items() if isinstance(value, list | dict))


@pytest.mark.parametrize(
    ("data", "code"),
    [
        ({"a": {1: 2}}, "bad-key"),
        ({"x" * 200: 1}, "key-too-long"),
        ({"a": "\ud800"}, "not-text"),
        ({"\udfff": 1}, "not-text"),
        ({"a": ["\ud800", "\udc00"]}, "not-text"),
        ({"a": object()}, "unsupported-value"),
        ({"a": {1, 2}}, "unsupported-value"),
        ({"a": b"x"}, "unsupported-value"),
        (LOOP, "too-complex"),
        ([[[[[[0]]]]]], "too-complex"),
        (list(range(40)), "too-complex"),
    ],
)
def test_what_is_unusual_is_refused_with_its_reason(data, code):
    assert problems_of(plain_data, data, Limits(nodes=30, depth=4))[0].code == code


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


def read_or_code(text: str):  # type: ignore[no-untyped-def]
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
        found = read_or_code(pattern.format(sign))
        assert found == "unseen-character" or (sign not in REFUSED and found.data == meant), ascii(sign)


@pytest.mark.parametrize("place", TEXTS)
def test_a_text_is_what_stands_there(place):
    """In quotes it holds what it holds, and outside of them what is not shown is refused."""
    pattern, quote = TEXTS[place]
    for sign in sorted({*UNSEEN, *REFUSED, *"é\ue000\U0001f4a9"} - set(ENDS)):
        found = read_or_code(pattern.format(sign))
        if found == "unseen-character":
            assert not (quote and sign in "\x85\u2028\u2029"), ascii(sign)
            continue
        assert quote or sign not in REFUSED, ascii(sign)
        values = [*found.data, *found.data.values()]
        assert f"x{sign}y" in values, ascii(sign)
        assert found.locate(("b",), key=True)[0] == (3 if "block" in place else 2)


def test_line_ends_are_those_of_yaml_and_git():
    for end in ("\n", "\r\n", "\r"):
        source = read_or_code(f"a: 1{end}# x{end}b: [1,{end} 2]{end}")
        assert source.locate(("b", 1)) == (4, 2)
    for text in ("a: 1\n# x\rb: 2\n", "a: 'x\ry'\nb: 1\n", "a: 1\r\n# x\rb: 2\r\n"):
        assert read_or_code(text) == "unseen-character"


def test_as_many_stand_ins_as_are_wanted():
    """Characters that a text holds already are not taken for those that it must not be read_or_code by."""
    taken = "".join(map(chr, range(0xE000, 0xF900)))
    assert read_or_code(f'a: "{taken}\u2028{taken}\x85"\n').data == {"a": f"{taken}\u2028{taken}\x85"}


def test_what_is_not_shown_is_written_as_an_escape_and_comes_back():
    for sign in sorted({*UNSEEN, *REFUSED} - {"\n"}):
        for value in (f"x{sign}y", sign, f"{sign} x ", [f"x{sign}", "y"], {f"k{sign}": f"{sign}"}):
            for text in (data_to_yaml({"a": value}), f"a: {dump_flow(value)}\n"):
                assert read_or_code(text).data == {"a": value}, ascii(text)
                assert not set(text) & {*REFUSED}, ascii(text)


DESIGNS = sorted(EXAMPLES.glob("*.yaml"))


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_one_half_width_changes_one_line_and_its_comment_stays(path):
    text = path.read_text(encoding="utf-8")
    old = design_to_data(load_design(path), inline=False)
    new = copy.deepcopy(old)
    if mounts := new.get("interfaces"):
        mount = mounts["connector_flange" if "connector_flange" in mounts else "structure_connector"]
        if "features" in mount:
            mount["features"][0]["flatness_mm"] = 0.1237
            begins = "- { name: flange, kind: pad,"
        elif "locators" in mount:
            mount["locators"][0]["half_width_mm"] = 0.1237
            begins = "half_width_mm: 0.1237"
        else:
            mount["tolerances"]["rx"]["half_width_deg"] = 0.1237
            begins = "rx: { half_width_deg: 0.1237, distribution:"
    else:  # a cage that no robot carries
        new["fiducials"]["manufacturing"]["half_width_mm"] = 0.1237
        begins = "manufacturing: { half_width_mm: 0.1237, distribution:"
    made = revise_yaml(text, old, new)
    lines = difflib.unified_diff(text.splitlines(), made.splitlines(), n=0, lineterm="")
    (added,) = (line[1:].strip() for line in lines if line.startswith("+") and not line.startswith("+++"))
    assert added.startswith(begins)
    assert text.count("#") == made.count("#")
    assert design_to_data(load_design(made, base_directory=EXAMPLES), inline=False) == new


CASES = {name: row for name, *row in read_cases("documents", "revised")}


@pytest.mark.parametrize("case", CASES)
def test_the_text_that_an_author_would_have_written(case):
    """independent: PyYAML, which shares no code with the revision but the parser's events."""
    text, new, wanted = CASES[case]
    assert revise_yaml(text, yaml.safe_load(text), new) == wanted
    assert yaml.safe_load(wanted) == new


leaves = (
    st.integers(-99, 99)
    | st.floats(-1e3, 1e3, allow_nan=False).map(lambda x: round(x, 4))
    | st.sampled_from(["a", "two words", "x: y", "# no", "yes", "1e3", "ä", "", "- x", "'", '"', "[", "null"])
)
names = st.sampled_from(["a", "b", "c", "label", "d"])
trees = st.recursive(
    leaves,
    lambda below: st.dictionaries(names, below, min_size=1, max_size=4) | st.lists(below, min_size=1, max_size=4),
    max_leaves=14,
)
documents = st.dictionaries(names, trees, min_size=1, max_size=4)


@pytest.mark.long
@given(documents, documents, st.booleans())
@settings(max_examples=300, deadline=None)
def test_any_document_can_become_any_other(old, new, flow):
    """Whatever the two have in common: the outcome reads as the new one, by the reader of designs itself."""
    text = yaml.safe_dump(old, sort_keys=False, default_flow_style=flow, allow_unicode=True)
    made = revise_yaml(text, read_yaml(text, None, DEFAULT_LIMITS)[0], new)
    assert read_yaml(made, None, DEFAULT_LIMITS)[0] == new, made
