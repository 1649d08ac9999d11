"""The design in the examples of the OpenAPI document; it also warms the service up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

# Eight corners of a 90 mm box, each moved a little so that no two images fall together in either view
EXAMPLE_DESIGN: dict[str, Any] = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
