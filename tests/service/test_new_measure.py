"""A measure is one file and one line: whoever adds them meets it wherever the product judges and tells an error."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import served
import yaml
from copied_sources import commands_on, copy_sources, path_of, refusal, tailstack
from page_in_node import in_node
from service_scenes import ROOT

from family import run_python
from tailstack.measures import MEASURE
from waiting import LIMIT_SECONDS

AXIS_ANGLE = '''"""The angle between an axis as planned and as executed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .measure import Measure, Site


def sites(design):
    """From each target to the next."""
    found = []
    for start, end in pairwise(design.targets):
        line = design.T_tcp_con[:3, :3] @ (end.position_mm - start.position_mm)
        length = np.linalg.norm(line)
        across = np.rad2deg((np.eye(3) - np.outer(line, line) / length**2) / length)
        weights = np.hstack([across, np.zeros((3, 3))])
        found.append(Site(f"{start.name} to {end.name}", {start.name: -weights, end.name: weights}))
    return tuple(found)


MEASURE = Measure(
    name="axis_angle", words="the angle of the axis", brief=", angle", meaning="angle of the axis between two targets",
    frame="tcp", sites=sites, unit="deg", calibrated=False,
)
'''
WORDS = "the angle of the axis"
LIBRARY = """
import json, sys
import numpy as np
from tailstack import load_design, score, score_batch, verify
from tailstack.design import compile_design
from tailstack.montecarlo.chain import run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack_service.documents import to_json
design = load_design(open(sys.argv[1], encoding="utf-8").read())
first, check = score(design, losses=False), verify(design, trials=20000, seed=1)
system = compile_design(design)
errors = run_indices(compile_plan(system), 1, 0, 20000).errors[:, 0]
ends = [system.T_tcp_con[:3, :3] @ target.position_mm for target in system.targets]
planned = ends[1] - ends[0]
executed = planned[:, None] + errors[1] - errors[0]
across = np.linalg.norm(np.cross(executed.T, planned), axis=1)
angles = np.rad2deg(np.arctan2(across, planned @ executed))
table = score_batch(design, {"views.*.target_noise_px": [0.3, 0.6]}, columns=("value", "within_limits"))
told = [[each.site, each.unit, each.p95, each.limit] for each in (*first.measures, *check.measures)]
checks = [[each.verdict.checks[-1].status, each.verdict.checks[-1].unit] for each in (first, check)]
rays = verify(design, seed=1, method="radial").measures[0].p95_interval
values = next(column.tolist() for name, column in table.columns.items() if "straight" in name)
records = [json.loads(to_json(each)) for each in (first, check)]
drawn = float(np.quantile(angles, 0.95)), check.measures[0].p95_interval
print(json.dumps([told, checks, *drawn, values, rays, records]))
"""
TERMS = """
import json, sys
import numpy as np
from tailstack import load_design
from tailstack.optimisation.exact_law import image_parts
from tailstack.optimisation.problem import present_choice
from tailstack.optimisation.symbols import plain
from tailstack.optimisation.task import read_task
from tailstack.optimisation.terms import (
    estimator_affine, image_parts_at, lay, linearise_demand, pivot_shift_of, terms_of
)
task = read_task(load_design(open(sys.argv[1], encoding="utf-8").read()))
problem = task.problems[0]
(demand,), mechanics = problem.demands, pivot_shift_of(problem, present_choice(problem))
term, told = terms_of(problem, demand), [plain(part.at(mechanics)) for part in estimator_affine(problem)]
laid = lay(problem, plain(problem.system.fiducials_mm), mechanics)
found = image_parts_at(problem.estimation, term, laid, *told, plain(term.reconstructed_mm)).numbers
model, _ = linearise_demand(problem.system, demand)
gains = np.vstack([block.gain("axis_angle").T for block in model.blocks if block.effect.way == "link"])
print(json.dumps([
    found.astype(float).tolist(), image_parts(model, "axis_angle").numbers.tolist(),
    float(np.abs(term.gains.base - gains).max()), [remark.message for remark in task.remarks],
]))
"""
OPTIMISED = """
import json, sys
from dataclasses import replace
import numpy as np
from scipy.optimize import brentq, minimize
from tailstack import load_design, score
from tailstack.design import compile_design
from tailstack.optimisation import optimise
found = optimise(load_design(open(sys.argv[1], encoding="utf-8").read()), starts=3)
check = found.certificate.verification.verdict.checks[-1]
told = [check.requirement, check.status, check.unit, check.interval[1], found.objective, *found.binding]

def angle(system):
    return score(system, losses=False).measures[0].p95

new = compile_design(load_design(found.design))
if found.moved:
    low, high = np.array([[-45.0, -45.0, -85.0], [45.0, 45.0, 15.0]])
    moved = lambda x: replace(new, fiducials_mm=np.ascontiguousarray(x.reshape(-1, 3)))
    at = new.fiducials_mm.ravel()
    bounds = np.tile(np.stack([low, high], 1), (len(new.fiducials_mm), 1))
    first, second = np.triu_indices(len(new.fiducials_mm), 1)
    apart = lambda x: ((x.reshape(-1, 3)[first] - x.reshape(-1, 3)[second]) ** 2).sum(axis=1) / 100 - 1
    best = minimize(
        lambda x: angle(moved(x)), at, method="SLSQP", bounds=bounds, options={"maxiter": 12},
        constraints={"type": "ineq", "fun": apart},
    )
    print(json.dumps([told, angle(new), float(best.fun), angle(compile_design(load_design(found.design_before)))]))
else:
    seat = new.structure_connector
    def excess(h):
        sources = replace(seat.sources, half_width=np.array([h, *seat.sources.half_width[1:]]))
        return angle(replace(new, structure_connector=replace(seat, sources=sources))) - 0.6
    print(json.dumps([told, found.cost_exact_law, 1 / brentq(excess, 1e-4, 0.1, xtol=1e-14)]))
"""

ELSEWHERE = """
import copy, json, sys
import numpy as np
import yaml
from tailstack import DesignFunction, load_design, score, score_batch, sweep, verify
from tailstack.design import compile_design
from tailstack.losses import search_losses
data, site = yaml.safe_load(open(sys.argv[1], encoding="utf-8")), "tip to entry"


def p95(changed):
    return score(load_design(changed), losses=False).measures[0].p95


def changed(**fields):
    other = copy.deepcopy(data)
    for name, value in fields.items():
        section = other[name]
        section[-1].update(value) if name == "requirements" else section.update(value)
    return load_design(other)


design, found = load_design(data), {}
(line,) = (line for line in score(design).losses if line.requirement == "straight")
worst = {}
for gone in data["fiducials"]["points"]:
    rest = copy.deepcopy(data)
    rest["fiducials"]["points"] = [point for point in data["fiducials"]["points"] if point != gone]
    worst[gone["label"]] = p95(rest)
found["loss"] = [line.unit, line.value, p95(data), line.single.value, line.single.lost[0], worst]
often = changed(fiducials={"loss_probability": 0.05})
first, drawn = score(often, losses=False), verify(often, trials=40000, seed=2)
alike = search_losses(compile_design(often)).law_of_simulation(site, "axis_angle", 0.95).quantile(0.95)
interval, status = drawn.measures[0].p95_interval, drawn.verdict.checks[-1].status
found["often"] = [alike, first.measures[0].p95, interval, status]
table = {"views.*.target_noise_px": [0.3, 0.6], "/targets/1/position_mm/0": [3.0, -4.0]}
batch = score_batch(design, table, columns=("value", "within_limits"))
rows = zip(*table.values())
single = [DesignFunction(design, list(table)).score(row).measures[0].p95 for row in rows]
found["batch"] = [dict(batch.ways), next(c.tolist() for name, c in batch.columns.items() if site in name), single]
points = sweep(design, {"views.*.target_noise_px": [0.3, 0.6]}).points
found["sweep"] = [[point.measures[0].site, point.measures[0].p95] for point in points]
inputs = [
    "views.0.target_noise_px", "fiducials.points.0.position_mm.1",
    "interfaces.structure_connector.tolerances.rz.half_width_deg",
]
function = DesignFunction(design, inputs)
value, gradient = function.p95_gradient(function.present, target=site, error="axis_angle")
differences = []
for k, now in enumerate(function.present):
    step = 1e-2 * max(abs(now), 0.1)
    ends = []
    for times in (-2, -1, 1, 2):
        moved = function.present.copy()
        moved[k] += times * step
        ends.append(function.score(moved, losses=False).measures[0].p95)
    differences.append((ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step))
found["derivative"] = [value, gradient.tolist(), differences]
units = changed(requirements={"risk": "per_unit", "min_yield": 0.9})
first, drawn = (each.verdict.checks[-1] for each in (score(units, losses=False), verify(units, trials=2000, seed=4)))
found["units"] = [first.value, first.yield_fraction, drawn.interval, drawn.yield_fraction, drawn.unit]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def variables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a copy with one file more, and one line in the table."""
    source = copy_sources(tmp_path_factory.mktemp("tailstack"))
    measures = source / "tailstack" / "measures"
    (measures / "axis_angle.py").write_text(AXIS_ANGLE, encoding="utf-8")
    table = (measures / "__init__.py").read_text(encoding="utf-8")
    listed = table.replace("    angle.MEASURE,\n", "    angle.MEASURE,\n    axis_angle.MEASURE,\n")
    listed = listed.replace("import angle, axial", "import angle, axial, axis_angle")
    assert len(listed.splitlines()) == len(table.splitlines()) + 1
    (measures / "__init__.py").write_text(listed, encoding="utf-8")
    return served.environment(tmp_path_factory.mktemp("jobs"), PYTHONPATH=path_of(source))


@pytest.fixture(scope="module")
def copy(variables: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    with commands_on(variables) as process:
        yield process


def designed(folder: Path, optimised: str | list[str] = "tip-accuracy", **limit: Any) -> Path:
    """The demo with a second target 30 mm behind the tip, and a limit on the angle between the two."""
    data = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text(encoding="utf-8"))
    x, y, z = data["targets"][0]["position_mm"]
    data["targets"].append({"name": "entry", "position_mm": [x, y, z - 30]})
    data["requirements"].append({"name": "straight", "error": "axis_angle", **(limit or {"limit_deg": 0.6})})
    data["optimise"]["requirement"] = optimised
    file = folder / "guide.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def computed(variables: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any]]:
    """A design that misses the limit by a factor of two, and what the library says of it."""
    folder = tmp_path_factory.mktemp("designs")
    file = designed(folder, limit_deg=0.2)
    done = run_python("-c", LIBRARY, str(file), env=variables, timeout=3 * LIMIT_SECONDS, cwd=folder)
    assert done.returncode == 0, done.stderr
    return file, json.loads(done.stdout)


def test_estimate_simulation_and_table_tell_it_in_its_unit(computed: tuple[Path, list[Any]]) -> None:
    """independent: the angle itself of 20,000 axes by the chain; the interval of 95 % widened to 99.9 %, and by 2 % for
    what first order leaves out.  The interval by rays meets that of the trials (1 in 150 seeds it does not) and is
    narrower."""
    told, checks, exact, (low, high), values, rays, _ = computed[1]
    (site, unit, first, limit), (_, _, drawn, _) = told
    assert (site, unit, limit) == ("tip to entry", "deg", 0.2)
    assert drawn == pytest.approx(exact, rel=1e-3)
    spread = (high - low) * (3.29 / 1.96 - 1) / 2 + 0.02 * first
    assert low - spread < first < high + spread
    assert rays[0] < high
    assert low < rays[1]
    assert rays[1] - rays[0] < high - low
    assert checks[0] == ["inconclusive", "deg"]
    assert checks[1] == ["pass" if high <= limit else "fail" if low > limit else "inconclusive", "deg"]
    assert values[0] == pytest.approx(first, rel=1e-9)
    assert values[1] > 1.05 * values[0]


def test_losses_batch_sweep_derivative_and_units_know_it(variables: dict[str, str], tmp_path: Path) -> None:
    """independent: structures without a bead, single scores, differences of fourth order, and the full chain, whose
    intervals of 95 % are widened to 99.9 %, and by 3 % for what first order leaves out."""
    done = run_python("-c", ELSEWHERE, str(designed(tmp_path)), env=variables, timeout=3 * LIMIT_SECONDS, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    unit, value, whole, single, lost, worst = found["loss"]
    assert (unit, value) == ("deg", whole)
    assert single == pytest.approx(max(worst.values()), rel=1e-9)
    assert worst[lost] == max(worst.values())
    first, bound, (low, high), status = found["often"]
    spread = (high - low) * (3.29 / 1.96 - 1) / 2 + 0.03 * first
    assert low - spread < first < high + spread
    assert bound > first > whole  # more than two missed count as beyond the bound
    assert status == ("pass" if high <= 0.6 else "fail" if low > 0.6 else "inconclusive")
    ways, compiled, scored = found["batch"]
    assert ways == {"compiled": 2, "in full": 0}
    assert compiled == pytest.approx(scored, rel=1e-9)
    assert found["sweep"][0] == ["tip to entry", whole]
    assert found["sweep"][1][1] > 1.05 * whole
    value, gradient, differences = found["derivative"]
    assert value == pytest.approx(whole, rel=1e-12)
    assert gradient == pytest.approx(differences, rel=1e-5)
    value, share, (low, high), drawn, unit = found["units"]
    spread = (high - low) * (3.29 / 1.96 - 1) / 2 + 0.03 * value
    assert low - spread < value < high + spread
    assert unit == "deg"
    assert abs(share - drawn) < 0.1


def test_it_is_limited_in_its_own_unit(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    schema = json.loads(tailstack(copy, tmp_path, "schema", "design"))
    (fields,) = [each["properties"] for each in schema["$defs"].values() if "limit_deg" in each.get("properties", ())]
    assert sorted(fields["error"]["enum"]) == sorted([*MEASURE, "axis_angle"])
    assert fields["error"]["x-limited-by"]["axis_angle"] == "limit_deg"
    assert "limit_deg" in refusal(copy, tmp_path, "validate", str(designed(tmp_path, limit_mm=1.0)))
    alone = str(designed(tmp_path, limit_deg=0.6, targets=["tip"]))
    assert "read nowhere among the targets" in refusal(copy, tmp_path, "validate", alone)


def run_on_copy(code: str, file: Path, variables: dict[str, str], seconds: float = LIMIT_SECONDS) -> Any:
    """What a piece of Python prints of a design."""
    done = run_python("-c", code, str(file), env=variables, timeout=3 * seconds, cwd=file.parent)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_programme_has_its_first_order(variables: dict[str, str], tmp_path: Path) -> None:
    """independent: what comes through the images, and the levers, by the linear model of the score."""
    found, wanted, apart, remarks = run_on_copy(TERMS, designed(tmp_path, optimised="straight"), variables)
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-15)
    assert apart < 1e-12
    assert any("P95 of the angle of the axis at target 'tip to entry' is" in message for message in remarks)
    assert any(" deg; with the tolerances as they are" in message for message in remarks)


def asking(folder: Path, **section: Any) -> Path:
    """The design with a limit of 0.6 deg on the angle, and this to be optimised."""
    file = designed(folder, optimised="straight", limit_deg=0.6)
    data = yaml.safe_load(file.read_text(encoding="utf-8"))
    data["optimise"] = {"requirement": "straight", **section}
    data["fiducials"].pop("diameter_mm", None)
    for view in data["views"]:
        view["target_noise_px"] = 0.05
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return file


@pytest.mark.long
def test_a_budget_keeps_it(variables: dict[str, str], tmp_path: Path) -> None:
    """brute force: the largest half-width at which the score has the angle within its limit."""
    free = {"interface": "structure_connector", "component": "rx", "min_deg": 0.001, "max_deg": 3.0}
    told, cost, best = run_on_copy(OPTIMISED, asking(tmp_path, tolerances=[free]), variables, 3 * LIMIT_SECONDS)
    requirement, status, unit, upper, objective, *binding = told
    assert (requirement, status, unit) == ("straight", "pass", "deg")
    assert upper <= 0.6
    assert cost == pytest.approx(best, rel=1e-5)
    assert f"P95 of {WORDS} within 0.6 deg" in objective
    assert f"P95 of {WORDS} at target 'tip to entry', limit 0.6 deg (straight)" in binding


@pytest.mark.long
def test_a_placement_has_the_least_of_it(variables: dict[str, str], tmp_path: Path) -> None:
    """independent: SLSQP over the score, from where the optimiser ended, finds nothing better by 1e-4."""
    box = {"min_mm": [-45, -45, -85], "max_mm": [45, 45, 15]}
    rules = {"min_spacing_mm": 10, "min_projected_spacing_px": 0, "image_margin_px": 0}
    told, reached, best, before = run_on_copy(
        OPTIMISED, asking(tmp_path, box=box, **rules), variables, 3 * LIMIT_SECONDS
    )
    assert told[1:3] == ["pass", "deg"]
    assert reached < 0.95 * before
    assert best > reached * (1 - 1e-4)


@pytest.mark.long
def test_an_optimisation_tells_it(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    """Both limits together: one is kept in mm, one in degrees, and a table has both."""
    file = str(designed(tmp_path, optimised=["tip-accuracy", "straight"], limit_deg=0.6))
    text = " ".join(tailstack(copy, tmp_path, "optimise", file, "--starts", "2", "-o", "new.yaml").split())
    assert "straight" in text
    assert "0.6 deg" in text
    verified = json.loads(tailstack(copy, tmp_path, "verify", "new.yaml", "--trials", "200000", "--json"))
    assert verified["verdict"]["status"] == "pass"


def test_the_page_tells_it_in_its_unit_and_states_its_limit(computed: tuple[Path, list[Any]]) -> None:
    """The page's own sources, before a service that answers with these records."""
    file, (*_, (estimate, simulation)) = computed
    text, [told] = file.read_text(encoding="utf-8"), estimate["measures"]
    answers = {"score": estimate, "verification": simulation, "distributions": []}
    states = [{"design": yaml.safe_load(text), "text": text, **answers}]
    node = {"x-limited-by": {"tcp": "limit_mm", "axis_angle": "limit_deg"}}
    choices = [
        {"node": node, "path": ["requirements", 0, "error"], "chosen": chosen} for chosen in ("axis_angle", "tcp")
    ]
    found = in_node(walks=[{"states": states}], advised=1.0, choices=choices)
    opened, verified = ([line["text"] for line in moment["lines"]] for moment in found["walks"][0])
    assert any("of the error at the tool, target tip" in line for line in opened)  # of the angle no estimate decides
    strip = verified[: next(k for k, line in enumerate(verified) if "beyond the limit" in line)]
    assert any("of the angle of the axis, tip to entry" in line for line in strip)
    value = simulation["verdict"]["checks"][-1]["value"]
    assert any(line.startswith(f"{value:.4f}"[:5]) and line.endswith(" deg") for line in strip)
    assert not [line for line in strip if line.endswith(" mm")]
    assert "straight at tip to entry: beyond the limit." in " ".join(verified)
    (row,) = {k for k, line in enumerate(verified) if line == "the angle of the axis, tip to entry"}
    assert verified[row + 1].startswith(f"{told['p95']:.3f}")
    assert verified[row + 1].endswith(" deg")
    assert found["choices"] == [
        [{"path": ["requirements", 0, "limit_mm"]}, {"path": ["requirements", 0, "limit_deg"], "value": 1}],
        [],
    ]


@pytest.mark.long
def test_what_judges_and_reports_names_it(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    file = str(designed(tmp_path, limit_deg=0.01))
    for command in ("score", "verify"):
        drawn = ("--trials", "20000", "--seed", "1") if command == "verify" else ()
        text = " ".join(tailstack(copy, tmp_path, command, file, *drawn, codes=(0, 1, 4)).split())
        assert re.search(r"the angle of .{0,20}tip to .{0,20}deg", text)
    gate = json.loads(tailstack(copy, tmp_path, "gate", file, "--format", "json"))
    assert gate["verdict"] == "fail"
    tailstack(copy, tmp_path, "report", file, "--parts", "score", "--format", "html", "-o", "out", codes=(0, 1, 4))
    (page,) = (tmp_path / "out").glob("*.html")
    assert WORDS in page.read_text(encoding="utf-8")
