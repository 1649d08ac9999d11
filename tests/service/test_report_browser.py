"""Reports in a real Chromium, as their readers open them: from a file without network, and from the service.

axe-core looks for what a reader could not use (WCAG 2.2, A and AA): light and dark, on a wide and a narrow screen.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsing import look, page_of
from service_scenes import client_with, limited
from test_report_rendering import results

from plain_data import DEMO, replaced
from tailstack import load_design, score
from tailstack.geometry.arrays import Array
from tailstack_service import report
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.scene import LayoutScene, scene_json, scene_of
from tailstack_service.report.scene_picture import draw_scene

pytestmark = pytest.mark.usefixtures("browser")
WIDE, NARROW = 1280, 360
LEAST_DRAWN = 0.01  # of the canvas is not the ground
LEAST_COLOURS = 20


WITH_VIEWER = ("report", "comparison", "optimisation")
# Each kind in both schemes and at both widths; reports and comparisons, which share a viewer, are four ways together
USUALLY, OTHERWISE = (("light", WIDE), ("dark", NARROW)), (("dark", WIDE), ("light", NARROW))


@pytest.fixture(scope="module")
def seen(browser: None, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str, int], dict[str, Any]]:
    """What Chromium found, by kind of result, colour scheme and width: one start of the browser for all."""
    folder = tmp_path_factory.mktemp("pages")
    names, jobs = [], []
    for kind, body in results().items():
        path = folder / f"{kind}.html"
        path.write_bytes(render(kind, body, "html"))
        for scheme, width in OTHERWISE if kind == "comparison" else USUALLY:
            names.append((kind, scheme, width))
            jobs.append(page_of(path, scheme=scheme, width=width, axe=True, viewer=True, keys=["ArrowRight", "+"]))
    return dict(zip(names, look(jobs), strict=True))


@pytest.mark.long
def test_pages_open_from_a_file_shut_nobody_out_and_fit_their_screen(
    seen: dict[tuple[str, str, int], dict[str, Any]],
) -> None:
    for name, found in seen.items():
        assert found["messages"] == [], name
        assert len(found["requests"]) == 1, name
        assert found["failed"] == [], name
        # oracle: axe-core, WCAG 2.0 to 2.2, A and AA, and that no two regions have one name.
        assert found["violations"] == [], name
        assert found["width"] <= name[2], name


@pytest.mark.long
def test_the_layout_is_drawn_and_turns_with_a_key(seen: dict[tuple[str, str, int], dict[str, Any]]) -> None:
    for name, found in seen.items():
        if name[0] not in WITH_VIEWER:
            assert found["canvases"] == [[]], name
            continue
        views = [canvases[0] for canvases in found["canvases"]]
        assert len(views) == 3
        assert all(view["drawn"] > LEAST_DRAWN and view["colours"] > LEAST_COLOURS for view in views), name
        assert len({view["hash"] for view in views}) == 3, name  # as it was, turned, nearer


def test_on_a_phone_the_limit_and_every_requirement_are_in_sight(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_bytes(render("report", results()["report"], "html"))
    gauge = """[...document.querySelectorAll('#figure-headline text')].filter((text) => /limit/.test(text.textContent)
        && text.getBoundingClientRect().width > 0).map((text) => text.getBoundingClientRect().right)"""
    cells = """[...document.querySelectorAll('.first .scroll td')].map((cell) => cell.getBoundingClientRect().right)"""
    signs = """[...document.querySelectorAll('.scroll, .picture')].filter((box) => box.scrollWidth > box.clientWidth + 1
        && !/move it sideways/.test(getComputedStyle(box, '::before').content)).length"""
    names = """[...document.querySelectorAll('caption > span')].map((name) => name.getBoundingClientRect().right)"""
    (found,) = look([page_of(path, width=390, ask=[gauge, cells, signs, names, BROKEN])])
    limits, ends, unsigned, captions, broken = found["answers"]
    assert len(limits) == 1
    assert len(ends) == 8
    assert max(limits + ends + captions) <= 390
    assert unsigned == 0
    assert broken == []


# Words of the names of rows that stand on more than one line.
BROKEN = """[...document.querySelectorAll('tbody th')].flatMap((cell) => [...cell.firstChild.data.matchAll(/\\S+/g)]
    .filter((word) => {
        const range = document.createRange();
        range.setStart(cell.firstChild, word.index);
        range.setEnd(cell.firstChild, word.index + word[0].length);
        return new Set([...range.getClientRects()].map((rect) => Math.round(rect.top))).size > 1;
    }).map((word) => word[0]))"""


def test_the_value_does_not_lie_across_the_limit_and_the_layout_is_named_above_it(tmp_path: Path) -> None:
    """The demo, whose P95 is a seventh above its limit: beside its mark there is little room on a phone."""
    path = tmp_path / "report.html"
    made = compute_report(load_design(DEMO), ReportContents(parts=("score",)))
    path.write_bytes(render("report", to_json(made), "html"))
    boxes = """[...document.querySelectorAll('#figure-headline text, #figure-headline path[stroke="#b3261e"]')]
        .map((part) => [part.textContent, part.getBoundingClientRect()]).filter(([, box]) => box.height > 0)
        .map(([words, box]) => [words, box.left, box.top, box.right, box.bottom])"""
    named = """['figcaption', '.viewer'].map((part) => document.querySelector('#figure-layout ' + part))
        .map((part) => part.getBoundingClientRect()).map((box) => [box.top, box.bottom])"""
    for found in look([page_of(path, width=wide, viewer=True, ask=[boxes, named]) for wide in (390, WIDE)]):
        parts, (caption, viewer) = found["answers"]
        (line,) = (box for words, *box in parts if not words)
        (value,) = (box for words, *box in parts if re.search(r"\d mm$", words) and "limit" not in words)
        assert value[2] < line[0] or value[0] > line[2], (value, line)
        assert caption[1] <= viewer[0]


@pytest.mark.long
def test_without_scripts_and_on_paper_the_picture_stands_there(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    record = to_json(compute_report(load_design(limited(0.9)), ReportContents(parts=("score",))))
    path.write_bytes(render("report", record, "html"))
    shown = "[...document.querySelectorAll('figure svg')].filter((svg) => svg.getBoundingClientRect().width > 0).length"
    shot = tmp_path / "plain.png"
    live, paper, plain = look(
        [
            page_of(path, ask=[shown]),
            page_of(path, media="print", ask=[shown, PRINTED_VIEWERS]),
            page_of(path, script=False, shot=str(shot)),
        ]
    )
    figures = path.read_text(encoding="utf-8").count("<figure ")
    assert live["answers"] == [figures - 1]
    assert paper["answers"] == [figures, 0]
    assert plain["messages"] == []
    assert shot.stat().st_size > 50_000


PRINTED_VIEWERS = (
    "[...document.querySelectorAll('.viewer')].filter((box) => box.getBoundingClientRect().width > 0).length"
)


@pytest.mark.long
def test_a_served_report_runs_its_viewer_and_nothing_else() -> None:
    """The response's own policy: an origin of its own, one script by its hash, no request to anybody."""
    with client_with(worker=True) as client:
        asked = {"design": limited(0.9), "trials": 2000}
        answer = client.post("/v1/reports", json=asked, headers={"Prefer": "wait=60"})
        assert answer.status_code == 200, answer.text
        address = answer.headers["content-location"] + "/report"
        attempts = [
            "window.origin",
            "(() => { try { return document.cookie; } catch (error) { return error.name; } })()",
            f"fetch('{client.base_url}health/live').then(() => 'reached', () => 'refused')",
            "(() => { const s = document.createElement('script'); s.textContent = 'window.ran = 1'; "
            "document.body.append(s); return window.ran ?? 'no'; })()",
        ]
        url = str(client.base_url).rstrip("/") + address
        (found,) = look([{"url": url, "viewer": True, "keys": ["ArrowLeft"], "ask": attempts}])
        policy = found["headers"]["content-security-policy"]
        assert "sandbox allow-scripts" in policy
        assert "allow-same-origin" not in policy
        assert "unsafe" not in policy
        assert found["status"] == 200
        assert found["answers"] == ["null", "SecurityError", "refused", "no"]
        first, second = (canvases[0] for canvases in found["canvases"])
        assert first["drawn"] > LEAST_DRAWN
        assert first["hash"] != second["hash"]
        assert len([request for request in found["requests"] if request != url]) <= 1  # the fetch that was refused
        assert "content-security-policy" not in client.get(f"{address}?format=pdf").headers


