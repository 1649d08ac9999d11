"""The build backend (PEP 517) of ``tailstack-kernels``, for cibuildwheel: it calls build.py.

A wheel has kernels for both levels or is not built: on a machine without AVX-512 this refuses.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SOLVER = HERE.parent
sys.path[:0] = [str(HERE), str(SOLVER)]
# build.py compiles in processes of its own, which import tailstack from here, too
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(SOLVER), os.environ.get("PYTHONPATH", ""))))


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    """Build the wheel for this Python into the folder; its name."""
    import build

    from tailstack.kernels.calls import COMPUTATIONS
    from tailstack.kernels.processor import LEVELS, levels_here

    levels = levels_here()
    if missing := [level for level in LEVELS if level not in levels]:
        raise SystemExit(f"this processor lacks {', '.join(missing)}: build kernels on one that has every level")
    return build.build_kernels(Path(wheel_directory), levels, ",".join(COMPUTATIONS)).name


def build_sdist(sdist_directory: str, config_settings: Any = None) -> str:
    """There is none: machine code is compiled from the sources of tailstack, which has its own."""
    raise SystemExit("tailstack-kernels has no sdist: it is compiled from tailstack's")
