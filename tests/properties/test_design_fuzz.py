"""Whatever is thrown at the loader, it answers with a design or with a TailstackError that says where.

Three throwers: arbitrary plain data in any field of the demo, damaged bytes of its text, and documents
built to hurt a parser.
"""

from __future__ import annotations

import copy
import json
import random

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from damage import damaged
from plain_data import EVERY, EXAMPLES, places_of, replaced, value_at
from tailstack.design import check_design, load_design
from tailstack.design.fiducial_files import FORMATS
from tailstack.errors import Problem, TailstackError
from tailstack.integrations.conversion import convert
from typical import declare_all

pytestmark = pytest.mark.hostile

TEXT = (EXAMPLES / "demo.yaml").read_text()
ALL = EVERY | {"every effect": declare_all(copy.deepcopy(EVERY["demo"]), np.random.default_rng(39))}


def refusal_of(call, *arguments, **options):
    """The TailstackError a call ends in, None when it succeeds; any other exception fails the test."""
    try:
        call(*arguments, **options)
    except TailstackError as error:
        return error
    return None


def attempt(source, **options):
    """Load, compile and check; a refusal must be well formed."""
    error = refusal_of(lambda: check_design(load_design(source, base_directory=EXAMPLES, **options)))
    if error is not None:
        assert error.problems
        for problem in error.problems:
            assert isinstance(problem, Problem)
            assert problem.code
            assert problem.detail
            assert len(str(problem)) < 2000
            assert problem.pointer == "" or problem.pointer.startswith("/")
            str(problem).encode()
    return error


scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.integers(-(10**400), 10**400)
    | st.floats()
    | st.text(max_size=30)
    | st.sampled_from([0, -1, 1e-300, 1e300, 1e5, "nan", "0.1", "1e999", float("inf"), "all", "AP", "normal", "tip"])
)
data = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=12), inner, max_size=4)
        | st.lists(st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=4), min_size=3, max_size=4)
    ),
    max_leaves=12,
)
PLACES = [(stem, path) for stem, document in sorted(ALL.items()) for path in places_of(document)]


@pytest.mark.long
@settings(max_examples=600, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(PLACES), data)
def test_any_value_in_any_field(place, value):
    stem, path = place
    attempt(replaced(ALL[stem], path, value) if path else {"value": value})


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(PLACES), st.floats() | st.integers(-3, 3)), min_size=1, max_size=6))
def test_any_numbers_in_several_fields(changes):
    stem = changes[0][0][0]
    document = ALL[stem]
    for (other, path), value in changes:
        if other == stem and path:
            try:
                document = replaced(document, path, value)
            except (TypeError, IndexError, KeyError):  # an earlier change removed the place
                continue
    attempt(document)


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(PLACES), st.sampled_from(PLACES))
def test_sections_in_the_wrong_place(there, here):
    value = value_at(ALL[here[0]], here[1])
    attempt(replaced(ALL[there[0]], there[1], value) if there[1] else {"value": value})


@pytest.mark.parametrize("seed", range(8))
def test_damaged_bytes(seed, run_seed):
    rng = random.Random(seed + 10 * run_seed)
    as_json = json.dumps(ALL["demo"], indent=1).encode()
    for _ in range(60):
        attempt(damaged(TEXT.encode(), rng))
        attempt(damaged(as_json, rng), form=rng.choice(["auto", "json", "yaml"]))


@pytest.mark.parametrize("seed", range(4))
def test_damaged_fiducial_files(seed, run_seed):
    rng = random.Random(1000 + seed + 10 * run_seed)
    files = sorted((EXAMPLES / "fiducials").iterdir())
    for _ in range(60):
        path = rng.choice(files)
        for ending in FORMATS:
            error = refusal_of(convert, damaged(path.read_bytes(), rng), path.name, "out" + ending)
            assert error is None or error.problems[0].detail


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=300) | st.text(max_size=300).map(lambda text: text.encode("utf-8", "surrogatepass")))
def test_arbitrary_bytes(content):
    assert attempt(content) is not None
    for ending in (*FORMATS, ".yaml", ".json"):
        error = refusal_of(convert, content, "in" + ending, "out.csv")
        assert error is None or error.problems[0].detail


@pytest.mark.parametrize("codec", ["utf-8-sig", "utf-16", "utf-32", "utf-16-le", "utf-16-be", "latin-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(codec, newline):
    error = attempt(TEXT.replace("\n", newline).encode(codec))
    assert (error is None) == (codec not in ("utf-16-le", "utf-16-be"))  # no mark: refused as binary


def bombs():
    nine = ", ".join(["*{}"] * 9)
    laughs = "a0: &a0 [lol]\n" + "".join(f"a{i}: &a{i} [{nine.replace('{}', f'a{i - 1}')}]\n" for i in range(1, 15))
    yield laughs
    yield TEXT + laughs
    yield TEXT + "again: &x\n  <<: *x\n"
    yield "[" * 900_000
    yield "{" * 900_000
    yield '{"a":' * 150_000
    yield '["a",' * 150_000
    yield "- " * 400_000
    yield "? " * 400_000
    yield "a: " * 300_000
    yield "a:\n" + "".join(" " * depth + f"b{depth}:\n" for depth in range(1, 1300))
    yield TEXT + "x: |\n" + " y\n" * 200_000
    yield "&" * 500_000
    yield "!" * 500_000
    yield "\n".join(f"k{i}: {i}" for i in range(60_000))
    yield "{" + ", ".join(f'"k{i}": {i}' for i in range(60_000)) + "}"
    yield TEXT.replace("points:", "points:\n" + "    - { position_mm: [1, 2, 3] }\n" * 5000)
    yield "x" * 2_000_000
    yield '"' + "\\u0041" * 150_000
    yield TEXT.replace("limit_mm: 1.0", "limit_mm: " + "9" * 100_000)


@pytest.mark.parametrize("bomb", list(bombs()), ids=lambda bomb: f"{bomb[:12]!r}-{len(bomb)}")
def test_bombs(bomb):
    assert attempt(bomb) is not None
    assert attempt(bomb.encode()) is not None


@pytest.mark.parametrize("cut", range(0, len(TEXT), 97))
def test_truncated_at_any_point(cut):
    attempt(TEXT.encode()[:cut])


def test_duplicate_keys_anywhere():
    lines = TEXT.splitlines()
    for number, line in enumerate(lines):
        if line.rstrip().endswith(":") or ": " not in line or line.lstrip().startswith(("#", "-")):
            continue
        error = attempt("\n".join([*lines[: number + 1], line, *lines[number + 1 :]]) + "\n")
        if error is not None:
            assert error.problems[0].code in ("duplicate-key", "yaml-syntax")
