"""Tools for an assistant that speaks MCP: validate, score, verify, optimise, sweep, report; over stdin and stdout."""

from __future__ import annotations

import argparse
import asyncio
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tailstack import __version__
from tailstack.errors import Problem
from tailstack.extras import require_extras
from tailstack.results.json_text import write_json

from ..clock import Clock
from ..console.answer import PASS, Answer
from ..console.arguments import read_settings
from ..problems import RequestError
from ..shipped import list_example_designs, write_example

if TYPE_CHECKING:
    from mcp.server.lowlevel import Server

    from .mcp_tools import Tools

HELP = "tools for an assistant that speaks MCP, over stdin and stdout"
JSON, YAML = "application/json", "application/yaml"
FIRST_EXAMPLE = "first_carrier"
PAUSE_SECONDS, SEND_SECONDS = 0.2, 10.0  # between two notifications of progress, and for one to leave


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--folder",
        metavar="DIR",
        help="the only place where designs are read and designs and reports are written (default: no files)",
    )


def run(arguments: argparse.Namespace) -> Answer:
    require_extras("mcp")

    from ..processes.birth import refuse_unusable_kernels
    from .mcp_tools import Tools

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
    """The server of one session."""
    from mcp.server.lowlevel import Server

    from .mcp_tools import INSTRUCTIONS

    handlers = Handlers(tools)
    example = list_example_designs()[FIRST_EXAMPLE].path.read_text(encoding="utf-8")
    return Server(
        "tailstack",
        version=__version__,
        title="tailstack",
        instructions=INSTRUCTIONS + example,
        on_list_tools=handlers.list_tools,
        on_call_tool=handlers.call_tool,
        on_list_resources=handlers.list_resources,
        on_read_resource=handlers.read_resource,
    )


class Handlers:
    """What the server does with each kind of request.

    Calls are computed one after the other, each on as many cores as there are.
    """

    def __init__(self, tools: Tools) -> None:
        self.tools = tools
        self._turn = asyncio.Lock()

    async def list_tools(self, context: Any, params: Any) -> Any:
        from mcp import types

        from ..operations.registry import OPERATIONS
        from .mcp_tools import TOOLS, input_schema

        listed = []
        for name, operation in TOOLS.items():
            schema = input_schema(name, self.tools.folder is not None)
            about = types.ToolAnnotations(
                read_only_hint="save_as" not in schema["properties"], idempotent_hint=True, open_world_hint=False
            )
            title, words = OPERATIONS[operation].summary, OPERATIONS[operation].description
            listed.append(types.Tool(name=name, title=title, description=words, input_schema=schema, annotations=about))
        return types.ListToolsResult(tools=listed)

    async def call_tool(self, context: Any, params: Any) -> Any:
        from mcp import types
        from mcp.shared.exceptions import MCPError

        from .mcp_tools import TOOLS

        if params.name not in TOOLS:
            raise MCPError(types.INVALID_PARAMS, f"there is no tool {params.name[:60]!r}; there are {', '.join(TOOLS)}")
        left = threading.Event()
        progress = _reporter(context.session.report_progress, self.tools.clock)
        async with self._turn:
            try:
                given = params.arguments or {}
                answer = await asyncio.to_thread(self.tools.call, params.name, given, progress, left.is_set)
            finally:
                left.set()  # cancelled: the thread ends at its next step
        return types.CallToolResult(
            content=[types.TextContent(type="text", text=answer.text)],
            structured_content=answer.content,
            is_error=answer.refused,
        )

    async def list_resources(self, context: Any, params: Any) -> Any:
        from mcp import types

        from ..schemas import TITLES

        listed = [
            types.Resource(uri=f"tailstack://schemas/{name}", name=name, description=title, mime_type=JSON)
            for name, title in TITLES.items()
        ]
        listed += [
            types.Resource(
                uri=f"tailstack://examples/{name}", name=example.title, description=example.words, mime_type=YAML
            )
            for name, example in list_example_designs().items()
        ]
        return types.ListResourcesResult(resources=listed)

    async def read_resource(self, context: Any, params: Any) -> Any:
        from mcp import types
        from mcp.shared.exceptions import MCPError

        kind, _, name = str(params.uri).removeprefix("tailstack://").partition("/")
        text, media = _resource(kind, name)
        if text is None:
            raise MCPError(types.INVALID_PARAMS, f"there is no resource {str(params.uri)[:100]!r}")
        content = types.TextResourceContents(uri=str(params.uri), text=text, mime_type=media)
        return types.ReadResourceResult(contents=[content])


def _reporter(
    send: Callable[[float, float], Coroutine[Any, Any, None]], clock: Clock
) -> Callable[[float, float], None]:
    """What a computing thread calls: the protocol wants progress to grow, which the time left need not do."""
    loop, reported, last = asyncio.get_running_loop(), 0.0, 0.0

    def report(done: float, total: float) -> None:
        nonlocal reported, last
        share, now = min(done / total, 1.0) if total > 0 else 0.0, clock.monotonic()
        if share > reported and now - last >= PAUSE_SECONDS:
            reported, last = share, now
            asyncio.run_coroutine_threadsafe(send(share, 1.0), loop).result(SEND_SECONDS)

    return report


def _resource(kind: str, name: str) -> tuple[str | None, str]:
    """Text and media type of a resource; None where there is none."""
    from ..schemas import TITLES, json_schema

    if kind == "schemas" and name in TITLES:
        return write_json(json_schema(name)), JSON
    if kind == "examples" and name in list_example_designs():
        return write_example(name), YAML
    return None, ""
