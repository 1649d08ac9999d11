"""What was found by use of the workbench, 2026-11, in a real Chromium: refuted estimates, lists, sizes, proxies."""

from __future__ import annotations

import base64
import io
import re
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from browsing import DEMO, demo_with, used
from served import Served, served
from service_scenes import EXAMPLES, ask
from test_prefix import NGINX, proxying

from tailstack import load_design, score, score_batch

pytestmark = pytest.mark.long
SHOTS = 20_000
BELOW = "/tools/tailstack"


SERVED = {"TAILSTACK_MAX_TRIALS": str(SHOTS)}  # of the service that the tests ask


def found_by(service: Served, scenario: str, design: str = DEMO, **more: Any) -> dict[str, Any]:
    return used(service.url, scenario, design, script="found.mjs", **more)


# --- estimate and simulation ------------------------------------------------------------------------------------------


def test_under_verified_by_simulation_stands_nothing_of_an_estimate_that_it_refutes(service: Served) -> None:
    """Beads at z = -50, -49.8, -49.6 in turn: nearly in a plane."""
    fiducials = yaml.safe_load(DEMO)["fiducials"]
    for k, point in enumerate(fiducials["points"]):
        point["position_mm"][2] = -50 + 0.2 * (k % 3)
    found = found_by(service, "refuted", demo_with("optimise", fiducials=fiducials))
    (job,) = ask("GET", f"{service.url}/v1/jobs?limit=1").json()["jobs"]
    check = ask("GET", f"{service.url}{job['links']['result']}").json()["verification"]
    assert check["trials"] == check["max_trials"] == SHOTS  # what the operator allows
    target = check["targets"][0]
    shown = {
        name: float(words.split()[0]) for name, words in found["numbers"].items() if name not in ("Limit", "Between")
    }
    bias = sum(value**2 for value in target["bias_mm"]) ** 0.5
    assert shown["P95"] == pytest.approx(target["p95_mm"], rel=0.01)
    assert shown["Mean error"] == pytest.approx(target["mean_norm_mm"], rel=0.01)
    assert shown["Bias"] == pytest.approx(bias, rel=0.01)
    assert target["mean_norm_mm"] > 4 * target["first_order_p95_mm"]  # nothing of the estimate is near
    assert "does not hold" in found["estimate"]
    assert f"{SHOTS:,} simulated shots" in found["words"]
    assert re.search(r"The estimate is \d+ % below it: it does not hold here", found["words"])
    assert (found["outdated"], found["shares"], found["advice"]) == (True, "0.62", 0)


def test_advice_stops_where_nothing_is_made_finer_and_what_is_impossible_is_an_answer(service: Served) -> None:
    found = found_by(service, "reach")
    before, after = found["advice"]
    assert before == "Tighten connector on flange rx, ry to 0.15° → 0.98 mm by estimate, pass"
    assert after == before  # though one of them is 0.1998
    noise = {f"/views/{k}/fiducial_noise_px": [0.0] for k in range(2)}
    places = score_batch(
        load_design(DEMO), {**noise, "/fiducials/manufacturing/half_width_mm": [0.0]}, columns=["p95_mm"]
    )
    (best,) = places.columns["p95_mm:tip"]
    assert re.search(rf"connector on flange.* 0\.72, .*beads elsewhere (not below )?{best:.2f} mm", found["reach"])
    # of what was dragged: the seats' own errors are as they were, whatever their shares
    assert found["moved"] > 0.001
    assert all(kind == "delta" for _, kind, _ in found["deltas"] if kind)
    changed = {name.partition(" per ")[0] for name, _, words in found["deltas"] if words}  # unit, mounting or shot
    assert changed <= {"fiducial noise, AP", "fiducial noise, LAT", "fiducial manufacturing"}
    assert changed
    assert found["limit"] == 0.3
    assert re.match(
        r"No tightening keeps the limit: at best 0\.4\d+ mm by estimate, .*, because .* has \d+ %", found["wall"]
    )
    wall, acts, steps = found["out"]
    assert re.search(r"Out of reach, by estimate: the smallest P95 .*, is 0\.466 mm.*; because hand_eye 81 %", wall)
    assert "no design keeps the limit" in acts
    assert "failed" not in acts
    assert steps == 0


def test_what_a_drawing_states_of_a_seat_is_typed(service: Served) -> None:
    text = (EXAMPLES / "dowelled_seat.yaml").read_text(encoding="utf-8")
    typed = [("face", "flatness, mm", "0.05"), ("face", "height upper, mm", "0.03"), ("pin 1", "fit", "H8/f7")]
    found = found_by(service, "features", text, typed=typed)
    data = yaml.safe_load(text)
    face, pin, *_ = data["interfaces"]["structure_connector"]["features"]
    face["flatness_mm"], face["height_mm"][0], pin["fit"] = 0.05, 0.03, "H8/f7"
    assert yaml.safe_load(found["text"]) == data
    assert found["p95"] == score(load_design(data)).targets[0].p95_mm
    assert (found["axe"], found["wide"]) == ([], 0)


