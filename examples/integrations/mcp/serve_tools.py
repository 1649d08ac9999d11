"""Tools for an assistant that speaks MCP, over stdin and stdout: ``python serve_tools.py [URL]`` needs mcp and httpx.

A running service computes (``tailstack serve``): this hands on what it is asked, and what it answers or refuses.
"""

from __future__ import annotations

import asyncio
import os
import sys
from typing import Any

import anyio
import httpx
from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ToolError

PATHS = {
    "validate": "/v1/validations",
    "score": "/v1/scores",
    "verify": "/v1/verifications",
    "optimise": "/v1/optimisations",
    "sweep": "/v1/sweeps",
    "report": "/v1/reports",
}
ANSWER_SECONDS, PAUSE_SECONDS = 120.0, 0.5
INSTRUCTIONS = """\
tailstack judges the mechanical design of a surgical robot's X-ray reference structure: how far from the target the tool
ends up in the worst 5 % of shots (P95, mm), which tolerance is to blame, and what the cheapest design within the limit
is. Usual order: validate, score, optimise, verify, report. A refusal names the field (a JSON pointer) and the cure.
Give a design once; afterwards name it by the design_sha256 of an answer, with patch (RFC 7396) for what is changed.
Lengths are in mm, angles in degrees, as the names of the fields say. A design:

"""


def make_server(url: str) -> MCPServer:
    """The tools; as resources the schemas and examples of the service."""
    key = os.environ.get("TAILSTACK_KEY", "")
    headers = {"Authorization": f"Bearer {key}"} if key else {}
    service = httpx.AsyncClient(base_url=url, headers=headers, timeout=ANSWER_SECONDS, follow_redirects=True)
    with httpx.Client(base_url=url, headers=headers, timeout=ANSWER_SECONDS) as first:
        document = first.get("/openapi.json").raise_for_status().json()
        example = first.get("/v1/examples/first_carrier").raise_for_status().text
    server = MCPServer("tailstack", instructions=INSTRUCTIONS + example)

    async def compute(path: str, body: dict[str, Any], context: Context) -> dict[str, Any]:
        answer = await service.post(path, json=body)
        if answer.status_code == 202:
            place = answer.headers["Location"]
            try:
                while (job := (await service.get(place)).raise_for_status().json())["state"] in ("queued", "running"):
                    await context.report_progress(job["progress"]["units_done"], job["progress"]["units_expected"])
                    await asyncio.sleep(PAUSE_SECONDS)
            except asyncio.CancelledError:
                with anyio.CancelScope(shield=True):
                    await service.post(f"{place}/cancel")
                raise
            answer = await service.get(f"{place}/result")
        if answer.is_error:
            problem = answer.json()
            lines = [f"{each['pointer']}: {each['detail']}. {each['hint']}" for each in problem["errors"]]
            raise ToolError("\n".join([problem["title"], *lines]))
        return answer.json()

    def add_tool(name: str, path: str) -> None:
        async def tool(
            context: Context,
            design: dict[str, Any] | None = None,
            design_sha256: str | None = None,
            patch: dict[str, Any] | None = None,
            options: dict[str, Any] | None = None,
        ) -> dict[str, Any]:
            given = {"design": design, "design_sha256": design_sha256, "patch": patch}
            body = {field: value for field, value in given.items() if value is not None} | (options or {})
            return await compute(path, body, context)

        route = document["paths"][path]["post"]
        sent = route["requestBody"]["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
        fields = document["components"]["schemas"][sent]["properties"]
        options = [f"{field}: {entry['description']}" for field, entry in fields.items() if field not in GIVEN]
        server.tool(name=name, description="\n".join([route["description"], "options:", *options]))(tool)

    for name, path in PATHS.items():
        add_tool(name, path)

    @server.resource("tailstack://schemas/{name}", mime_type="application/json")
    async def schema(name: str) -> str:
        return (await service.get(f"/v1/schemas/{name}")).raise_for_status().text

    @server.resource("tailstack://examples/{name}", mime_type="application/yaml")
    async def example_design(name: str) -> str:
        return (await service.get(f"/v1/examples/{name}")).raise_for_status().text

    return server


GIVEN = ("design", "design_sha256", "patch")


def main(url: str = "http://127.0.0.1:8321") -> None:
    make_server(url).run()


if __name__ == "__main__":
    main(*sys.argv[1:])
