"""Pictures of a report: SVG as text, the same for the same numbers.

What chapters use: ``scene.scene_of`` (the layout as data) with ``scene.scene_json`` (for the viewer, which stands in
``templates/viewer.js`` and ``viewer.css``) and ``scene_picture.scene_svg`` (the same on paper); ``images.images_svg``;
``budget``, ``errors``, ``sweep``; ``tolerance_curves.tolerance_curves`` (computed) with ``tolerances.curves_svg``
(drawn); ``comparison`` for two designs.
"""
