"""Results in a notebook: what is shown, drawn, and taken as data; records are the answers in openapi.json."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from answers import committed_answers
from openapi_scenes import DOCUMENT
from rules import resolved
from service_scenes import EXAMPLES, luminance

from family import run_python
from tailstack import MissingExtraError, load_design, score, sweep
from tailstack.results import Optimisation, Score, Verification
from tailstack.results.notebook import PLAIN, TONES
from tailstack.results.record import Result
from tailstack.results.sweep import Sweep
from tailstack_service.cli.main import main
from tailstack_service.documents import from_json, from_plain, to_json
from tailstack_service.gate.records import GateRecord
from tailstack_service.operations.registry import OPERATIONS
from waiting import LIMIT_SECONDS

PATHS: dict[type[Result], str] = {
    Score: "/v1/scores",
    Verification: "/v1/verifications",
    Optimisation: "/v1/optimisations",
    Sweep: "/v1/sweeps",
    GateRecord: "/v1/gates",
}
KINDS = pytest.mark.parametrize("kind", PATHS, ids=lambda kind: kind.__name__)


def published(kind: type[Result]) -> Any:
    """The answer that openapi.json has as an example."""
    content = resolved(DOCUMENT, DOCUMENT["paths"][PATHS[kind]]["post"]["responses"]["200"])["content"]
    example = next(iter(content["application/json"]["examples"].values()))
    return from_plain(kind, resolved(DOCUMENT, example)["value"])


@pytest.fixture
def pyplot() -> Iterator[Any]:
    """matplotlib without a screen, closed again."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    import matplotlib.pyplot as pyplot

    yield pyplot
    pyplot.close("all")


# --- plain data and tables -----------------------------------------------------------------------------


@KINDS
def test_to_dict_is_what_the_json_holds(kind: type[Result]) -> None:
    record = published(kind)
    assert record.to_dict() == json.loads(to_json(record))


@KINDS
def test_every_table_is_a_frame_with_units_in_its_columns(kind: type[Result]) -> None:
    record = published(kind)
    for table in record.outline().frames:
        frame = record.to_frame(table.name)
        assert len(frame) == len(table.rows)
        assert len(frame.columns) == len(set(frame.columns)) > 0, table.name  # a table without rows has columns too
        assert not [name for name in frame.columns if "_mm_" in name and not re.search("_per_", name)]
        assert not [value for column in frame for value in frame[column] if isinstance(value, tuple | list | dict)]
    assert record.to_frame().equals(record.to_frame(record.outline().frames[0].name))


def test_columns_hold_the_numbers_of_the_record() -> None:
    record = published(Verification)
    first, frame = record.targets[0], record.to_frame("targets")
    row = frame.iloc[0]
    assert tuple(row[[f"bias_{axis}_mm" for axis in "xyz"]]) == first.bias_mm
    assert (row["p95_low_mm"], row["p95_high_mm"]) == first.p95_interval_mm
    assert row["localisation_p95_mm"] == first.localisation.p95_mm
    assert row["localisation_std_y_mm"] == first.localisation.std_mm[1]
    scored = published(Score)
    row, target = scored.to_frame().iloc[0], scored.targets[0]
    assert row["covariance_xz_mm2"] == target.covariance_mm2[0][2]
    assert row["bounds_unimodal_mm"] == target.bounds_mm.unimodal
    budget = scored.to_frame("budget")
    assert budget["variance_share"].sum() == pytest.approx(sum(line.variance_share for line in target.contributors))


