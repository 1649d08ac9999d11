"""The chapter of radiostereometry: what ISO 16087 asks for beside a migration."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from tailstack.results.radiostereometry import DoubleExaminations, MarkerModel, Radiostereometry
from tailstack.results.tables import IN_DETAIL, PAPER, Cell, Column, Table, tabulate

from ...rendering.document import Block, Paragraph, group

USUAL = (
    "Usual upper limits: condition number 150 /m, mean error of fitting 0.35 mm (Valstar et al., Acta Orthopaedica 76 "
    "(2005) 563)."
)
PUBLISHED = (
    "To compare: a phantom with six markers in each segment ± 0.016 mm and ± 0.024 deg (Acta Orthopaedica 81 (2010) "
    "487), sacroiliac joints of patients 0.47 mm and 0.71 deg (PMC3462864), subsidence of hip stems in patients 0.12 "
    "to 0.14 mm (Clinical Biomechanics 2014, S0268-0033(14)00139-9). A design has no motion of the patient, and no "
    "marker that is loose or hidden."
)
_IN_MM = partial(Column, unit="mm", kind="fixed", digits=4)
Precision = tuple[str, str, str, tuple[float | None, ...]]  # body, number, unit; estimate, simulated, from, to


def radiostereometry_blocks(found: Radiostereometry) -> tuple[Block, ...]:
    """Marker models, double examinations, crossing lines, and how all of it is meant."""
    kept = f". The same at both: {'; '.join(found.kept)}" if found.kept else ""
    drawn = "" if found.pairs is None else f" {found.pairs:,} pairs were simulated; intervals of 95 %."
    about = (
        f"Of two examinations between which nothing has moved. Drawn anew at the second: {'; '.join(found.drawn_anew)}"
        f"{kept}. Precision is 1.96 standard deviations of the difference of both, which is the square root of 2 times "
        f"that of one; the cage is the same, and the patient lies in the same place in it.{drawn}"
    )
    return (
        models_table(found),
        precision_table(found),
        group(lines_table(found), on=PAPER | IN_DETAIL),
        Paragraph(about),
        group(Paragraph(PUBLISHED), on=IN_DETAIL),
    )


def models_table(found: Radiostereometry) -> Table:
    """Each body by its markers."""
    columns = (
        Column("Body", of=lambda row: row.body),
        Column("Against", of=lambda row: row.against or "the cage"),
        Column("Markers", kind="whole", of=lambda row: row.markers),
        Column("Condition number", "1/m", "fixed", 0, brief="condition\nnumber\n1/m",
               of=lambda row: row.condition_number_per_m),
        _IN_MM("Mean error of fitting", brief="mean error\nof fitting\nmm", of=lambda row: _fitting_of(row.estimate)),
        _IN_MM("Simulated", brief="simulated\nmm", of=lambda row: _fitting_of(row.simulated)),
        _IN_MM("From", on=PAPER, of=lambda row: _fitting_of(row.simulated_from)),
        _IN_MM("To", on=PAPER, of=lambda row: _fitting_of(row.simulated_to)),
    )  # fmt: skip
    return tabulate("Marker models", "Marker models, and how well their markers fit", columns, found.bodies, USUAL)


def _fitting_of(examined: DoubleExaminations | None) -> Cell:
    return None if examined is None else examined.fitting_error_mm


def precision_table(found: Radiostereometry) -> Table:
    """What double examinations come out to differ by, component by component."""

    def value(k: int) -> Any:
        return lambda row: row[3][k]

    columns = (
        Column("Body", of=lambda row: row[0]),
        Column("Number", of=lambda row: row[1]),
        Column("Unit", kind="unit", of=lambda row: row[2]),
        *(Column(each, "", "fixed", 4, of=value(k)) for k, each in enumerate(("Estimate", "Simulated", "From", "To"))),
    )
    caption = "Precision of double examinations (1.96 standard deviations), and maximum total point motion (MTPM)"
    rows = [row for model in found.bodies for row in _list_precisions(model)]
    return tabulate("Double examinations", caption, columns, rows)


def _list_precisions(model: MarkerModel) -> Iterator[Precision]:
    each = (model.estimate, model.simulated, model.simulated_from, model.simulated_to)
    for words, unit, field in (("rotation", "deg", "rotation_deg"), ("translation", "mm", "translation_mm")):
        for k, axis in enumerate("xyz"):
            values = tuple(None if one is None else getattr(one, field)[k] for one in each)
            yield model.body, f"{words} {axis}", unit, values
    for words, field in (("mean MTPM", "mtpm_mean_mm"), ("MTPM, P95", "mtpm_p95_mm")):
        values = tuple(None if one is None else getattr(one, field) for one in each)
        if any(value is not None for value in values):
            yield model.body, words, "mm", values


def lines_table(found: Radiostereometry) -> Table:
    """How far the rays to each marker miss each other."""
    columns = (
        Column("Marker", of=lambda row: row.target),
        Column("Views", of=lambda row: " and ".join(row.views)),
        _IN_MM("Expected", of=lambda row: row.mean_mm),
        _IN_MM("Root mean square", of=lambda row: row.rms_mm),
    )
    caption = "Crossing-line error: the shortest distance of the two rays to a marker, everything drawn, by estimate"
    return tabulate("Crossing lines", caption, columns, found.crossing_lines)