# --- the viewer of the layout ---------------------------------------------------------------------


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
    design = load_design(replaced(DEMO, ("fiducials", "points", 0, "label"), HOSTILE))
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
def viewed(browser: None, tmp_path_factory: pytest.TempPathFactory) -> Seen:
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


def answer(viewed: Seen, number: int) -> Any:
    return viewed[0][0]["answers"][number]


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


def view(viewed: Seen, number: int, right: Array, up: Array) -> tuple[float, Array]:
    """Checks that a frame is viewed with these axes; its scale and the page place of con's origin."""
    at = np.array(answer(viewed, number))
    places = ordered(viewed[2], right, up)
    found_right, found_up, scale = _fitted(at, places)
    np.testing.assert_allclose(found_right, right, atol=1e-5)
    np.testing.assert_allclose(found_up, up, atol=1e-5)
    origin = at[0] - scale * np.array([places[0] @ right, -(places[0] @ up)])
    return scale, origin


def turn(angle_deg: float) -> Array:
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@pytest.mark.long
def test_it_begins_as_the_picture_on_paper_and_turns_by_keys(viewed: Seen) -> None:
    """closed form: five degrees a key, as if the scene were pushed that way; z stays up."""
    camera = viewed[1].cameras[0]
    right, up = np.array(camera.right), np.array(camera.up)
    view(viewed, 0, right, up)
    view(viewed, 1, turn(-90) @ right, turn(-90) @ up)
    level, east = np.cross(turn(-90) @ right, [0, 0, 1]), turn(-90) @ right
    steep = [np.deg2rad(angle) for angle in (-85, -90)]  # the last step may end a rounding error short
    ups = [np.cos(angle) * np.array([0, 0, 1]) - np.sin(angle) * level for angle in steep]
    at = np.array(answer(viewed, 2))
    fits = [np.column_stack([ordered(viewed[2], east, up), np.ones(len(at))]) for up in ups]
    errors = [float(np.linalg.lstsq(places, at, rcond=None)[1].sum()) for places in fits]
    view(viewed, 2, east, ups[int(np.argmin(errors))])
    first = viewed[1].cameras[1]
    assert first.label == "From AP source"
    view(viewed, 3, np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))


