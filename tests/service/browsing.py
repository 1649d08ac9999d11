"""A real Chromium for the tests: pages opened as a reader opens them, by the Node script in ``browser/``."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import node
import pytest
from postgres import required
from service_scenes import ROOT

HOME = ROOT / "tests" / "service" / "browser"
NAMES = ("chromium", "chromium-browser", "google-chrome")
SECONDS = 180


class BrowserMissing(Exception):
    """Chromium, Node or the pinned npm packages are not to be had here; the message says which."""


def chromium() -> str:
    """Path of the browser.  Raises BrowserMissing."""
    found = next((path for name in NAMES if (path := shutil.which(name)) is not None), None)
    if found is None:
        raise BrowserMissing("no Chromium on the PATH: on Debian apt-get install chromium")
    return found


def place_script(name: str) -> Path:
    """A script of ``browser/`` beside the packages that it uses: Node looks for them there.  Raises BrowserMissing."""
    try:
        place = node.tools(HOME).parent.parent / name
    except node.NodeMissing as missing:
        raise BrowserMissing(str(missing)) from None
    place.write_bytes((HOME / name).read_bytes())
    return place


def look(jobs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Open pages one after the other; what each did is described in ``browser/look.mjs``.  Raises BrowserMissing."""
    executable = chromium()
    script = place_script("look.mjs")
    asked = {"executable": executable, "sandbox": os.geteuid() != 0, "jobs": list(jobs)}
    done = subprocess.run(
        ["node", str(script)], input=json.dumps(asked), capture_output=True, text=True, timeout=SECONDS
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
