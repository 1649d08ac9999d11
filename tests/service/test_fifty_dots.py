"""Fifty shots as dots: how many stand on which side of the limit, in every form and on the page."""

import io
import re
from pathlib import Path

import numpy as np
import openpyxl
from test_page_modules import call_page

from plain_data import DEMO
from tailstack import load_design, score
from tailstack.results.look import LIMIT_COLOUR, VALUE_COLOUR
from tailstack.results.score import SHOTS, FiftyShots
from tailstack_service.documents import to_json
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import ReportContents
from tailstack_service.report.charts import draw_dots
from tailstack_service.report.comparing import compute_comparison

LINE = re.compile(rf'<path d="M([\d.]+) [\d.]+L\1 [\d.]+" [^>]*stroke="{LIMIT_COLOUR}"')
SCRIPT = """const { heap, missWords, scaleOf } = require("./dots.js");
answer(asked.map((each) => [missWords(each), ...heap(each, scaleOf([each]).end, scaleOf([each]).step)]));"""


def test_every_shot_is_one_dot_and_those_beyond_the_limit_have_another_shape(tmp_path: Path) -> None:
    """Of 24 laws, wide and narrow beside their limit; by the report, and by the page's own module."""
    several = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        values = np.sort(rng.lognormal(0.0, rng.uniform(0.02, 0.9), SHOTS) * rng.uniform(0.1, 3.0))
        several.append(FiftyShots("the error, tip", "mm", tuple(values.tolist()), 1.0, float((values > 1.0).mean())))
    asked = [{name: getattr(each, name) for name in FiftyShots.__dataclass_fields__} for each in several]
    for shots, (words, *heap) in zip(several, call_page(tmp_path, ("words", "dots"), SCRIPT, asked), strict=True):
        svg = draw_dots([("one", shots)])
        kept = [float(x) for x in re.findall(rf'<circle cx="([\d.]+)" [^>]*fill="{VALUE_COLOUR}"', svg)]
        missed = [float(x) for x in re.findall(rf'<path d="M([\d.]+) [^>]*fill="{LIMIT_COLOUR}"', svg)]
        misses = round(SHOTS * shots.exceedance_probability)
        assert (len(kept), len(missed)) == (SHOTS - misses, misses)
        assert max(kept, default=0.0) < float(LINE.findall(svg)[0]) <= min(missed, default=1e9)
        assert [sum(n for k, n in heap if (k >= 0) == far) for far in (False, True)] == [SHOTS - misses, misses]
        assert words.startswith(f"{misses} of 50 shots miss")


def test_they_stand_in_every_form_and_two_designs_on_one_scale() -> None:
    design = load_design(DEMO)
    body = to_json(record := score(design, fifty_shots=True))
    assert "5 of 50 shots miss the limit of 1 mm" in render("score", body, "html").decode()
    book = openpyxl.load_workbook(io.BytesIO(render("score", body, "xlsx")))
    assert [row[3].value for row in book["Fifty shots"].iter_rows(min_row=3)].count("misses") == 5
    assert "o" * 45 + "X" * 5 in OPERATIONS["score"].write(record, None)
    wider = design.with_value("/interfaces/connector_flange/tolerances/rx/half_width_deg", 0.4)
    compared = to_json(compute_comparison(design, wider, ReportContents(parts=("score",))))
    page = render("comparison", compared, "html").decode()
    svg = page[page.index("<svg", page.index("Fifty shots that stand for all")) :].split("</svg>")[0]
    assert len(LINE.findall(svg)) == 2
    assert len(set(LINE.findall(svg))) == 1  # both have one limit
