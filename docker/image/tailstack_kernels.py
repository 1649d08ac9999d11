"""Which of the image's compiled kernels this processor is given; a .pth file asks at the start of every interpreter.

numba looks its cache up under the name of the processor, and an image runs on other processors than the one it was
built on.  Kernels are therefore compiled for levels of the x86-64 psABI instead, and the highest level is taken that
both the processor and the image have.  ``NUMBA_CPU_NAME`` overrides the choice: hosts of different generations that
must agree to the last digit are given the lower level.  Where no level fits, numba compiles for the processor it is on.
"""

from __future__ import annotations

import os
from pathlib import Path

PREBUILT = Path("/opt/tailstack/kernels")
_V3 = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"}
# Highest first; the flags are those of /proc/cpuinfo
LEVELS = {"x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}, "x86-64-v3": _V3}


def levels_of_processor() -> list[str]:
    """Levels that this processor (and its hypervisor) has, highest first; none where that cannot be read."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as lines:
            flags = next((set(line.split()) for line in lines if line.startswith("flags")), set())
    except OSError:
        return []
    return [level for level, needed in LEVELS.items() if needed <= flags]


def choose(environment: dict[str, str], prebuilt: Path = PREBUILT) -> dict[str, str]:
    """What this processor and these prebuilt kernels add to the environment of a process."""
    chosen = {}
    if "NUMBA_CPU_NAME" not in environment:
        level = next((level for level in levels_of_processor() if (prebuilt / level).exists()), None)
        if level is None:
            return {}
        chosen["NUMBA_CPU_NAME"] = level
    if (environment | chosen)["NUMBA_CPU_NAME"] in LEVELS and "NUMBA_CPU_FEATURES" not in environment:
        chosen["NUMBA_CPU_FEATURES"] = ""  # else numba adds this processor's own
    return chosen


def write_choice() -> None:
    """For this process and its children; what ``tailstack.pth`` calls."""
    os.environ.update(choose(dict(os.environ)))
