"""The workbench in a real Chromium, used as a designer uses it; and the files of it that are in the package."""

from __future__ import annotations

import filecmp
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from statistics import quantiles
from typing import Any

import node
import pytest
import yaml
from browsing import browser, chromium, place_script
from served import COMMAND, Served, served
from service_scenes import EXAMPLES, ROOT

from family import die_with_parent
from tailstack import load_design, score
from tailstack_service.documents import to_json

__all__ = ["browser"]

DEMO = (EXAMPLES / "demo.yaml").read_text(encoding="utf-8")
SOURCES, BUILT = ROOT / "service" / "workbench", ROOT / "service" / "tailstack_service" / "workbench"
SECONDS = 400
SCRIPT = "workbench.mjs"  # the scenarios


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, browser: None) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("workbench")) as running:
        yield running


def asked(url: str, scenario: str, design: str = DEMO, **more: Any) -> str:
    shot = os.environ.get("TAILSTACK_SCREENSHOTS")  # a folder: where pictures of the page are wanted
    picture = {"shot": f"{shot}/{more.get('name', scenario)}.png"} if shot else {}
    return json.dumps({
        "executable": chromium(), "sandbox": os.geteuid() != 0, "url": f"{url}/", "scenario": scenario,
        "design": design, **picture, **more,
    })  # fmt: skip


