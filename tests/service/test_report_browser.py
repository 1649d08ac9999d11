"""Reports in a real Chromium, as their readers open them: from a file without network, and from the service.

axe-core looks for what a reader could not use (WCAG 2.2, A and AA): light and dark, on a wide and a narrow screen.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from browsing import browser, look, page_of
from service_scenes import EXAMPLES, client_with, limited

from tailstack import load_design, score, verify
from tailstack_service.documents import to_json
from tailstack_service.gate.judge import judge
from tailstack_service.gate.request import admit_gate
from tailstack_service.operations.rendering import render
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.comparing import compute_comparison

__all__ = ["browser"]

pytestmark = pytest.mark.usefixtures("browser")
WIDE, NARROW = 1280, 360
LEAST_DRAWN = 0.01  # of the canvas is not the ground
LEAST_COLOURS = 20


@cache
def results() -> dict[str, bytes]:
    """A result of every kind of page."""
    from datetime import date

    from tailstack.sweeping import read_axes, sweep

    design, other = load_design(limited(0.9)), load_design(limited(0.5, name="tighter"))
    axis = {"pointer": "/views/0/fiducial_noise_px", "values": [0.2, 0.3, 0.4]}
    designs = [{"file": "a.yaml", "design": limited(0.9)}, {"file": "b.yaml", "design": limited(0.3)}]
    made = {
        "report": compute_report(design, ReportContents(trials=4_000)),
        "comparison": compute_comparison(design, other, ReportContents(trials=4_000)),
        "score": score(design),
        "verification": verify(design, trials=4_000),
        "sweep": sweep(design, read_axes(design, [axis])),
        "gate": judge(admit_gate({"designs": designs, "mode": "analytic"}, today=date(2026, 11, 21)).gate),
    }
    return {name: to_json(record) for name, record in made.items()}


WITH_VIEWER = ("report", "comparison")
# Each kind in both schemes and at both widths; the two with a viewer show it in all four
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
def test_pages_open_from_a_file_without_any_request_or_message(
    seen: dict[tuple[str, str, int], dict[str, Any]],
) -> None:
    for name, found in seen.items():
        assert found["messages"] == [], name
        assert len(found["requests"]) == 1, name
        assert found["failed"] == [], name


@pytest.mark.long
def test_nobody_is_shut_out(seen: dict[tuple[str, str, int], dict[str, Any]]) -> None:
    """oracle: axe-core, WCAG 2.0 to 2.2, A and AA, and that no two regions have one name."""
    for name, found in seen.items():
        assert found["violations"] == [], name


@pytest.mark.long
def test_no_page_is_wider_than_its_screen(seen: dict[tuple[str, str, int], dict[str, Any]]) -> None:
    for name, found in seen.items():
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


def test_on_a_phone_the_limit_and_every_requirement_are_in_sight(browser: None, tmp_path: Path) -> None:
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


def test_the_value_does_not_lie_across_the_limit_and_the_layout_is_named_above_it(
    browser: None, tmp_path: Path
) -> None:
    """The demo, whose P95 is a seventh above its limit: beside its mark there is little room on a phone."""
    path = tmp_path / "report.html"
    demo = load_design(EXAMPLES / "demo.yaml")
    path.write_bytes(render("report", to_json(compute_report(demo, ReportContents(parts=("score",)))), "html"))
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
def test_without_scripts_and_on_paper_the_picture_stands_there(browser: None, tmp_path: Path) -> None:
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
def test_a_served_report_runs_its_viewer_and_nothing_else(browser: None) -> None:
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
