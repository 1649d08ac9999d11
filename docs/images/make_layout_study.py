"""Make the figures and the numbers of docs/layouts.md with the tool itself.

``PYTHONPATH=solver:service python docs/images/make_layout_study.py [--only NAME]`` prints every number that the page
quotes and writes layouts_NAME.svg beside this file.  The same seed gives the same output.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import layout_pictures
import numpy as np
from line_charts import Chart, Series, figure
from study_scenes import (
    CARELESS,
    SEED,
    Costs,
    Layouts,
    Scene,
    closed_form_half_width_deg,
    costs_of,
    cube,
    fixed_half_widths,
    least_cost,
    p95_mm,
    problem_of,
    system_at,
)

from tailstack import verify
from tailstack.design import load_design
from tailstack.optimisation.request import read_request
from tailstack.optimisation.search import objective_for_people, rms_distance_mm, search
from tailstack.results.look import BLUE, GREEN, INK, MUTED, PURPLE, VERMILION

HERE = Path(__file__).resolve().parent
DEMO = HERE.parents[1] / "examples" / "demo.yaml"
STARTS = 6
TEXTBOOK = "corners, then\nedges of the box"
BROKEN = "\n(hollow: breaks\na rule)"
RANDOM = "careless (random),\nmedian"
SURVIVORS = "careless, median\nof those that can"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table as the page has it."""
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(str(value) for value in row) + " |")
    print(flush=True)


def write(name: str, svg: str) -> None:
    (HERE / f"layouts_{name}.svg").write_text(svg, encoding="utf-8")


def three(layouts: Layouts) -> tuple[str, str, str, str]:
    """P95 of the optimal, the textbook and the careless layouts (median; 10 ... 90 %), mm."""
    low, middle, high = np.percentile(layouts.careless_mm, [10, 50, 90])
    star = "*" if "breaks" in layouts.textbook else ""
    return f"{layouts.best_mm:.3f}", f"{layouts.textbook_mm:.3f}{star}", f"{middle:.3f}", f"{low:.3f} … {high:.3f}"


def cost_cells(costs: Costs) -> tuple[str, str, str]:
    star = "*" if costs.textbook_breaks_rule else ""
    if costs.best is None:
        return "out of reach", "", ""
    textbook = "out of reach" if costs.textbook is None else f"{costs.textbook:.0f}{star}"
    missed = f"{costs.careless_infeasible} of {CARELESS}"
    return f"{costs.best:.0f}", textbook, missed + (f"; {costs.careless_median:.0f}" if costs.careless_median else "")


def p95_lines(x: Sequence[float], found: Sequence[Layouts]) -> list[Series]:
    """Optimal, textbook and careless layouts with their band; the floor that no layout can go below."""
    low, middle, high = np.percentile([item.careless_mm for item in found], [10, 50, 90], axis=1).tolist()
    hollow = ["breaks" in item.textbook for item in found]
    name = TEXTBOOK + BROKEN if any(hollow) else TEXTBOOK
    return [
        Series(RANDOM, x, middle, MUTED, "diamond", "2 3", low=low, high=high),
        Series(name, x, [item.textbook_mm for item in found], VERMILION, "square", "7 3", hollow=hollow),
        Series("optimal", x, [item.best_mm for item in found], BLUE, "circle"),
        Series(
            "perfect images\nof the fiducials", x, [item.no_fiducial_noise_mm for item in found], GREEN, "none", "1 3"
        ),
    ]


def cost_lines(x: Sequence[float], found: Sequence[Costs]) -> list[Series]:
    kept = [k for k, item in enumerate(found) if item.textbook is not None]
    hollow = [found[k].textbook_breaks_rule for k in kept]
    name = TEXTBOOK + BROKEN if any(hollow) else TEXTBOOK
    some = [k for k, item in enumerate(found) if item.careless_median is not None]
    reached = [k for k, item in enumerate(found) if item.best is not None]
    lines = [
        Series(
            SURVIVORS,
            [x[k] for k in some],
            [found[k].careless_median for k in some],
            MUTED,
            "diamond",
            "2 3",
            label_left=len(some) < len(found) and some[-1:] != [len(found) - 1],
        ),
        Series(
            name, [x[k] for k in kept], [found[k].textbook for k in kept], VERMILION, "square", "7 3", hollow=hollow
        ),
        Series("optimal", [x[k] for k in reached], [found[k].best for k in reached], BLUE, "circle"),
    ]
    return [item for item in lines if len(item.x)]