def test_a_sweep_is_a_row_for_each_point_and_target_refused_points_too() -> None:
    design = load_design(EXAMPLES / "slicer_markups.yaml")
    found = sweep(design, {"views.AP.fiducial_noise_px": [0.2, -1.0], "views.LAT.fiducial_noise_px": [0.1, 0.4]})
    frame = found.to_frame()
    targets = len(found.points[0].targets)
    assert len(frame) == 2 * targets + 2
    refused = frame[frame["status"] == "refused"]
    assert list(refused["/views/0/fiducial_noise_px"]) == [-1.0, -1.0]
    assert refused["p95_mm"].isna().all()
    assert refused["reason"].str.contains("/views/0/fiducial_noise_px").all()
    largest = frame.groupby("/views/1/fiducial_noise_px")["p95_mm"].max()
    assert list(largest) == [max(target.p95_mm for target in point.targets) for point in found.points[:2]]


def test_an_unknown_table_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="Score has the tables targets, checks, budget; got 'budgets'"):
        published(Score).to_frame("budgets")


def test_what_is_not_installed_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    record = published(Score)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match="pip install pandas"):
        record.to_frame()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"pip install -e '.*\[report\]'"):
        record.plot()
    assert "<table" in record._repr_html_()  # which needs neither


# --- what a notebook shows -----------------------------------------------------------------------------


def tree_of(record: Any) -> ElementTree.Element:
    """What is shown, read as a browser that forgives nothing would."""
    return ElementTree.fromstring(record._repr_html_())


@KINDS
def test_a_notebook_shows_verdict_and_tables(kind: type[Result]) -> None:
    record = published(kind)
    words = " ".join(tree_of(record).itertext())
    outline = record.outline()
    assert outline.kind in words
    assert outline.title in words
    assert outline.status in words
    assert outline.sentence in words
    assert len(list(tree_of(record).iter("table"))) >= 1


def test_a_score_is_shown_with_p95_limit_and_budget() -> None:
    record = score(load_design(EXAMPLES / "demo.yaml"))
    words = " ".join(tree_of(record).itertext())
    assert "the error at the tool (target tip) is at most 1.14 mm (P95; between 1.13 and 1.16)" in words
    assert "above the limit of 1 mm" in words
    cells = ["".join(cell.itertext()) for row in tree_of(record).iter("tr") for cell in row]
    largest = max(record.targets[0].contributors, key=lambda line: (line.component != "all") * line.variance_share)
    assert cells[cells.index(f"{100 * largest.variance_share:.1f}") - 3] == largest.component
    assert '7 more: .to_frame("budget") has all' in words


