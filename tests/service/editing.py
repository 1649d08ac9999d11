"""A document as an editor shows it: yaml-language-server over stdio, as VS Code and Neovim speak with it."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import node
import pytest
from openapi_scenes import pinned_tools
from service_scenes import ROOT

from family import die_with_parent

HOME = ROOT / "tests" / "service" / "editor"
SERVER = "yaml-language-server"
SETTINGS = {
    "yaml": {"schemaStore": {"enable": False}, "validate": True, "hover": True, "completion": True},
    "http": {},
    "[yaml]": {},
    "editor": {"tabSize": 2},
    "files": {},
}


@pytest.fixture(scope="session")
def editor_tools() -> None:
    """The pinned language server is installed, or the test is skipped and says so."""
    pinned_tools(HOME)


class Editor:
    """One session with the server; lines and columns count from 0, as the protocol does."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [node.tools(HOME) / SERVER, "--stdio"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=folder,
            preexec_fn=die_with_parent,
        )  # fmt: skip
        self.folder, self.count = folder, 0
        self.diagnostics: dict[str, list[dict[str, Any]]] = {}

    def __enter__(self) -> Editor:
        abilities = {
            "textDocument": {
                "completion": {"completionItem": {"snippetSupport": True, "documentationFormat": ["markdown"]}},
                "hover": {"contentFormat": ["markdown"]},
                "publishDiagnostics": {},
            },
            "workspace": {"configuration": True, "didChangeConfiguration": {}},
        }
        folder = self.folder.as_uri()
        self.ask("initialize", {"processId": None, "rootUri": folder, "capabilities": abilities})
        self.tell("initialized", {})
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(30)
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            stream.close()

    def ask(self, method: str, parameters: Any) -> Any:
        """The answer to a request; the server's own requests are answered on the way."""
        self.count += 1
        self._send({"id": self.count, "method": method, "params": parameters})
        return next(message["result"] for message in self._messages() if message.get("id") == self.count)

    def tell(self, method: str, parameters: Any) -> None:
        self._send({"method": method, "params": parameters})

    def open(self, path: Path) -> list[dict[str, Any]]:
        """What the editor underlines in a file, which is opened once."""
        uri = path.as_uri()
        assert uri not in self.diagnostics
        item = {"uri": uri, "languageId": "yaml", "version": 1, "text": path.read_text(encoding="utf-8")}
        self.tell("textDocument/didOpen", {"textDocument": item})
        while uri not in self.diagnostics:
            next(self._messages())
        return self.diagnostics[uri]

    def complete(self, path: Path, line: int, column: int) -> dict[str, dict[str, Any]]:
        """What can stand at a place, by its label."""
        answer = self.ask("textDocument/completion", _place(path, line, column))
        items = answer["items"] if isinstance(answer, dict) else answer or []
        return {item["label"]: item for item in items}

    def hover(self, path: Path, line: int, column: int) -> str:
        """What is shown when the pointer rests at a place."""
        answer = self.ask("textDocument/hover", _place(path, line, column))
        return "" if answer is None else str(answer["contents"]["value"])

    def _messages(self) -> Iterator[dict[str, Any]]:
        """What the server says, one message after the other; diagnostics are kept, requests answered."""
        stream = self.process.stdout
        assert stream is not None
        while True:
            length = 0
            while line := stream.readline().strip():
                name, _, value = line.partition(b":")
                length = int(value) if name.lower() == b"content-length" else length
            assert length, "the language server has ended"
            message = json.loads(stream.read(length))
            if message.get("method") == "workspace/configuration":
                asked = [SETTINGS.get(item["section"]) for item in message["params"]["items"]]
                self._send({"id": message["id"], "result": asked})
            elif "id" in message and "method" in message:
                self._send({"id": message["id"], "result": None})
            elif message.get("method") == "textDocument/publishDiagnostics":
                self.diagnostics[message["params"]["uri"]] = message["params"]["diagnostics"]
            yield message

    def _send(self, message: dict[str, Any]) -> None:
        content = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self.process.stdin is not None
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n" % len(content) + content)
        self.process.stdin.flush()


def _place(path: Path, line: int, column: int) -> dict[str, Any]:
    return {"textDocument": {"uri": path.as_uri()}, "position": {"line": line, "character": column}}


@contextmanager
def editor(folder: Path) -> Iterator[Editor]:
    """A session whose files lie in a folder."""
    with Editor(folder) as session:
        yield session
