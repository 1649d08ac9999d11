"""What the page says without a browser: of which kind every number is, links below a path, lists, tables of beads.

The page's own sources run in Node (``workbench_in_node.mjs``), in a document of a few lines, before a service whose
answers are these: real scores of twenty designs, and for each a simulation that nobody could take for its estimate.
"""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import jsonschema
import pytest
import yaml
from page_in_node import in_node
from service_scenes import EXAMPLES

from plain_data import replaced, value_at
from tailstack import load_design, score
from tailstack.design import DEFAULT_LIMITS
from tailstack.design.fiducial_files import read_fiducials
from tailstack_service.documents import to_json

NAMES = [
    "demo", "first_carrier", "flat_plate", "locators_321", "small_cluster_far_target", "tube_carrier",
    *(f"gallery/{path.stem}" for path in sorted((EXAMPLES / "gallery").glob("*.yaml"))),
    "paper/c_arm", "paper/fitted_eq18", "paper/fitted_physical",
]  # fmt: skip
SOME = ["demo", "flat_plate", "gallery/per_unit_limit"]  # in the short tier
ESTIMATES, SIMULATIONS = (1.0, 0.931, 1.077), (1.373, 1.289, 1.511)  # of each state: no two are alike in three digits
ADVISED = 0.12345  # mm: what the service says that any advice comes to


# --- every number is of one kind -------------------------------------------------------------------------------------


def name_of(key: str, record: dict[str, Any], above: str) -> str:
    """What a field is called, with its unit; of what no field is, a point or a bead, what it stands below."""
    if not key.isidentifier():
        return above
    return f"{key}_{record['unit']}" if "unit" in record and key in ("value", "interval", "limit", "margin") else key


def scaled(record: Any, factor: float, name: str = "") -> Any:
    """A record with every length in it times a factor, but for limits, which the design states."""
    if isinstance(record, dict):
        return {key: scaled(value, factor, name_of(key, record, name)) for key, value in record.items()}
    if isinstance(record, list):
        return [scaled(value, factor, name) for value in record]
    if not isinstance(record, float) or "limit" in name:
        return record
    return record * factor if is_length(name) else record * factor**2 if name.endswith("_mm2") else record


def is_length(name: str) -> bool:
    """Whether numbers of a field are lengths: all measures of these designs are."""
    return name.endswith("_mm") or name in ("value", "interval", "margin")


def simulated(estimate: dict[str, Any], factor: float) -> dict[str, Any]:
    """A simulation of the design of an estimate, whose lengths are all others."""
    record = scaled(estimate, factor)
    targets = [
        {
            **{key: target[key] for key in ("name", "frame", "bias_mm", "std_mm", "mean_norm_mm", "p95_mm")},
            "p95_interval_mm": [0.99 * target["p95_mm"], 1.01 * target["p95_mm"]], "confidence": 0.95,
            "worst_mm": 1.7 * target["p95_mm"], "exceedance": None, "first_order_p95_mm": own["p95_mm"],
        }
        for target, own in zip(record["targets"], estimate["targets"], strict=True)
    ]  # fmt: skip
    checks = [
        {**check, "interval": [0.99 * check["value"], 1.01 * check["value"]], "status": "fail"}
        for check in record["verdict"]["checks"]
    ]
    return {
        "schema": "tailstack/verification/1", "seed": 0, "trials": 100_000, "precision_reached": 0.01, "stopping": "",
        "targets": targets, "first_order_ratio": 1 / factor, "provenance": estimate["provenance"],
        "verdict": {
            "status": "fail" if checks else "no requirement", "basis": "Monte Carlo", "checks": checks, "findings": [],
        },
    }  # fmt: skip


