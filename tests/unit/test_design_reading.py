"""The reader of YAML and JSON: scalars by YAML 1.2, refusals with line and column, bounds."""

from __future__ import annotations

import json
import math
from functools import partial
from typing import Any

import numpy as np
import pytest

from tailstack.design.reading import DEFAULT_LIMITS, Limits, _careful_copy, decode, plain_data, read_text, show
from tailstack.errors import DesignError, LimitError


def read(text, form="auto", limits=DEFAULT_LIMITS):
    return read_text(text, limits, file="d.yaml", directory=None, form=form)


def refused(text, form="auto"):
    with pytest.raises((DesignError, LimitError)) as caught:
        read(text, form)
    return caught.value.problems[0]


# published: YAML 1.2.2, section 10.3.2, core schema; leading zeros and underscores are text here on purpose
SCALARS = {
    "0": 0, "-19": -19, "+12": 12, "0.": 0.0, "-0.0": -0.0, ".5": 0.5, "+12e03": 12000.0, "-2E+05": -2e5, "1e3": 1e3,
    "~": None, "null": None, "Null": None, "true": True, "False": False, "yes": "yes", "No": "No", "on": "on",
    "1:30": "1:30", "1_000": "1_000", "010": "010", "0o14": "0o14", "0x1F": "0x1F", "2001-12-14": "2001-12-14",
    "'1'": "1", '"true"': "true", "-": None, "1.2.3": "1.2.3", ".": ".", "e5": "e5",
}  # fmt: skip


@pytest.mark.parametrize("text", [text for text in SCALARS if text != "-"])
def test_scalars(text):
    value = read(f"a: {text}").data["a"]
    assert (value, type(value)) == (SCALARS[text], type(SCALARS[text]))


def test_infinities_arrive_as_such_and_are_refused_later():
    data = read("[.inf, -.Inf, .nan, 1e999, " + "9" * 5000 + "]").data
    assert [math.isfinite(value) for value in data] == [False] * 5


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("", "empty-document", None),
        ("# nothing\n", "empty-document", None),
        ("a: 1\nb: 2\na: 3\n", "duplicate-key", 3),
        ("a:\n  b: 1\n  b: 2\n", "duplicate-key", 3),
        ('{"a": 1,\n "a": 2}', "duplicate-key", 2),
        ("a: !!float 1\n", "yaml-tag", 1),
        ("a: !!python/object/apply:os.system [ls]\n", "yaml-tag", 1),
        ("a:\n\t- 1\n", "yaml-syntax", 2),
        ("a: [1, 2\nb: 3\n", "yaml-syntax", 2),
        ("a: 1\n---\nb: 2\n", "several-documents", None),
        ("? [1, 2]\n: 3\n", "bad-key", 1),
        ("1: 2\n", "bad-key", 1),
        ("a:\n  ? " + "k" * 101 + "\n  : 1\n", "key-too-long", 2),
        ("a: &x [*x]\n", "yaml-alias", 1),
        ("a: *nowhere\n", "yaml-alias", 1),
        ("a: \x07\n", "unseen-character", 1),
    ],
)
def test_refusals(text, code, line):
    problem = refused(text)
    assert problem.code == code
    assert line is None or problem.line == line
    assert problem.file == "d.yaml"


def test_a_tab_is_named():
    assert "tab" in refused("a:\n\t- 1\n").hint


def test_json_syntax_has_line_and_column():
    problem = refused('{"a": 1,\n  "b": }', form="json")
    assert (problem.code, problem.line, problem.column) == ("json-syntax", 2, 8)


def test_alias_bomb_is_counted_not_built():
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [" + ", ".join([f"*a{i - 1}"] * 9) + "]" for i in range(1, 12)]
    assert refused("\n".join(lines)).code == "too-complex"


@pytest.mark.parametrize("text", ["[" * 400_000, "{a: " * 100_000, "- " * 200_000, '{"a":' * 100_000])
def test_nesting_bombs(text):
    assert refused(text).code in ("too-complex", "yaml-syntax")


def test_aliases_of_ordinary_size_are_values():
    assert read("a: &x {h: 1}\nb: *x\n").data == {"a": {"h": 1}, "b": {"h": 1}}


def test_places_are_lines_and_columns_of_values_and_keys():
    source = read("a:\n  - b: 1\n    c: [1, 2]\n")
    assert source.locate(("a", 0, "c", 1)) == (3, 12)
    assert source.locate(("a", 0, "c"), key=True) == (3, 5)
    assert source.locate(("a", 0, "missing", 7)) == (2, 5)  # the nearest ancestor that is there
    assert read('{"a": [1,\n 2]}').locate(("a", 1)) == (2, 2)


@pytest.mark.parametrize("codec", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_encodings_with_a_mark(codec):
    assert read(decode("a: é\r\nb: 1\r\n".encode(codec), "f")).data == {"a": "é", "b": 1}


@pytest.mark.parametrize(
    "content", [b"a: \xff\xfe", b"PK\x03\x04\x00\x00", "a: 1".encode("utf-16-le"), b"\xff\xfe\x00"]
)
def test_bytes_that_are_no_text(content):
    with pytest.raises(DesignError) as caught:
        decode(content, "f")
    assert caught.value.problems[0].code == "not-text"


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
            expected = outcome(partial(_careful_copy, json.loads(text), limits))
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


def test_plain_data_refuses_what_json_has_not():
    for value in ({1: 2}, {"a": object()}, {"a": {1, 2}}, {"a": b"x"}, {"a": "\ud800"}):
        with pytest.raises(DesignError):
            plain_data(value, DEFAULT_LIMITS)
    loop: dict[str, Any] = {}
    loop["a"] = loop
    with pytest.raises(LimitError):
        plain_data(loop, DEFAULT_LIMITS)


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


def test_limits_are_stated():
    with pytest.raises(LimitError, match="1000 characters"):
        read("a: " + "x" * 2000, limits=Limits(document_bytes=1000))
    with pytest.raises(LimitError, match="more than 10 values"):
        read("[" + "1," * 20 + "]", limits=Limits(nodes=10))


@pytest.mark.parametrize(
    "data",
    [
        {"a": [1, 2.5, None, True, "text", {"b": []}], "c": {}},
        {"a": (1, 2.0), "b": 2**63},
        {"a": np.float64(1.5), "b": np.arange(3)},
        {"a": 10**30, "b": [-(10**30)]},
        [],
        "text",
        3,
    ],
)
def test_a_quick_copy_is_the_careful_one(data):
    """independent: the copy value by value, which the quick one falls back on; nothing is shared with the caller."""
    copied = plain_data(data, DEFAULT_LIMITS)
    assert copied == _careful_copy(data, DEFAULT_LIMITS)
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
        ([[[[[[0]]]]]], "too-complex"),
        (list(range(40)), "too-complex"),
    ],
)
def test_what_is_unusual_is_refused_with_its_reason(data, code):
    with pytest.raises((DesignError, LimitError)) as caught:
        plain_data(data, Limits(nodes=30, depth=4))
    assert caught.value.problems[0].code == code
