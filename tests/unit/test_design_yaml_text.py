"""A design's YAML with some numbers changed: those numbers, and not one character more."""

from __future__ import annotations

import copy
import difflib

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from plain_data import EXAMPLES
from tailstack.design import design_to_data, load_design
from tailstack.design.reading import DEFAULT_LIMITS, read_yaml
from tailstack.design.yaml_text import revise_yaml

DESIGNS = sorted(EXAMPLES.glob("*.yaml"))


def read(text):
    """By PyYAML, which shares no code with the revision but the parser's events."""
    return yaml.safe_load(text)


def changed_lines(before, after):
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm="")
    return [line[1:].strip() for line in lines if line.startswith("+") and not line.startswith("+++")]


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_one_half_width_changes_one_line_and_its_comment_stays(path):
    text = path.read_text(encoding="utf-8")
    old = design_to_data(load_design(path), inline=False)
    new = copy.deepcopy(old)
    mount = new["interfaces"]["connector_flange" if "connector_flange" in new["interfaces"] else "structure_connector"]
    mount["tolerances"]["rx"]["half_width_deg"] = 0.1237
    made = revise_yaml(text, old, new)
    (line,) = changed_lines(text, made)
    assert line.startswith("rx: { half_width_deg: 0.1237, distribution:")
    assert text.count("#") == made.count("#")
    assert design_to_data(load_design(made, base_directory=EXAMPLES), inline=False) == new


CASES = {
    "a number keeps its neighbours": ("a: 1 # one\nb: 2\n", {"a": 3, "b": 2}, "a: 3 # one\nb: 2\n"),
    "a whole number stays whole": ("a: [1, 2.0, 3]\n", {"a": [4.0, 2.0, 3.5]}, "a: [4, 2.0, 3.5]\n"),
    "a field that goes takes its line": ("a: 1\nb: 2 # two\nc: 3\n", {"a": 1, "c": 3}, "a: 1\nc: 3\n"),
    "a field that comes is last": ("m:\n  a: 1 # one\nn: 2\n", {"m": {"a": 1, "b": [1, 2]}, "n": 2},
                                   "m:\n  a: 1 # one\n  b: [1, 2]\nn: 2\n"),
    "what comes for something stands in its place": (
        "m:\n  file: x.csv # beads\n  b: 2\n", {"m": {"points": [1], "b": 2}}, "m:\n  points: [1]\n  b: 2\n"),
    "an item that goes takes its line": (
        "p:\n  - { label: A, x: 1 } # first\n  - { label: B, x: 2 }\n", {"p": [{"label": "B", "x": 5}]},
        "p:\n  - { label: B, x: 5 }\n"),
    "an item that comes is last, and looks like the others": (
        "p:\n- {label: A, x: 1}\n# end\nq: 1\n", {"p": [{"label": "A", "x": 1}, {"label": "B", "x": 2}], "q": 1},
        "p:\n- {label: A, x: 1}\n- {label: B, x: 2}\n# end\nq: 1\n"),
    "an item that comes stands below what the last one gets": (
        "p:\n  - name: A\n    x: 1\nq: 1\n", {"p": [{"name": "A", "x": 1, "y": 2}, {"name": "B"}], "q": 1},
        "p:\n  - name: A\n    x: 1\n    y: 2\n  - { name: B }\nq: 1\n"),
    "an alias follows its anchor": ("a: &v { x: 1 }\nb: *v\n", {"a": {"x": 2}, "b": {"x": 2}},
                                    "a: &v { x: 2 }\nb: *v\n"),
    "an alias that differs is written out": ("a: &v { x: 1 }\nb: *v\n", {"a": {"x": 2}, "b": {"x": 1}},
                                             "a: &v { x: 2 }\nb: { x: 1 }\n"),
    "an anchor on a number stays": ("a: &v 1\nb: *v\n", {"a": 2, "b": 2}, "a: &v 2\nb: *v\n"),
    "a list without names is written anew, a line for each item": (
        "p:\n  - { x: 1 }\n  - { x: 2 }\nq: 1\n", {"p": [{"x": 2}], "q": 1}, "p:\n  - { x: 2 }\nq: 1\n"),
    "lines end as they did": ("a: 1\r\nm:\r\n  b: 2\r\n", {"a": 3, "m": {"b": 2, "c": 4}},
                              "a: 3\r\nm:\r\n  b: 2\r\n  c: 4\r\n"),
    "no line break at the end": ("m:\n  a: 1", {"m": {"a": 1, "b": 2}}, "m:\n  a: 1\n  b: 2\n"),
    "quotes and letters beyond ASCII": ("a: 'x: y' # ä\nb: 1\n", {"a": "x: y", "b": 2}, "a: 'x: y' # ä\nb: 2\n"),
    "a text that needs quotes gets them": ("a: x\n", {"a": "yes: no"}, "a: 'yes: no'\n"),
    "block text that changes": ("a: |\n  one\n  two\nb: 1\n", {"a": "three", "b": 1}, "a: three\nb: 1\n"),
    "JSON is YAML too": ('{"a": [1, 2], "b": {"c": 3}}\n', {"a": [1, 5], "b": {"c": 3}},
                         '{"a": [1, 5], "b": {"c": 3}}\n'),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_the_text_that_an_author_would_have_written(case):
    text, new, wanted = CASES[case]
    assert revise_yaml(text, read(text), new) == wanted
    assert read(wanted) == new


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
