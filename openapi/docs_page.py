"""What the page at /docs is made of: Swagger UI, of the version that ``docs_page/package-lock.json`` pins.

``python openapi/docs_page.py`` copies its files, as they are published, into the package.  For a newer version change
``docs_page/package.json``, run ``npm install --package-lock-only --ignore-scripts`` there, and then this.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import node

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "service" / "tailstack_service" / "docs_page"
FILES = ("swagger-ui-bundle.js", "swagger-ui-bundle.js.LICENSE.txt", "swagger-ui.css", "LICENSE", "NOTICE")


def published() -> Path:
    """The pinned package, installed.  Raises NodeMissing."""
    return node.tools(HERE / "docs_page").parent / "swagger-ui-dist"


def main() -> int:
    package = published()
    for name in FILES:
        shutil.copyfile(package / name, PAGE / name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
