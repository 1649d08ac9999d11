"""The pages as a site: built without a remark, fetching nothing, with every figure and result made by its script.

The page on the library says what its docstrings say.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import yaml
from service_scenes import ROOT

import tailstack
import tailstack.design
import tailstack.results
from family import run_python
from tailstack_service.cli.main import main

GALLERY = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
DESIGNS = sorted((ROOT / "examples" / "gallery").glob("*.yaml"))
LINKS = {"a"}  # what a reader may follow; everything else is fetched by the browser
SOURCES = ("src", "href", "srcset", "data", "poster", "action", "style")


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return run_python(*map(str, arguments), cwd=ROOT)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = run("docs/website.py", "-o", folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


class Sources(HTMLParser):
    """What a page makes a browser fetch."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [value for name, value in attrs if name in SOURCES and value and tag not in LINKS]


def is_outside(address: str) -> bool:
    return (
        not address.lstrip("'\"").startswith("data:") and re.search(r"(^|[\s('\",])(https?:)?//", address) is not None
    )


@pytest.mark.long
def test_the_site_is_built_without_a_remark_and_holds_every_page(site: Path) -> None:
    pages = {page.relative_to(ROOT) for page in (*ROOT.glob("docs/**/*.md"), ROOT / "CHANGELOG.md")}
    built = {page: page.with_name("index.html" if page.name == "README.md" else f"{page.stem}.html") for page in pages}
    assert [page for page in pages if not (site / built[page]).is_file()] == []
    assert "reference structure" in (site / "index.html").read_text(encoding="utf-8")


def test_no_page_of_the_site_fetches_anything_from_elsewhere(site: Path) -> None:
    pages, sheets = [*site.rglob("*.html")], [*site.rglob("*.css")]
    assert len(pages) > 30
    assert sheets
    for page in pages:
        sources = Sources(page.read_text(encoding="utf-8"))
        assert sources.fetched
        # for these two the theme's script would ask unpkg.com and api.github.com
        assert not re.search(r'class="mermaid"|data-md-component="source"', page.read_text(encoding="utf-8")), page
        assert [address for address in sources.fetched if is_outside(address)] == [], page
    for sheet in sheets:
        addresses = re.findall(r"url\(([^)]*)\)|@import\s+([^;]+)", sheet.read_text(encoding="utf-8"))
        assert [address for pair in addresses for address in pair if is_outside(address)] == [], sheet


def test_a_source_elsewhere_would_be_seen() -> None:
    sources = Sources(
        '<a href="https://x.org">x</a><img src="pictures/x.svg"><link href="//fonts.x.org"><script src="https://x.org/x.js">'
    )
    assert [address for address in sources.fetched if is_outside(address)] == ["//fonts.x.org", "https://x.org/x.js"]


class Navigation(yaml.SafeLoader):
    """MkDocs' configuration, without the Python objects that it names."""


Navigation.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def read_groups() -> dict[str, list[str]]:
    """The groups of the navigation, with their pages."""
    configuration: Any = yaml.load((ROOT / "docs" / "mkdocs.yml").read_text(encoding="utf-8"), Navigation)
    return {
        name: [page for entry in entries for page in entry.values()]
        for group in configuration["nav"]
        for name, entries in group.items()
    }


def test_the_index_of_pages_has_the_six_groups_of_the_navigation() -> None:
    groups = read_groups()
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    listed = {
        name: [os.path.normpath(f"docs/{page}") for page in re.findall(r"^- \[[^]]+\]\(([^)]+)\)$", text, re.M)]
        for name, text in re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", index, re.M | re.S)
    }
    assert len(listed) == 6
    assert {name: [page for page in pages if page != "docs/README.md"] for name, pages in groups.items()} == listed


def test_the_readme_has_few_links_and_the_index_of_pages_is_one() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)]+)\)", readme) if not link.startswith("docs/images/")]
    assert "docs/README.md" in links
    assert len(links) <= 15


def test_the_index_of_integrations_links_to_every_page_of_one() -> None:
    index = (ROOT / "docs" / "integrations.md").read_text(encoding="utf-8")
    pages = [f"docs/integrations/{page.name}" for page in sorted((ROOT / "docs" / "integrations").glob("*.md"))]
    assert [page for page in pages if f"]({page.removeprefix('docs/')})" not in index] == []
    assert sorted(set(pages) - set(read_groups()["Connect"])) == []


# --- figures and results --------------------------------------------------------------------------


@pytest.mark.long("demo", "gallery")
@pytest.mark.parametrize("name", ["overview", "demo", "gallery", "history"])
def test_the_figures_are_what_their_scripts_draw(name: str) -> None:
    done = run(f"docs/images/make_{name}.py", "--check")
    assert done.returncode == 0, done.stderr