@cache
def scene(name: str) -> dict[str, Any]:
    """A design in three states (as it is, with a bead dragged, as a variant), with both answers to each."""
    text = (EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8")
    design = yaml.safe_load(text)
    real = json.loads(to_json(score(load_design(EXAMPLES / f"{name}.yaml"), losses=False)))
    drag: list[dict[str, Any]] = [{"path": ["views", 0, "fiducial_noise_px"], "value": 0.2718}]
    points = design["fiducials"].get("points")
    if points:
        x, y, z = points[0]["position_mm"]
        drag = [{"path": ["fiducials", "points", 0, "position_mm"], "value": [x + 1.5, y, z]}]
    dragged = replaced(design, drag[0]["path"], drag[0]["value"])
    states = []
    for k, state in enumerate((design, dragged, {**design, "description": "a variant"})):
        record = scaled(real, ESTIMATES[k])
        record["provenance"] = {**record["provenance"], "design_sha256": f"{k}" * 64}
        simulation = simulated(record, SIMULATIONS[k] / ESTIMATES[k])
        shares = {"target": record["targets"][0]["name"], "edges_mm": [0.0, 1.0, 2.0], "trials": 10}
        shares |= {"sampled": [0.5, 0.5], "first_order": [0.5, 0.5]}
        own = text if k == 0 else yaml.safe_dump(state, sort_keys=False, allow_unicode=True)
        answers = {"score": record, "verification": simulation, "distributions": [shares]}
        states.append({"design": state, "text": own, **answers})
    return {"states": states, "drag": drag}


def lengths_of(record: Any, name: str = "") -> Iterator[float]:
    """Every length of a record, and the sizes of its vectors."""
    if isinstance(record, dict):
        for key, value in record.items():
            yield from lengths_of(value, name_of(key, record, key))
    elif isinstance(record, list):
        if name.endswith("_mm") and all(isinstance(value, float) for value in record):
            yield sum(value * value for value in record) ** 0.5
        for value in record:
            yield from lengths_of(value, name)
    elif isinstance(record, float) and is_length(name):
        yield abs(record)


def is_among(token: str, values: list[float]) -> bool:
    digits = len(token.partition(".")[2])
    return any(abs(float(token) - value) <= 0.5001 * 10**-digits for value in values)


SAYS = {"estimate": "estimate|first order", "simulation": "simulat|verified"}
NUMBER = re.compile(r"([▲▼] )?(?<![\d.])(\d+\.\d{2,})(?![\d.]| ?%| ?°)")


def mixtures(each: dict[str, Any], seen: list[dict[str, Any]]) -> tuple[list[str], dict[str, int]]:
    """Lines in which a number of one kind stands where the other is said, or none, and differences of one kind from the
    other; and how many numbers were looked at."""
    states = each["states"]
    verifications = [copy.deepcopy(state["verification"]) for state in states]
    for target in (target for verification in verifications for target in verification["targets"]):
        del target["first_order_p95_mm"]
    records = {"estimate": [state["score"] for state in states], "simulation": verifications}
    values = {kind: [value for record in records[kind] for value in lengths_of(record)] for kind in records}
    values["estimate"].append(ADVISED)
    decisive = {kind: [value for record in records[kind] for value in decided(record)] for kind in records}
    differences = [abs(a - b) for those in decisive.values() for a in those for b in those]
    mixed = [abs(a - b) for a in decisive["estimate"] for b in decisive["simulation"]]
    stated = [float(token) for token in re.findall(r"\d+\.?\d*", json.dumps([state["design"] for state in states]))]
    stated += [check["limit"] for state in states for check in state["score"]["verdict"]["checks"]]
    wrong, looked = [], {"estimate": 0, "simulation": 0}
    for moment in seen:
        for line in moment["lines"]:
            for arrow, token in NUMBER.findall(line["text"]):
                where = f"{moment['what']}: {token} in {line['kind']}: {line['text']!r}"
                if arrow:
                    if (
                        is_among(token, mixed) and not is_among(token, differences) and "%" not in line["text"]
                    ):  # of a share: mm
                        wrong.append(where)
                    continue
                kinds = [kind for kind, known in values.items() if is_among(token, known)]
                if len(kinds) != 1 or is_among(token, stated):
                    continue  # neither, or not to be told apart
                looked[kinds[0]] += 1
                if line["kind"] != kinds[0] and not re.search(SAYS[kinds[0]], line["text"]):
                    wrong.append(f"{kinds[0]}: {where}")
    return wrong, looked


def decided(record: dict[str, Any]) -> list[float]:
    """What may be the number of a record that is compared."""
    checks: list[dict[str, Any]] = record["verdict"]["checks"]
    return [*(check["value"] for check in checks), *(target["p95_mm"] for target in record["targets"])]


def look_at(names: list[str]) -> None:
    scenes = [scene(name) for name in names]
    wrong: list[str] = []
    advised = 0
    for name, each, seen in zip(names, scenes, in_node(walks=scenes, advised=ADVISED)["walks"], strict=True):
        found, looked = mixtures(each, seen)
        wrong += [f"{name}, {line}" for line in found]
        assert [moment["current"] for moment in seen] == [True] * 10
        assert [moment["basis"][0] for moment in seen][:6] == list("eseess")  # estimate or simulation
        assert min(looked.values()) > 5, (name, looked)
        # every simulation here is 37 % or more beyond its estimate, which nobody is advised by any more
        assert not any(moment["advice"] for moment in seen if moment["basis"] == "simulation")
        advised += seen[0]["advice"]
    assert wrong == []
    assert advised > 0


def test_no_line_mixes_an_estimate_with_a_simulation() -> None:
    """Each design is verified, dragged, undone, kept and taken as a variant; every moment of it is read."""
    look_at(SOME)


@pytest.mark.long
def test_no_line_of_any_design_mixes_an_estimate_with_a_simulation() -> None:
    assert len(NAMES) == 23
    look_at(NAMES)


# --- links, lists, tables, steps -------------------------------------------------------------------------------------

REPORT = "/v1/results/ab/report?format=pdf"
JOB: dict[str, Any] = {
    "addresses": [
        ("http://host/", "/v1/jobs/1", "/v1/jobs/1"),
        ("http://host/tools/tailstack/", REPORT, f"/tools/tailstack{REPORT}"),
        ("http://host/tools/tailstack/", f"/tools/tailstack{REPORT}", f"/tools/tailstack{REPORT}"),
        ("http://host/tools/", "/elsewhere/v1/jobs/1", "/tools/v1/jobs/1"),
        ("http://host/v1/tools/", "/v1/tools/v1/jobs/1", "/v1/tools/v1/jobs/1"),
        ("http://host/tools/?x#design=1", "/version", "/tools/version"),
    ],
    "history": [9_000_000, 9_000_000, 9_000_000, 30_000_000, 100],
    "tables": {
        "1,2,3\n4,5,6\n": [["F1", 1, 2, 3], ["F2", 4, 5, 6]],
        "A;1,5;2;3\nB;4;5;6\n": [["A", 1.5, 2, 3], ["B", 4, 5, 6]],
        "A\t1\t2\t3\nB\t4\t5\t6\n": [["A", 1, 2, 3], ["B", 4, 5, 6]],
        "label x y z\nA 1 2 3\nB 4 5 6": [["A", 1, 2, 3], ["B", 4, 5, 6]],
        "x,y,z\r\n1,2,-3\r\n4,5,6\r\n": [["F1", 1, 2, -3], ["F2", 4, 5, 6]],
        "# of the CT\n1.5 2 3\n4 5 6\n": [["F1", 1.5, 2, 3], ["F2", 4, 5, 6]],
        "1,2\n3,4\n": None, "A,1,2,three\n": None, "a design: 1\n": None, "1,2,3\n4,5\n": None,
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def made() -> dict[str, Any]:
    schema = json.loads((EXAMPLES / "tailstack-design.schema.json").read_text(encoding="utf-8"))
    lists = list(lists_of(schema, schema))
    cases = [
        {"node": each["items"], "value": value}
        for _, each in lists
        for value in ([], ["F1"], [{"name": "A", "limit_mm": 1}])
    ]
    job = in_node(
        schema=schema,
        lists=cases,
        tables=list(JOB["tables"]),
        addresses=[case[:2] for case in JOB["addresses"]],
        history=JOB["history"],
    )
    return {**job, "schema": schema, "cases": cases, "of": lists}


def lists_of(schema: Any, part: Any, at: str = "", known: frozenset[str] = frozenset()) -> Iterator[tuple[str, Any]]:
    """Every list of a schema that may be of several lengths, with the path of names to it."""
    if "$ref" in part:
        if part["$ref"] not in known:
            yield from lists_of(schema, value_at(schema, part["$ref"].split("/")[1:]), at, known | {part["$ref"]})
        return
    if (
        part.get("type") == "array"
        and "items" in part
        and not (part.get("maxItems") == part.get("minItems") is not None)
    ):
        yield at, part
    for option in (*part.get("anyOf", ()), *part.get("oneOf", ()), *part.get("allOf", ())):
        yield from lists_of(schema, option, at, known)
    for name, each in part.get("properties", {}).items():
        yield from lists_of(schema, each, f"{at}/{name}", known)
    if isinstance(part.get("items"), dict):
        yield from lists_of(schema, part["items"], f"{at}/-", known)


def test_links_lead_to_the_service_whether_or_not_a_proxy_passes_its_path_on(made: dict[str, Any]) -> None:
    assert made["addresses"] == [f"http://host{case[2]}" for case in JOB["addresses"]]


def test_steps_that_are_kept_have_room_together_and_the_first_and_the_last_are_among_them(made: dict[str, Any]) -> None:
    large, larger = JOB["history"][0], JOB["history"][3]
    assert made["history"] == [[4, large], [4, large, large], [4, large, large], [4, larger], [4, 100]]


def test_a_table_without_a_header_is_read_once_its_unit_is_said(made: dict[str, Any]) -> None:
    for (text, rows), found in zip(JOB["tables"].items(), made["tables"], strict=True):
        assert (found is None) == (rows is None), text
        if found is not None:
            fiducials = read_fiducials(found["mm"].encode(), "beads.csv", DEFAULT_LIMITS)
            assert [[label, *at] for label, at in zip(fiducials.labels, fiducials.positions_mm, strict=True)] == rows


def test_every_list_of_a_design_can_grow_by_what_its_schema_takes(made: dict[str, Any]) -> None:
    """From nothing: the required fields are there, each of its type.  From others: under a new name."""
    assert {"/requirements", "/targets", "/views", "/optimise/keep_out", "/optimise/tolerances"} <= {
        at for at, _ in made["of"]
    }
    for case, item in zip(made["cases"], made["lists"], strict=True):
        if not case["value"]:
            schema = {"definitions": made["schema"]["definitions"], **case["node"]}
            jsonschema.Draft7Validator(schema).validate(item)  # which test_editors.py finds to be a schema
        elif case["value"] == ["F1"]:
            assert item == "F2"
        else:
            assert item == {"name": "A1", "limit_mm": 1}


def test_the_first_requirement_that_is_added_is_judged(made: dict[str, Any]) -> None:
    (requirement,) = [
        item
        for case, item in zip(made["cases"], made["lists"], strict=True)
        if not case["value"] and case["node"].get("$ref", "").endswith("RequirementDocument")
    ]
    design = yaml.safe_load((EXAMPLES / "demo.yaml").read_text(encoding="utf-8"))
    del design["optimise"]
    assert score(load_design({**design, "requirements": [requirement]})).verdict.status in ("pass", "fail")
