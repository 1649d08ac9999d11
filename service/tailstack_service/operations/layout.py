"""Where everything is: fiducials and targets in space and in every image, and the scene that pages turn."""

from __future__ import annotations

from typing import Any, Self

from .operation import LateImport, Operation, Options, run_function


class LayoutOptions(Options):
    """What is wanted besides positions and images."""

    scene: bool = False
    """Add the scene in space, with the errors of a score."""

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        return super().of_record(record, scene=record.scene is not None)


OPERATION = Operation(
    name="layout",
    verb="layout",
    path="/v1/layouts",
    summary="Where every fiducial and target is, in space and in each image",
    description="Fiducials and targets in con and in every image, without noise and as the structure sits with its "
    "known bias, the projections that image them, and the scene that reports and the web page turn in space.",
    title="answer of layout: fiducials and targets in space and in every image",
    options=LayoutOptions,
    record=LateImport("..report.chapters.coordinates", "Layout").load,
    run=run_function(LateImport("..report.chapters.coordinates", "lay_out")),
    immediate=True,
    document=LateImport("..report.chapters.coordinates", "layout_document"),
)
