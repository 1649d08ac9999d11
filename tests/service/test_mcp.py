"""`tailstack mcp`, as the SDK's own client meets it over stdio: a whole session, refusals, bounds, one folder."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import anyio
import pytest
import yaml
from mcp import Client, StdioServerParameters
from mcp.shared.exceptions import MCPError
from service_scenes import EXAMPLES, ROOT, coplanar_design, small_design

from family import COMMAND, SOURCES
from tailstack import load_design, score
from tailstack_service.cli.main import build_parser
from tailstack_service.integrations.mcp_tools import TOOLS, Tools, input_schema
from tailstack_service.schemas import json_schema
from tailstack_service.settings import load_settings
from waiting import LIMIT_SECONDS

CARRIER = (EXAMPLES / "first_carrier.yaml").read_text(encoding="utf-8")
Session = Callable[[Client], Awaitable[Any]]


def in_session(session: Session, *arguments: str, **settings: str) -> Any:
    """What a session with a server of its own comes to."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("TAILSTACK_")}
    variables |= {"PYTHONPATH": SOURCES, **settings}
    server = StdioServerParameters(command=sys.executable, args=[*COMMAND, "mcp", *arguments], env=variables)

    async def meet() -> Any:
        async with Client(server, read_timeout_seconds=LIMIT_SECONDS) as client:
            return await session(client)

    return anyio.run(meet)


def text_of(result: Any) -> str:
    """What the assistant is shown of an answer."""
    text: str = result.content[0].text
    return text


def record_of(result: Any) -> dict[str, Any]:
    assert not result.is_error, text_of(result)
    record: dict[str, Any] = result.structured_content
    return record


@pytest.mark.long
def test_no_argument_of_a_tool_has_a_list_of_types() -> None:
    """A large client refuses `type: [object, string]`, and with it every tool that is offered."""

    def list_types(schema: Any) -> list[Any]:
        if isinstance(schema, list):
            return [found for each in schema for found in list_types(each)]
        if not isinstance(schema, dict):
            return []
        own = [schema["type"]] if "type" in schema else []
        return own + [found for each in schema.values() for found in list_types(each)]

    for tool in TOOLS:
        for with_folder in (False, True):
            schema = input_schema(tool, with_folder)
            assert all(isinstance(each, str | dict) for each in list_types(schema))
            assert {"object", "string"} == {each["type"] for each in schema["properties"]["design"]["anyOf"]}


