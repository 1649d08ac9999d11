"""Where everything is: fiducials and targets in space and in every image, and the scene that pages turn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

from tailstack.errors import IllPosedError

from .operation import LateImport, Operation, Options

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.geometry.arrays import Array
    from tailstack.system import System

    from ..report.beams import Beam
    from ..report.chapters.coordinates import ImagedPoint, Layout, PlacedPoint


class LayoutOptions(Options):
    """What is wanted besides positions and images."""

    scene: bool = False
    """Add the scene in space, with the errors of a score."""

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        return super().of_record(record, scene=record.scene is not None)


def lay_out(design: Design, *, scene: bool = False) -> Layout:
    """Compile the design and image it.  Raises DesignError.

    A layout that determines no answer is laid out nevertheless: a picture shows best what is wrong with it.
    """
    import numpy as np

    from tailstack.design import compile_design
    from tailstack.estimation.checks import imaged_fiducials
    from tailstack.scoring import provenance

    from ..report.beams import beams_of
    from ..report.chapters.coordinates import ImagedView, Layout

    system = compile_design(design)
    places = imaged_fiducials(system)
    targets = np.array([target.position_mm for target in system.targets])
    target_names = tuple(target.name for target in system.targets)
    section = design.document.optimise
    installed = _displacement(system)
    views = tuple(
        ImagedView(
            view=beam.view.name,
            projection=tuple(map(_numbers, beam.view.projection @ installed)),
            target_projection=tuple(map(_numbers, beam.view.projection)),
            image_size_px=None if beam.view.image_size_px is None else _numbers(beam.view.image_size_px),
            margin_px=0.0 if section is None else float(section.image_margin_px),
            source_mm=_numbers(beam.source_mm),
            fiducials=_image_points(beam, system.fiducial_labels, places, used),
            targets=_image_points(beam, target_names, targets, np.ones(len(targets))),
        )
        for beam, used in zip(beams_of(design, system), system.sees, strict=True)
    )
    return Layout(
        schema="tailstack/layout/1",
        fiducials=_place_points(system.fiducial_labels, system.fiducials_mm),
        targets=_place_points(target_names, targets),
        views=views,
        scene=_scene(design) if scene else None,
        provenance=provenance(system),
    )


def _scene(design: Design) -> dict[str, Any]:
    """The layout in space; where it can be scored, with its errors."""
    from tailstack.scoring import score_errors

    from ..report.scene import scene_data, scene_of

    record = None
    with suppress(IllPosedError):
        record = score_errors(design)
    return scene_data(scene_of(design, record, design.name))


def _image_points(beam: Beam, labels: Sequence[str], points: Array, used: Array) -> tuple[ImagedPoint, ...]:
    from ..report.chapters.coordinates import ImagedPoint

    low, high = beam.corners_px.min(axis=0), beam.corners_px.max(axis=0)
    imaged = []
    for label, image, weight in zip(labels, beam.images(points), used, strict=True):
        seen = bool((image == image).all())  # NaN behind the source
        inside = seen and (not beam.sized or bool(((image >= low) & (image <= high)).all()))
        imaged.append(ImagedPoint(label, _numbers(image) if seen else None, inside, bool(weight)))
    return tuple(imaged)


def _displacement(system: System) -> Array:
    """(4, 4): from a nominal position of a fiducial in con to where it is when it is imaged."""
    import numpy as np

    from tailstack.estimation.checks import imaged_fiducials

    origin, *ends = imaged_fiducials(replace(system, fiducials_mm=np.vstack([np.zeros(3), np.eye(3)])))
    return np.block(
        [[np.column_stack([end - origin for end in ends]), origin[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]
    )


def _place_points(labels: Sequence[str], points: Array) -> tuple[PlacedPoint, ...]:
    from ..report.chapters.coordinates import PlacedPoint

    return tuple(PlacedPoint(label, _numbers(point)) for label, point in zip(labels, points, strict=True))


def _numbers(values: Iterable[float]) -> Any:
    return tuple(float(value) for value in values)


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
    run=lambda call: lay_out(call.design, scene=call.options.scene),
    immediate=True,
    document=LateImport("..report.chapters.coordinates", "layout_document"),
)
