"""Compile every kernel into a directory, once for each processor level of the image that this machine has.

usage: compile_kernels.py DIRECTORY EXAMPLES
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import tailstack_kernels


def compile_all(examples: Path) -> None:
    """Run every computation, briefly, so that numba meets nearly every function with every signature."""
    from tailstack import load_design, optimise, score, verify
    from tailstack.errors import TailstackError
    from tailstack_service.operations.example import variants

    for variant in variants():  # what a service warms up with
        score(load_design(variant))
    for file in sorted(examples.glob("*.yaml")):
        design = load_design(file)
        score(design)
        # purely Gaussian errors have kernels of their own
        score(load_design(with_law(design.source.data, "normal"), base_directory=examples))
        verify(design, trials=1000, threads=1)
        with suppress(TailstackError):  # not every example allows second order and radial sampling
            score(design, second_order=True)
        with suppress(TailstackError):
            verify(design, trials=1000, method="radial", threads=1)
        if design.document.optimise is not None:
            optimise(design, starts=2, threads=1)


def with_law(data: Any, law: str) -> Any:
    """The same design with this law for every tolerance."""
    if isinstance(data, dict):
        return {key: law if key == "distribution" else with_law(value, law) for key, value in data.items()}
    return [with_law(value, law) for value in data] if isinstance(data, list) else data


def main(directory: Path, examples: Path) -> None:
    """One process per level, since numba reads its settings once; on other processors one for this very machine."""
    for level in tailstack_kernels.levels_of_processor() or [None]:
        began = time.monotonic()
        environment = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")}
        environment |= {"NUMBA_CACHE_DIR": str(directory), "OMP_NUM_THREADS": "1"}
        if level is not None:
            environment |= {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""}
        subprocess.run([sys.executable, __file__, "--one", str(examples)], env=environment, check=True)
        if level is not None:
            (directory / level).touch()
        print(f"kernels for {level or 'this processor'}: {time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        compile_all(Path(sys.argv[2]))
    else:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
