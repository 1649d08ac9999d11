"""The chapters of the studies: the paper's tables, the reach of first order, coupling, views, the bench."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tailstack.studies.views import StudyViews, maps_of

from ...rendering.studies.coupling import COMPARISONS, cases_of
from ..blocks import (
    Block,
    Bullets,
    Cell,
    Column,
    Document,
    Facts,
    Figure,
    KeyNumber,
    Listing,
    Paragraph,
    Row,
    Section,
    Table,
    Tone,
)
from ..study_charts import draw_bench, draw_coupling, draw_linearity, draw_paper, draw_views
from .tables import findings_table, not_included, provenance_facts

if TYPE_CHECKING:
    from tailstack.results import Interval, Provenance
    from tailstack.studies.bench.compare import StudyComparison
    from tailstack.studies.bench.levels import LevelCompared
    from tailstack.studies.coupling import StudyCoupling
    from tailstack.studies.linearity import StudyLinearity
    from tailstack.studies.paper.reproduce import Geometry, StudyPaper

MOST_ROWS = 400  # of a page


def _auditor(provenance: Provenance, command: str, *method: Block) -> tuple[Section, ...]:
    """What every study ends with."""
    return (
        Section("Method and assumptions", method, reader="auditor"),
        Section("What is not included", (not_included(provenance),), reader="auditor"),
        Section("Reproduction", (Listing(command), Paragraph(REPRODUCTION)), reader="auditor"),
    )


REPRODUCTION = (
    "design.yaml is the design of the hash named on the first page; the record of a study does not hold it. The same "
    "version of tailstack gives the same digits, whatever the number of threads, workers or machines."
)


def _ends(interval: Interval | None) -> tuple[Cell, Cell]:
    return (None, None) if interval is None else (interval[0], interval[1])


# --- linearity ------------------------------------------------------------------------------------------


def linearity_document(study: StudyLinearity, sha256: str) -> Document:
    """The map of where first order holds, every point as a row, and how the validity statement did."""
    evaluated = [point for point in study.points if point.status == "ok"]
    within = [point for point in evaluated if point.within == "1 %" and point.sure]
    broken = sum(line.broken for line in study.calibration if line.promise != "not valid")
    numbers = (
        KeyNumber("Points", f"{len(study.points):,}", f"{len(study.points) - len(evaluated):,} refused"),
        KeyNumber("Within 1 %", f"{len(within):,}", f"of {len(evaluated):,}, by the whole interval"),
        KeyNumber("Promises broken", f"{broken:,}", "by the whole interval"),
    )
    caption = "Estimated P95 over the simulated one: where it is within 1, 5 and 20 %."
    axes = (
        f"Noises {_list_numbers(study.noises_px)} px; rotations {_list_numbers(study.rotations_deg)} deg; spreads "
        f"{_list_numbers(study.spreads)}; {_list_numbers(study.counts)} fiducials"
    )
    options = (
        f"--noise {_join(study.noises_px)} --rotation {_join(study.rotations_deg)} --spread {_join(study.spreads)} "
        f"--count {_join(study.counts)} --error {study.error}"
    )
    return Document(
        kind="Study: where the estimate holds",
        title=study.provenance.design_name,
        tone="neutral",
        status="study",
        sentence=study.sentences[0] if study.sentences else "No point could be evaluated.",
        numbers=numbers,
        matters=study.sentences[1:4],
        figures=(Figure("linearity", draw_linearity(study), caption),),
        sections=(
            Section(
                "Points",
                (Paragraph(f"P95 of the {study.error} error at {study.target}. {axes}."), _linearity_table(study)),
            ),
            Section("The validity statement", (_calibration_table(study), Bullets(study.sentences))),
            *_auditor(
                study.provenance,
                f"tailstack study linearity design.yaml {options} --trials {study.trials} --seed {study.seed} --json",
                Paragraph(f"{study.varied}. Intervals: {study.interval_method}."),
            ),
        ),
        provenance=provenance_facts(study.provenance, sha256, study.schema),
    )


def _list_numbers(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _join(values: tuple[float, ...]) -> str:
    return ",".join(f"{value:g}" for value in values)


def _linearity_table(study: StudyLinearity) -> Table:
    rows = []
    for point in study.points:
        place = (point.fiducials, point.spread, point.noise_px, point.rotation_deg)
        quantiles = (point.first_order_p95_mm, point.second_order_p95_mm, point.monte_carlo_p95_mm)
        verdict = point.status if point.within is None else f"{point.within}{'' if point.sure else ', open'}"
        rows.append(Row((*place, point.nu, *quantiles, point.ratio, *_ends(point.ratio_interval), verdict)))
    return Table(
        "Points",
        "Every point of the grid",
        (
            Column("Fiducials", kind="whole"),
            Column("Spread", kind="given"),
            Column("Noise", "px", "given"),
            Column("Rotation", "deg", "given"),
            Column("nu", kind="significant", digits=2),
            Column("Estimate", "mm", "significant", 4),
            Column("Second order", "mm", "significant", 4, on_page=False),
            Column("Monte Carlo", "mm", "significant", 4),
            Column("Ratio", kind="fixed", digits=4),
            Column("Ratio from", kind="fixed", digits=4),
            Column("Ratio to", kind="fixed", digits=4),
            Column("Within"),
        ),
        tuple(rows),
        most=MOST_ROWS,
    )


def _calibration_table(study: StudyLinearity) -> Table:
    return Table(
        "Validity",
        "What the validity statement promised, and what came of it",
        (
            Column("Statement"),
            Column("Points", kind="whole"),
            Column("Came true", kind="whole"),
            Column("Broken", kind="whole"),
            Column("Left open", kind="whole"),
            Column("Smallest ratio", kind="fixed"),
            Column("Largest ratio", kind="fixed"),
        ),
        tuple(
            Row((line.promise, line.points, line.kept, line.broken, line.open, line.lowest_ratio, line.highest_ratio))
            for line in study.calibration
        ),
    )


# --- coupling -------------------------------------------------------------------------------------------


def coupling_document(study: StudyCoupling, sha256: str) -> Document:
    """The parts, both together, and every ratio with its interval."""
    shown = cases_of(study, None)
    designed = next(case for case in shown if case.rotation_deg is None)
    levels = dict.fromkeys(
        (case.rotation_deg, case.translation_mm) for case in study.cases if case.rotation_deg is not None
    )
    options = " ".join(f"--level {rotation:g},{translation:g}" for rotation, translation in levels)
    return Document(
        kind="Study: installation error and noise together",
        title=study.provenance.design_name,
        tone="neutral",
        status="study",
        sentence=study.conclusions[0] if study.conclusions else designed.sentence,
        numbers=(
            KeyNumber("Together", f"{designed.p95_together_mm:.3f} mm", f"P95 at {designed.target}, as designed"),
            KeyNumber("Installation alone", f"{designed.p95_installation_mm:.3f} mm", "P95"),
            KeyNumber("Noise alone", f"{designed.p95_noise_mm:.3f} mm", "P95"),
        ),
        matters=study.conclusions[1:4],
        figures=(Figure("coupling", draw_coupling(study), "P95 of both together against the parts, with intervals."),),
        sections=(
            Section("P95 of the parts and together", (_coupling_quantiles(study),)),
            Section(
                "Ratios",
                (_coupling_ratios(study), Bullets(tuple(case.sentence for case in shown)), Bullets(study.conclusions)),
            ),
            *_auditor(
                study.provenance,
                f"tailstack study coupling design.yaml {options} --error {study.error} --trials {study.trials} --seed "
                f"{study.seed} --json",
                Facts("Parts", (("Installation", study.installation), ("Noise", study.noise))),
                Paragraph(f"Intervals: {study.interval_method}. First order: {study.validity.statement}."),
            ),
        ),
        provenance=provenance_facts(study.provenance, sha256, study.schema),
    )


def _coupling_quantiles(study: StudyCoupling) -> Table:
    rows = []
    for case in study.cases:
        parts = (case.p95_installation_mm, case.p95_noise_mm, case.p95_together_mm, case.p95_vector_sum_mm)
        noise = (case.noise_rms_nominal_mm, case.noise_rms_biased_mm)
        rows.append(Row((case.target, case.installation, case.reading, *parts, case.p95_first_order_mm, *noise)))
    return Table(
        "Parts",
        f"P95 of the {study.error} error, and the noise's root mean square",
        (
            Column("Target"),
            Column("Installation error"),
            Column("Reading"),
            Column("Alone", "mm", "fixed"),
            Column("Noise alone", "mm", "fixed"),
            Column("Together", "mm", "fixed"),
            Column("Added as vectors", "mm", "fixed"),
            Column("Estimate", "mm", "fixed"),
            Column("Noise rms nominal", "mm", "fixed", on_page=False),
            Column("Noise rms biased", "mm", "fixed", on_page=False),
        ),
        tuple(rows),
        most=MOST_ROWS,
    )


def _coupling_ratios(study: StudyCoupling) -> Table:
    rows = []
    for case in study.cases:
        for name, _, which in COMPARISONS:
            ratio = which(case)
            if ratio is not None:
                cells = (ratio.value, *_ends(ratio.interval), ratio.first_order)
                rows.append(Row((case.target, case.installation, case.reading, name, *cells)))
    return Table(
        "Ratios",
        f"Each with its {100 * study.confidence:g} % interval by itself",
        (
            Column("Target"),
            Column("Installation error"),
            Column("Reading"),
            Column("Ratio of"),
            Column("Value", kind="fixed", digits=4),
            Column("From", kind="fixed", digits=4),
            Column("To", kind="fixed", digits=4),
            Column("Estimate", kind="fixed", digits=4),
        ),
        tuple(rows),
        most=MOST_ROWS,
    )


# --- views ----------------------------------------------------------------------------------------------


def views_document(study: StudyViews, sha256: str) -> Document:
    """The maps, what they come to, and every direction as a row."""
    maps = maps_of(study)
    rows, angles = [], []
    for name, one in maps:
        angles += [Row((name, each.view, each.angle_deg)) for each in one.angles]
        for each in one.directions:
            beam = ", ".join(f"{value:g}" for value in each.beam_direction)
            rows.append(Row((name, each.right_deg, each.up_deg, each.p95_mm, each.target, beam, each.reason)))
    caption = "P95 over the directions of each view's beam: what it costs or buys to turn it, and to add one."
    directions = Table(
        "Directions",
        f"P95 of the {study.error} error, at the target where it is largest",
        (Column("View"), Column("To the right", "deg", "given"), Column("Up", "deg", "given"),
         Column("P95", "mm", "fixed"), Column("At", on_page=False), Column("Beam direction in con"),
         Column("Not allowed because")),
        tuple(rows),
        most=MOST_ROWS,
    )  # fmt: skip
    between = Table(
        "Angles",
        "Between the best beam of each map and those of the other views",
        (Column("View"), Column("To"), Column("Angle", "deg", "fixed", 1)),
        tuple(angles),
    )
    return Document(
        kind="Study: which view buys most",
        title=study.provenance.design_name,
        tone="neutral",
        status="study",
        sentence=study.conclusions[0],
        numbers=(
            KeyNumber("As designed", f"{study.p95_mm:.3f} mm", f"P95 at {study.target}"),
            *(KeyNumber(name, f"{one.best.p95_mm:.3f} mm", "P95 of the best direction") for name, one in maps
              if one.best is not None),
        ),
        matters=study.conclusions[1:],
        figures=(Figure("views", draw_views(study), caption),) if maps else (),
        sections=(
            *((Section("The best directions", (between,)), Section("Every direction", (directions,))) if maps else ()),
            *_auditor(
                study.provenance,
                f"tailstack study views design.yaml --cone-deg {study.cone_deg:g} --step-deg {study.step_deg:g} "
                f"--error {study.error} --json",
                Paragraph(
                    "Every direction is scored to first order under the declared laws, everything else as designed, "
                    "one view at a time. Whether the C-arm reaches a direction, and what of the patient or the table "
                    "lies in its beam, is not asked."
                ),
            ),
        ),
        provenance=provenance_facts(study.provenance, sha256, study.schema),
    )  # fmt: skip


# --- measurements on a bench ----------------------------------------------------------------------------

BENCH_TONE: dict[str, Tone] = {"agrees": "pass", "differs": "fail", "not testable": "inconclusive"}


def bench_document(study: StudyComparison, sha256: str) -> Document:
    """Means and spreads beside the prediction, every test, and what would explain a difference."""
    tests = [test for level in study.levels for test in level.tests]
    file = study.file
    findings: tuple[Block, ...] = (findings_table(study.findings),) if study.findings else ()
    return Document(
        kind="Study: measurements against prediction",
        title=study.provenance.design_name,
        tone=BENCH_TONE[study.verdict],
        status=study.verdict,
        sentence=study.conclusions[0] if study.conclusions else f"Measurements and prediction: {study.verdict}.",
        numbers=(
            KeyNumber("Rows", f"{file.rows:,}", f"{file.form} in {file.unit}"),
            KeyNumber("Levels", f"{len(study.levels):,}", f"{study.error} error"),
            KeyNumber("Tests that differ", f"{sum(test.differs for test in tests):,}", f"of {len(tests):,}"),
        ),
        matters=study.conclusions[1:4],
        figures=(Figure("bench", draw_bench(study), "Mean error by level beside what such benches would give."),),
        sections=(
            Section("Means and spreads", (_bench_table(study), *findings)),
            Section("Tests", (_tests_table(study.levels), Bullets(study.conclusions))),
            *((Section("What would explain it", (_explanations_table(study),)),) if study.explanations else ()),
            *_auditor(
                study.provenance,
                f"tailstack study compare design.yaml --measurements {file.name} --error {study.error} "
                f"--instrument-sd {study.instrument_sd_mm:g} --seed {study.seed} --json",
                Facts("Measurements", (("File", file.name), ("SHA-256", file.sha256), ("Frame", study.frame))),
                Paragraph(f"First order: {study.validity.statement}."),
                *((Bullets(file.notes),) if file.notes else ()),
            ),
        ),
        provenance=provenance_facts(study.provenance, sha256, study.schema),
    )


def _bench_table(study: StudyComparison) -> Table:
    rows = []
    for level in study.levels:
        norm, spread = level.norm, level.spread
        ratio = (None, None, None) if spread is None else (spread.ratio, *_ends(spread.interval))
        mean = (norm.measured_mm, *_ends(norm.interval_mm), norm.predicted_mm, *_ends(norm.predicted_range_mm))
        rows.append(Row((level.level, level.target, level.trials, level.installations, *mean, *ratio)))
    return Table(
        "Levels",
        f"Mean error norm, and spread from trial to trial over the predicted one; {100 * study.confidence:g} % each",
        (
            Column("Level"),
            Column("Target"),
            Column("Trials", kind="whole"),
            Column("Installations", kind="whole"),
            Column("Mean", "mm", "fixed"),
            Column("From", "mm", "fixed"),
            Column("To", "mm", "fixed"),
            Column("Predicted", "mm", "fixed"),
            Column("Benches from", "mm", "fixed"),
            Column("Benches to", "mm", "fixed"),
            Column("Spread ratio", kind="fixed"),
            Column("Spread from", kind="fixed", on_page=False),
            Column("Spread to", kind="fixed", on_page=False),
        ),
        tuple(rows),
    )


def _tests_table(levels: tuple[LevelCompared, ...]) -> Table:
    return Table(
        "Tests",
        "Every test, by itself and all of them together",
        (
            Column("Level"),
            Column("Target"),
            Column("Test"),
            Column("p", kind="significant", digits=2),
            Column("p, all tests together", kind="significant", digits=2),
            Column("Differs"),
        ),
        tuple(
            Row((level.level, level.target, test.test, test.p_value, test.p_adjusted, "yes" if test.differs else "no"))
            for level in levels
            for test in level.tests
        ),
    )


def _explanations_table(study: StudyComparison) -> Table:
    rows = []
    for entry in study.explanations:
        intervals = "; ".join(f"{low:.4g} to {high:.4g}" for low, high in entry.intervals)
        values = (entry.declared, entry.most_plausible, intervals)
        rows.append(Row((entry.contributor, entry.component, entry.kind, entry.unit, *values)))
    return Table(
        "Explanations",
        "How large one contributor alone would have to be",
        (
            Column("Contributor"),
            Column("Component"),
            Column("Kind"),
            Column("Unit"),
            Column("Declared", kind="significant", digits=3),
            Column("Most plausible", kind="significant", digits=3),
            Column("95 % intervals"),
        ),
        tuple(rows),
    )


# --- the paper ------------------------------------------------------------------------------------------


def paper_document(study: StudyPaper, sha256: str) -> Document:
    """Every geometry's cells beside the printed ones, and what the printed figures themselves say."""
    compared = [geometry for geometry in study.geometries if geometry.compared]
    cells, outside = (
        sum(getattr(geometry, name) for geometry in compared) for name in ("compared_cells", "outside_cells")
    )
    charts = draw_paper(study)
    figures = tuple(Figure(name.removesuffix(".svg").replace("_", "-"), svg, "") for name, svg in charts.items())
    own = [geometry.design_sha256 or "not known" for geometry in study.geometries]
    return Document(
        kind="Study: the published tables",
        title=study.source,
        tone="neutral",
        status="study",
        sentence=study.statements[0].sentence if study.statements else "No table was compared.",
        numbers=(
            KeyNumber("Cells compared", f"{cells:,}", f"in {len(compared)} geometries that were fitted"),
            KeyNumber("Outside", f"{outside:,}", f"the {100 * study.band:g} % band"),
            KeyNumber("Trials a cell", f"{study.trials:,}", f"{study.published_trials:,} as published"),
        ),
        matters=tuple(statement.sentence for statement in study.statements[1:4]),
        figures=figures[:1],
        sections=(
            *(Section(geometry.name, (_cells_table(geometry, k),)) for k, geometry in enumerate(study.geometries, 1)),
            Section("Printed cells", (_printed_table(study),)),
            Section("Pictures", figures[1:]),
            Section("What the printed figures say", (Bullets(tuple(one.sentence for one in study.statements)),)),
            Section(
                "Reproduction",
                (Listing(f"tailstack study paper --trials {study.trials} --seed {study.seed} --json"),),
                reader="auditor",
            ),
        ),
        provenance=Facts(
            "Provenance",
            (
                ("Source", study.source),
                *((f"SHA-256 of design {k}", one) for k, one in enumerate(own, 1)),
                ("SHA-256 of this record", sha256),
                ("Record", study.schema),
                ("Computed by", f"tailstack {study.tailstack_version}"),
            ),
        ),
    )


