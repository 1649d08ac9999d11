"""How near the bound over every layout is to what the optimiser finds, in every shipped design.

``python benchmarks/bounds.py`` prints the table of ``docs/certificate.md``, ``--write`` puts it there.  A design that
does not say what may change is asked what the workbench asks for: beads anywhere in the box round them, half-widths of
the seats by half of themselves.  Of the requirement that is nearest to its limit, at the half-widths found:

- *rms of the images*: how far the root mean square of what comes through them is above the least of any layout, in
  the directions that the quantile feels; what the bound leaves out of it counts as gap;
- *share proven*: of what the images add to the quantile, the part that the bound has too;
- *as normal*: how far the least quantile that a search for it finds, at these half-widths, is above the bound where
  manufacturing errors are taken as normal, of the same standard deviations;
- *time*: of both bounds against all of the optimisation without them, CPU seconds.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from tailstack import load_design, optimise
from tailstack.design import Design, compile_design, design_to_data
from tailstack.errors import TailstackError
from tailstack.optimisation.cost_bound import bound_any_layout, cells_for
from tailstack.optimisation.exact_law import evaluate_demand
from tailstack.optimisation.global_bound import certify_layout, law_with, net_about, why_none
from tailstack.optimisation.problem import PlacementProblem, present_choice
from tailstack.optimisation.request import read_request
from tailstack.optimisation.search import search
from tailstack.optimisation.terms import DemandTerms, every_terms
from tailstack.results.digits import at_most
from tailstack.tail.declared import law_quantile

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "certificate.md"
MARKS = "<!-- bounds -->\n\n", "\n<!-- end of the bounds -->"
HEAD = "| design, all but mm in % | bound, mm | rms of the images | share proven | quantile | as normal | cost | time |"
COLUMNS = ("rms", "share", "quantile", "as_normal", "cost", "time")
SPACING_MM, STARTS = 10.0, 4
OWN_STARTS, OWN_TRIED = 16, 3  # of a search for the least quantile; layouts of it that are held against the bound


@dataclass(frozen=True, slots=True)
class Row:
    """What is known of one design; per cent, None where there is no bound."""

    design: str
    bound_mm: float | None = None
    rms: float | None = None
    share: float | None = None
    quantile: float | None = None
    as_normal: float | None = None
    cost: float | None = None
    time: float | None = None
    as_it_is: float | None = None
    reason: str = ""


def with_freedom(design: Design) -> Design:
    """The design with what the workbench would let change, where it says nothing of that."""
    if design.document.optimise is not None:
        return design
    system, data = compile_design(design), design_to_data(design)
    points = system.fiducials_mm
    low, high = np.floor(points.min(axis=0)), np.ceil(points.max(axis=0))
    apart = min(float(np.linalg.norm(a - b)) for k, a in enumerate(points) for b in points[k + 1 :])
    free = [
        {"interface": seat, "component": name, f"min_{unit}": width / 2, f"max_{unit}": width * 1.5}
        for seat, told in (data.get("interfaces") or {}).items()
        for name, given in _sized(told)
        for unit in ("deg", "mm")
        if (width := given.get(f"half_width_{unit}")) and given.get("distribution") != "bounded"
    ]
    section: dict[str, Any] = {
        "box": {"min_mm": (low - (high == low)).tolist(), "max_mm": (high + (high == low)).tolist()},
        "min_spacing_mm": min(SPACING_MM, float(np.floor(apart))),
        "starts": STARTS,
    }
    freed = data | {"optimise": section | ({"tolerances": free} if free else {})}
    return load_design(freed, base_directory=design.source.directory)


def _sized(seat: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    locators = [(each["name"], each) for each in seat.get("locators") or []]
    return [*(seat.get("tolerances") or {}).items(), *locators]


def measure(name: str, design: Design) -> Row:
    """One optimisation, and both bounds of it."""
    begun = process_time()
    found = optimise(design)
    whole = process_time() - begun
    problem = read_request(load_design(found.design, base_directory=design.source.directory)).problem
    terms, here = every_terms(problem), present_choice(problem)
    net_about.cache_clear()
    begun = process_time()
    told = certify_layout(problem, terms, here)
    cells = cells_for(problem, found.certificate.starts)
    cheapest = bound_any_layout(problem, terms, here.half_width, found.cost_after, 0.0, cells)
    spent = process_time() - begun
    if told.lower_bound_mm is None:
        return Row(name, reason=told.statement)
    least = None if cheapest is None else cheapest.lower_bound
    term = next(
        term for term in terms
        if (term.demand.requirement.name, term.demand.site.name) == (told.requirement, told.target)
        and not why_none(problem, term)
    )  # fmt: skip
    as_normal, as_it_is = gaps_as_normal(load_design(found.design, base_directory=design.source.directory))
    return Row(
        name,
        told.lower_bound_mm,
        told.images_gap_percent,
        share_proven(problem, term, here.half_width, told.lower_bound_mm),
        told.gap_percent,
        as_normal,
        None if least is None else 100 * (found.cost_after / least - 1),
        100 * spent / max(whole - spent, 1e-9),
        as_it_is=as_it_is,
    )


def gaps_as_normal(design: Design) -> tuple[float | None, float | None]:
    """Of the quantile where manufacturing errors are normal, at the design's half-widths, %: of the least quantile that
    a search finds, and of the layout as it is."""
    data = design_to_data(design)
    if (made := data["fiducials"].get("manufacturing")) and made.get("distribution", "normal") != "normal":
        per = compile_design(design).manufacturing_std_mm.max() / np.max(made["half_width_mm"])
        made |= {"distribution": "normal", "coverage_factor": 1 / float(per)}
    problem = read_request(load_design(data, base_directory=design.source.directory)).problem
    problem = replace(problem, objective="quantile", half_widths=())
    found, here, terms = search(problem, starts=OWN_STARTS), present_choice(problem), every_terms(problem)
    layouts = [found.program.split(each.point.x).fiducials_mm for each in found.iterates[:OWN_TRIED]]
    choices = [here, *(replace(here, fiducials_mm=layout) for layout in layouts)]
    as_it_is, *others = [certify_layout(problem, terms, choice).gap_percent for choice in choices]
    return min((gap for gap in (as_it_is, *others) if gap is not None), default=None), as_it_is


def share_proven(problem: PlacementProblem, term: DemandTerms, half_width: Any, bound_mm: float) -> float | None:
    """Of what the images add to the quantile, %; a mean or a unit's is not taken apart."""
    if term.demand.nested or not term.demand.requirement.row.by_quantile:
        return None
    reached = evaluate_demand(problem, term, present_choice(problem))
    law = replace(law_with(term, half_width, np.zeros((3, 3))), mean=reached.mean_mm - reached.images.shift)
    bare_mm = law_quantile(law, term.demand.requirement.quantile).quantile_mm
    return float(100 * (bound_mm - bare_mm) / (reached.exact_mm - bare_mm))


