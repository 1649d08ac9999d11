"""Examples of answers, which the document shows: as a running service answered, a file OPERATION_ID.json each.

``python openapi/answers.py [URL]`` asks every operation with the document's own examples of requests and writes what
came back beside the code that makes the document (URL: of a service without authentication, by default
http://127.0.0.1:8321).  Then write openapi.json anew.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from math import isclose
from typing import Any

import httpx
from rules import HERE, ITSELF, METHODS, resolved

ANSWERS = HERE.parent / "service" / "tailstack_service" / "http" / "example_answers"
WAIT_SECONDS = 60  # what a service waits for at most, unless it was told otherwise
VARYING = frozenset({"provenance", "execution", "created_at", "python", "tailstack", "numpy", "today"})


def answers(document: dict[str, Any], url: str) -> Iterator[tuple[str, Any]]:
    """(operation id, answer) of everything that answers with JSON and shows no example, or its own answer.

    Raises RuntimeError with the refusal for an operation that does not answer with 200.
    """
    found: dict[str, str] = {}  # values of path parameters that only the service can know
    with httpx.Client(base_url=url, timeout=3 * WAIT_SECONDS, trust_env=False) as client:
        for path, item in document["paths"].items():
            for method in (m for m in METHODS if m in item):
                operation = item[method]
                content = resolved(document, operation["responses"].get("200", {})).get("content", {})
                media = content.get("application/json")
                identity = operation["operationId"]
                own = {"example": {"$ref": f"#/components/examples/{identity}"}}
                if media is None or media.get("examples", own) != own or identity == ITSELF:
                    continue
                parameters = [resolved(document, p) for p in operation.get("parameters", ())]
                values = {p["name"]: found.get(p["name"], p.get("example")) for p in parameters if p["in"] == "path"}
                response = client.request(
                    method,
                    path.format(**values),
                    json=_body(document, operation),
                    headers={"Prefer": f"wait={WAIT_SECONDS}"},
                    params={"format": "json"} if any(p["name"] == "format" for p in parameters) else None,
                )
                if response.status_code == 202:
                    response = _result(client, response.headers["location"])
                if response.status_code != 200:
                    raise RuntimeError(f"{identity}: {response.status_code} {response.text[:2000]}")
                if method == "post" and "etag" in response.headers:
                    found.setdefault("sha256", response.headers["etag"].strip('"'))
                yield identity, response.json()


def _result(client: httpx.Client, location: str) -> httpx.Response:
    """The result of a job that took longer than anybody waits."""
    while client.get(location).json()["state"] in ("queued", "running"):
        time.sleep(1.0)
    return client.get(location + "/result", follow_redirects=True)


def _body(document: dict[str, Any], operation: dict[str, Any]) -> Any:
    content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
    return next((resolved(document, entry)["value"] for entry in content.get("examples", {}).values()), None)


def shape(value: Any) -> Any:
    """What a document is made of, without its values: equal for answers of equal form.

    Lists are the set of the forms in them, and what depends on the host or on the day is left out.
    """
    if isinstance(value, dict):
        return tuple(sorted((key, shape(child)) for key, child in value.items() if key not in VARYING))
    if isinstance(value, list):
        return "[]", *sorted({repr(shape(child)) for child in value})
    return "number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value).__name__


def differences(fresh: Any, shown: Any, at: str = "") -> Iterator[str]:
    """Where two answers of one form say other things; numbers may differ in the last digits that processors leave."""
    if isinstance(fresh, dict):
        for key in fresh.keys() - VARYING:
            yield from differences(fresh[key], shown[key], f"{at}/{key}")
    elif isinstance(fresh, list):
        if len(fresh) != len(shown):
            yield f"{at}: {len(shown)} entries are now {len(fresh)}"
        for index, pair in enumerate(zip(fresh, shown, strict=False)):
            yield from differences(*pair, f"{at}/{index}")
    elif isinstance(fresh, float):
        if not isclose(fresh, shown, rel_tol=1e-6, abs_tol=1e-9):
            yield f"{at}: {shown} is now {fresh}"
    elif fresh != shown:
        yield f"{at}: {shown!r} is now {fresh!r}"


def main(arguments: list[str]) -> int:
    document = json.loads((HERE / "openapi.json").read_text(encoding="utf-8"))
    fresh = dict(answers(document, arguments[0] if arguments else "http://127.0.0.1:8321"))
    for old in ANSWERS.glob("*.json"):
        old.unlink()
    for name, answer in fresh.items():
        (ANSWERS / f"{name}.json").write_text(json.dumps(answer, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
