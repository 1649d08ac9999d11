"""Draw docs/images/demo.svg from the demo design, with the project's environment: no arguments, or ``--check``.

Left: both detector images with the fiducials (filled) and the target (cross).  Right: histogram of 200,000
trials of the TCP error with P95 and the limit; below: the contributors by share of variance.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pictures import write_picture

from tailstack import compile_design, load_design, score, verify
from tailstack.estimation.resection import project
from tailstack.montecarlo.chain import run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack.results.digits import count_decimals, in_percent

ROOT = Path(__file__).resolve().parents[2]
INK, GREY, BLUE, RED, PAPER = "#1b1f24", "#68717a", "#2b6cb0", "#c0392b", "#ffffff"
NAMES = 270  # width of what the design calls its sources


def text(x: float, y: float, words: str, size: int = 13, anchor: str = "start", colour: str = INK) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" fill="{colour}">{words}</text>'


def line(x1: float, y1: float, x2: float, y2: float, colour: str = GREY, width: float = 1.0, dash: str = "") -> str:
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="{colour}" stroke-width="{width}"{dashed}/>'


def detector(system, view, x0: float, y0: float, side: float) -> list[str]:
    width, _ = view.image_size_px
    scale = side / width
    parts = [f'<rect x="{x0}" y="{y0}" width="{side}" height="{side}" fill="#f2f4f7" stroke="{GREY}"/>']
    for u, v in project(view.projection, system.fiducials_mm):
        parts.append(f'<circle cx="{x0 + u * scale:.1f}" cy="{y0 + v * scale:.1f}" r="4" fill="{BLUE}"/>')
    for target in system.targets:
        u, v = project(view.projection, target.position_mm[None])[0] * scale + [x0, y0]
        parts += [line(u - 7, v, u + 7, v, RED, 2), line(u, v - 7, u, v + 7, RED, 2)]
    parts.append(text(x0, y0 - 8, f"{view.name}, {width} px"))
    return parts


def histogram(norms, check, limit: float, x0: float, y0: float, width: float, height: float) -> list[str]:
    bin_mm = limit / 35  # one of the edges is the limit
    counts, edges = np.histogram(norms, bins=bin_mm * np.arange(int(1.9 * check.p95_mm / bin_mm) + 1))
    top = edges[-1]
    scale = height / counts.max()
    parts = [text(x0, y0 - 26, "error at the tool, 200,000 trials of the full chain; red: beyond the limit")]
    step = width / len(counts)
    for k, n in enumerate(counts):
        beyond = k >= 35
        parts.append(
            f'<rect x="{x0 + k * step:.1f}" y="{y0 + height - n * scale:.1f}" width="{step - 1:.1f}" '
            f'height="{n * scale:.1f}" fill="{RED if beyond else BLUE}" fill-opacity="0.75"/>'
        )
    parts.append(line(x0, y0 + height, x0 + width, y0 + height, INK))
    for mm in np.arange(0, top, 0.5):
        parts.append(text(x0 + mm / top * width, y0 + height + 17, f"{mm:g} mm", 11, "middle", GREY))
    low, high = check.p95_interval_mm
    decimals = count_decimals(limit, (high - low) / 2 / check.p95_mm)
    measured = " to ".join(f"{end:.{decimals}f}" for end in (low, high))
    for value, words, colour in (
        (check.p95_mm, f"P95 {check.p95_mm:.{decimals}f} mm ({measured})", INK),
        (limit, f"limit {limit:g} mm", RED),
    ):
        x = x0 + value / top * width
        side = -1 if value < max(limit, check.p95_mm) else 1  # labels point away from each other
        parts += [
            line(x, y0 - 16, x, y0 + height, colour, 1.5, "5 3"),
            text(x + 6 * side, y0 - 6, words, 12, "end" if side < 0 else "start", colour),
        ]
    return parts


def bars(target, limit: float, x0: float, y0: float, width: float) -> list[str]:
    groups = [c for c in target.contributors if c.component == "all"]
    groups = sorted(groups, key=lambda c: -c.variance_share)[:7]
    parts = [text(x0, y0 - 8, "who is to blame: share of variance, and P95 without")]
    for k, row in enumerate(groups):
        y = y0 + 22 * k
        length = row.variance_share / groups[0].variance_share * (width - NAMES - 150)
        parts += [
            text(x0, y + 13, row.label or row.name.replace("_", " ").replace(":", ", "), 12),
            f'<rect x="{x0 + NAMES}" y="{y + 2}" width="{length:.1f}" height="14" fill="{BLUE}"/>',
            text(
                x0 + NAMES + 8 + length,
                y + 13,
                f"{in_percent(row.variance_share)}, {row.p95_without_mm:.{count_decimals(limit)}f} mm",
                12,
                colour=GREY,
            ),
        ]
    return parts


def draw() -> str:
    design = load_design(ROOT / "examples" / "demo.yaml")
    system = compile_design(design)
    target = score(design).targets[0]
    check = verify(design, trials=200_000, seed=1).targets[0]
    errors = run_indices(compile_plan(system), 1, 0, 200_000).errors[0, 0]
    parts = []
    for k, view in enumerate(system.views):
        parts += detector(system, view, 24, 40 + 268 * k, 230)
    limit = system.requirements[0].limit
    parts += histogram(np.linalg.norm(errors, axis=0), check, limit, 300, 58, 560, 212)
    parts += bars(target, limit, 300, 338, 560)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 884 556" font-family="sans-serif" fill="none">'
        f'<rect width="884" height="556" fill="{PAPER}"/>{"".join(parts)}</svg>\n'
    )


if __name__ == "__main__":
    sys.exit(write_picture(Path(__file__).with_name("demo.svg"), draw()))
