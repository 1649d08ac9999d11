"""Write the simulated bench files of this folder: ``python examples/measurements/make_examples.py``.

Nothing in them was measured.  Each is one bench of ``examples/demo.yaml``, drawn through the full chain, with a truth
that the comparison is then asked to find.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import radians, sqrt
from pathlib import Path

import numpy as np

from tailstack import compile_design, load_design
from tailstack.studies.bench.levels import BenchDraws, set_level, simulate_benches
from tailstack.system import Array, System

HERE = Path(__file__).parent
ORIGIN = "# Simulated, not measured: one bench of examples/demo.yaml, by make_examples.py.\n"
LEVELS = {"L0": (0.0, 0.0), "L1": (1.0, 2.0), "L2": (2.0, 5.0)}  # deg about each axis, mm along (1, 1, 1)


def points_text(system: System, sizes: Sequence[int], seed: int, truth: str) -> str:
    """Where the tip came to lie, connector frame, 1 um."""
    errors = simulate_benches(system, 0, "tcp", sizes, BenchDraws(seed, 1))[0]
    points = errors @ system.T_tcp_con[:3, :3] + system.targets[0].position_mm
    rows = [f"{number},{trial}" for number, count in enumerate(sizes, 1) for trial in range(1, count + 1)]
    lines = [f"{row},{x:.3f},{y:.3f},{z:.3f}\n" for row, (x, y, z) in zip(rows, points, strict=True)]
    return f"{ORIGIN}# Truth: {truth}.\ninstallation,trial,x_mm,y_mm,z_mm\n" + "".join(lines)


def levels_text(system: System, count: int, seed: int) -> str:
    """Norms of the localisation error by level, 1 um."""
    lines = []
    for number, (level, (rotation, translation)) in enumerate(LEVELS.items()):
        set_by = np.array([radians(rotation)] * 3 + [translation / sqrt(3)] * 3)
        here, draws = set_level(system, set_by), BenchDraws(seed, 1, first=number << 40)
        errors: Array = simulate_benches(here, 0, "localisation", (count,), draws)[0]
        columns = ",".join([f"{rotation:g}"] * 3 + [f"{translation / sqrt(3):.4f}"] * 3)
        norms = np.linalg.norm(errors, axis=1)
        lines += [f"{level},{trial},{columns},{norm:.3f}\n" for trial, norm in enumerate(norms, 1)]
    header = "level,trial,rx_deg,ry_deg,rz_deg,tx_mm,ty_mm,tz_mm,error_mm\n"
    return f"{ORIGIN}# Truth: the design as it stands, at each level's installation error.\n{header}" + "".join(lines)


def files() -> dict[str, str]:
    """Text of every simulated file, by name."""
    system = compile_design(load_design(HERE.parent / "demo.yaml"))
    flange = system.connector_flange
    bent = replace(flange, known=flange.known + np.array([radians(0.46), 0, 0, 0, 0, 0]))
    loud = tuple(replace(v, fiducial_noise_px=0.6, target_noise_px=0.6) for v in system.views)
    return {
        "bench_as_designed.csv": points_text(system, (8,) * 4, 101, "the design as it stands"),
        "bench_tilted_flange.csv": points_text(
            replace(system, connector_flange=bent), (8,) * 4, 102, "connector on flange tilted by 0.46 deg about x"
        ),
        "bench_noisy_views.csv": points_text(
            replace(system, views=loud), (25,), 103, "image noise of 0.6 px instead of 0.3 px, fiducials and target"
        ),
        "bench_levels.csv": levels_text(system, 12, 105),
    }


if __name__ == "__main__":
    for name, text in files().items():
        (HERE / name).write_text(text, encoding="utf-8")
