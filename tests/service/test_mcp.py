"""Tools of an assistant before a running service, by the example, as the client of the protocol's SDK meets them."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import anyio
import pytest
from served import Served
from service_scenes import EXAMPLES, ROOT, small_design

from tailstack import load_design, score
from tailstack_service.schemas import json_schema
from waiting import LIMIT_SECONDS

if TYPE_CHECKING:
    from mcp import Client

EXAMPLE = EXAMPLES / "integrations" / "mcp" / "serve_tools.py"
CARRIER = load_design(EXAMPLES / "first_carrier.yaml")


@pytest.mark.long
def test_an_assistant_scores_checks_and_optimises_a_design_and_meets_refusals(services: Callable[..., Served]) -> None:
    """independent: the library's score, in this process."""
    from mcp import Client, StdioServerParameters  # here: every process that collects would wait a second for it

    heard: list[tuple[float, float]] = []

    async def hear(progress: float, total: float | None, message: str | None) -> None:
        heard.append((progress, total or 0.0))

    async def record_of(client: Client, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        result = await client.call_tool(tool, arguments, progress_callback=hear)
        assert not result.is_error, result.content
        return result.structured_content

    async def meet(url: str) -> None:
        server = StdioServerParameters(command=sys.executable, args=[str(EXAMPLE), url], env=dict(os.environ))
        async with Client(server, read_timeout_seconds=LIMIT_SECONDS) as client:
            tools = (await client.list_tools()).tools
            assert [tool.name for tool in tools] == ["validate", "score", "verify", "optimise", "sweep", "report"]
            assert sum(len(tool.model_dump_json()) for tool in tools) < 20_000  # what is read before anything is done
            assert '"schema":"tailstack/design/1"' in client.instructions
            scored = await record_of(client, "score", {"design": dict(CARRIER.source.data)})
            assert scored["targets"][0]["p95_mm"] == score(CARRIER).targets[0].p95_mm
            name = scored["provenance"]["design_sha256"]
            assert name == CARRIER.sha256
            found = await record_of(client, "optimise", {"design_sha256": name, "options": {"starts": 2}})
            again = {"design": found["design"], "options": {"precision": 0.02}}
            assert (await record_of(client, "verify", again))["verdict"]["status"] == "pass"
            for arguments, told in (
                ({"design_sha256": name, "patch": {"views": 5}}, "/design/views"),
                ({"design_sha256": "0" * 64}, "/design_sha256"),
                ({"design": small_design(), "options": {"trails": 3}}, "/trails"),
            ):
                refused = await client.call_tool("verify", arguments)
                assert refused.is_error
                assert told in refused.content[0].text  # type: ignore[union-attr]
            schema: Any = (await client.read_resource("tailstack://schemas/design")).contents[0]
            assert json.loads(schema.text) == json_schema("design")

    anyio.run(meet, services().url)
    assert heard  # of the optimisation at least, which takes seconds; how much of it between two looks is chance
    assert all(0 <= done <= total for done, total in heard)


def test_the_page_shows_a_configuration_that_starts_it() -> None:
    page = (ROOT / "docs" / "integrations" / "mcp.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```json\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    entry = json.loads(block)["mcpServers"]["tailstack"]
    assert entry["command"] == "python"
    assert entry["args"][0].endswith(str(EXAMPLE.relative_to(ROOT)))