# --- 1: what they look like -----------------------------------------------------------------------


def optimal() -> None:
    """Pictures of the layouts for 8 and 12 fiducials; the distinct optima of 32 starts; how flat the optimum is."""
    found = {count: fixed_half_widths(Scene(fiducials=count), starts=32) for count in (8, 12)}
    for count, item in found.items():
        print(f"{count} fiducials: P95 {item.best_mm:.4f} mm; 32 starts; optima within 2.5e-4 count as one")
        table(
            ("P95 above the best, %", "starts", "rms distance from the best layout, mm"),
            [
                (f"{100 * (o.objective / item.optima[0].objective - 1):.2f}", o.starts, f"{o.rms_distance_mm:.0f}")
                for o in item.optima
            ],
        )
        places = layout_pictures.by_place(item.layout_mm, Scene().box_mm)
        print({name: np.round(item.layout_mm[which], 1).tolist() for name, which in places.items()})
        rng = np.random.default_rng(SEED)
        low, high = np.array(Scene().box_mm)
        rows = []
        for shift in (1, 2, 5, 10, 20):
            moved = [
                np.clip(item.layout_mm + rng.uniform(-shift, shift, item.layout_mm.shape), low, high) for _ in range(40)
            ]
            worse = [100 * (p95_mm(item.problem, layout) / item.best_mm - 1) for layout in moved]
            rows.append((shift, f"{np.median(worse):.2f}", f"{max(worse):.2f}"))
        table(("each coordinate moved by up to, mm", "P95 rises by (median of 40), %", "at most, %"), rows)
    other = fixed_half_widths(Scene(angle_deg=-90.0), starts=8)
    far = layout_pictures.by_place(other.layout_mm, Scene().box_mm)[layout_pictures.FAR]
    print("second tube on the other side of the box: far face", np.round(other.layout_mm[far], 1).tolist())
    write("optimal", layout_pictures.gallery(found, Scene().box_mm))


# --- 2 to 6: one quantity at a time ---------------------------------------------------------------