def used(url: str, scenario: str, design: str = DEMO, **more: Any) -> dict[str, Any]:
    """What a scenario of ``browser/workbench.mjs`` found.  Raises BrowserMissing."""
    done = subprocess.run(
        ["node", place_script(SCRIPT)], input=asked(url, scenario, design, **more), capture_output=True, text=True,
        timeout=SECONDS,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    found: dict[str, Any] = json.loads(done.stdout)
    assert found["watched"]["strangers"] == []  # no request to another host
    return found


def design_with(**changes: Any) -> str:
    return yaml.safe_dump({**yaml.safe_load(DEMO), **changes}, allow_unicode=True, sort_keys=False)


# --- from nothing to the first number ------------------------------------------------------------------------


def test_whoever_opens_the_address_is_one_click_from_a_score(service: Served) -> None:
    found = used(service.url, "first", example=yaml.safe_load(DEMO)["name"])
    assert found["watched"]["messages"] == []  # no error in the console, no breach of the policy
    assert [found["light"], found["opened"], found["dark"]] == [[], [], []]  # axe
    assert found["sizes"] < 600_000
    record = json.loads(to_json(score(load_design(EXAMPLES / "demo.yaml"))))
    assert found["score"] == record  # to the last digit
    assert found["p95"] == f"{record['verdict']['checks'][0]['value_mm']:.3f}"


def test_a_drag_shows_its_own_numbers_and_sends_one_request_at_a_time(service: Served) -> None:
    """p95 over 200 moves, from the pointer to the number, against the same request from a script in turn with it."""
    found = used(service.url, "drag", json={"design": yaml.safe_load(DEMO)}, moves=200)
    assert found["mostInFlight"] == 1
    assert found["position"] == 1  # the whole drag is one step
    page, alone = (quantiles(found[name], n=20)[18] for name in ("took", "alone"))
    assert page <= 3 * alone, (page, alone)


# --- what was done can be undone, and is kept --------------------------------------------------------------------


def test_fifty_edits_undone_give_the_first_design_and_done_again_the_last(service: Served) -> None:
    found = used(service.url, "undo", edits=50, seed=7)
    assert found["first"] == load_design(EXAMPLES / "demo.yaml").sha256 == found["undone"]
    assert found["last"] == found["redone"] != found["first"]
    assert found["steps"] >= 40  # some moves end where they began


def test_link_reload_crash_and_a_second_tab_lose_nothing(service: Served) -> None:
    found = used(service.url, "keep")
    assert found["mine"] == found["linked"] == found["reloaded"] == found["inherited"]
    assert found["theirs"] != found["mine"] == found["undisturbed"] == found["still"]
    assert found["file"].endswith(".yaml")
    assert "too large for a link" in found["words"]


# --- the whole job -----------------------------------------------------------------------------------------------


def test_the_whole_job_by_mouse(service: Served) -> None:
    found = used(service.url, "mouse")
    assert len({found["moved"], found["loosened"], found["taken"]}) == 3
    assert found["undone"] == found["loosened"]
    assert found["status"] in ("pass", "inconclusive")  # at the limit, within what first order is worth
    assert "Tolerance-budget report" in found["title"]
    assert found["comments"] >= DEMO.count("#") // 2  # the author's comments are still there
    assert found["watched"]["messages"] == []


def test_the_whole_job_by_keyboard(service: Served) -> None:
    found = used(service.url, "keyboard")
    assert len({found["first"], found["moved"], found["loosened"], found["taken"]}) == 4
    assert found["undone"] == found["loosened"]


def test_a_killed_service_is_waited_for_and_its_job_goes_on(tmp_path: Path, browser: None) -> None:
    with served(tmp_path) as running:
        port = running.url.rpartition(":")[2]
        page = subprocess.Popen(
            ["node", place_script(SCRIPT)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, preexec_fn=die_with_parent,
        )  # fmt: skip
        assert page.stdin is not None
        assert page.stderr is not None
        page.stdin.write(asked(running.url, "restart"))
        page.stdin.close()
        page.stdin = None
        assert page.stderr.readline() == "kill\n"
        os.kill(running.pid, signal.SIGKILL)
        running.process.wait(30)
        again = subprocess.Popen(
            [*COMMAND, "serve", "--port", port], env=running.environment, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, preexec_fn=die_with_parent,
        )  # fmt: skip
        try:
            out, error = page.communicate(timeout=SECONDS)
            assert page.returncode == 0, error[-3000:]
            assert json.loads(out)["sha"]
        finally:
            page.kill()
            again.send_signal(signal.SIGTERM)
            again.wait(60)


# --- strange and large designs -------------------------------------------------------------------------------------


def test_what_cannot_be_answered_is_explained_and_one_undo_away(service: Served) -> None:
    found = used(service.url, "refused")
    assert "F3" in found["words"]
    assert "outside view AP" in found["words"]
    assert (found["shown"], found["old"]) == ("false", 1)  # the last numbers are grey
    assert found["before"] == found["after"]


def test_names_are_text_and_push_nothing_out_of_the_page(service: Served) -> None:
    code, right_to_left = "<script>window.hacked = 1</script><img src=x onerror=hacked=1>", "הנחיית מקדחה"
    design = yaml.safe_load(DEMO)
    design["name"] = f"{right_to_left} {code}"
    design["interfaces"]["structure_connector"]["label"] = code + "x" * (200 - len(code))  # the longest that is read
    design["fiducials"]["points"][0]["label"] = "F" * 80
    design["targets"][0]["name"] = "<b>" + "W" * 77
    for width in (1280, 390):
        found = used(service.url, "names", yaml.safe_dump(design, allow_unicode=True, sort_keys=False), width=width)
        assert (found["scripts"], found["hacked"]) == (0, None)
        assert found["name"] == design["name"]
        assert (found["wide"], found["opened"]) == (0, 0)


def test_many_targets_fiducials_and_views_stay_usable(tmp_path: Path, browser: None) -> None:
    design = yaml.safe_load(DEMO)
    design["targets"] = [
        {"name": f"t{k}", "position_mm": [k % 10 * 3 - 15, k // 10 % 10 * 3 - 15, 40 + k // 100 * 20]}
        for k in range(200)
    ]
    spread = [(k % 4 * 18 - 27 + k % 3, k // 4 % 4 * 18 - 27 + k % 5, k // 16 * 14 - 80 + k % 7) for k in range(64)]
    design["fiducials"]["points"] = [{"label": f"F{k}", "position_mm": list(at)} for k, at in enumerate(spread)]
    oblique = {key: value for key, value in design["views"][0].items() if key != "orientation"}
    design["views"] += [{**oblique, "name": f"V{k}", "beam_direction": [1, k / 4, 0.1]} for k in range(1, 7)]
    del design["optimise"]
    with served(tmp_path, TAILSTACK_MAX_TARGETS="200") as running:
        found = used(running.url, "large", json.dumps(design))
    assert found["wide"] == 0
    assert len(found["took"]) == 1  # a change was answered with its own numbers


# --- the files in the package -----------------------------------------------------------------------------------------


def test_the_built_files_are_those_of_the_sources(tmp_path: Path) -> None:
    try:
        modules = node.tools(SOURCES).parent
    except node.NodeMissing as missing:
        from postgres import required

        if required("node"):
            pytest.fail(f"{missing}; TAILSTACK_TESTS_REQUIRE lists node")
        pytest.skip(f"NOT TESTED: {missing}")
    work = tmp_path / "service" / "workbench"
    shutil.copytree(SOURCES, work, ignore=shutil.ignore_patterns("node_modules"))
    shutil.copytree(
        ROOT / "service/tailstack_service/report/templates", tmp_path / "service/tailstack_service/report/templates"
    )
    shutil.copytree(ROOT / "openapi/typescript", tmp_path / "openapi/typescript")
    (work / "node_modules").symlink_to(modules)
    for command in (["tsc", "--noEmit"], ["vite", "build", "--logLevel", "warn"]):
        done = subprocess.run(
            [modules / ".bin" / command[0], *command[1:]], cwd=work, capture_output=True, text=True, timeout=SECONDS
        )
        assert done.returncode == 0, done.stdout + done.stderr
    fresh = tmp_path / "service" / "tailstack_service" / "workbench"
    names = sorted(str(path.relative_to(fresh)) for path in fresh.rglob("*") if path.is_file())
    assert names == sorted(str(path.relative_to(BUILT)) for path in BUILT.rglob("*") if path.is_file())
    assert filecmp.cmpfiles(fresh, BUILT, names, shallow=False)[0] == names
