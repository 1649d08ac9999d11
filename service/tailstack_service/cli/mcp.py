"""Tools for an assistant that speaks MCP: validate, score, verify, optimise, sweep, report; over stdin and stdout."""

from __future__ import annotations

import argparse
import asyncio
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tailstack.errors import Problem
from tailstack.extras import require_extras

from ..console.answer import PASS, Answer
from ..console.arguments import read_settings
from ..problems import RequestError

if TYPE_CHECKING:
    from mcp.server.lowlevel import Server

    from ..mcp_tools import Tools

HELP = "tools for an assistant that speaks MCP, over stdin and stdout"
JSON, YAML = "application/json", "application/yaml"
FIRST_EXAMPLE = "first_carrier"
PAUSE_SECONDS = 0.2  # between two notifications of progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--folder", metavar="DIR",
        help="the only place where designs are read and designs and reports are written (default: no files)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> Answer:
    require_extras("mcp")

    from ..mcp_tools import Tools
    from ..processes.interpreter import refuse_unusable_kernels

    folder = None if arguments.folder is None else Path(arguments.folder)
    if folder is not None and not folder.is_dir():
        raise RequestError(Problem("", "no-folder", f"{arguments.folder} is not a directory", "make it first"))
    settings = read_settings(arguments)
    refuse_unusable_kernels()
    asyncio.run(_serve(make_server(Tools(settings, folder))))
    return Answer("", PASS)


async def _serve(server: Server[Any]) -> None:
    from mcp.server.stdio import stdio_server

    async with stdio_server() as (read, write):
        await server.run(read, write, server.create_initialization_options())


def make_server(tools: Tools) -> Server[Any]:
    """The server of one session.  Calls are computed one after the other, each on as many cores as there are."""
    from mcp import types
    from mcp.server.lowlevel import Server
    from mcp.shared.exceptions import MCPError

    from tailstack import __version__

    from ..examples import list_example_designs
    from ..mcp_tools import INSTRUCTIONS, TOOLS, input_schema
    from ..operations.registry import OPERATIONS
    from ..schemas import TITLES

    turn = asyncio.Lock()
    examples = list_example_designs()
    instructions = INSTRUCTIONS + examples[FIRST_EXAMPLE].path.read_text(encoding="utf-8")

    async def list_tools(context: Any, params: Any) -> Any:
        with_folder = tools.folder is not None
        return types.ListToolsResult(
            tools=[
                types.Tool(
                    name=name,
                    title=OPERATIONS[operation].summary,
                    description=OPERATIONS[operation].description,
                    input_schema=input_schema(name, with_folder),
                    annotations=types.ToolAnnotations(
                        read_only_hint="save_as" not in input_schema(name, with_folder)["properties"],
                        idempotent_hint=True,
                        open_world_hint=False,
                    ),
                )
                for name, operation in TOOLS.items()
            ]
        )

    async def call_tool(context: Any, params: Any) -> Any:
        if params.name not in TOOLS:
            raise MCPError(types.INVALID_PARAMS, f"there is no tool {params.name[:60]!r}; there are {', '.join(TOOLS)}")
        reported, last, left, loop = 0.0, 0.0, False, asyncio.get_running_loop()

        def progress(done: float, total: float) -> None:
            """The protocol wants it to grow, which the time left of a search need not do."""
            nonlocal reported, last
            share, now = min(done / total, 1.0) if total > 0 else 0.0, time.monotonic()
            if share > reported and now - last >= PAUSE_SECONDS:
                reported, last = share, now
                asyncio.run_coroutine_threadsafe(context.session.report_progress(share, 1.0), loop).result()

        async with turn:
            try:
                given = params.arguments or {}
                answer = await asyncio.to_thread(tools.call, params.name, given, progress, lambda: left)
            finally:
                left = True
        return types.CallToolResult(
            content=[types.TextContent(type="text", text=answer.text)],
            structured_content=answer.content,
            is_error=answer.refused,
        )

    async def list_resources(context: Any, params: Any) -> Any:
        schemas = [
            types.Resource(uri=f"tailstack://schemas/{name}", name=name, description=title, mime_type=JSON)
            for name, title in TITLES.items()
        ]
        designs = [
            types.Resource(
                uri=f"tailstack://examples/{one.name}", name=one.title, description=one.words, mime_type=YAML
            )
            for one in examples.values()
        ]
        return types.ListResourcesResult(resources=[*schemas, *designs])

    async def read_resource(context: Any, params: Any) -> Any:
        kind, _, name = str(params.uri).removeprefix("tailstack://").partition("/")
        text, media = _resource(kind, name)
        if text is None:
            raise MCPError(types.INVALID_PARAMS, f"there is no resource {str(params.uri)[:100]!r}")
        content = types.TextResourceContents(uri=str(params.uri), text=text, mime_type=media)
        return types.ReadResourceResult(contents=[content])

    return Server(
        "tailstack",
        version=__version__,
        title="tailstack",
        instructions=instructions,
        on_list_tools=list_tools,
        on_call_tool=call_tool,
        on_list_resources=list_resources,
        on_read_resource=read_resource,
    )


def _resource(kind: str, name: str) -> tuple[str | None, str]:
    """Text and media type of a resource; None where there is none."""
    from tailstack.design.write import data_to_yaml
    from tailstack.json_text import write_json

    from ..examples import list_example_designs, read_example
    from ..schemas import TITLES, json_schema

    if kind == "schemas" and name in TITLES:
        return write_json(json_schema(name)), JSON
    if kind == "examples" and name in list_example_designs():
        return data_to_yaml(read_example(name)), YAML
    return None, ""
