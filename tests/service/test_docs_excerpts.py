"""What pages quote is what the commands print, to the last digit; and the comparison would see a difference."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import ModuleType

import pytest
from service_scenes import ROOT

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
FOLLOWED = [ROOT / "README.md", ROOT / "docs" / "troubleshooting.md", *TUTORIALS]


@pytest.fixture(scope="module")
def excerpts() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "docs")
        return importlib.import_module("excerpts")


@pytest.mark.long
@pytest.mark.parametrize("page", FOLLOWED, ids=lambda page: page.stem)
def test_a_page_quotes_what_its_commands_print(excerpts: ModuleType, page: Path) -> None:
    assert excerpts.check(page, write=False) == []


def test_no_other_page_is_followed(excerpts: ModuleType) -> None:
    assert excerpts.list_pages() == sorted(FOLLOWED)
    assert len(TUTORIALS) == 4


def test_the_carrier_that_is_typed_is_the_one_that_the_other_tutorials_copy(excerpts: ModuleType) -> None:
    blocks = excerpts.read_blocks((ROOT / "docs" / "tutorials" / "first_carrier.md").read_text(encoding="utf-8"))
    (typed,) = (block.text for block in blocks if block.title == "carrier.yaml")
    copied = (ROOT / "examples" / "first_carrier.yaml").read_text(encoding="utf-8")
    assert copied[copied.index("schema: tailstack/design/1") :] == typed


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_number_with_a_unit_in_the_text_stands_in_a_block_of_the_page(page: Path) -> None:
    """Millimetres, per cent and pixels of the sentences are those of files and outputs, digit for digit."""
    text = page.read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"^```.*?^```$", text, re.MULTILINE | re.DOTALL))
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    prose = re.sub(r"^#.*$|\[[^\]]*\]\([^)]*\)", "", prose, flags=re.MULTILINE)  # names of pages
    numbers = re.findall(r"(?<![\d.])(\d+(?:\.\d+)?)\s(?:mm|%|px)", prose)
    standing = {float(number) for number in re.findall(r"\d+(?:\.\d+)?", blocks)}
    shares = {round(100 * number, 9) for number in standing}  # --precision 0.01 is 1 %
    assert [number for number in numbers if float(number) not in standing | shares] == []


# --- the comparison itself ------------------------------------------------------------------------

PAGE = """
```yaml title="a/list.txt"
one
two
three
four
```

```diff title="a/list.txt"
 one
-two
+deux
```

```console
$ cat a/list.txt
one
...
three
...
$ wc -l < a/list.txt
4
$ false || \\
  (echo on stderr >&2; exit 3)
on stderr
$ echo $?
3
```

```python
print("from Python")
```

```text
from Python
```
"""


def differences(excerpts: ModuleType, folder: Path, text: str, write: bool = False) -> list[str]:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return excerpts.check(page, write)  # type: ignore[no-any-return]


def test_a_page_that_says_what_happens_has_no_difference_and_progress_is_left_out(
    excerpts: ModuleType, tmp_path: Path
) -> None:
    assert differences(excerpts, tmp_path, PAGE) == []
    lines = "'optimise: 3 s, 86 %, about 1 s left' 'compiling kernels, once on this machine: 9 s, 3 of 31' 'wrote x'"
    assert differences(excerpts, tmp_path, f"```console\n$ printf '%s\\n' {lines}\nwrote x\n```\n") == []
    assert differences(excerpts, tmp_path, "```console\n$ echo wrote y\nwrote x\n```\n")
    assert differences(excerpts, tmp_path, PAGE.replace("-two\n", "-twice\n"))


@pytest.mark.parametrize(
    ("quoted", "changed"),
    [
        ("\nthree\n...", "\ntwo\n..."), ("\n4\n", "\n5\n"), ("\n3\n```", "\n0\n```"), ("on stderr\n$ echo", "$ echo"),
        ("```text\nfrom", "```text\nFrom"), ("one\n...", "deux\n..."), ("three\n...\n", "three\n"),
        ("...\nthree\n...", "...\nthree\none\n..."), ("+deux", "+zwei\n+drei"),
    ],
)  # fmt: skip
def test_a_page_that_says_something_else_is_told_what_was_printed(
    excerpts: ModuleType, tmp_path: Path, quoted: str, changed: str
) -> None:
    assert PAGE.count(quoted) == 1
    assert differences(excerpts, tmp_path, PAGE.replace(quoted, changed))


def test_writing_brings_a_page_up_to_date_and_keeps_what_is_left_out(excerpts: ModuleType, tmp_path: Path) -> None:
    stale = PAGE.replace("\nthree\n...", "\nthre\n...").replace("\n4\n", "\n5\n").replace("\n3\n```", "\n```")
    assert differences(excerpts, tmp_path, stale, write=True)
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == PAGE