def test_the_figure_of_the_demo_is_red_beyond_the_limit_and_calls_seats_by_their_names() -> None:
    svg = (ROOT / "docs/images/demo.svg").read_text(encoding="utf-8")
    (limit,) = re.findall(r'<path d="M([\d.]+) [^"]*" stroke="#c0392b" stroke-width="1.5"', svg)
    bars = re.findall(r'<rect x="([\d.]+)"[^>]* fill="(#\w+)" fill-opacity', svg)
    assert {colour == "#c0392b" for _, colour in bars} == {True, False}
    assert all((colour == "#c0392b") == (float(left) > float(limit) - 0.2) for left, colour in bars)
    design = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text(encoding="utf-8"))
    assert all(f">{seat['label']}<" in svg for seat in design["interfaces"].values())


def test_every_figure_of_the_readme_has_its_script() -> None:
    figures = re.findall(r"\]\((docs/images/[^)]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    drawn, pictured = ["docs/images/overview.svg", "docs/images/demo.svg"], ["start", "change", "after"]
    assert figures == [*drawn, *(f"docs/images/workbench_{state}.png" for state in pictured)]  # by test_workbench.py


def results(text: str) -> Iterator[tuple[str, str]]:
    """(design, paragraph with its result) of each part of the gallery."""
    for part in text.split("\n## ")[1:]:
        (design,) = re.findall(r"\(\.\./(examples/(?:gallery/)?\w+\.yaml)\)", part)
        assert part.count("images/gallery/") == 1
        paragraph = next(each for each in part.split("\n\n") if each.startswith("P95 "))
        yield design, " ".join(paragraph.split())


def test_the_gallery_shows_its_designs_and_five_beside_with_pictures_of_moderate_size() -> None:
    shown = [design for design, _ in results(GALLERY)]
    assert {str(file.relative_to(ROOT)) for file in DESIGNS} < set(shown)
    assert len(DESIGNS) == 14
    assert len(shown) == len(set(shown)) == 19
    for design in shown:
        picture = ROOT / "docs" / "images" / "gallery" / f"{Path(design).stem}.svg"
        assert picture.stat().st_size < 40_000


@pytest.mark.parametrize(("design", "result"), list(results(GALLERY)))
def test_a_result_of_the_gallery_is_what_score_says(
    design: str, result: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(("score", str(ROOT / design), "--json"))
    record = json.loads(capsys.readouterr().out)
    stated = re.findall(r"([\d.]+)(?: mm| deg|) of ([\d.]+)[^:]*: \*\*(\w+)\*\*", result)
    assert len(stated) == len(record["verdict"]["checks"])
    for (value, limit, status), check in zip(stated, record["verdict"]["checks"], strict=True):
        assert abs(float(value) - check["value"]) <= 5.001e-4
        assert (float(limit), status) == (check["limit"], check["status"])
    whole = [entry for entry in record["targets"][0]["contributors"] if entry["component"] == "all"]
    most = max(whole, key=lambda entry: entry["variance_share"])
    assert result.endswith(f"Largest share: {100 * most['variance_share']:.0f} %, {most['label']}.")


# --- the page on the library ----------------------------------------------------------------------


PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
ALIASES = {"DEFAULT_LIMITS", "ERRORS", "Interval", "Matrix3", "Severity", "Vector3", "headline_of", "__version__"}
PUBLIC = sorted({*tailstack.__all__, *tailstack.design.__all__, *tailstack.results.__all__} - ALIASES)


@pytest.mark.long
def test_the_page_says_what_the_docstrings_say() -> None:
    done = run("docs/python_api.py", "--check")
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_described(name: str) -> None:
    part = re.search(rf"^### {name}\n\n(.*?)(?=^##+ |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert part is not None
    assert re.search(r"^[A-Z(`k].{12,}", part[1].replace("```text", ""), re.MULTILINE), "it has no sentence"
    assert not re.search(rf"^{name}\(\w+: '", part[1], re.MULTILINE), "a dataclass describes itself by its signature"
    empty = re.findall(r"^- `(\w+)` `[^`]+`$", part[1], re.MULTILINE)
    assert empty in ([], ["file"]), "fields without a meaning"


def test_what_is_refused_stands_with_every_verb() -> None:
    for verb in ("load_design", "score", "verify", "optimise", "sweep", "Design.with_value"):
        part = re.search(rf"^###+ {re.escape(verb)}\n(.*?)(?=^##+ )", PAGE, re.MULTILINE | re.DOTALL)
        assert part is not None
        assert "Raises DesignError" in " ".join(part[1].split()), verb


@pytest.mark.long
def test_the_code_of_the_page_runs() -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    done = run("-c", f"import matplotlib; matplotlib.use('Agg')\n{code}")
    assert done.returncode == 0, done.stderr[-2000:]
    first, check, sharper, *frame = done.stdout.splitlines()
    value, verdict = first.split()
    assert (round(float(value), 3), verdict) == (1.144, "fail")  # as the README's picture has it
    low, high = map(float, check.strip("()").split(","))
    assert low < float(value) < high
    assert float(sharper) < float(value)
    swept, scored = frame[:4], frame[4:]
    assert swept[0].split() == ["p95_mm", "verdict"]
    assert scored[0].split() == ["p95_mm:tip"]
    rows = [float(row.split()[1]) for row in scored[1:]]
    assert len(rows) == 3
    assert rows == sorted(rows)  # more noise is never less risk
