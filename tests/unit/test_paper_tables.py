"""The paper's tables by examples/paper: printed cells, their scatter, the fitted scenarios of the oracle, S3, S4."""

from __future__ import annotations

import csv
import importlib
import json
from dataclasses import replace
from functools import cache
from math import radians, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi, norm

from reference_chain import rotation
from scenes import cube8_system, mount, read_only, system_of, target
from tailstack import score
from tailstack.design import compile_design, load_design
from tailstack.estimation.resection import project
from tailstack.geometry.camera import depths
from tailstack.geometry.rotation import RotationForm
from tailstack.system import Reading, System, Triangulation, View

ROOT = Path(__file__).parents[2]
ORACLE = json.loads((ROOT / "tests" / "data" / "oracles" / "paper_scenario.json").read_text())
READINGS = {"A": Reading.EQ18, "B": Reading.PHYSICAL}
COLUMNS_OF_S4 = ("e_3d_mean", "e_3d_std", "e_3d_p95", "e_reprojection_mean_px")


@pytest.fixture(scope="module")
def tables() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "examples" / "paper"))
        yield importlib.import_module("tables")


def oracle_system(name: str, of_a_metre: float = 1e3, noise_px: float = 1.0) -> System:
    """A scenario of the oracle file in units of which a metre has so many: lengths are only numbers to the solver."""
    case = ORACLE[name]
    fiducials, aim = np.array(case["fiducials_m"]) * of_a_metre, np.array(case["target_m"]) * of_a_metre
    views = []
    for k, matrix in enumerate(case["P"]):
        projection = np.array(matrix) @ np.diag([1 / of_a_metre] * 3 + [1.0])
        projection /= np.linalg.norm(projection[2, :3])
        projection *= np.sign(depths(projection, fiducials).mean())
        views.append(View(f"v{k + 1}", read_only(projection), noise_px, noise_px, None))
    seat = mount("structure_connector", (0.0, 0.0, 0.0))
    system = system_of(fiducials, views=tuple(views), targets=(target(aim),), structure_connector=seat)
    return replace(system, reading=READINGS[name])


@cache
def cells_of(name: str) -> list[Any]:
    return importlib.import_module("tables").compute_cells(oracle_system(name), 60_000, 5)


def oracle_name(tables: Any, place: int, cell: Any) -> str:
    """The oracle's name of a cell."""
    setting = tables.list_printed()[place].setting
    if cell.table == "S1":
        statistic = {"mean": "mean", "p95": "P95"}[cell.quantity]
        turned = cell.row.startswith("rotation")
        size = setting.rotation_deg if turned else setting.translation_mm
        return f"S1 {'rot' if turned else 'tr'} {size:g} {statistic}"
    return f"S2 {setting.rotation_deg:g}/{setting.translation_mm:g} {setting.noise_px:g}px"


def named(tables: Any, name: str) -> dict[str, Any]:
    return {
        oracle_name(tables, place, cell): cell
        for place, cell in enumerate(cells_of(name))
        if cell.table != "S3" and not np.isnan(cell.z)
    }


def typed() -> dict[tuple[str, str, str], str]:
    """published: the tables, typed once more by themselves; every cell as it stands there."""
    with (ROOT / "tests" / "data" / "paper_tables.csv").open(encoding="utf-8", newline="") as stream:
        return {(one["table"], one["row"], one["column"]): one["printed"] for one in csv.DictReader(stream)}


def test_printed_cells_are_those_typed_a_second_time_and_those_of_the_oracle(tables: Any) -> None:
    found = {
        (table, row, column): text
        for table in ("S1", "S2", "S3", "S4")
        for row, *texts in tables.PRINTED[table]["rows"]
        for column, text in zip(tables.PRINTED[table]["columns"], texts, strict=True)
        if text is not None
    }
    assert found == typed()
    held = {cell["cell"]: cell["paper_m"] * 1e3 for cell in ORACLE["A"]["cells"]}
    assert {name: cell.printed_mm for name, cell in named(tables, "A").items()} == pytest.approx(held, rel=1e-9)
    assert sum(not np.isnan(cell.z) for cell in cells_of("A")) == 27
    assert [float(row[4]) for row in tables.PRINTED["S3"]["rows"]] == ORACLE["A"]["S3_paper_m"]["analytic"]


