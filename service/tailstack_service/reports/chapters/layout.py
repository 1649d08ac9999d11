"""The layout as blocks: the scene in space, which a screen can turn, and what each view sees."""

from __future__ import annotations

from tailstack.design import Design, compile_design, load_design
from tailstack.results import Score

from ...rendering.layout_picture import layout_svg, single_layout_svg
from ..blocks import Block, Figure
from ..figures.scene import scene_json, scene_of
from ..figures.scene_picture import scene_svg

Known = tuple[dict[str, object], Score]  # a design document and what was computed of it


def layout_blocks(now: Known, title: str, name: str = "layout", before: Known | None = None) -> tuple[Block, ...]:
    """Pictures of a layout, drawn over another one if that is given.  ``name`` is kebab-case, unique in the report."""
    design = _loaded(now[0])
    old = None if before is None else (_loaded(before[0]), before[1])
    scene = scene_of(design, now[1], title, old)
    caption = "The layout in the connector frame con, mm: nominal positions"
    if scene.magnification > 0:
        size = "to scale" if scene.magnification == 1 else f"{scene.magnification:g} times their size"
        caption += f"; ellipsoids of 95 % of a Gaussian error, about target plus bias, {size}"
    blocks: list[Block] = [Figure(name, scene_svg(scene, name), f"{caption}.", scene_json(scene))]
    system = compile_design(design)
    if old is None:
        images = single_layout_svg(system, f"{title}: what each view sees", f"{name}-images")
        words = (
            "Detector images of the first two views (px, u right, v down) and the connector frame con (mm). Nominal."
        )
    else:
        images = layout_svg(compile_design(old[0]), system, f"{title}: before above after")
        words = "Before above after: detector images of the first two views (px) and the connector frame con (mm)."
    return (*blocks, Figure(f"{name}-images", images, words))


def _loaded(data: dict[str, object]) -> Design:
    return load_design(data, allow_files=False)
