"""One design after another: nothing of one is found in the next, and the hash is of all that a design says."""

from __future__ import annotations

import hashlib
import json
from math import copysign
from pathlib import Path

import pytest
import yaml

from plain_data import replaced
from tailstack.design import compile_design, load_design
from tailstack.errors import DesignError

ROOT = Path(__file__).parents[2]
DEMO = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text())
EXAMPLES = sorted(
    path for path in (ROOT / "examples").rglob("*.yaml") if "schema: tailstack/design/1" in path.read_text()
)


def changed(value, *path):
    return replaced(DEMO, path, value)


@pytest.mark.parametrize("written", [yaml.safe_dump, json.dumps, lambda data: data], ids=["yaml", "json", "mapping"])
@pytest.mark.parametrize("order", [(0.0, -0.0), (-0.0, 0.0)])
def test_a_zero_has_no_sign_in_whatever_form_it_arrives(order, written):
    """JavaScript writes -0.0 as 0: the same design from a page and from a file has one hash, and one system."""
    path = ("interfaces", "structure_connector", "pivot_mm")
    systems = [compile_design(load_design(written(changed([zero, 1.0, -95.0], *path)))) for zero in order]
    assert [copysign(1, system.structure_connector.pivot_mm[0]) for system in systems] == [1, 1]
    assert systems[0].design_sha256 == systems[1].design_sha256


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
def test_lists_of_any_length_are_hashed(count):
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
