"""What is written down in tables, each a file beside this one: words and units, ranges, doubts, published C-arms."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any


@cache
def read_table(name: str) -> Any:
    """The content of ``NAME.json``, the same object each time: nobody changes it."""
    return json.loads(Path(__file__).with_name(f"{name}.json").read_text(encoding="utf-8"))
