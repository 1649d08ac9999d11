"""The bill of materials of a release, as CycloneDX 1.6 in JSON: what the locks pin, and what is bundled.

Python packages come from the lock files (the core is required, the rest optional); they are installed beside tailstack
and are no part of it.  Bundled are Swagger UI and the packages of the workbench's page.
"""

from __future__ import annotations

import re
import uuid
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tailstack.results.json_text import write_json

HASHES = r"((?: +--hash=sha256:[0-9a-f]{64}(?: \\)?\n?)+)"
ENTRY = re.compile(r"^([a-z0-9._-]+)==([^ ;\\\n]+)(?: ; ([^\\\n]+?))? \\\n" + HASHES, re.MULTILINE)
BUNDLED = re.compile(r"^(@?[a-z0-9][a-z0-9@/._-]*) (\d\S*) \(([A-Za-z0-9.-]+)\)$", re.MULTILINE)
SPACE = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")  # RFC 9562's of addresses


def locked(text: str) -> list[dict[str, Any]]:
    """The packages of a lock file: name, version, marker and hashes of their files."""
    return [
        {"name": name, "version": version, "marker": marker, "hashes": re.findall(r"sha256:([0-9a-f]{64})", hashes)}
        for name, version, marker, hashes in ENTRY.findall(text)
    ]


def _of_python(package: dict[str, Any], required: bool) -> dict[str, Any]:
    name, version = package["name"], package["version"]
    component: dict[str, Any] = {
        "type": "library",
        "bom-ref": f"pkg:pypi/{name}@{version}",
        "name": name,
        "version": version,
        "scope": "required" if required else "optional",
        "purl": f"pkg:pypi/{name}@{version}",
        "externalReferences": [
            {
                "type": "distribution",
                "url": f"https://pypi.org/project/{name}/{version}/",
                "comment": "one hash for each file that the lock accepts",
                "hashes": [{"alg": "SHA-256", "content": content} for content in package["hashes"]],
            }
        ],
    }
    if package["marker"]:
        component["properties"] = [{"name": "tailstack:marker", "value": package["marker"]}]
    return component


def _of_page(name: str, version: str, licence: str) -> dict[str, Any]:
    purl = f"pkg:npm/{quote(name, safe='/')}@{version}"
    return {
        "type": "library",
        "bom-ref": purl,
        "name": name,
        "version": version,
        "scope": "required",
        "licenses": [{"license": {"id": licence}}],
        "purl": purl,
        "properties": [{"name": "tailstack:bundled", "value": "true"}],
    }


def bundled(root: Path) -> list[tuple[str, str, str]]:
    """Name, version and licence of what the wheel brings along for browsers."""
    service = root / "service" / "tailstack_service"
    found = [
        entry
        for file in sorted((service / "workbench" / "assets").glob("licences-*.txt"))
        for entry in BUNDLED.findall(file.read_text(encoding="utf-8"))
    ]
    package = (root / "openapi" / "docs_page" / "package.json").read_text(encoding="utf-8")
    (version,) = re.findall(r'"swagger-ui-dist": "([^"]+)"', package)
    return [*found, ("swagger-ui-dist", version, "Apache-2.0")]


def bill(root: Path, version: str, moment: int) -> dict[str, Any]:
    """The bill of a version; ``moment``: seconds since 1970, of its sources."""
    core = {package["name"] for package in locked((root / "requirements-core.lock").read_text(encoding="utf-8"))}
    packages = locked((root / "requirements-run.lock").read_text(encoding="utf-8"))
    components = [_of_python(package, package["name"] in core) for package in packages]
    components += [_of_page(*entry) for entry in bundled(root)]
    ours = f"pkg:pypi/tailstack@{version}"
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(SPACE, write_json(components) + ours)}",
        "version": 1,
        "metadata": {
            "timestamp": datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "component": {
                "type": "application",
                "bom-ref": ours,
                "name": "tailstack",
                "version": version,
                "licenses": [{"license": {"id": "Apache-2.0"}}],
                "purl": ours,
            },
        },
        "components": components,
        "dependencies": [{"ref": ours, "dependsOn": sorted({component["bom-ref"] for component in components})}],
    }