@pytest.mark.parametrize("name", "AB")
def test_every_cell_agrees_with_the_oracles_model(tables: Any, name: str) -> None:
    """oracle: cells of a fit made elsewhere, sampled there (errors of some 0.2 %) and here; 4.5 standard errors.  Its z
    is computed from its own model: S1's decimals are the same, so z may differ by ours against its."""
    model = {cell["cell"]: cell for cell in ORACLE[name]["cells"]}
    found = named(tables, name)
    assert found.keys() == model.keys()
    for key, cell in found.items():
        tolerance = 4.5 * cell.standard_error_mm + 0.004 * cell.value_mm
        assert cell.value_mm == pytest.approx(model[key]["model_m"] * 1e3, abs=tolerance), key
        assert cell.tcp_mm == pytest.approx(cell.value_mm, rel=1e-9, abs=1e-9)  # closed form: rigid maps keep norms
        if cell.table == "S1":
            assert cell.z == pytest.approx(model[key]["z"], abs=0.55), key
    outside = {key for key, cell in found.items() if cell.outside}
    if name == "A":
        assert outside == {"S2 0/0 5px", "S2 2/5 2px", "S2 2/5 5px"}
    else:  # z = -2.66 where the band ends at -2.576: either side of it is right
        assert outside - {"S2 2/5 2px"} == {"S2 1/2 5px"}


@pytest.mark.parametrize("name", "AB")
def test_s3_is_an_omission_and_full_first_order_is_right(tables: Any, name: str) -> None:
    """oracle: first order by implicit differentiation elsewhere, its Monte Carlo of 10^6 trials; closed form: variances
    of independent parts add."""
    oracle = ORACLE[name]["S3_std_m"]
    ways = tables.propagate(oracle_system(name))
    assert ways["full"] / 1e3 == pytest.approx(np.array(oracle["first_order_full"]), rel=1e-4)
    without = np.array(oracle["first_order_without_one_views_matrix_covariance"])
    assert ways["without matrix 2"] / 1e3 == pytest.approx(without, rel=1e-4)
    printed = np.array(ORACLE[name]["S3_paper_m"]["analytic"]) * 1e3
    same = [way for way, std in ways.items() if (np.abs(printed - std) <= 0.5).all() and "matrix" in way]
    assert same == ["without matrix 2"]
    for k, cell in enumerate(cell for cell in cells_of(name) if cell.table == "S3"):
        own = 4.5 * cell.standard_error_mm + 0.002 * cell.value_mm
        assert cell.value_mm == pytest.approx(oracle["monte_carlo"][k] * 1e3, abs=own)
        assert abs(ways["full"][k] / cell.value_mm - 1) < 0.012
    parts = {way: std**2 for way, std in ways.items()}
    full, aims = parts["full"], parts["target noise alone"]
    assert parts["matrices alone"] + aims == pytest.approx(full, rel=1e-9)
    lost = [full - parts[f"without matrix {k}"] for k in (1, 2)]
    assert lost[0] + lost[1] + aims == pytest.approx(full, rel=1e-9)
    if name == "A":
        assert ways["target noise alone"] == pytest.approx(
            np.array(ORACLE["A"]["exact"]["std_target_only"]) * 1e3, rel=1e-6
        )


def test_s2_against_its_parts(tables: Any) -> None:
    """oracle: P95 of |m + noise| at the Eq 18 cells (good to 2e-5 there); closed form: between quadrature and sum, and
    by Anderson's inequality a column that does not fall in the Eq 18 reading."""
    cells = {cell.row: cell for cell in cells_of("A") if cell.table == "S2"}
    exact = ORACLE["A"]["exact"]["eq18_cells"]
    for level in ("L1", "L2"):
        bias = cells[f"{level}, 0 px"].value_mm
        for noise in ("2 px", "5 px"):
            joint, alone = cells[f"{level}, {noise}"], cells[f"L0, {noise}"].value_mm
            expected = exact[f"{level}_{noise}".replace(" ", "")]
            assert joint.first_order_mm == pytest.approx(expected["P95_law"] * 1e3, rel=2e-5)
            assert bias == pytest.approx(expected["bias_norm"] * 1e3, rel=1e-9)
            assert sqrt(bias**2 + alone**2) < joint.value_mm < bias + alone
    for name in "AB":
        column = [cell for cell in cells_of(name) if cell.table == "S2" and cell.row.endswith("5 px")]
        eq18 = [cell.first_order_mm if name == "A" else cell.other_reading_mm for cell in column]
        assert eq18 == sorted(eq18)
    physical = [cell.first_order_mm for cell in column]
    assert min(physical) < 0.99 * physical[0]  # there it falls