def test_an_assistant_validates_scores_optimises_and_reports_a_design(tmp_path: Path) -> None:
    """independent: the library's score, in this process, and the files that were written."""
    heard: list[float] = []

    async def hear(progress: float, total: float | None, message: str | None) -> None:
        heard.append(progress)

    async def session(client: Client) -> None:
        listed = {tool.name: tool for tool in (await client.list_tools()).tools}
        assert list(listed) == ["validate", "score", "verify", "optimise", "sweep", "report"]
        assert listed["verify"].input_schema["properties"]["trials"]["anyOf"][0] == {"minimum": 1, "type": "integer"}

        checked = record_of(await client.call_tool("validate", {"design": CARRIER}))
        name = checked["design_sha256"]
        assert name == load_design(CARRIER).sha256
        scored = await client.call_tool("score", {"design_sha256": name})
        assert record_of(scored)["targets"][0]["p95_mm"] == score(load_design(CARRIER)).targets[0].p95_mm
        assert "1.21 mm" in text_of(scored)
        swept = await client.call_tool(
            "sweep",
            {"design_sha256": name, "axes": [{"pointer": "/views/0/fiducial_noise_px", "values": [0.1, 0.2]}]},
        )
        assert [point["status"] for point in record_of(swept)["points"]] == ["ok", "ok"]

        found = await client.call_tool(
            "optimise", {"design_sha256": name, "starts": 2, "save_as": "better.yaml"}, progress_callback=hear
        )
        better = record_of(found)["provenance"]["design_sha256"]
        assert load_design(tmp_path / "better.yaml").sha256 == better != name
        again = record_of(await client.call_tool("verify", {"design_sha256": better, "precision": 0.02}))
        assert again["verdict"]["status"] == "pass"
        same = record_of(await client.call_tool("validate", {"file": "better.yaml"}))
        assert same["design_sha256"] == better
        reported = await client.call_tool(
            "report", {"design_sha256": better, "trials": 20_000, "save_as": "better.html"}
        )
        assert "better.html" in text_of(reported)

    in_session(session, "--folder", str(tmp_path))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["better.html", "better.yaml"]
    assert (tmp_path / "better.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert heard == sorted(set(heard)) != []
    assert all(0 < done <= 1 for done in heard)


@pytest.mark.long
def test_refusals_tell_the_field_and_the_cure_and_the_session_goes_on(tmp_path: Path) -> None:
    wrong = small_design()
    wrong["views"][0]["fiducial_noise_px"] = "0,3"
    (tmp_path / "inside").mkdir()
    (tmp_path / "secret.yaml").write_text(CARRIER, encoding="utf-8")
    (tmp_path / "inside" / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    refused: list[tuple[str, Any, str, str]] = [
        ("score", {"design": wrong}, "/design/views/0/fiducial_noise_px", "invalid-design"),
        ("score", {"design": coplanar_design()}, "", "ill-posed-geometry"),
        ("score", {"design": "name: [1"}, "", "invalid-design"),
        ("score", {"design": {"name": "x"}}, "/design", "invalid-design"),
        ("score", {"designs": {}}, "/designs", "invalid-request"),
        ("score", {}, "", "invalid-request"),
        ("score", {"design_sha256": "0" * 64}, "/design_sha256", "invalid-request"),
        ("verify", {"design": small_design(), "trials": 10**9}, "/trials", "limit-exceeded"),
        ("verify", {"design": small_design(), "trials": "many"}, "/trials", "invalid-request"),
        ("sweep", {"design": small_design(), "axes": [{"pointer": "/x", "values": [1]}]}, "/axes/0/pointer", ""),
        ("score", {"file": "../secret.yaml"}, "/file", "invalid-request"),
        ("score", {"file": str(tmp_path / "secret.yaml")}, "/file", "invalid-request"),
        ("score", {"file": "link.yaml"}, "/file", "invalid-request"),
        ("score", {"file": "nothing.yaml"}, "", "invalid-design"),
        ("report", {"design": small_design(), "save_as": "../r.html"}, "/save_as", "invalid-request"),
        ("report", {"design": small_design(), "save_as": "r.exe"}, "/save_as", "invalid-request"),
        ("optimise", {"design": small_design(), "save_as": 5}, "/save_as", "invalid-request"),
    ]

    async def session(client: Client) -> None:
        for tool, arguments, pointer, slug in refused:
            result = await client.call_tool(tool, arguments)
            assert result.is_error, (tool, arguments)
            problem = result.structured_content
            assert problem["errors"][0]["pointer"].startswith(pointer), problem
            assert problem["type"].endswith(slug), problem
            assert problem["errors"][0]["detail"] in text_of(result)
        with pytest.raises(MCPError, match="there is no tool"):
            await client.call_tool("delete", {})
        record_of(await client.call_tool("score", {"design": small_design(), "patch": {"name": "still here"}}))

    in_session(session, "--folder", str(tmp_path / "inside"))
    assert [path.name for path in (tmp_path / "inside").iterdir()] == ["link.yaml"]


def test_without_a_folder_no_file_is_touched_and_a_call_has_an_end() -> None:
    async def session(client: Client) -> None:
        tools = {tool.name: tool.input_schema["properties"] for tool in (await client.list_tools()).tools}
        assert all(not {"file", "save_as"} & set(properties) for properties in tools.values())
        assert len(json.dumps(tools)) < 20_000  # what an assistant reads before it does anything
        result = await client.call_tool("score", {"file": "x.yaml"})
        assert result.structured_content["errors"][0]["pointer"] == "/file"
        minutes = {"design": small_design(), "precision": 1e-4, "max_trials": 500_000_000}
        slow = await client.call_tool("verify", minutes)
        assert slow.is_error
        assert "TAILSTACK_MAX_JOB_SECONDS" in text_of(slow)

    in_session(session, TAILSTACK_MAX_JOB_SECONDS="1", TAILSTACK_MAX_TRIALS="1000000000")


@pytest.mark.long
def test_a_call_that_is_given_up_makes_way_for_the_next() -> None:
    """The check of 50 targets would take hours, and is given up at its first word.

    Neither the next call nor the end of the session waits for it.
    """

    large = small_design(targets=[{"name": f"t{k}", "position_mm": [k / 10, 0, 70]} for k in range(50)])

    async def session(client: Client) -> None:
        with anyio.CancelScope() as given_up:

            async def give_up(progress: float, total: float | None, message: str | None) -> None:
                given_up.cancel()

            await client.call_tool("verify", {"design": large, "precision": 1e-4}, progress_callback=give_up)
        assert given_up.cancelled_caught
        record_of(await client.call_tool("score", {"design": small_design()}))

    in_session(session, TAILSTACK_MAX_TRIALS="1000000000")


RUBBISH: list[dict[str, Any]] = [
    {"file": "\ud800"}, {"second_order": "\ud800"}, {"file": "a" * 5000}, {"file": "."}
]  # fmt: skip


@pytest.mark.parametrize("arguments", RUBBISH)
def test_half_a_character_and_other_rubbish_are_refused(arguments: dict[str, Any], tmp_path: Path) -> None:
    answer = Tools(load_settings(), tmp_path).call("score", {"design": small_design(), **arguments}, lambda *_: None)
    assert answer.refused
    assert json.dumps(answer.content)
    assert answer.text.encode()


def test_the_page_shows_a_configuration_that_starts_it() -> None:
    page = (ROOT / "docs" / "integrations" / "mcp.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```json\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    entry = json.loads(block)["mcpServers"]["tailstack"]
    assert entry["command"] == "tailstack"
    arguments = build_parser().parse_args(entry["args"])
    assert (arguments.verb, arguments.folder) == ("mcp", "/home/me/designs")


def test_schemas_and_examples_are_resources() -> None:
    async def session(client: Client) -> None:
        addresses = [str(one.uri) for one in (await client.list_resources()).resources]
        assert "tailstack://schemas/design" in addresses
        schemas: Any = (await client.read_resource("tailstack://schemas/design")).contents
        assert json.loads(schemas[0].text) == json_schema("design")
        examples: Any = (await client.read_resource("tailstack://examples/demo")).contents
        assert load_design(yaml.safe_load(examples[0].text)).sha256 == load_design(EXAMPLES / "demo.yaml").sha256
        with pytest.raises(MCPError, match="there is no resource"):
            await client.read_resource("tailstack://examples/../settings")
        assert "schema: tailstack/design/1" in client.instructions

    in_session(session)
