"""The viewer of the layout in a real Chromium: the same view as on paper, and what keys, wheel and boxes make of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsing import browser, look, page_of
from service_scenes import EXAMPLES

from tailstack import load_design, score
from tailstack.geometry.arrays import Array
from tailstack_service import report
from tailstack_service.report.scene import LayoutScene, scene_json, scene_of
from tailstack_service.report.scene_picture import draw_scene

__all__ = ["browser"]

Seen = tuple[list[dict[str, Any]], LayoutScene, Array]  # what each page did, the scene, (N, 3) fiducials

TEMPLATES = Path(report.__file__).parent / "templates"
HOSTILE = "</script><img src=x>"
RECORDER = """
window.drawn = [];
const arc = CanvasRenderingContext2D.prototype.arc, fill = CanvasRenderingContext2D.prototype.fillRect;
CanvasRenderingContext2D.prototype.arc = function (x, y, r, ...more) {
  if (this.canvas.closest(".viewer-stage") && r === 4.6) window.drawn.push([x, y]);
  return arc.call(this, x, y, r, ...more);
};
CanvasRenderingContext2D.prototype.fillRect = function (x, y, ...more) {
  if (this.canvas.closest(".viewer-stage") && x === 0 && y === 0) window.drawn = [];
  return fill.call(this, x, y, ...more);
};
const later = window.setTimeout.bind(window), never = window.clearTimeout, awaited = new Set(); // what is said later
window.setTimeout = (what, ...more) => {
  const number = later(() => { awaited.delete(number); what(); }, ...more);
  awaited.add(number);
  return number;
};
window.clearTimeout = (number) => { awaited.delete(number); never.call(window, number); };
const frame = () => new Promise((done) => requestAnimationFrame(done));
const frames = () => frame().then(frame).then(() => window.drawn);
window.press = (key, times = 1, shiftKey = false) => {
  const canvas = document.querySelector(".viewer-stage canvas");
  const pressed = () => new KeyboardEvent("keydown", { key, shiftKey, bubbles: true, cancelable: true });
  for (let k = 0; k < times; k += 1) canvas.dispatchEvent(pressed());
  return frames();
};
window.turnWheel = (deltaY) => {
  const canvas = document.querySelector(".viewer-stage canvas");
  canvas.dispatchEvent(new WheelEvent("wheel", { deltaY, ctrlKey: true, bubbles: true, cancelable: true }));
  return frames();
};
window.tick = (words) => {
  [...document.querySelectorAll(".viewer-layers label")].find((entry) => entry.textContent.includes(words)).click();
  return frames();
};
window.press_button = (words) => {
  [...document.querySelectorAll(".viewer-bar button")].find((entry) => entry.textContent === words).click();
  return frames();
};
const status = () => document.querySelector(".viewer-status").textContent;
window.said = () => new Promise((done) => {
  const look = () => (awaited.size ? requestAnimationFrame(look) : done(status()));
  look();
});
"""


def demo() -> tuple[LayoutScene, Array]:
    data = load_design(EXAMPLES / "demo.yaml").source.data
    data = {**data, "fiducials": {**data["fiducials"], "points": [*data["fiducials"]["points"]]}}
    data["fiducials"]["points"][0] = {**data["fiducials"]["points"][0], "label": HOSTILE}
    design = load_design(data)
    return scene_of(design, score(design), HOSTILE), np.array(design.fiducials.positions_mm)


def page(found: LayoutScene) -> str:
    style = "".join(
        (TEMPLATES / name).read_text(encoding="utf-8") for name in ("report.css", "screen.css", "viewer.css")
    )
    script = (TEMPLATES / "viewer.js").read_text(encoding="utf-8")
    return (
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>x</title><style>{style}</style>'
        f"<script>{RECORDER}</script></head><body><main><h1>x</h1><figure>{draw_scene(found)}"
        f'<script type="application/json" class="scene-data">{scene_json(found)}</script>'
        f"<figcaption>x</figcaption></figure></main><script>{script}</script></body></html>"
    )


QUESTIONS = (
    "press('x')", "press('ArrowRight', 18)", "press('ArrowUp', 40)", "press('2')", "press('+')",
    "press('ArrowRight', 1, true)", "turnWheel(100)", "press('0')", "said()", "tick('Fiducials')", "tick('Fiducials')",
    "press_button('Whole set-up')", "said()",
    "[...document.querySelectorAll('[aria-pressed=true]')].map((entry) => entry.textContent)",
    "document.querySelectorAll('img').length",
    "getComputedStyle(document.querySelector('figure > svg')).display",
)  # fmt: skip


@pytest.fixture(scope="module")
def seen(browser: None, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    found, places = demo()
    file = tmp_path_factory.mktemp("viewer") / "page.html"
    file.write_text(page(found), encoding="utf-8")
    displays = "['.viewer', 'figure > svg'].map((name) => getComputedStyle(document.querySelector(name)).display)"
    jobs = [
        page_of(file, ask=list(QUESTIONS)),
        page_of(file, media="print", ask=[displays]),
        page_of(file, width=360, height=740, scheme="dark", ask=["press('x')"], axe=True),
    ]
    return look(jobs), found, places


def answer(seen: Seen, number: int) -> Any:
    return seen[0][0]["answers"][number]


def _fitted(at: Array, places: Array) -> tuple[Array, Array, float]:
    """(right, up, page units per mm) of the view that puts the places there: an exact similarity, or the test fails."""
    solved, *_ = np.linalg.lstsq(np.column_stack([places, np.ones(len(places))]), at, rcond=None)
    np.testing.assert_allclose(np.column_stack([places, np.ones(len(places))]) @ solved, at, atol=1e-6)
    right, down = solved[:3].T
    scale = float(np.linalg.norm(right))
    assert float(np.linalg.norm(down)) == pytest.approx(scale, rel=2e-6)  # axes of a camera have six decimals
    assert right @ down == pytest.approx(0, abs=2e-6 * scale**2)
    return right / scale, -down / scale, scale


def ordered(places: Array, right: Array, up: Array) -> Array:
    """Places from far to near, the order in which marks are drawn."""
    return places[np.argsort(places @ np.cross(right, up), kind="stable")]


def view(seen: Seen, number: int, right: Array, up: Array) -> tuple[float, Array]:
    """Checks that a frame is seen with these axes; its scale and the page place of con's origin."""
    at = np.array(answer(seen, number))
    places = ordered(seen[2], right, up)
    found_right, found_up, scale = _fitted(at, places)
    np.testing.assert_allclose(found_right, right, atol=1e-5)
    np.testing.assert_allclose(found_up, up, atol=1e-5)
    origin = at[0] - scale * np.array([places[0] @ right, -(places[0] @ up)])
    return scale, origin


