"""The page without a browser: its own sources run in Node, before a service of a table (``workbench_in_node.mjs``)."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from openapi_scenes import pinned_tools
from service_scenes import ROOT

from family import run_process
from waiting import LIMIT_SECONDS

SOURCES = ROOT / "service" / "workbench"
SCRIPT = Path(__file__).parent / "workbench_in_node.mjs"


def in_node(**job: Any) -> dict[str, Any]:
    """What the page makes of a job."""
    modules = pinned_tools(SOURCES).parent.parent
    done = run_process("node", SCRIPT, modules, SOURCES / "src", input=json.dumps(job))
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


STRIP = """
const ts = require("typescript"), fs = require("fs");
for (const name of process.argv.slice(1)) {
  const source = fs.readFileSync(`${process.env.PAGE}/src/${name}.ts`, "utf8");
  const { outputText } = ts.transpileModule(source, { compilerOptions: { module: "commonjs", target: "es2022" } });
  fs.writeFileSync(`${name}.js`, outputText);
}
"""


def call_page(folder: Path, modules: tuple[str, ...], script: str, asked: Any) -> Any:
    """What a script answers, which may require the modules: it finds its question in ``asked`` and calls ``answer``."""
    packages = pinned_tools(SOURCES).parent
    head = 'const asked = JSON.parse(require("fs").readFileSync(0, "utf8"));\n'
    head += "const answer = (value) => console.log(JSON.stringify(value));\n"
    environment = {**os.environ, "NODE_PATH": str(packages), "PAGE": str(SOURCES)}
    for arguments, given in ((["-e", STRIP, *modules], ""), (["-e", head + script], json.dumps(asked))):
        done = run_process("node", *arguments, input=given, cwd=folder, env=environment, timeout=LIMIT_SECONDS)
        assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
