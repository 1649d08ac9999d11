"""What moves the images of all beads together: balls, fields, motion, temperature, as declared in a design."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from plain_data import DEMO, REMOVED, problems_of, replaced, value_at
from scenes import projection_looking
from tailstack import DesignFunction, load_design, score, sweep
from tailstack.design import Design, compile_design, design_to_yaml
from tailstack.effects.ball_images import outline_shifts
from tailstack.effects.detector_tilt import detector_tilt
from tailstack.errors import OutOfRangeError
from tailstack.estimation.resection import project
from tailstack.system import no_sources

FIELD = {"half_widths_px": [0, 0, 0.4, 0.6], "distribution": "uniform"}
MOTION = {"pivot_mm": [0, 0, -95], "tolerances": {"rx": {"half_width_deg": 0.4, "distribution": "normal"}}}
HEAT = {
    "difference_k": 15, "half_width_k": 10, "distribution": "triangular",
    "structure_expansion_um_per_m_k": 47, "connector_expansion_um_per_m_k": 23,
}  # fmt: skip


def tilted(focal_px: float, degrees: Any, images: Any) -> Any:
    """(n, 2) px: where rays to images (n, 2), px from the foot of the perpendicular, meet the plane that is turned by
    angles about u and v."""
    about_u, about_v = np.deg2rad(degrees)
    u, v = np.array([np.cos(about_v), 0, np.sin(about_v)]), np.array([0, np.cos(about_u), np.sin(about_u)])
    rays = np.column_stack([images, np.full(len(images), focal_px)])
    foot = np.array([0, 0, focal_px])
    normal = np.cross(u, v)
    hits = rays * (normal @ foot / (rays @ normal))[:, None] - foot
    return np.linalg.lstsq(np.column_stack([u, v]), hits.T, rcond=None)[0].T


@pytest.mark.parametrize("degrees", [(1.0, 0.0), (0.0, -1.0)])
def test_a_tilted_detector_shows_points_where_their_rays_meet_it(degrees: tuple[float, float]) -> None:
    """independent: the plane and the rays themselves; what is left out at one degree is 0.02 % of the place."""
    system = compile_design(demo())
    view = system.views[0]
    effect = detector_tilt(view.name, no_sources(2), np.deg2rad(degrees))
    (act,) = effect.act(system.scene(np.array([[10.0, -20.0, 70.0]]), project))
    places = project(view.projection, np.vstack([system.fiducials_mm, [10.0, -20.0, 70.0]])) - 767.5
    shifts = act.by(effect.known).reshape(-1, 2)
    assert np.abs(shifts).max() > 0.3
    found = tilted(1020 / 0.194, degrees, places) - places
    assert np.abs(found - shifts).max() < 2e-4 * np.abs(places).max()
    both = [tilted(1020 / 0.194, tuple(1e-3 * sign * a for a in degrees), places) for sign in (1, -1)]
    np.testing.assert_allclose(1e-3 * shifts, (both[0] - both[1]) / 2, rtol=1e-5, atol=1e-9)


def test_estimators_of_all_unknowns_absorb_a_tilt_and_those_that_believe_the_intrinsics_do_not() -> None:
    """closed form: a tilted detector shows a homography of the image, which is taken at nominal places here."""
    turn = {"about_u": {"half_width_deg": 1.0, "distribution": "uniform"}, "bias_about_v_deg": 0.5}
    for estimator in ("dlt", "reprojection", "pose"):
        plain = demo().with_value("model.estimator", estimator)
        before = score(plain, losses=False).targets[0].p95_mm
        after = score(plain.with_value("views.AP.detector_tilt", turn), losses=False).targets[0].p95_mm
        assert abs(after / before - 1) < 1e-6 or estimator == "pose"
        assert abs(after / before - 1) > 1e-4 or estimator != "pose"


def demo(change: Any = lambda data: None) -> Design:
    data = copy.deepcopy(DEMO)
    change(data)
    return load_design(data)


def everything(data: dict[str, Any]) -> None:
    data["views"][0]["image_field"] = FIELD
    data["views"][1] |= {"motion": MOTION}
    data["temperature"] = HEAT
    data["fiducials"]["diameter_mm"] = 10


def test_the_outline_of_a_ball_is_shifted_as_its_tangent_rays_say() -> None:
    """independent: the ellipse fitted to the images of the circle in which rays from the source touch the ball."""
    projection, centre, radius = projection_looking(0.3, 700.0, 0.2), np.array([40.0, -20.0, -60.0]), 12.0
    source = np.linalg.solve(projection[:, :3], -projection[:, 3])
    away = centre - source
    distance = np.linalg.norm(away)
    across = np.linalg.svd(away[None])[2][1:]
    middle = centre - away * (radius / distance) ** 2
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = radius * np.sqrt(1 - (radius / distance) ** 2)
    circle = middle + ring * (np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1])
    images = circle @ projection[:, :3].T + projection[:, 3]
    u, v = (images[:, :2] / images[:, 2:] - 700).T / 100
    a, b, c, d, e, _ = np.linalg.svd(np.column_stack([u * u, u * v, v * v, u, v, np.ones_like(u)]))[2][-1]
    ellipse = np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e]) * 100 + 700
    plain = projection[:, :3] @ centre + projection[:, 3]
    shift = outline_shifts(projection, centre[None], radius)[0]
    assert np.linalg.norm(shift) > 0.05
    np.testing.assert_allclose(shift, ellipse - plain[:2] / plain[2], rtol=0, atol=1e-6)


def test_the_shadow_of_a_ball_is_shifted_by_four_fifths() -> None:
    """independent: the path of rays through the ball, summed over pixels of 0.1 px about its image."""
    projection, centre, radius = projection_looking(0.0, 700.0), np.array([60.0, 0.0, -50.0]), 10.0
    source = np.linalg.solve(projection[:, :3], -projection[:, 3])
    plain = projection[:, :3] @ centre + projection[:, 3]
    at = plain[:2] / plain[2]
    grid = np.arange(-90, 90, 0.1)
    u, v = np.meshgrid(at[0] + grid, at[1] + grid, indexing="ij")
    rays = np.linalg.solve(projection[:, :3], np.stack([u, v, np.ones_like(u)]).reshape(3, -1))
    along = (centre - source) @ rays / np.linalg.norm(rays, axis=0)
    chord = np.sqrt(np.maximum(along**2 - (centre - source) @ (centre - source) + radius**2, 0)).reshape(u.shape)
    centroid = np.array([(chord * u).sum(), (chord * v).sum()]) / chord.sum()
    outline = outline_shifts(projection, centre[None], radius)[0]
    np.testing.assert_allclose(centroid - at, 0.8 * outline, rtol=0, atol=1e-3 * float(np.linalg.norm(outline)))


def test_what_is_declared_is_no_longer_among_what_is_not_included() -> None:
    before, after = (score(design, losses=False).provenance.not_included for design in (demo(), demo(everything)))
    words = " ".join(after)
    assert "motion between the shots" in before
    assert "motion between" not in words
    assert "thermal" not in words
    assert "ball" not in words
    assert "image distortion that its correction leaves (LAT)" in after  # AP declares a field
    assert "image distortion that its correction leaves" in before


def test_a_known_error_of_assumed_intrinsics_has_a_line_that_says_what_correcting_it_is_worth() -> None:
    """independent: the design whose intrinsics were corrected in that view, scored."""
    known = {"focal": {"bias_rel": 0.1, "half_width_rel": 0.01, "distribution": "uniform"}}

    def tell(*views: int) -> Any:
        def change(data: dict[str, Any]) -> None:
            data["model"] = {"estimator": "pose"}
            for v, view in enumerate(data["views"]):
                focal = known["focal"] if v in views else known["focal"] | {"bias_rel": 0}
                view["intrinsics_error"] = {"focal": focal}

        return change

    target = score(demo(tell(0, 1)), losses=False).targets[0]
    lines, both = target.contributors, target.p95_mm
    for name, other in (("AP", 1), ("LAT", 0)):
        (line,) = [c for c in lines if c.name == f"assumed_intrinsics:{name}" and c.component == "known"]
        corrected = score(demo(tell(other)), losses=False).targets[0].p95_mm
        assert line.p95_without_mm == pytest.approx(corrected, abs=2e-5)  # the budget is not refined further
        assert abs(corrected - both) > 1e-3
        assert line.label == f"assumed intrinsics, {name}, known"
        assert line.variance_share == 0
    assert not [c for c in score(demo(tell()), losses=False).targets[0].contributors if c.law == "known"]


@pytest.mark.parametrize(
    "path",
    ["temperature.half_width_k", "views.0.intrinsics_error.focal.half_width_rel",
     "views.0.intrinsics_error.principal_point.half_width_px"],
)  # fmt: skip
def test_a_half_width_can_be_varied_from_nought_its_law_beside_it(path: str) -> None:
    """closed form: a half-width of 0 is as if there were none; what was written can be read again."""

    def declare(data: dict[str, Any]) -> None:
        data["model"] = {"estimator": "pose"}
        data["temperature"] = {"structure_expansion_um_per_m_k": 47, "half_width_k": 9, "distribution": "normal"}
        data["views"][0]["intrinsics_error"] = {
            "focal": {"half_width_rel": 0.05, "distribution": "uniform"},
            "principal_point": {"half_width_px": 40, "distribution": "normal", "coverage_factor": 2},
        }

    def leave_out(data: dict[str, Any]) -> None:
        declare(data)
        *way, last = (int(step) if step.isdecimal() else step for step in path.split("."))
        for field in (last, "distribution", "coverage_factor"):
            value_at(data, way).pop(field, None)

    first, second = sweep(demo(declare), {path: [0.0, 0.9]}).points
    assert first.targets[0].p95_mm == pytest.approx(score(demo(leave_out), losses=False).targets[0].p95_mm, rel=1e-12)
    assert first.targets[0].p95_mm < second.targets[0].p95_mm
    nought = demo(declare).with_value(path, 0)
    assert load_design(design_to_yaml(nought)).sha256 == nought.sha256


def test_degrees_0_and_1_of_a_field_are_absorbed_by_dlt() -> None:
    """closed form: an affine map of the image is absorbed by the eleven parameters, and the target moves with it."""
    absorbed = {"half_widths_px": [5.0, 5.0], "distribution": "normal"}
    # with a bias, the images are not where the field is taken
    unbiased = replaced(DEMO, ("interfaces", "structure_connector", "bias"), REMOVED)
    bent = replaced(unbiased, ("views", 0, "image_field"), absorbed)
    before, after = (score(load_design(data)).targets[0].p95_mm for data in (unbiased, bent))
    assert after == pytest.approx(before, rel=1e-9)


def test_a_body_of_one_material_shrinks_what_it_sees_about_the_flange() -> None:
    """closed form: structure and connector grow alike, so the target seems nearer to the flange's seat by alpha dT."""
    alike = {"difference_k": 100, "structure_expansion_um_per_m_k": 23, "connector_expansion_um_per_m_k": 23}
    unbiased = replaced(DEMO, ("interfaces", "structure_connector", "bias"), REMOVED)
    heated = unbiased | {"temperature": alike}
    warm, cold = (score(load_design(data), losses=False).targets[0] for data in (heated, unbiased))
    shift = np.array(warm.bias_mm) - cold.bias_mm
    tip, seat = np.array([0, 0, 70.0]), np.array([0, 0, -145.0])
    np.testing.assert_allclose(shift, -23e-6 * 100 * (tip - seat), rtol=0, atol=1e-4)


def test_a_temperature_needs_the_seat_of_the_connector() -> None:
    heated = replaced(DEMO | {"temperature": HEAT}, ("interfaces", "connector_flange"), REMOVED)
    problem = problems_of(load_design, heated)[0]
    assert (problem.pointer, problem.code) == ("/temperature/flange_seat_mm", "missing-field")


@pytest.mark.parametrize("path", ["temperature.difference_k", "fiducials.diameter_mm"])
def test_what_moves_the_bias_otherwise_than_through_fiducials_has_no_derivative(path: str) -> None:
    function = DesignFunction(demo(everything), [path])
    with pytest.raises(OutOfRangeError, match="the bias"):
        function.p95_gradient(function.present)
