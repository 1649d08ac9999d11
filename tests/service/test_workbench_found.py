"""What was found by use of the workbench, 2026-11, in a real Chromium: refuted estimates, lists, sizes, proxies."""

from __future__ import annotations

import base64
import io
import re
import zipfile
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from browsing import DEMO, browser, used
from served import Served, served
from service_scenes import ask

__all__ = ["browser"]

pytestmark = pytest.mark.long
SHOTS = 20_000


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, browser: None) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("found"), TAILSTACK_MAX_TRIALS=str(SHOTS)) as running:
        yield running


def found_by(service: Served, scenario: str, design: str = DEMO, **more: Any) -> dict[str, Any]:
    return used(service.url, scenario, design, script="found.mjs", **more)


def without(*fields: str, **changes: Any) -> str:
    data = {key: value for key, value in yaml.safe_load(DEMO).items() if key not in fields}
    return yaml.safe_dump({**data, **changes}, sort_keys=False, allow_unicode=True)


# --- estimate and simulation ------------------------------------------------------------------------------------------


def test_under_verified_by_simulation_stands_nothing_of_an_estimate_that_it_refutes(service: Served) -> None:
    """Beads at z = -50, -49.8, -49.6 in turn: nearly in a plane."""
    fiducials = yaml.safe_load(DEMO)["fiducials"]
    for k, point in enumerate(fiducials["points"]):
        point["position_mm"][2] = -50 + 0.2 * (k % 3)
    found = found_by(service, "refuted", without("optimise", fiducials=fiducials))
    (job,) = ask("GET", f"{service.url}/v1/jobs?limit=1").json()["jobs"]
    check = ask("GET", f"{service.url}{job['links']['result']}").json()["verification"]
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


# --- what is in the way -----------------------------------------------------------------------------------------------


def test_words_in_pictures_can_be_read_enlarge_enlarges_and_a_phone_shows_what_was_opened(service: Served) -> None:
    found = found_by(service, "sizes")
    assert found["before"]["words"] >= 10
    assert found["after"]["width"] > 1.8 * found["before"]["width"]
    assert found["after"]["spread"] > 3 * found["before"]["spread"]
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