def turn(angle_deg: float) -> Array:
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@pytest.mark.long
def test_it_begins_as_the_picture_on_paper_and_turns_by_keys(
    seen: Seen,
) -> None:
    """closed form: five degrees a key, as if the scene were pushed that way; z stays up."""
    camera = seen[1].cameras[0]
    right, up = np.array(camera.right), np.array(camera.up)
    view(seen, 0, right, up)
    view(seen, 1, turn(-90) @ right, turn(-90) @ up)
    level, east = np.cross(turn(-90) @ right, [0, 0, 1]), turn(-90) @ right
    steep = [np.deg2rad(angle) for angle in (-85, -90)]  # the last step may end a rounding error short
    ups = [np.cos(angle) * np.array([0, 0, 1]) - np.sin(angle) * level for angle in steep]
    at = np.array(answer(seen, 2))
    fits = [np.column_stack([ordered(seen[2], east, up), np.ones(len(at))]) for up in ups]
    errors = [float(np.linalg.lstsq(places, at, rcond=None)[1].sum()) for places in fits]
    view(seen, 2, east, ups[int(np.argmin(errors))])
    first = seen[1].cameras[1]
    assert first.label == "From AP source"
    view(seen, 3, np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))


def test_zoom_pan_wheel_and_back(seen: Seen) -> None:
    """closed form: 1.2 a key about the middle, 24 units a step, exp(-delta / 400) by the wheel."""
    ap = (np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    before, _ = view(seen, 3, *ap)
    zoomed, at_zoomed = view(seen, 4, *ap)
    assert zoomed / before == pytest.approx(1.2, rel=1e-9)
    _, at_moved = view(seen, 5, *ap)
    np.testing.assert_allclose(at_moved - at_zoomed, [24, 0], atol=1e-6)
    wheeled, _ = view(seen, 6, *ap)
    assert wheeled / zoomed == pytest.approx(np.exp(-100 / 400), rel=1e-9)
    camera = seen[1].cameras[0]
    scale, origin = view(seen, 7, np.array(camera.right), np.array(camera.up))
    first_scale, first_origin = view(seen, 0, np.array(camera.right), np.array(camera.up))
    assert scale == pytest.approx(first_scale, rel=2e-6)
    np.testing.assert_allclose(origin, first_origin, atol=1e-3)
    assert answer(seen, 8).startswith("Seen from azimuth −62°, elevation 20° of con; ")


def test_layers_extents_and_names(seen: Seen) -> None:
    assert answer(seen, 9) == []
    assert len(answer(seen, 10)) == 12
    near, far = (float(answer(seen, k).split("; ")[1].split()[0]) for k in (8, 12))
    assert far > 1.5 * near  # the sources stand 700 mm away
    assert answer(seen, 13) == ["Oblique", "Whole set-up"]
    assert answer(seen, 14) == 0  # a hostile name is a name
    assert answer(seen, 15) == "none"  # the picture on paper


def test_print_shows_the_picture(seen: Seen) -> None:
    assert seen[0][1]["answers"] == [["none", "block"]]


def test_no_message_no_request_no_barrier(seen: Seen) -> None:
    for result in seen[0]:
        assert result["messages"] == []
        assert all(url.startswith("file:") for url in result["requests"])
        assert result["violations"] == []
    assert seen[0][2]["width"] <= 360
    assert len(seen[0][2]["answers"][0]) == 12