@pytest.mark.parametrize("quantity", ["mean", "p95", "std_x"])
def test_scatter_of_a_statistic_over_experiments_of_the_papers_size(tables: Any, quantity: str) -> None:
    """closed form (chi with 3 degrees of freedom) and sampled: 600 experiments, whose standard deviation is good to
    2.9 %; four of these."""
    rng = np.random.default_rng(17)
    value, scatter, own = tables.estimate(rng.standard_normal((3, 200_000)), quantity)
    q = chi.ppf(0.95, 3)
    expected = {
        "mean": (chi.mean(3), chi.std(3) / sqrt(tables.TRIALS)),
        "p95": (q, sqrt(0.95 * 0.05 / tables.TRIALS) / chi.pdf(q, 3)),
        "std_x": (1.0, 1 / sqrt(2 * tables.TRIALS)),
    }[quantity]
    assert value == pytest.approx(expected[0], abs=5 * own)
    assert scatter == pytest.approx(expected[1], rel=0.05)
    assert own == pytest.approx(expected[1] / 10, rel=0.05)
    experiments = rng.standard_normal((600, 3, tables.TRIALS))
    assert np.std([tables.estimate(one, quantity)[0] for one in experiments]) == pytest.approx(scatter, rel=0.116)


def test_z_counts_one_percent_of_true_cells_as_outside(tables: Any) -> None:
    """sampled: 3,000 printed means, six decimals of a metre; 30 expected beyond the 99 % band, and 14 to 48 with
    probability 0.998."""
    system = tables.nominal(cube8_system())
    setting = tables.Setting(0.0, 0.0, 0.5)
    errors, _ = tables.sample(tables.apply_setting(system, setting), True, 40_000, 1)
    model = tables.linearise(system, system.targets[0])
    value, scatter, _ = tables.estimate(errors[1], "mean")
    drawn = np.round(np.random.default_rng(3).normal(value, scatter, 3000), 3)
    first = tables.Printed("S1", "row", "mean", setting, float(drawn[0]), 0.0005)
    width = (first.value_mm - value) / tables.compare(first, errors, model, model).z
    assert 14 <= (np.abs((drawn - value) / width) > norm.ppf(0.995)).sum() <= 48
    assert tables.compare(replace(first, value_mm=1.2 * value), errors, model, model).outside


@pytest.mark.parametrize("reading", list(Reading))
def test_levels_of_s4_move_the_target_rigidly_and_leave_no_residual(tables: Any, reading: Reading) -> None:
    """closed form: |T q - q|, and the displaced structure seen with the true projections."""
    system = tables.nominal(cube8_system(reading=reading))
    q, pivot = system.targets[0].position_mm, system.structure_connector.pivot_mm
    for level, (error_mm, kept_px) in tables.compute_levels(system).items():
        degrees, millimetres = tables.LEVELS[level]
        turn = rotation(np.full(3, radians(degrees)), RotationForm.FULL)
        shift = np.full(3, millimetres / sqrt(3))
        moved = turn @ (q - pivot) + pivot + shift
        back = turn.T @ (q - pivot - shift) + pivot
        assert error_mm == pytest.approx(np.linalg.norm((moved if reading is Reading.EQ18 else back) - q), abs=1e-8)
        structure = (system.fiducials_mm - pivot) @ turn.T + pivot + shift
        gaps = [
            np.linalg.norm(project(v.projection, structure) - project(v.projection, system.fiducials_mm), axis=1)
            for v in system.views
        ]
        assert kept_px == pytest.approx(sqrt(np.mean(np.square(gaps))), abs=1e-7)


def test_reprojection_with_noise_does_not_follow_the_level(tables: Any) -> None:
    """closed form: in the Eq 18 reading the estimator is equivariant, trial by trial; 2 px leave about
    2 E(chi_10) / sqrt(16) px to a best fit of 11 numbers to 16 in each of two views, and DLT is nearly one."""
    for name in "AB":
        system = tables.nominal(oracle_system(name))
        settings = [tables.Setting(*torsor, 2.0) for torsor in tables.LEVELS.values()]
        found = [tables.sample(tables.apply_setting(system, each), True, 20_000, 5)[1] for each in settings]
        assert found == pytest.approx([found[0]] * 3, rel=1e-9 if name == "A" else 2e-3)
        assert chi.mean(10) / 2 < found[0] < 1.05 * chi.mean(10) / 2


