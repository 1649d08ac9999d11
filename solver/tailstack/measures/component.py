"""An error along one axis of a frame, either way: of the error at the tool in tcp, of the located target in con."""

from __future__ import annotations

from functools import partial
from itertools import chain

from .measure import Measure, Measured, Site, Sites, on_each_side


def along_row(name: str, row: int) -> Sites:
    """Sites of one of the six rows of both errors, at the targets that requirements on measure ``name`` name."""

    def sites(design: Measured) -> tuple[Site, ...]:
        import numpy as np

        if not (named := dict.fromkeys(chain.from_iterable(design.demands.get(name, ())))):
            return ()
        weights = np.zeros((3, 6))
        weights[0, row] = 1.0
        return tuple(Site(at, {at: weights}) for at in named)

    return sites


def measure_along(row: int) -> Measure:
    """The measure of one of the six rows of both errors."""
    axis, frame = "xyz"[row % 3], "con" if row > 2 else "tcp"
    name = f"localisation_{axis}" if row > 2 else axis
    of = "the error of the located target" if row > 2 else "the error at the tool"
    return Measure(
        name=name,
        words=f"{axis} of {of}",
        brief=f", located {axis}" if row > 2 else f", {axis}",
        meaning=f"{of} along {axis} of {frame}, either way",
        frame=frame,
        sites=along_row(name, row),
    )


MEASURES = tuple(measure_along(row) for row in range(6))
ONE_SIDED = tuple(
    chain.from_iterable(on_each_side(each, partial(along_row, row=row)) for row, each in enumerate(MEASURES))
)
