"""openapi.json: the document of the service, and with it an example of every answer.

``python openapi/answers.py`` writes openapi.json anew, of the installed tailstack and the examples that it has.  With
the URL of a service without authentication it asks that one for new ones: every operation, with the examples of
requests in its document; of what comes back lists are cut short.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Mapping
from math import isclose
from typing import Any

import httpx
from rules import HERE, ITSELF, METHODS, resolved

from tailstack.results.json_text import write_json
from tailstack_service.http.app import create_app

DOCUMENT = HERE / "openapi.json"
SHOWN_BY = {"get_result": "create_verification", "get_report": "create_verification"}  # answer with another's record
SUMMARY = "As a service answered the example of the request; of long lists the first two entries"
WAIT_SECONDS = 60  # what a service waits for at most, unless it was told otherwise
SHOWN, MOST_PLAIN = 2, 12  # entries that are left of a list, where they are objects or more than so many
VARYING = frozenset({"provenance", "execution", "created_at", "python", "tailstack", "numpy", "today"})


def committed_answers() -> dict[str, Any]:
    """The examples of answers in openapi.json, by the operation that answered so."""
    examples = json.loads(DOCUMENT.read_text(encoding="utf-8"))["components"]["examples"]
    return {name: entry["value"] for name, entry in examples.items() if entry.get("summary") == SUMMARY}


def text_with_answers(document: dict[str, Any], examples: Mapping[str, Any] | None = None) -> str:
    """The text of openapi.json: the document of the service, which is changed, and an example of every answer.

    ``examples``: by the operation that answered so; None: those that stand there.
    """
    examples = committed_answers() if examples is None else dict(sorted(examples.items()))
    document["components"]["examples"] |= {
        name: {"summary": SUMMARY, "value": value} for name, value in examples.items()
    }
    for operation in (item[method] for item in document["paths"].values() for method in METHODS if method in item):
        media = resolved(document, operation["responses"].get("200", {})).get("content", {}).get("application/json")
        shown = SHOWN_BY.get(operation["operationId"], operation["operationId"])
        if media is not None and shown in examples:
            media.setdefault("examples", {"example": {"$ref": f"#/components/examples/{shown}"}})
    return write_json(document, indent=1) + "\n"


def answers(url: str) -> Iterator[tuple[str, Any]]:
    """(operation id, answer) of everything that answers with JSON of its own and shows no example of it.

    Raises RuntimeError with the refusal for an operation that does not answer with 200.
    """
    found: dict[str, str] = {}  # values of path parameters that only the service can know
    with httpx.Client(base_url=url, timeout=3 * WAIT_SECONDS, trust_env=False) as client:
        document = client.get("/openapi.json").raise_for_status().json()
        for path, item in document["paths"].items():
            for method in (m for m in METHODS if m in item):
                operation = item[method]
                content = resolved(document, operation["responses"].get("200", {})).get("content", {})
                media = content.get("application/json")
                identity = operation["operationId"]
                if media is None or "examples" in media or identity in SHOWN_BY or identity == ITSELF:
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


def shortened(value: Any) -> Any:
    """An answer as it is shown: two entries of lists of objects and of long lists; vectors and designs stay whole."""
    if isinstance(value, list):
        if len(value) > MOST_PLAIN or any(isinstance(entry, dict) for entry in value):
            value = value[:SHOWN]
        return [shortened(entry) for entry in value]
    if isinstance(value, dict) and not {"fiducials", "views"} <= value.keys():  # a design could not be sent back
        return {key: shortened(child) for key, child in value.items()}
    return value


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
        for key in sorted(fresh.keys() - VARYING):
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
    fresh = {name: shortened(answer) for name, answer in answers(arguments[0])} if arguments else None
    DOCUMENT.write_text(text_with_answers(create_app(warm_up=False).openapi(), fresh), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
