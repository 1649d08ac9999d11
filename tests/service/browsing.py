"""A real Chromium for the tests: pages opened as a reader opens them, by the Node script in ``browser/``."""

from __future__ import annotations

import atexit
import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import node
import pytest
from postgres import required
from service_scenes import EXAMPLES, ROOT

from family import die_with_parent
from waiting import LIMIT_SECONDS

HOME = ROOT / "tests" / "service" / "browser"
NAMES = ("chromium", "chromium-browser", "google-chrome")
USED_SECONDS = 3 * LIMIT_SECONDS  # of a scenario on the workbench, which waits under the one limit again and again
DEMO = (EXAMPLES / "demo.yaml").read_text(encoding="utf-8")


class BrowserMissing(Exception):
    """Chromium, Node or the pinned npm packages are not to be had here; the message says which."""


def chromium() -> str:
    """Path of the browser.  Raises BrowserMissing."""
    found = next((path for name in NAMES if (path := shutil.which(name)) is not None), None)
    if found is None:
        raise BrowserMissing("no Chromium on the PATH: on Debian apt-get install chromium")
    return found


def place_script(name: str) -> Path:
    """A script of ``browser/`` beside those that it imports, below the packages they use: Node looks for them there.

    The folder is named by what the scripts say, so that another checkout's do not take their place.  Raises
    BrowserMissing.
    """
    try:
        packages = node.tools(HOME).parent.parent
    except node.NodeMissing as missing:
        raise BrowserMissing(str(missing)) from None
    scripts = {path.name: path.read_bytes() for path in sorted(HOME.glob("*.mjs"))}
    place = packages / sha256(b"".join(scripts.values())).hexdigest()[:16]
    place.mkdir(exist_ok=True)
    for called, content in scripts.items():
        (place / called).write_bytes(content)
    return place / name


@cache
def browser_address() -> str:
    """Of the one browser of this process, which ends with it.  Raises BrowserMissing."""
    process = subprocess.Popen(
        ["node", place_script("browser.mjs")], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        preexec_fn=die_with_parent,
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    atexit.register(_end_browser, process)
    process.stdin.write(json.dumps({"executable": chromium(), "sandbox": os.geteuid() != 0}) + "\n")
    process.stdin.flush()
    address = process.stdout.readline().strip()
    assert address, "Chromium did not start"
    return address


def _end_browser(process: subprocess.Popen[str]) -> None:
    process.communicate(timeout=LIMIT_SECONDS)  # which closes its stdin


def _surroundings() -> dict[str, Any]:
    """What every script is told: the browser, and the limit of its waits, ms."""
    return {"browser": browser_address(), "limit": 1000 * LIMIT_SECONDS}


def asked(url: str, scenario: str, design: str = DEMO, **more: Any) -> str:
    shot = os.environ.get("TAILSTACK_SCREENSHOTS")  # a folder: where pictures of the page are wanted
    picture = {"shot": f"{shot}/{more.get('name', scenario)}.png"} if shot else {}
    return json.dumps({
        **_surroundings(), "url": f"{url}/", "scenario": scenario, "design": design, **picture, **more,
    })  # fmt: skip


def used(url: str, scenario: str, design: str = DEMO, *, script: str = "workbench.mjs", **more: Any) -> dict[str, Any]:
    """What a scenario of a script in ``browser/`` found on the workbench.  Raises BrowserMissing."""
    done = subprocess.run(
        ["node", place_script(script)], input=asked(url, scenario, design, **more), capture_output=True, text=True,
        timeout=USED_SECONDS,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    found: dict[str, Any] = json.loads(done.stdout)
    assert found["watched"]["strangers"] == []  # no request to another host
    return found


def awaited(condition: str) -> str:
    """For ``ask`` of a job: answered once the condition is true of the page, and an error where it never is."""
    return (
        f"new Promise((done, fail) => {{ const ends = Date.now() + {1000 * LIMIT_SECONDS};"
        f" const look = () => ({condition}) ? done(true) : Date.now() < ends ? setTimeout(look, 10)"
        f" : fail(new Error({json.dumps('it never came true: ' + condition)})); look(); }})"
    )


def look(jobs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Open pages one after the other; what each did is described in ``browser/look.mjs``.  Raises BrowserMissing."""
    script = place_script("look.mjs")
    asked = {**_surroundings(), "jobs": list(jobs)}
    done = subprocess.run(
        ["node", str(script)], input=json.dumps(asked), capture_output=True, text=True, timeout=LIMIT_SECONDS
    )
    assert done.returncode == 0, done.stderr[-4000:]
    results: list[dict[str, Any]] = json.loads(done.stdout)["results"]
    return results


@pytest.fixture(scope="session")
def browser() -> None:
    """Chromium can be used, or the test is skipped and says so."""
    try:
        chromium()
        node.tools(HOME)
    except (BrowserMissing, node.NodeMissing) as missing:
        if required("chromium"):
            pytest.fail(f"{missing}; TAILSTACK_TESTS_REQUIRE lists chromium")
        pytest.skip(f"NOT TESTED: {missing}")


def page_of(path: Path, **more: Any) -> dict[str, Any]:
    """A job for a file, opened without any network."""
    return {"url": path.resolve().as_uri(), **more}