@KINDS
def test_names_from_a_design_are_text_and_no_html(kind: type[Result]) -> None:
    """A design comes from anybody; its names stand in the page of whoever opens it."""
    evil = "<img src=x onerror=alert(1)>\"'&</td>"
    named = ("design_name", "policy_name", "name", "label", "target", "file", "message", "sentence", "requirement")

    def spoil(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        return {key: evil if key in named and isinstance(value, str) else value for key, value in pairs}

    data = json.loads(json.dumps(published(kind).to_dict()), object_pairs_hook=spoil)
    record = from_plain(kind, data)
    shown = record._repr_html_()
    assert "<img" not in shown
    assert evil in "".join(tree_of(record).itertext())
    allowed = {"div", "span", "table", "thead", "tbody", "tr", "th", "td", "ul", "li"}
    assert {element.tag for element in tree_of(record).iter()} <= allowed
    assert {name for element in tree_of(record).iter() for name in element.attrib} <= {"style", "scope", "aria-hidden"}


@KINDS
def test_it_can_be_read_on_a_light_and_on_a_dark_page(kind: type[Result]) -> None:
    """Letters have the page's colour, or stand on a ground of their own with a contrast of 4.5 and more."""
    for element in tree_of(published(kind)).iter():
        look = dict(entry.split(":", 1) for entry in element.get("style", "").rstrip(";").split(";") if entry)
        assert ("color" in look) <= ("background" in look)
        if "color" in look:
            light, dark = sorted((luminance(look["background"]), luminance(look["color"])), reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= 4.5
    assert {PLAIN, *TONES.values()} > {TONES["pass"]}


# --- charts --------------------------------------------------------------------------------------------


@pytest.mark.long("Score")
@KINDS
def test_every_result_draws_itself_and_leaves_the_settings(kind: type[Result], pyplot: Any) -> None:
    record, before = published(kind), dict(pyplot.rcParams)
    axes = record.plot()
    axes.figure.canvas.draw()
    assert dict(pyplot.rcParams) == before
    assert axes.get_title(loc="left")
    assert axes.get_xlabel()
    figure, own = pyplot.subplots()
    assert record.plot(ax=own) is own
    assert own.figure is figure


def test_bars_are_the_shares_of_the_budget(pyplot: Any) -> None:
    record = score(load_design(EXAMPLES / "demo.yaml"))
    axes: Any = record.plot()
    widths = [bar.get_width() for bar in axes.patches]
    shares = sorted((line.variance_share for line in record.targets[0].contributors if line.component != "all"
                     or line.name.startswith(("fiducial", "target"))), reverse=True)  # fmt: skip
    assert widths[:12] == pytest.approx([100 * share for share in shares[:12]])
    assert sum(widths) == pytest.approx(100)
    axes.figure.canvas.draw()
    box = axes.figure.get_tightbbox(axes.figure.canvas.get_renderer())
    assert box.x1 <= axes.figure.get_figwidth() + 0.05  # nothing leaves the picture
    assert box.x0 >= -0.05


def test_curves_go_over_the_last_axis_and_gaps_are_refused_points(pyplot: Any) -> None:
    design = load_design(EXAMPLES / "demo.yaml")
    found = sweep(design, {"views.AP.fiducial_noise_px": [0.1, 0.3], "views.LAT.fiducial_noise_px": [0.5, -1, 0.2]})
    lines: Any = found.plot().get_lines()
    assert [line.get_label() for line in lines] == [
        "views.AP.fiducial_noise_px 0.1", "views.AP.fiducial_noise_px 0.3", "limit 1 mm",
    ]  # fmt: skip
    by_values = {point.values: point for point in found.points}
    for line, noise in zip(lines[:2], (0.1, 0.3), strict=True):
        assert list(line.get_xdata()) == [-1.0, 0.2, 0.5]
        refused, *drawn = line.get_ydata()
        assert refused != refused
        assert drawn == [by_values[noise, other].targets[0].p95_mm for other in (0.2, 0.5)]


def test_more_curves_than_can_be_told_apart_are_refused() -> None:
    found = published(Sweep)
    one = found.points[0]
    axes = tuple(replace(found.axes[0], pointer=f"/views/{k}/fiducial_noise_px", values=tuple(map(float, range(1, n))))
                 for k, n in enumerate((15, 3)))  # fmt: skip
    points = tuple(replace(one, values=(a, b)) for a in axes[0].values for b in axes[1].values)
    with pytest.raises(ValueError, match="at most 12 curves, this sweep has 14"):
        replace(found, axes=axes, points=points).plot()


# --- a notebook that runs ------------------------------------------------------------------------------

RUN = """
import json, sys
import nbformat
from nbclient import NotebookClient
cells = [nbformat.v4.new_code_cell(source) for source in json.load(sys.stdin)]
notebook = nbformat.v4.new_notebook(cells=cells)
limit = int(sys.argv[1])
NotebookClient(
    notebook, timeout=limit, startup_timeout=limit, kernel_name="python3", allow_errors=True
).execute()
nbformat.validate(notebook)
json.dump([cell.outputs for cell in notebook.cells], sys.stdout)
"""


def run_cells(sources: Sequence[str], folder: Path) -> list[list[dict[str, Any]]]:
    """What each cell shows."""
    done = run_python(
        "-c", RUN, f"{3 * LIMIT_SECONDS:.0f}", input=json.dumps(sources), cwd=folder, timeout=3 * LIMIT_SECONDS
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


def run_example(folder: str, name: str, path: Path) -> list[list[dict[str, Any]]]:
    """A notebook of the examples from top to bottom, where the command writes it, with nothing else beside it."""
    assert main(["example", folder, "-o", str(path / "there")]) == 0
    notebook = json.loads((path / "there" / name).read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells), "keep it without outputs"
    outputs = run_cells(["".join(cell["source"]) for cell in cells], path / "there")
    assert [one for cell in outputs for one in cell if one["output_type"] == "error"] == []
    return outputs


@pytest.mark.long
def test_the_example_notebook_says_what_the_readme_says(tmp_path: Path) -> None:
    """And the library's own derivative beside it."""
    shown, drawn, table, changed, curves, slopes, checked = run_example("integrations", "notebook.ipynb", tmp_path)
    assert "is at most 1.14 mm" in "".join(shown[0]["data"]["text/html"])
    for cell in (drawn, curves):
        assert sum("image/png" in one.get("data", {}) for one in cell) == 1, "the picture, once"
    assert "text/html" in table[0]["data"]
    assert re.match(r"P95 1\.144 mm, with sharper images \d\.\d+ mm", changed[0]["text"])
    assert len(re.findall(r"mm per unit of", slopes[0]["text"])) == 4
    assert "text/html" in checked[-1]["data"]


@pytest.mark.long
def test_the_notebook_of_the_paper_shows_its_tables_figures_and_equations(tmp_path: Path) -> None:
    _, *tables, resection, triangulation, readings = run_example("paper", "paper.ipynb", tmp_path)
    kinds = [{kind for one in cell for kind in one.get("data", {})} for cell in tables]
    assert [("image/png" in found, "text/html" in found) for found in kinds] == [
        (False, True), (True, False), (False, True), (True, False), (False, True), (False, True),
    ]  # fmt: skip
    assert resection[0]["text"].splitlines() == [
        "columns and rank: 12 11", "changes of the matrix alike: False", "of the image alike: True",
    ]  # fmt: skip
    assert triangulation[0]["text"].splitlines() == [
        "the rows vanish: True", "twice the weight of LAT moves the point by 0.013 mm",
    ]  # fmt: skip
    assert readings[0]["text"].splitlines() == ["physical finds inverse of T, q", "eq18 finds T q"]


def test_the_repr_of_a_design_and_of_a_score_is_a_line_or_two() -> None:
    """All that it holds, with the place of every value in its file, filled three screens."""
    design = load_design(EXAMPLES / "demo.yaml")
    assert repr(design) == f"<Design {design.name!r}: 12 fiducials, 2 views, 1 target; sha256 {design.sha256[:12]}>"
    record = published(Score)
    said = repr(record)
    assert record.provenance.design_name in said
    assert f"{record.verdict.status}: " in said
    assert "targets, checks, budget" in said


# --- what an interpreter shows ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(OPERATIONS))
def test_the_repr_of_every_published_record_is_a_few_lines(name: str) -> None:
    """An example of every record, as a service answered, and what an interpreter prints of it."""
    answered = committed_answers()[f"create_{name.replace('-', '_')}"]
    said = repr(from_json(OPERATIONS[name].record(), json.dumps(answered).encode()))
    assert len(said.splitlines()) <= 3
    assert len(said) < 800
    assert "object at 0x" not in said


@pytest.mark.long("tailstack.results", "tailstack.design", "tailstack.optimisation")
@pytest.mark.parametrize("package", ["tailstack", "tailstack.results", "tailstack.design", "tailstack.optimisation"])
def test_completion_of_a_package_offers_what_is_public(package: str) -> None:
    """In an interpreter of its own: names that are loaded later are there, insides that were loaded are not."""
    code = f"import json, {package} as p, tailstack.scoring; print(json.dumps([dir(p), p.__all__]))"
    offered, public = json.loads(run_python("-c", code, check=True).stdout)
    assert offered == sorted(public)
    if package == "tailstack":
        assert {"load_design", "score", "sweep", "optimise", "score_batch", "DesignFunction"} <= set(offered)
        assert not {"TYPE_CHECKING", "annotations", "kernels", "packed"} & set(offered)