def test_zoom_pan_wheel_and_back(viewed: Seen) -> None:
    """closed form: 1.2 a key about the middle, 24 units a step, exp(-delta / 400) by the wheel."""
    ap = (np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    before, _ = view(viewed, 3, *ap)
    zoomed, at_zoomed = view(viewed, 4, *ap)
    assert zoomed / before == pytest.approx(1.2, rel=1e-9)
    _, at_moved = view(viewed, 5, *ap)
    np.testing.assert_allclose(at_moved - at_zoomed, [24, 0], atol=1e-6)
    wheeled, _ = view(viewed, 6, *ap)
    assert wheeled / zoomed == pytest.approx(np.exp(-100 / 400), rel=1e-9)
    camera = viewed[1].cameras[0]
    scale, origin = view(viewed, 7, np.array(camera.right), np.array(camera.up))
    first_scale, first_origin = view(viewed, 0, np.array(camera.right), np.array(camera.up))
    assert scale == pytest.approx(first_scale, rel=2e-6)
    np.testing.assert_allclose(origin, first_origin, atol=1e-3)
    assert answer(viewed, 8).startswith("Seen from azimuth −62°, elevation 20° of con; ")


def test_layers_extents_and_names_and_the_picture_in_print(viewed: Seen) -> None:
    assert answer(viewed, 9) == []
    assert len(answer(viewed, 10)) == 12
    near, far = (float(answer(viewed, k).split("; ")[1].split()[0]) for k in (8, 12))
    assert far > 1.5 * near  # the sources stand 700 mm away
    assert answer(viewed, 13) == ["Oblique", "Whole set-up"]
    assert answer(viewed, 14) == 0  # a hostile name is a name
    assert answer(viewed, 15) == "none"  # the picture on paper
    assert viewed[0][1]["answers"] == [["none", "block"]]


def test_no_message_no_request_no_barrier(viewed: Seen) -> None:
    for result in viewed[0]:
        assert result["messages"] == []
        assert all(url.startswith("file:") for url in result["requests"])
        assert result["violations"] == []
    assert viewed[0][2]["width"] <= 360
    assert len(viewed[0][2]["answers"][0]) == 12
