"""Sections met before: one record for all designs that hold them, and nothing but the bytes decides which it is."""

from __future__ import annotations

import hashlib
import json
from math import copysign
from pathlib import Path

import numpy as np
import pytest
import yaml

from plain_data import replaced
from tailstack.design import compile_design, load_design
from tailstack.design.remembering import LONGEST, MOST, kept
from tailstack.errors import DesignError

ROOT = Path(__file__).parents[2]
DEMO = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text())
EXAMPLES = sorted(
    path for path in (ROOT / "examples").rglob("*.yaml") if "schema: tailstack/design/1" in path.read_text()
)


def changed(value, *path):
    return replaced(DEMO, path, value)


def arrays(value):
    """Every array of a compiled record."""
    if isinstance(value, np.ndarray):
        yield value
    for name in getattr(type(value), "__dataclass_fields__", ()):
        yield from arrays(getattr(value, name))
    if isinstance(value, tuple):
        for item in value:
            yield from arrays(item)


def test_a_moved_fiducial_leaves_the_rest_as_it_was():
    first, moved = (load_design(data) for data in (DEMO, changed(-61.5, "fiducials", "points", 0, "position_mm", 2)))
    for name in ("interfaces", "transforms", "execution", "optimise"):
        assert getattr(first.document, name) is getattr(moved.document, name)
    assert all(a is b for a, b in zip(first.document.views, moved.document.views, strict=True))
    one, other = compile_design(first), compile_design(moved)
    for name in ("structure_connector", "connector_flange", "hand_eye", "execution", "T_flange_con", "T_tcp_flange"):
        assert getattr(one, name) is getattr(other, name)
    assert one.fiducials_mm[0, 2] != other.fiducials_mm[0, 2] == -61.5
    assert first.sha256 != moved.sha256
    assert not any(array.flags.writeable for array in arrays(one) if array.size)


@pytest.mark.parametrize("order", [(0.0, -0.0), (-0.0, 0.0)])
def test_a_negative_zero_is_not_a_zero_that_came_first(order):
    path = ("interfaces", "structure_connector", "pivot_mm")
    systems = [compile_design(load_design(changed([zero, 1.0, -95.0], *path))) for zero in order]
    assert [copysign(1, system.structure_connector.pivot_mm[0]) for system in systems] == [
        copysign(1, zero) for zero in order
    ]
    assert systems[0].design_sha256 != systems[1].design_sha256


@pytest.mark.parametrize("value", [True, "1.0", None, 10**30, float("nan")])
def test_what_equals_a_number_or_looks_like_it_is_refused_after_it(value):
    path = ("interfaces", "structure_connector", "bias")
    load_design(changed({"rz_deg": 1.0}, *path))
    for _ in range(2):
        with pytest.raises(DesignError) as caught:
            load_design(changed({"rz_deg": value}, *path))
        assert [p.pointer for p in caught.value.problems] == ["/interfaces/structure_connector/bias/rz_deg"]


def test_what_compiling_refuses_it_refuses_again():
    reflection = {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}
    for field in ("T_flange_con", "T_tcp_flange", "T_flange_con"):
        design = load_design(changed({field: reflection}, "transforms"))
        with pytest.raises(DesignError) as caught:
            compile_design(design)
        assert caught.value.problems[0].pointer == f"/transforms/{field}/rotation"


def test_rounding_is_noted_each_time():
    matrix = [[1, 1e-7, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    data = changed({"T_flange_con": matrix, "T_tcp_flange": matrix}, "transforms")
    for _ in range(2):
        notes = compile_design(load_design(data)).notes
        assert [note.split(":")[0] for note in notes] == ["/transforms/T_flange_con", "/transforms/T_tcp_flange"]


def test_a_long_section_is_read_all_the_same():
    zones = [{"name": f"zone {k}", "ball": {"centre_mm": [k, 0, 0], "radius_mm": 1.0}} for k in range(LONGEST // 60)]
    designs = [load_design(changed(zones, "optimise", "keep_out")) for _ in range(2)]
    assert designs[0].document.optimise == designs[1].document.optimise
    assert designs[0].document.optimise is not designs[1].document.optimise
    assert len(designs[0].document.optimise.keep_out) == len(zones)


def hash_of_all(design):
    """independent: Python's json of the whole document, and of the points."""
    elsewhere = {"fiducials": {"points", "file"}}
    data = json.loads(design.document.model_dump_json(by_alias=True, exclude_none=True, exclude=elsewhere))
    content = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    points = json.dumps([design.fiducials.labels, design.fiducials.positions_mm], ensure_ascii=False)
    return hashlib.sha256(f"{content}\n{points}".encode()).hexdigest()


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_the_hash_is_of_the_whole_document(path):
    for _ in range(2):
        design = load_design(path)
        assert design.sha256 == hash_of_all(design)


@pytest.mark.parametrize("size", [1e-300, 1e-7, 1e-5, 9.9999999e-5, 1e-4, 1.00001e-4, 0.1, 30.00001, 99999.99999999999])
def test_the_hash_does_not_depend_on_who_writes_the_numbers(size):
    data = changed([size, -size, -0.0], "fiducials", "points", 0, "position_mm")
    data["fiducials"]["points"][1]["label"] = 'a, "é" e'
    design = load_design(data)
    assert design.sha256 == hash_of_all(design)


@pytest.mark.parametrize("count", [1, 16, 17, 40])
def test_a_long_list_is_hashed_as_a_short_one(count):
    targets = [{"name": f"t{k}", "position_mm": [k, 0, 70.0]} for k in range(count)]
    for _ in range(2):
        design = load_design(changed(targets, "targets"))
        assert design.sha256 == hash_of_all(design)
        assert [target.name for target in compile_design(design).targets] == [target["name"] for target in targets]


def test_sections_that_are_left_out_are_those_that_hold_nothing():
    bare = {key: DEMO[key] for key in ("schema", "name", "views", "fiducials", "targets", "requirements")}
    written = load_design({**bare, "interfaces": {}, "transforms": {}, "execution": {}, "model": {}})
    left_out = load_design(bare)
    assert left_out.document == written.document
    assert left_out.sha256 == written.sha256 == hash_of_all(left_out)


def test_a_part_is_known_by_identity_and_an_id_that_is_used_again_is_another():
    calls = []

    @kept
    def total(part, factor):
        calls.append(factor)
        return factor * sum(part)

    same, equal = [1, 2], [1, 2]
    assert [total(same, 2), total(same, 2), total(equal, 2), total(same, 3)] == [6, 6, 6, 9]
    assert calls == [2, 2, 3]
    assert [total([k], 1) for k in range(5 * MOST)] == list(range(5 * MOST))  # ids of lists that are gone come back
    assert total(same, 2) == 6
