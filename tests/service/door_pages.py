"""Pages of docs/integrations: their Python blocks are run one after the other, and print what stands below them."""

from __future__ import annotations

import io
import re
from contextlib import redirect_stdout
from typing import Any

from service_scenes import ROOT

BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```$)?", re.MULTILINE | re.DOTALL)


def run_page(name: str, **replaced: str) -> tuple[list[str], list[str]]:
    """What the blocks of a page print, and what the page says that they print; texts of the page ``replaced``."""
    page = (ROOT / "docs" / "integrations" / f"{name}.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {"__name__": name}
    printed, quoted = [], []
    for code, output in BLOCK.findall(page):
        for old, new in replaced.items():
            code = code.replace(old, new)
        with redirect_stdout(io.StringIO()) as found:
            exec(compile(code, f"{name}.md", "exec"), names)
        printed.append(found.getvalue())
        quoted.append(output)
    assert printed
    return printed, quoted
