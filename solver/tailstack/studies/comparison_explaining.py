"""Which contributor would have to be how large to explain what was measured, one at a time.

By inversion of the tests: a factor (or a value) is plausible when none of the tests, corrected for their number,
refuses the law that has it.  The plausible ones are a 95 % confidence set of it, if nothing else differs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from ..cores import usable_cores
from .comparison_factors import factor_of
from .comparison_linear import Scene
from .comparison_records import Explanation
from .comparison_values import value_of

Progress = Callable[[float], None]


def explanations(
    scenes: Sequence[Scene], alpha: float, threads: int | None = None, progress: Progress | None = None
) -> tuple[Explanation, ...]:
    """A factor for every contributor and a value for every component of a mount; scenes are of one target."""
    parts = {part.name: part for scene in scenes for part in scene.law.contributions}
    names = list(parts)
    moved = {(d.contributor, d.component) for scene in scenes for d in scene.law.displacements}
    asked: list[Callable[[], Explanation]] = [partial(factor_of, scenes, name, alpha) for name in names]
    asked += [partial(value_of, scenes, key, alpha) for key in sorted(moved)]
    found: list[Explanation] = []
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        for one in pool.map(lambda ask: ask(), asked):
            found.append(one)
            if progress is not None:
                progress(len(found) / len(asked))
    return tuple(found)
