"""The page without a browser: its own sources run in Node, before a service of a table (``workbench_in_node.mjs``)."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from openapi_scenes import pinned_tools
from service_scenes import ROOT

from waiting import LIMIT_SECONDS

SOURCES = ROOT / "service" / "workbench"
SCRIPT = Path(__file__).parent / "workbench_in_node.mjs"


def in_node(**job: Any) -> dict[str, Any]:
    """What the page makes of a job."""
    modules = pinned_tools(SOURCES).parent.parent
    command = ["node", str(SCRIPT), str(modules), str(SOURCES / "src")]
    done = subprocess.run(command, input=json.dumps(job), capture_output=True, text=True, timeout=LIMIT_SECONDS)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found
