"""Modules of the page that need no browser, run by Node, their types stripped by the compiler that the page has."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import node
import pytest
from service_scenes import ROOT

from family import run_process

PAGE = ROOT / "service" / "workbench"
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
    try:
        packages = node.tools(PAGE).parent
    except node.NodeMissing as missing:
        pytest.skip(f"NOT TESTED: {missing}")
    head = 'const asked = JSON.parse(require("fs").readFileSync(0, "utf8"));\n'
    head += "const answer = (value) => console.log(JSON.stringify(value));\n"
    environment = {**os.environ, "NODE_PATH": str(packages), "PAGE": str(PAGE)}
    for arguments, given in ((["-e", STRIP, *modules], ""), (["-e", head + script], json.dumps(asked))):
        done = run_process("node", *arguments, input=given, cwd=folder, env=environment, timeout=60)
        assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