def table(rows: list[Row]) -> str:
    lines = [HEAD, "|---|" + "---:|" * (1 + len(COLUMNS))]
    bounded = [row for row in rows if row.bound_mm is not None]
    for row in bounded:
        told = [_percent(getattr(row, column)) for column in COLUMNS]
        lines.append(f"| {row.design} | {at_most(row.bound_mm)} | {' | '.join(told)} |")
    middle = [
        median([value for row in bounded if (value := getattr(row, column)) is not None] or [inf]) for column in COLUMNS
    ]
    lines.append(f"| **median of {len(bounded)}** | | {' | '.join(map(_percent, middle))} |")
    as_found = median([row.as_it_is for row in bounded if row.as_it_is is not None] or [inf])
    lines += [
        "",
        f"*As normal*, the layouts found for their cost are {_percent(as_found)} % above the bound in the median.",
    ]
    reasons = dict.fromkeys(row.reason for row in rows if row.bound_mm is None)
    without = {each: ", ".join(row.design for row in rows if row.reason == each) for each in reasons}
    lines += ["", *(f"- {reason} {designs}" for reason, designs in without.items())]
    return "\n".join(lines)


def _percent(value: float | None) -> str:
    """Without its sign, which stands at the head of the table."""
    return "" if value is None else f"{value:.2g}" if 0.005 < value < 99.5 else f"{value:.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("designs", nargs="*", help="names without .yaml; absent: all that are shipped")
    parser.add_argument("--write", action="store_true", help="put the table into docs/certificate.md")
    given = parser.parse_args()
    files = sorted(path for folder in ("", "gallery", "paper") for path in (ROOT / "examples" / folder).glob("*.yaml"))
    rows = []
    for path in files:
        name = str(path.relative_to(ROOT / "examples").with_suffix(""))
        if given.designs and name not in given.designs:
            continue
        try:
            rows.append(measure(name, with_freedom(load_design(path))))
        except TailstackError as refused:
            rows.append(Row(name, reason=f"No optimum: {refused.problems[0].detail.split(';')[0].split(',')[0]}."))
        print(rows[-1], file=sys.stderr, flush=True)
    made = table(rows)
    print(made)
    if given.write:
        text = PAGE.read_text(encoding="utf-8")
        start, end = (re.escape(mark) for mark in MARKS)
        PAGE.write_text(re.sub(f"(?s)(?<={start}).*?(?={end})", lambda _: made, text), encoding="utf-8")


if __name__ == "__main__":
    main()
