"""Everything that is made from openapi.json: the Python client and the TypeScript types.

``python openapi/generate.py`` makes both anew (``--python`` or ``--typescript``: one of them), in ``python/`` and
``typescript/`` beside this file, where Git does not see them, or in the folder that ``-o`` names.  Same document, same
bytes.  The Python client takes openapi-python-client and ruff, the types take Node.
"""

from __future__ import annotations

import argparse
import copy
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import node

HERE = Path(__file__).resolve().parent
DOCUMENT = HERE / "openapi.json"
PACKAGE = "tailstack_client"
METHODS = frozenset({"get", "put", "post", "delete", "patch"})
JSON = "application/json"

STREAMS = "text/event-stream"  # a generated call would wait for the end of the stream: read it line by line instead
FILE = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}
PROJECT = """\
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "tailstack-client"
version = "{version}"
description = "Client of the tailstack service, generated from its OpenAPI document"
requires-python = ">=3.11"
license = "Apache-2.0"
dependencies = ["httpx>=0.23", "attrs>=22.2", "python-dateutil>=2.8"]

[tool.hatch.build.targets.wheel]
packages = ["{package}"]
"""


def client_document(document: dict[str, Any]) -> dict[str, Any]:
    """The document as the Python client is made from: the overlay that openapi/README.md explains.

    The design stays a mapping; bodies are JSON, with no options in the query; event streams are left out; what may be
    answered as a record is that; another answer that may be binary is a file in any of its forms; classes are called
    what the schemas are.
    """
    document = copy.deepcopy(document)
    schemas = document["components"]["schemas"]
    words = schemas["Design"].get("description", "")
    schemas["Design"] = {"type": "object", "additionalProperties": True, "description": words}
    for name, schema in schemas.items():
        _untitled(schema)
        schema["title"] = name
    for path in list(document["paths"]):
        item = document["paths"][path]
        for method in METHODS & set(item):
            content = item[method].get("requestBody", {}).get("content", {})
            for media in [m for m in content if m != JSON]:
                del content[media]
            if content:  # what stands in the query belongs to the bodies that were just left out
                kept = [entry for entry in item[method].get("parameters", ()) if entry.get("in") != "query"]
                item[method]["parameters"] = kept
            answers = item[method]["responses"].values()
            for answer in answers:  # a call reads an answer in one way: as text, a PDF would be destroyed
                content = answer.get("content", {})
                if "$ref" in content.get(JSON, {}).get("schema", {}):  # what is answered unless Accept says otherwise
                    answer["content"] = {JSON: content[JSON]}
                elif any(map(_is_binary, content.values())):
                    answer["content"] = FILE
            if any(STREAMS in answer.get("content", {}) for answer in answers):
                del item[method]
        if not METHODS & set(item):
            del document["paths"][path]
    used = _used(document, document["paths"], set())
    document["components"]["schemas"] = {name: schema for name, schema in schemas.items() if name in used}
    return document


def _is_binary(content: dict[str, Any]) -> bool:
    return bool(content.get("schema", {}).get("format") == "binary")


def _used(document: dict[str, Any], node: Any, seen: set[str]) -> set[str]:
    """Names of the schemas that a part of the document leads to."""
    for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        if isinstance(child, str) and child.startswith("#/components/") and child not in seen:
            seen.add(child)
            kind, name = child.split("/")[2:]
            _used(document, document["components"][kind][name], seen)
        _used(document, child, seen)
    return {reference.split("/")[3] for reference in seen if reference.startswith("#/components/schemas/")}


def _untitled(node: Any) -> None:
    """Drop the titles inside a schema: they would become class names of their own."""
    for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        if isinstance(child, dict) and isinstance(child.get("title"), str):
            del child["title"]
        _untitled(child)


def make_python(target: Path) -> None:
    """Write the client's project (package and pyproject.toml) to the folder ``target``.

    Raises RuntimeError with the generator's words when it leaves anything out.
    """
    document = json.loads(DOCUMENT.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory(prefix="tailstack-client-") as folder:
        source, config = Path(folder) / "openapi.json", Path(folder) / "config.json"
        source.write_text(json.dumps(client_document(document)), encoding="utf-8")
        config.write_text(json.dumps({"post_hooks": [], "literal_enums": True}), encoding="utf-8")
        package = Path(folder) / PACKAGE
        places = ["--path", str(source), "--config", str(config), "--output-path", str(package)]
        _checked("openapi_python_client", "generate", "--meta", "none", "--fail-on-warning", *places)
        _checked("ruff", "format", "--isolated", "--line-length", "120", "--quiet", str(package))
        target.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(target / PACKAGE, ignore_errors=True)
        shutil.copytree(package, target / PACKAGE, ignore=shutil.ignore_patterns("__pycache__", ".ruff_cache"))
    project = PROJECT.format(version=document["info"]["version"], package=PACKAGE)
    (target / "pyproject.toml").write_text(project, encoding="utf-8")


def make_typescript(target: Path) -> None:
    """Write the types, tailstack.d.ts, to the folder ``target``.

    Raises NodeMissing, or RuntimeError with the generator's words.
    """
    target.mkdir(parents=True, exist_ok=True)
    done = node.run_script(HERE / "types.mjs", DOCUMENT, target / "tailstack.d.ts")
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)


def _checked(module: str, *arguments: str) -> None:
    done = subprocess.run([sys.executable, "-m", module, *arguments], capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(f"{module}: {done.stdout}{done.stderr}")


def main() -> int:
    parser = argparse.ArgumentParser(description="Make the Python client and the TypeScript types from openapi.json.")
    parser.add_argument("--python", action="store_true", help="the Python client only")
    parser.add_argument("--typescript", action="store_true", help="the TypeScript types only")
    parser.add_argument("-o", type=Path, default=HERE, metavar="DIR", help="the folder (default: the one of this file)")
    chosen = parser.parse_args()
    try:
        if chosen.python or not chosen.typescript:
            make_python(chosen.o / "python")
        if chosen.typescript or not chosen.python:
            make_typescript(chosen.o / "typescript")
    except node.NodeMissing as missing:
        print(f"no TypeScript: {missing}", file=sys.stderr)
        return 3
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
