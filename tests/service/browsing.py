"""A real Chromium for the tests: pages opened as a reader opens them, by the Node script in ``browser/``."""

from __future__ import annotations

import atexit
import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import node
import pytest
import yaml
from postgres import go_without
from service_scenes import EXAMPLES, ROOT

from family import die_with_parent
from waiting import LIMIT_SECONDS

HOME = ROOT / "tests" / "service" / "browser"
# First the one that cannot open a window: the same pages take two thirds of the CPU
NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
DEMO = (EXAMPLES / "demo.yaml").read_text(encoding="utf-8")


def demo_with(*left_out: str, **changes: Any) -> str:
    """The demonstration without some of its sections, and with others in the place of its own."""
    data = {name: section for name, section in yaml.safe_load(DEMO).items() if name not in left_out}
    return str(yaml.safe_dump({**data, **changes}, sort_keys=False, allow_unicode=True))


class BrowserMissing(Exception):
    """Chromium, Node or the pinned npm packages are not to be had here; the message says which."""


def chromium() -> str:
    """Path of the browser.  Raises BrowserMissing."""
    found = next((path for name in NAMES if (path := shutil.which(name)) is not None), None)
    if found is None:
        raise BrowserMissing("no Chromium on the PATH: on Debian apt-get install chromium-headless-shell")
    return found


def place_scripts() -> Path:
    """The folder of the scripts of ``browser/``, below the packages they use: Node looks for them there.

    It is named by what the scripts say, so that another checkout's do not take their place.  Raises BrowserMissing.
    """
    try:
        packages = node.tools(HOME).parent.parent
    except node.NodeMissing as missing:
        raise BrowserMissing(str(missing)) from None
    scripts = {path.name: path.read_bytes() for path in sorted(HOME.glob("*.mjs"))}
    place = packages / sha256(b"".join(scripts.values())).hexdigest()[:16]
    place.mkdir(exist_ok=True)
    for called, content in scripts.items():
        fresh = place / f".{called}.{os.getpid()}"  # another process may be reading the one that is there
        fresh.write_bytes(content)
        fresh.replace(place / called)
    return place


class Browser:
    """The one browser of this process, which ends with it.  It plays one scenario after the other."""

    def __init__(self) -> None:
        """Raises BrowserMissing."""
        self.process = subprocess.Popen(
            ["node", place_scripts() / "browser.mjs"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            preexec_fn=die_with_parent,
        )  # fmt: skip
        atexit.register(self.end)
        self.ask({"executable": chromium(), "sandbox": os.geteuid() != 0, "limit": 1000 * LIMIT_SECONDS})

    def ask(self, job: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(job) + "\n")
        self.process.stdin.flush()

    def read(self) -> dict[str, Any]:
        """What comes next from the scenario; one that does not end says so by itself."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the browser ended"
        return json.loads(line)  # type: ignore[no-any-return]

    def said(self) -> str:
        """What the scenario tells while it is played."""
        answer = self.read()
        assert "said" in answer, answer
        return str(answer["said"])

    def found(self) -> dict[str, Any]:
        """What the scenario found in the end, without a request to another host."""
        answer = self.read()
        assert "found" in answer, answer.get("error", answer)
        found: dict[str, Any] = answer["found"]
        assert found["watched"]["strangers"] == []
        return found

    def end(self) -> None:
        atexit.unregister(self.end)
        self.process.communicate(timeout=LIMIT_SECONDS)  # which closes its stdin


started = cache(Browser)


@contextmanager
def playing(script: str, scenario: str, **more: Any) -> Iterator[Browser]:
    """While a scenario of a script in ``browser/`` is played.  Where it was not read to its end, the next gets another
    browser.  Raises BrowserMissing."""
    one = started()
    try:
        one.ask({"script": script, "scenario": scenario, "limit": 1000 * LIMIT_SECONDS, **more})
        yield one
    except BaseException:
        started.cache_clear()
        one.end()
        raise


def asked(url: str, scenario: str, design: str = DEMO, **more: Any) -> dict[str, Any]:
    """Of a scenario on the workbench."""
    shot = os.environ.get("TAILSTACK_SCREENSHOTS")  # a folder: where pictures of the page are wanted
    picture = {"shot": f"{shot}/{more.get('name', scenario)}.png"} if shot else {}
    return {"url": f"{url}/", "scenario": scenario, "design": design, **picture, **more}


def used(url: str, scenario: str, design: str = DEMO, *, script: str = "workbench.mjs", **more: Any) -> dict[str, Any]:
    """What a scenario of a script in ``browser/`` found on the workbench.  Raises BrowserMissing."""
    with playing(script, **asked(url, scenario, design, **more)) as page:
        return page.found()


def awaited(condition: str) -> str:
    """For ``ask`` of a job: answered once the condition is true of the page, and an error where it never is."""
    return (
        f"new Promise((done, fail) => {{ const ends = Date.now() + {1000 * LIMIT_SECONDS};"
        f" const look = () => ({condition}) ? done(true) : Date.now() < ends ? setTimeout(look, 10)"
        f" : fail(new Error({json.dumps('it never came true: ' + condition)})); look(); }})"
    )


def look(jobs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Open pages one after the other; what each did is described in ``browser/look.mjs``.  Raises BrowserMissing."""
    with playing("look.mjs", "look", jobs=list(jobs)) as page:
        results: list[dict[str, Any]] = page.found()["results"]
        return results


@pytest.fixture(scope="session")
def browser() -> None:
    """Chromium can be used, or the test is skipped and says so."""
    try:
        chromium()
        node.tools(HOME)
    except (BrowserMissing, node.NodeMissing) as missing:
        go_without("chromium", missing)


def page_of(path: Path, **more: Any) -> dict[str, Any]:
    """A job for a file, opened without any network."""
    return {"url": path.resolve().as_uri(), **more}