def test_what_s4_says_of_itself() -> None:
    """closed form, from the typed table: a constant per pixel, a P95 nearer to the mean than in a normal law even at
    the worst rounding, a P95 over mean that does not grow, a level that is zero throughout: as the page says."""
    bench = {level: [float(typed()["S4", level, column]) for column in COLUMNS_OF_S4] for level in ("L0", "L1", "L2")}
    assert bench["L0"] == [0.0] * 4
    assert [bench[level][0] / bench[level][3] for level in ("L1", "L2")] == pytest.approx([0.2755, 0.2760], abs=1e-12)
    shapes = [(p95 - mean) / std for mean, std, p95, _ in (bench["L1"], bench["L2"])]
    worst = [(p95 - mean + 0.001) / (std - 0.00005) for mean, std, p95, _ in (bench["L1"], bench["L2"])]
    assert max(shapes) < 1.1 < max(worst) < norm.ppf(0.95)
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    assert f"at most {max(worst):.2f} with rounding" in page


def test_what_a_design_has_of_its_own_errors_stays_out(tables: Any) -> None:
    """The tables bring their own conditions: tolerances, biases and requirements of a design change nothing."""
    loud = compile_design(load_design(ROOT / "examples" / "demo.yaml"))
    bare = replace(
        loud,
        structure_connector=replace(loud.structure_connector, known=read_only(np.zeros(6))),
        manufacturing_half_width_mm=read_only(np.zeros_like(loud.fiducials_mm)),
        requirements=(),
    )
    setting = tables.Setting(1.0, 2.0, 1.0)
    found = [
        tables.sample(tables.apply_setting(tables.nominal(each), setting), True, 2_000, 1)[0] for each in (loud, bare)
    ]
    assert np.array_equal(*found)
    assert np.linalg.norm(found[0][0], axis=0) == pytest.approx(np.linalg.norm(found[0][1], axis=0), rel=1e-9)


@pytest.mark.long
def test_the_command_prints_what_the_page_states(
    tables: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["tables.py"])
    tables.main()
    printed = capsys.readouterr().out
    page = " ".join((ROOT / "docs" / "paper.md").read_text(encoding="utf-8").split())
    assert "3 of 27 printed cells" in printed
    assert "3 of 27 lie outside" in page
    assert "1 of 27 printed cells" in printed
    assert "9.98 / 7.97 / 19.0" in printed
    assert "9.98 / 7.97 / 19.0" in page
    assert "c_arm: Cios Fusion C-arm, 100 mm cube; the target lies 165 mm from the pivot" in printed
    assert "165 mm from the seat" in page
    assert not any("outside" in line for line in printed.splitlines() if line.startswith(("S1", "S3")))
    monkeypatch.setattr("sys.argv", ["tables.py", str(ROOT / "examples" / "demo.yaml"), "--csv", "--trials", "40000"])
    tables.main()
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert len(rows) == len(tables.list_printed())


def test_first_order_figures_of_scenario_a():
    exact = ORACLE["A"]["exact"]
    # The file's second-order figures are those of the plain 4x4 triangulation in world coordinates, in metres.
    system = replace(oracle_system("A", of_a_metre=1.0, noise_px=2.0), triangulation=Triangulation.PUBLISHED)
    result = score(system, second_order=True).targets[0]
    assert result.std_mm == pytest.approx(exact["std_full"], rel=exact["tol_rel_Sigma"])
    assert result.mean_norm_mm == pytest.approx(exact["mean_norm"], rel=1e-6)
    assert result.p95_mm == pytest.approx(exact["P95"], rel=1e-6)
    second = result.second_order
    assert second.status == "applied"
    assert second.mean_shift_mm == pytest.approx(exact["second_order_bias"], rel=1e-4)
    assert second.std_mm == pytest.approx(exact["second_order_std"], rel=1e-5)
    assert second.p95_mm == pytest.approx(exact["second_order_P95"], rel=1e-5)