def test_every_lever_has_its_bar_and_every_slider_its_curve_whose_crossing_is_where_the_limit_is_kept(
    service: Served,
) -> None:
    """Bars are those of the command; the crossing is that of a bisection of scores, with what estimates are off by."""
    found = found_by(service, "levers")
    levers = {lever.label: lever for lever in score(load_design(DEMO)).levers}
    assert {row[0] for row in found["rows"]} == {*levers}
    for label, _, value, how in found["rows"]:
        if how != "by a search":
            assert value == f"{levers[label].value:.2f}"
    assert set(found["keeps"]) == {label for label, lever in levers.items() if lever.value <= 1.0}
    assert found["axe"] == []

    check = score(load_design(DEMO)).verdict.checks[0]
    assert check.interval[1] is not None
    aim = check.value / check.interval[1]

    def beyond(width: float) -> float:
        data = yaml.safe_load(DEMO)
        data["interfaces"]["connector_flange"]["tolerances"]["rx"]["half_width_deg"] = width
        return score(load_design(data), losses=False).targets[0].p95_mm - aim

    low, high = 1e-3, 1.0
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if beyond(middle) > 0 else (middle, high)
    assert found["crossing"] == pytest.approx(low, rel=1e-4)
    assert low * 0.99 < float(found["set"]) <= low
    assert 0.99 * aim < found["p95"] <= aim


# --- what is in the way -----------------------------------------------------------------------------------------------


def test_a_design_without_a_requirement_gets_one_and_more_under_all_fields_or_by_the_strip(service: Served) -> None:
    found = found_by(service, "grow", demo_with("requirements", "optimise"))
    assert not any("no such field" in shown for shown in found["fields"])  # of a union of needed fields
    none, one, two, empty, again, stated = found["found"]
    assert none == empty == []
    assert len(one) == len(again) == 1
    assert len({name for name, _ in two}) == 2
    assert stated == [["accuracy", 1]]


def test_words_in_pictures_can_be_read_enlarge_enlarges_and_a_phone_shows_what_was_opened(service: Served) -> None:
    found = found_by(service, "sizes")
    assert found["before"]["words"] >= 10
    assert found["after"]["width"] > 1.8 * found["before"]["width"]
    assert found["after"]["spread"] > 1.8 * found["before"]["spread"]
    colour, ground = found["pressed"]
    assert (colour, ground) == ("rgb(255, 255, 255)", "rgb(11, 83, 148)")
    assert (found["phone"]["scrolled"], found["phone"]["wide"]) == (0, 0)
    assert found["phone"]["top"] < 400


def test_beads_as_people_have_them_are_taken_or_it_is_said_how(service: Served) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>" * 200)
    places = [(0, 0, -40), (40, 5, -50), (-20, 35, -60), (10, -30, -70), (25, 20, -45), (-35, -20, -55)]
    rows = [[f"F{k + 1}", *place] for k, place in enumerate(places)]
    tables = {
        "beads.txt": "\n".join(" ".join(map(str, row)) for row in rows),
        "bare.csv": "\n".join(",".join(map(str, row[1:])) for row in rows),
    }
    files = [
        {"name": name, "base64": base64.b64encode(text.encode()).decode(), "press": "Yes, in mm"}
        for name, text in tables.items()
    ]
    files.append({"name": "beads.xlsx", "base64": base64.b64encode(packed.getvalue()).decode()})
    spaced, bare, workbook = found_by(service, "tables", files=files)["found"]
    assert spaced["beads"] == bare["beads"] == rows
    assert "save the sheet with the table as CSV UTF-8" in workbook["words"]


# --- below a path -----------------------------------------------------------------------------------------------------


@contextmanager
def proxy(api: str, folder: Path, passes_on: bool) -> Iterator[str]:
    """nginx that gives a service a path, and cuts it off again or not; yields the address with that path."""

    def configure(port: int) -> str:
        return f"""
        events {{}}
        pid {folder}/pid;
        http {{
          access_log off;
          client_body_temp_path {folder}/body; proxy_temp_path {folder}/proxy; fastcgi_temp_path {folder}/f;
          uwsgi_temp_path {folder}/u; scgi_temp_path {folder}/s;
          server {{
            listen 127.0.0.1:{port};
            location {BELOW}/ {{
              proxy_pass {api}{"" if passes_on else "/"};
              proxy_set_header Host $http_host;
            }}
          }}
        }}"""

    with proxying(folder, configure) as running:
        yield f"http://127.0.0.1:{running.port}{BELOW}"


@pytest.mark.skipif(not Path(NGINX).exists(), reason="NOT TESTED: nginx is not installed")
@pytest.mark.parametrize("passes_on", [True, False], ids=["passes its path on", "cuts its path off"])
def test_reports_are_found_below_a_path_and_are_named_after_their_design(
    tmp_path: Path, browser: None, passes_on: bool
) -> None:
    named = "drill-guide-reference-structure-with-12-beads.html"
    told = {"TAILSTACK_ROOT_PATH": BELOW} if passes_on else {}
    secret = {"TAILSTACK_AUTH": "required"} if passes_on else {}
    with served(tmp_path, **told, **secret) as running:
        key = running.run("keys", "create", "--tenant", "acme", "--name", "page").strip() if secret else ""
        with proxy(running.url, tmp_path, passes_on) as url:
            found = used(url, "below", script="found.mjs", key=key)
    assert re.fullmatch(rf"{url}/v1/results/[0-9a-f]{{64}}/report\?format=html", found["href"])
    if secret:
        assert found["name"] == named
        assert "The report does not come: Not found" in found["said"]
    else:
        status, media, disposition = found["status"]
        assert (status, media) == (200, "text/html; charset=utf-8")
        assert f'filename="{named}"' in disposition
