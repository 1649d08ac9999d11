"""The pages name what there is: every verb, path, problem and setting, with its default; files, and walks."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest
import served
from openapi_scenes import DOCUMENT
from service_scenes import ROOT

from family import run_process, run_python
from tailstack.effects import EFFECTS
from tailstack.laws import LAWS
from tailstack_service.cli.main import verbs
from tailstack_service.environment import OTHERS
from tailstack_service.problems import CATALOGUE
from tailstack_service.settings import schemas

CLI = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
HTTP = (ROOT / "docs" / "http.md").read_text(encoding="utf-8")
PAGES = sorted(
    page.relative_to(ROOT)
    for place in (".", "docs", "docs/*", "openapi", "docker", "examples/*", "tests/data/*", "benchmarks")
    for page in ROOT.glob(f"{place}/*.md")
    if "gate" not in page.relative_to(ROOT).parts  # what the gate prints, and no page of ours
)
TEXTS = {page: (ROOT / page).read_text(encoding="utf-8") for page in PAGES}
SETTINGS = TEXTS[Path("docs/settings.md")]


def test_every_verb_path_and_law_is_described() -> None:
    design = TEXTS[Path("docs/design.md")]
    assert [verb for verb in verbs() if verb not in CLI] == []
    assert [path for path in DOCUMENT["paths"] if f"{path}`" not in HTTP] == []
    assert [law for law in LAWS if f"\n| `{law}` | " not in design] == []


def test_every_problem_is_listed_with_its_status() -> None:
    for slug, entry in CATALOGUE.items():
        row = next(line for line in HTTP.splitlines() if re.match(rf"\| \d.*`{slug}`", line))
        assert str(entry.status) in row.split("|")[1], slug


def test_the_rows_of_a_table_have_the_cells_of_its_header() -> None:
    """A site drops what a row has too many, without a word."""
    wrong = []
    for page, text in TEXTS.items():
        width = 0
        for number, line in enumerate(text.splitlines(), 1):
            cells = len(re.findall(r"(?<!\\)\|", re.sub(r"`[^`]*`", "", line))) - 1 if line.startswith("|") else 0
            if cells and width and cells != width:
                wrong.append(f"{page}:{number}: {cells} cells below a header of {width}")
            width = width or cells if cells else 0
    assert wrong == []


@pytest.mark.long
def test_the_minute_with_curl_runs_as_it_stands(tmp_path: Path) -> None:
    """Pasted into a shell, but for the line that starts the service and the address of the one that runs here."""
    (block,) = re.findall(r"## In one minute\n\n```bash\n(.*?)```", HTTP, re.DOTALL)
    start, address, *rest = block.splitlines()
    assert start.startswith("./run serve &")
    assert address.startswith("api=")
    with served.served(tmp_path) as service:
        script = "\n".join(["set -eu", f"api={service.url}", *rest]).replace("@examples/", f"@{ROOT}/examples/")
        done = run_process("bash", "-c", script, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "accepted.json").read_text())["kind"] == "optimisation"
    assert "event: state" in done.stdout
    assert json.loads((tmp_path / "optimum.json").read_text())["schema"] == "tailstack/optimisation/1"
    assert (tmp_path / "report.html").read_text().lower().startswith("<!doctype html>")


def test_every_setting_is_listed_with_its_default_and_its_meaning() -> None:
    for variable, schema in schemas().items():
        line = next(line for line in SETTINGS.splitlines() if line.startswith(f"| `{variable}` |"))
        default, (_, cell, meaning) = schema["default"], map(str.strip, line.strip("| ").split(" | "))
        if isinstance(default, str):
            assert cell == (f"`{default}`" if default else "(empty)"), variable
        else:
            assert cell == "the cores" if variable == "TAILSTACK_WORKER_PROCESSES" else float(cell) == default
        words = [word.strip("`;,.:()") for word in schema["description"].split()]
        assert all(word in meaning for word in words), meaning
        if schema["type"] != "string":
            low, high = (float(number) for number in re.findall(r"[\d.e+]+", meaning.rpartition("(")[2]))
            assert (low, high) == (schema["minimum"], schema["maximum"]), variable
        assert all(f"`{choice}`" in meaning or choice in words for choice in schema.get("enum", ())), meaning


def test_settings_are_listed_in_their_order_and_no_others() -> None:
    listed = re.findall(r"^\| `(TAILSTACK_\w+)` \|", SETTINGS, re.MULTILINE)
    assert listed[: len(schemas())] == list(schemas())
    assert sorted(listed[len(schemas()) :]) == sorted(OTHERS)


def prose_of(text: str) -> list[tuple[int, str]]:
    """The numbered lines of a page that are neither a table nor inside a block of code."""
    lines, fence = [], False
    for number, line in enumerate(text.splitlines(), 1):
        fence ^= line.lstrip().startswith("```")
        if not fence and not line.lstrip().startswith("|"):
            lines.append((number, line))
    return lines


def test_prose_is_wrapped_at_120_characters() -> None:
    long = [f"{page}:{number}" for page, text in TEXTS.items() for number, line in prose_of(text) if len(line) > 120]
    assert long == []


def test_a_decision_has_at_most_fifteen_lines_of_prose_and_stands_in_the_index() -> None:
    pages = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
    index = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    lines = {page.name: [line for _, line in prose_of(page.read_text(encoding="utf-8")) if line] for page in pages}
    assert [name for name, of_page in lines.items() if len(of_page) > 16] == []  # with the title
    assert re.findall(r"\]\((\d[^)]+)\)", index) == [page.name for page in pages]


def test_what_the_method_leaves_to_a_declaration_is_what_a_document_can_declare() -> None:
    """Section 6: all fields of the effects, and beside them how large balls are and how often they are missed."""
    section = (ROOT / "docs" / "method.md").read_text(encoding="utf-8").partition("\n## 6. Not modelled\n")[2]
    fields = {name for kind in EFFECTS for name in kind.section.model_fields}
    assert set(re.findall(r"`(\w+)`", section)) == fields - {"image_point"} | {"diameter_mm", "loss_probability"}


NOW = {page: text for page, text in TEXTS.items() if page.name != "CHANGELOG.md"}  # which names what is gone, too
A_USERS_OWN = ("designs/", "out/demo/")
ROOMS = ("", "solver/tailstack", "service/tailstack_service", "solver", "service", "tests", "tests/service")


def exists(name: str, page: Path) -> bool:
    """Whether there is such a file or folder, from the root, the page or one of the packages."""
    return any((ROOT / room / name).exists() for room in (*ROOMS, page.parent))


def test_every_file_and_module_that_a_page_names_is_there() -> None:
    for page, text in NOW.items():
        spans = [span for _, line in prose_of(text) for span in re.findall(r"`([^`]+)`", line)]
        paths = [span for span in spans if re.fullmatch(r"[\w-][\w./-]*(\.py|/)", span)]
        modules = [span for span in spans if re.fullmatch(r"tailstack(_service)?(\.[a-z_]+)+", span)]
        assert [path for path in paths if path not in A_USERS_OWN and not exists(path, page)] == [], page
        assert [name for name in modules if find_spec_of(name) is None] == [], page


NAMED = re.compile(r"`([\w/]+\.py)`: ((?:`\w+`(?:, | and )?)+)")  # what is in a file: `file.py`: `name`, `other`


def test_what_a_page_says_is_in_a_file_is_there() -> None:
    missing = []
    for page, name, listed in ((page, *each) for page, text in NOW.items() for each in NAMED.findall(text)):
        places = [ROOT / room / name for room in (*ROOMS, page.parent)]
        text = "\n".join(place.read_text(encoding="utf-8") for place in places if place.is_file())
        for word in re.findall(r"\w+", listed):
            if not re.search(rf"^\s*(def |class )?{word}\b", text, re.MULTILINE):
                missing.append(f"{page}: {name}: {word}")
    assert missing == []


def find_spec_of(name: str) -> object:
    """The module of that name, or what is called so in the module before the last dot."""
    try:
        if (found := importlib.util.find_spec(name)) is not None:
            return found
    except ModuleNotFoundError:
        pass
    module, _, word = name.rpartition(".")
    return getattr(importlib.import_module(module), word, None)


@pytest.mark.long("command")
@pytest.mark.parametrize("name", ["score", "command"])
def test_architecture_draws_the_walk_that_the_code_takes(name: str) -> None:
    done = run_python(ROOT / "docs" / "walks.py", "--check", name)
    assert done.returncode == 0, done.stderr


def words_of(text: str) -> str:
    """The text in small letters with single spaces; names with underscores and hyphens as words."""
    return re.sub(r"[\s_-]+", " ", text.lower())


def test_every_term_of_the_glossary_is_used_and_stands_once() -> None:
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    terms = re.findall(r"^- \*\*(.+?)\*\*: ", glossary, re.MULTILINE)
    assert len(terms) == len(re.findall(r"^- ", glossary, re.MULTILINE)) == len(set(terms)) >= 60
    pages = [ROOT / page for page in PAGES if page.name != "glossary.md"]
    sources = [*(ROOT / "solver").rglob("*.py"), *(ROOT / "service").rglob("*.py")]
    everything = words_of(" ".join(file.read_text(encoding="utf-8") for file in (*pages, *sources)))
    assert [term for term in terms if not re.search(rf"\b{re.escape(words_of(term))}", everything)] == []