def _cells_table(geometry: Geometry, number: int) -> Table:
    rows = []
    for cell in geometry.cells:
        ours = (cell.value_mm, cell.standard_error_mm, cell.first_order_mm, cell.other_reading_mm, cell.tcp_mm)
        rows.append(Row((cell.table, cell.row, cell.quantity, *ours, cell.printed_mm, cell.z)))
    return Table(
        f"Geometry {number}",
        f"Target {geometry.target}, {geometry.reading} reading: our cells beside the printed ones",
        (
            Column("Table"),
            Column("Row"),
            Column("Statistic"),
            Column("Ours", "mm", "significant", 4),
            Column("Standard error", "mm", "significant", 2),
            Column("Estimate", "mm", "significant", 4),
            Column("Other reading", "mm", "significant", 4),
            Column("At the tool", "mm", "significant", 4),
            Column("Printed", "mm", "significant", 4),
            Column("z", kind="signed", digits=1),
        ),
        tuple(rows),
        most=MOST_ROWS,
    )


def _printed_table(study: StudyPaper) -> Table:
    return Table(
        "Printed",
        "Every printed cell, as it is printed, and why one is not predicted",
        (
            Column("Table"),
            Column("Row"),
            Column("Column"),
            Column("Printed"),
            Column("Value", kind="significant", digits=4),
            Column("Unit"),
            *(Column(f"Ours, geometry {k}", kind="significant", digits=4) for k in range(1, len(study.geometries) + 1)),
            Column("Remark"),
        ),
        tuple(
            Row((cell.table, cell.row, cell.column, cell.printed, cell.value, cell.unit, *cell.ours, cell.remark))
            for cell in study.printed
        ),
        most=MOST_ROWS,
    )