def count() -> None:
    """P95 and least cost against the number of fiducials."""
    counts = (6, 7, 8, 10, 12, 14, 16)
    fixed = [fixed_half_widths(Scene(fiducials=n), STARTS) for n in counts]
    costs = [least_cost(Scene(fiducials=n), STARTS) for n in counts]
    loose = [least_cost(Scene(fiducials=n, limit_mm=1.0), 4) for n in (8, 12)]
    print("P95 at 0.05 degrees; least cost at 0.5 mm (* breaks a rule)")
    table(
        ("fiducials", "optimal, mm", "textbook, mm", "careless, median, mm", "10 … 90 %", "first order valid for",
         "cost, optimal", "textbook", "careless out of reach; median of the others",
         "noise through fiducials, mm rms: optimal, textbook, careless", "near face, far face, elsewhere"),
        [
            (n, *three(item), f"{item.careless_valid} of {CARELESS}", *cost_cells(cost),
             ", ".join(f"{v:.3f}" for v in item.through_fiducials_mm),
             layout_pictures.split(item.layout_mm, Scene().box_mm))
            for n, item, cost in zip(counts, fixed, costs, strict=True)
        ],
    )  # fmt: skip
    print("floors at 0.05 degrees:", f"{fixed[0].no_fiducial_noise_mm:.3f} mm with perfect images of the fiducials,",
          f"{fixed[0].no_noise_mm:.3f} mm without any image noise")  # fmt: skip
    print("at 1.0 mm, 8 and 12:", [cost_cells(c) for c in loose])
    checked = []
    for n, item in zip(counts, fixed, strict=True):
        if n not in (6, 8, 12):
            continue
        middle = item.careless_layouts_mm[CARELESS // 2]
        for name, layout in (
            ("optimal", item.layout_mm), ("textbook", item.textbook_layout_mm), ("careless, 16th of 30", middle)
        ):  # fmt: skip
            got = verify(system_at(item.problem, layout), trials=2**18, seed=SEED).targets[0]
            low, high = got.p95_interval_mm
            checked.append(
                (n, name, f"{p95_mm(item.problem, layout):.4f}", f"{got.p95_mm:.4f} [{low:.4f}, {high:.4f}]")
            )
    table(("fiducials", "layout", "P95 first order, mm", "Monte Carlo, 2^18 trials, 95 % interval"), checked)
    charts = [
        Chart("P95 at half-widths of 0.05°", "number of fiducials", "P95, mm (logarithmic)", (6, 8, 10, 12, 14, 16),
              (0.3, 0.5, 1, 2, 5, 10), p95_lines(counts, fixed), log_y=True),
        Chart("least cost at a limit of 0.5 mm", "number of fiducials", "cost, 1/rad (logarithmic)",
              (6, 8, 10, 12, 14, 16), (3000, 4000, 5000, 7000, 10000), cost_lines(counts, costs), log_y=True),
    ]  # fmt: skip
    write("count", figure("What more fiducials buy", "Two line charts over 6 to 16 fiducials. " + CHART_WORDS, charts))


CHART_WORDS = (
    "Blue circles: optimal layout. Vermilion squares: corners, then midpoints of edges of the box. Grey diamonds: "
    "median of 30 random layouts that keep the rules, the band holds the middle 80 per cent. "
    "Hollow squares break a rule on spacing or view. Green dots: only the "
    "target's own image noise is left. Numbers are in the table beside the figure."
)


def spread() -> None:
    """P95 against the edge of the box, and against its distance from the target."""
    edges = (30, 40, 50, 60, 80, 100, 120)
    fixed = [fixed_half_widths(Scene(box_mm=cube(edge)), STARTS) for edge in edges]
    near = [fixed_half_widths(Scene(box_mm=cube(edge, 10 - edge / 2)), 4) for edge in (30, 60)]
    print("box edge, its middle 110 mm from the target (* breaks a rule: out of the image)")
    table(
        ("edge, mm", "optimal, mm", "textbook, mm", "careless, median, mm", "10 … 90 %", "first order valid for",
         "noise through fiducials, mm rms: optimal, textbook, careless"),
        [(edge, *three(item), f"{item.careless_valid} of {CARELESS}",
          ", ".join(f"{v:.3f}" for v in item.through_fiducials_mm)) for edge, item in zip(edges, fixed, strict=True)],
    )  # fmt: skip
    print("near face kept 60 mm from the target, edges 30 and 60 mm:", [f"{item.best_mm:.3f}" for item in near])
    distances = (30, 50, 70, 90, 110, 130)
    apart = [fixed_half_widths(Scene(box_mm=cube(60, 70 - d)), STARTS) for d in distances]
    table(
        ("middle of a 60 mm box to target, mm", "optimal, mm", "textbook, mm", "careless, median, mm", "10 … 90 %",
         "noise through fiducials, mm rms: optimal, textbook, careless"),
        [(d, *three(item), ", ".join(f"{v:.3f}" for v in item.through_fiducials_mm))
         for d, item in zip(distances, apart, strict=True)],
    )  # fmt: skip
    charts = [
        Chart("box of this edge, 110 mm from the target", "edge of the box, mm", "P95, mm (logarithmic)",
              (30, 60, 90, 120), (0.3, 0.5, 1, 2, 5, 10), p95_lines(edges, fixed), log_y=True),
        Chart("box of 60 mm, at this distance", "middle of the box to target, mm", "P95, mm (logarithmic)",
              (30, 50, 70, 90, 110, 130), (0.3, 0.5, 1, 2, 5, 10), p95_lines(distances, apart), log_y=True),
    ]  # fmt: skip
    title = "What a wide structure near the target buys, 8 fiducials at 0.05°"
    write("spread", figure(title, "Two line charts of P95. " + CHART_WORDS, charts))


def angle() -> None:
    """P95 and least cost against the angle between the two shots."""
    angles = (30, 40, 50, 60, 75, 90)
    fixed = [fixed_half_widths(Scene(angle_deg=a), STARTS) for a in angles]
    costs = [least_cost(Scene(angle_deg=a), STARTS) for a in angles]
    table(
        ("angle, degrees", "optimal, mm", "textbook, mm", "careless, median, mm", "10 … 90 %",
         "perfect images of the fiducials, mm", "noise through fiducials, mm rms: optimal, textbook, careless",
         "cost, optimal", "textbook", "careless out of reach; median"),
        [(a, *three(item), f"{item.no_fiducial_noise_mm:.3f}", ", ".join(f"{v:.3f}" for v in item.through_fiducials_mm),
          *cost_cells(cost)) for a, item, cost in zip(angles, fixed, costs, strict=True)],
    )  # fmt: skip
    charts = [
        Chart("P95 at half-widths of 0.05°", "angle between the beams, degrees", "P95, mm (logarithmic)",
              (30, 45, 60, 75, 90), (0.3, 0.4, 0.5, 0.7, 1, 2, 3), p95_lines(angles, fixed), log_y=True),
        Chart("least cost at a limit of 0.5 mm", "angle between the beams, degrees", "cost, 1/rad (logarithmic)",
              (30, 45, 60, 75, 90), (3000, 4000, 6000, 10000, 20000), cost_lines(angles, costs), log_y=True),
    ]  # fmt: skip
    write(
        "angle", figure("What the angle between the shots buys, 8 fiducials", "Two line charts. " + CHART_WORDS, charts)
    )


def lever() -> None:
    """P95 against the lever from pivots to target; how a budget shares out half-widths; pivots that are free."""
    reference = fixed_half_widths(Scene(), STARTS)
    levers = (25, 50, 75, 100, 135, 165, 200)
    rows, best, floor, corners = [], [], [], []
    for arm in levers:
        scene = Scene(pivots_z_mm=(70.0 - arm, 20.0 - arm))
        problem = problem_of(scene, free=False)
        best.append(p95_mm(problem, reference.layout_mm))
        corners.append(p95_mm(problem, reference.textbook_layout_mm))
        quiet = problem_of(replace(scene, noise_px=1e-6), free=False)
        floor.append(p95_mm(quiet, reference.layout_mm))
        again = f"{fixed_half_widths(scene, 4).best_mm:.4f}" if arm in (levers[0], levers[-1]) else ""
        rows.append((arm, f"{best[-1]:.4f}", again, f"{corners[-1]:.4f}", f"{floor[-1]:.4f}", f"{floor[-1] / arm:.5f}"))
    print("both pivots move; half-widths of 0.05 degrees; second lever 50 mm longer; layout of the reference")
    table(("first lever, mm", "P95, optimal for the reference, mm", "optimised anew, mm", "corners, mm",
           "no image noise, mm", "per mm of lever"), rows)  # fmt: skip
    budgets(reference)
    arms = (50, 75, 100, 135, 165, 215)
    found = [least_cost(Scene(pivots_z_mm=(70.0 - arm, -145.0)), 4) for arm in arms]
    first = [float(item.half_width_deg[0]) for item in found]
    second = [float(item.half_width_deg[3]) for item in found]
    print("only the first pivot moves, the second lever stays 215 mm; least cost at 0.5 mm, exact law")
    table(
        ("first lever, mm", "first half-width (rx), degrees", "second, degrees", "their ratio",
         "(levers' ratio)^(-2/3)", "cost"),
        [(arm, f"{a:.4f}", f"{b:.4f}", f"{a / b:.3f}", f"{(arm / 215) ** (-2 / 3):.3f}", f"{item.exact:.0f}")
         for arm, a, b, item in zip(arms, first, second, found, strict=True)],
    )  # fmt: skip
    charts = [
        Chart("P95 at half-widths of 0.05°", "first lever, mm (the second is 50 mm longer)", "P95, mm",
              (0, 50, 100, 150, 200), (0, 0.1, 0.2, 0.3, 0.4, 0.5),
              [Series("corners", levers, corners, VERMILION, "square", "7 3"),
               Series("optimal", levers, best, BLUE),
               Series("no image noise", levers, floor, PURPLE, "none", "9 3 2 3")]),
        Chart("half-widths at least cost, limit 0.5 mm", "first lever, mm (the second is 215 mm)",
              "half-width of rx, degrees", (50, 100, 150, 215), (0, 0.05, 0.1, 0.15, 0.2, 0.25),
              [Series("first interface", arms, first, BLUE),
               Series("second interface", arms, second, INK, "triangle"),
               Series("second × (lever\nratio)^(−2/3)", arms,
                      [b * (arm / 215) ** (-2 / 3) for arm, b in zip(arms, second, strict=True)], MUTED, "none", "2 3"),
               ]),
    ]  # fmt: skip
    words = (
        "Left: P95 grows with the lever from pivot to target. "
        "Right: the interface with the shorter lever gets the looser half-width."
    )
    write("lever", figure("What the lever from pivot to target costs, 8 fiducials", words, charts))


def budgets(reference: Layouts) -> None:
    """All levers scaled together without image noise, and pivots that are free."""
    scaled = []
    for factor in (0.5, 1.0):
        pivots = (70 - 165 * factor, 70 - 215 * factor)
        quiet = closed_form_half_width_deg(Scene(pivots_z_mm=pivots, noise_px=1e-3))
        noisy = least_cost(Scene(pivots_z_mm=pivots), 4)
        scaled.append((factor, f"{quiet:.4f}", f"{noisy.half_width_deg[0]:.4f}", f"{noisy.exact:.0f}",
                       f"{rms_distance_mm(noisy.layout_mm, reference.layout_mm):.0f}"))  # fmt: skip
    table(("both levers times", "first half-width without image noise, degrees", "with 0.5 px", "cost",
           "layout differs from the reference by, mm rms"), scaled)  # fmt: skip
    for words, box in (
        ("first pivot free in x, y = ±20, z = -145 ... -45", ((-20, -20, -145), (20, 20, -45))),
        ("first pivot free in x, y = ±20, z = -145 ... 100", ((-20, -20, -145), (20, 20, 100))),
    ):
        free = least_cost(Scene(pivot_box_mm=box), 4)
        print(words, "-> pivot", (np.round(free.pivot_mm, 3) + 0.0).tolist(), f"cost {free.exact:.0f}, half-widths",
              np.round(free.half_width_deg, 4).tolist())  # fmt: skip


def noise() -> None:
    """P95 and least cost against pixel noise, and which part of P95 the layout can act on."""
    sizes = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
    fixed = [fixed_half_widths(Scene(noise_px=px), STARTS) for px in sizes]
    costs = [least_cost(Scene(noise_px=px), STARTS) for px in sizes]
    table(
        ("noise, px", "no image noise, mm", "target's noise only, mm", "optimal, mm", "textbook, mm",
         "careless, median, mm", "10 … 90 %", "first order valid for", "optimal above target's noise only, %",
         "cost, optimal", "textbook", "careless out of reach; median"),
        [(px, f"{i.no_noise_mm:.3f}", f"{i.no_fiducial_noise_mm:.3f}", *three(i), f"{i.careless_valid} of {CARELESS}",
          f"{100 * (i.best_mm / i.no_fiducial_noise_mm - 1):.1f}", *cost_cells(c))
         for px, i, c in zip(sizes, fixed, costs, strict=True)],
    )  # fmt: skip
    floor = Series("no image noise", sizes, [item.no_noise_mm for item in fixed], PURPLE, "none", "9 3 2 3")
    charts = [
        Chart("P95 at half-widths of 0.05°", "image noise, px (logarithmic)", "P95, mm (logarithmic)",
              (0.05, 0.1, 0.2, 0.5, 1), (0.3, 0.5, 1, 2, 4), [*p95_lines(sizes, fixed), floor], log_x=True, log_y=True),
        Chart("least cost at a limit of 0.5 mm", "image noise, px (logarithmic)", "cost, 1/rad (logarithmic)",
              (0.05, 0.1, 0.2, 0.5, 1), (2500, 3000, 4000, 6000, 10000, 15000), cost_lines(sizes, costs), log_x=True,
              log_y=True),
    ]  # fmt: skip
    words = "Two line charts over image noise from 0.05 to 1 px. " + CHART_WORDS
    write("noise", figure("What image noise costs, 8 fiducials", words, charts))


# --- 7: what placement is worth -------------------------------------------------------------------


def worth() -> None:
    """Optimal placement against the textbook and against carelessness, half-widths optimised alike."""
    rows: list[tuple[str, Costs]] = []
    for fiducials, limit in ((8, 1.0), (8, 0.5), (12, 0.5), (16, 0.5)):
        rows.append(
            (f"{fiducials} fiducials, {limit:g} mm", least_cost(Scene(fiducials=fiducials, limit_mm=limit), 12))
        )
    problem = read_request(load_design(DEMO)).problem
    found = search(problem, starts=12, seed=SEED, threads=1)
    rows.append(("examples/demo.yaml", costs_of(found, SEED)))
    drawn = search(replace(problem, places=()), starts=1, seed=SEED, threads=1)
    print(f"demo, layout as drawn: cost {objective_for_people(drawn.program, drawn.iterates[0].point.objective):.1f}")

    def percent(value: float | None, best: float | None) -> str:
        return "out of reach" if value is None or best is None else f"{100 * (value / best - 1):+.2f} %"

    table(
        ("problem", "least cost", "at the exact law", "textbook", "careless out of reach", "others, median", "worst"),
        [
            (name, f"{c.best:.1f}", f"{c.exact:.1f}", percent(c.textbook, c.best) + "*" * c.textbook_breaks_rule,
             f"{c.careless_infeasible} of {CARELESS}", percent(c.careless_median, c.best),
             percent(c.careless_worst, c.best))
            for name, c in rows
        ],
    )  # fmt: skip
    write("worth", layout_pictures.worth_chart(rows, CARELESS))


def estimators() -> None:
    """P95 and what the layout is worth under each estimator, against the edge of the box; a table, no figure."""
    known: dict[str, dict[str, Any]] = {
        "dlt": {},
        "pose_with_prior": {"estimator": "pose_with_prior", "intrinsics_prior": (0.01, 10.0)},
        "pose": {"estimator": "pose"},
    }
    rows = []
    for name, what in known.items():
        for edge in (30, 60, 100):
            found = fixed_half_widths(Scene(box_mm=cube(edge), **what), 4)
            through = ", ".join(f"{value:.3f}" for value in found.through_fiducials_mm)
            rows.append((name, edge, *three(found), f"{found.no_fiducial_noise_mm:.3f}", through))
    table(
        ("estimator", "edge, mm", "optimal, mm", "textbook, mm", "careless, median, mm", "10 … 90 %", "perfect images",
         "noise through fiducials, mm rms: optimal, textbook, careless"),
        rows,
    )  # fmt: skip


FIGURES: dict[str, Callable[[], None]] = {
    "optimal": optimal, "count": count, "spread": spread, "angle": angle, "lever": lever, "noise": noise,
    "worth": worth, "estimators": estimators,
}  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", choices=list(FIGURES), help="one figure with its numbers")
    wanted: Any = parser.parse_args(arguments).only
    for name in [wanted] if wanted else FIGURES:
        print(f"## {name}\n")
        FIGURES[name]()


if __name__ == "__main__":
    main()
