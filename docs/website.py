"""The pages as a site: ``./run docs`` builds it into out/docs, without a network.

The sources are the repository's Markdown files where they lie.  They are copied, with every file that they link to,
into a folder laid out like the repository, so that a relative link leads to the same place on both.  MkDocs then
builds the folder as docs/mkdocs.yml says, and every remark of it (a link to nowhere, a page outside the navigation)
is an error.
"""

from __future__ import annotations

import argparse
import logging
import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.exceptions import Abort

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("*.md", "docs/**/*.md", "openapi/*.md", "docker/*.md", "examples/*/*.md", "benchmarks/*.md")
LINK = re.compile(r"\]\(([^)#\s]+)")
STYLES = ROOT / "docs" / "site.css"


def list_pages() -> list[Path]:
    """The Markdown files that make the site, relative to the root."""
    return sorted({page.relative_to(ROOT) for pattern in PAGES for page in ROOT.glob(pattern)})


def list_files(page: Path) -> list[Path]:
    """Files other than pages that a page links to or shows, relative to the root."""
    targets = LINK.findall((ROOT / page).read_text(encoding="utf-8"))
    files = [(ROOT / page.parent / target).resolve() for target in targets if "://" not in target]
    return [file.relative_to(ROOT) for file in files if file.is_file() and file.suffix != ".md"]


def stage(folder: Path) -> None:
    """Copy the pages, and the files that they link to, into a folder laid out like the repository."""
    pages = list_pages()
    for name in {*pages, *(file for page in pages for file in list_files(page)), STYLES.relative_to(ROOT)}:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, folder / name)


def build_site(target: Path) -> None:
    """Build the site into a folder, which is emptied before.  Raises Abort at the first kind of remark."""
    with TemporaryDirectory() as staged:
        stage(Path(staged))
        build(load_config(str(ROOT / "docs" / "mkdocs.yml"), docs_dir=staged, site_dir=str(target), strict=True))


def main() -> int:
    parser = argparse.ArgumentParser(description="Build the pages as a site, without a network.")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "docs", metavar="DIR")
    target = parser.parse_args().output.resolve()
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s")
    try:
        build_site(target)
    except Abort as refusal:
        print(f"website: {refusal}", file=sys.stderr)
        return 1
    print(f"website: {target / 'index.html'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
