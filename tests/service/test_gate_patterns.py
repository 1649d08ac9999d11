"""Patterns of a gate: they see what is in the repository and nothing above it; what can match nothing is refused."""

from __future__ import annotations

import os
import re
import typing
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest
from gate_scenes import PASSING, TODAY, gate_in, waivers_of_today, write_document
from gate_scenes import policy as policy_of
from pydantic import BaseModel
from service_scenes import limited

from plain_data import problems_of
from tailstack_service.cli.gate_files import Anchors, find_paths
from tailstack_service.gate.file_names import match_names
from tailstack_service.gate.pattern_slips import find_slip
from tailstack_service.gate.policy import Patterns, Policy
from tailstack_service.gate.reading import GateError
from tailstack_service.gate.request import admit_gate
from tailstack_service.gate.waivers import Waivers


def policy(*patterns: str, limit_mm: float = 1.3) -> dict[str, Any]:
    """A strict policy with a lax class; P95 of the design is about 0.65 mm."""
    own = {"name": "lax", "files": list(patterns), "rules": {"p95": {"limit_mm": limit_mm}}}
    return policy_of({"p95": {"limit_mm": 0.5}}, classes=[own])


# --- nothing above the root ---------------------------------------------------------------------------------------

CLONES = ("prototypes", "prototypes/guides", "home/prototypes/a/b", "Prototypes/prototypes")
MARKS = (".git", "a file .git", "CI_PROJECT_DIR", "GITHUB_WORKSPACE", "a link and CI_PROJECT_DIR", "none")
PLACES = ("policy.yaml", "ci/policy.yaml", "ci/gate/policy.yaml", "designs/policy.yaml")


def list_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Clones below folders that a pattern names: words, and the names of a design that patterns see."""
    for number, (clone, mark, place) in enumerate((c, m, p) for c in CLONES for m in MARKS for p in PLACES):
        root = tmp_path / str(number) / clone
        design = write_document(root / "designs" / "x.yaml", "")
        rules = write_document(root / place, "")
        with monkeypatch.context() as patch:
            if mark == ".git":
                (root / ".git").mkdir()
            elif mark == "a file .git":
                (root / ".git").write_text("gitdir: elsewhere", encoding="utf-8")
            elif mark.startswith("a link"):
                (tmp_path / f"prototypes{number}").symlink_to(root)
                patch.setenv("CI_PROJECT_DIR", str(tmp_path / f"prototypes{number}"))
            elif mark != "none":
                patch.setenv(mark, str(root))
            seen = set()
            for folder in (root, design.parent, tmp_path):
                with chdir(folder):
                    seen.add(Anchors.of_documents([str(rules)]).list_names(os.path.relpath(design)))
            (names,) = seen
            yield f"{clone}, {mark}, {place}", names


def test_no_name_has_a_folder_above_the_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for words, names in list_scenes(tmp_path, monkeypatch):
        for pattern in ("*prototypes*", "*Prototypes*", "**/prototypes/*", "*/prototypes/*", "prototypes/*"):
            assert not match_names(names, pattern), (words, names)
        assert match_names(names, "**/x.yaml"), words
        assert {name.lstrip("./") for name in names} <= {"designs/x.yaml", "x.yaml"}, (words, names)


def test_a_policy_beside_the_repository_sees_names_from_its_root(tmp_path: Path) -> None:
    """Policies of their own repository, as a submodule or elsewhere; and a checkout below the pipeline's folder."""
    design = write_document(tmp_path / "prototypes" / "repo" / "designs" / "x.yaml", "")
    (tmp_path / "prototypes" / "repo" / ".git").mkdir()
    for place in ("policies/p.yaml", "p.yaml", "prototypes/p.yaml", "prototypes/repo/rules/p.yaml"):
        rules = write_document(tmp_path / place, "")
        if "rules" in place or "policies" in place:
            (rules.parent / ".git").write_text("gitdir: elsewhere", encoding="utf-8")
        names = Anchors.of_documents([str(rules)]).list_names(str(design))
        assert names[0] == "designs/x.yaml"
        assert {*names[1:]} <= {"../designs/x.yaml"}, place  # of a policy below the root


def test_designs_in_a_submodule_are_named_from_the_repository_of_the_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With and without what a pipeline says."""
    (tmp_path / ".git").mkdir()
    design = write_document(tmp_path / "parts" / "designs" / "x.yaml", "")
    (tmp_path / "parts" / ".git").write_text("gitdir: elsewhere", encoding="utf-8")
    anchors = Anchors.of_documents([str(write_document(tmp_path / "policy.yaml", ""))])
    for _ in range(2):
        assert anchors.list_names(str(design)) == ("parts/designs/x.yaml",)
        monkeypatch.setenv("CI_PROJECT_DIR", str(tmp_path))


# --- what patterns match ------------------------------------------------------------------------------------------

MATCHES = [
    ("**/x.yaml", "x.yaml", True), ("**/x.yaml", "a/x.yaml", True), ("**/x.yaml", "a/b/x.yaml", True),
    ("**/x.yaml", "ax.yaml", False), ("a/**/x.yaml", "a/x.yaml", True), ("a/**/x.yaml", "a/b/c/x.yaml", True),
    ("a/**/x.yaml", "ax.yaml", False), ("a/**/x.yaml", "b/a/x.yaml", False), ("**/**/x.yaml", "x.yaml", True),
    ("**/a/**/x.yaml", "a/x.yaml", True), ("**/a/**/x.yaml", "b/a/c/x.yaml", True), ("**/a/**", "a/x.yaml", True),
    ("**/a/**", "xa/x.yaml", False), ("**", "a/b.yaml", True), ("**/*", "b.yaml", True), ("a/**", "a/b/c.yaml", True),
    ("*/x.yaml", "x.yaml", False), ("*/x.yaml", "a/b/x.yaml", True), ("./a/*", "a/x.yaml", True),
    ("a/*", "./a/x.yaml", True), ("a/*", "a//x.yaml", True), ("b/*", "a/../b/x.yaml", True),
    ("../b/*", "../b/x.yaml", True), ("../b/*", "b/x.yaml", False), ("*/b/*", "../b/x.yaml", False),
    ("../../b/*", "../b/x.yaml", False), ("*", "../x.yaml", False), ("*", "/tmp/x.yaml", False),
    ("*x.yaml", "C:/x.yaml", False), ("A/*", "a/x.yaml", False), ("[ab]/*", "a/x.yaml", False),
    ("order [A7]/*", "order A/x", False), ("sub/*", "x.yaml", False), ("gepr\u00fcft/*", "gepru\u0308ft/x", True),
    ("gepru\u0308ft/*", "gepr\u00fcft/x", True),
]  # fmt: skip


@pytest.mark.parametrize(("pattern", "name", "matches"), MATCHES)
def test_what_a_pattern_matches(pattern: str, name: str, matches: bool) -> None:
    assert match_names([name], pattern) is matches


def test_a_pattern_that_is_a_folder_by_its_letters_is_that_folder() -> None:
    assert match_names(["x.yaml", "sub/x.yaml"], "sub/*")
    assert match_names(["order [A7]/x"], "order [A7]/*")


def test_a_file_called_as_a_pattern_takes_nothing_away_from_it(tmp_path: Path) -> None:
    """Who adds a file named ``*.yaml`` would else be the only one who is judged, or free the others of their class."""
    write_document(tmp_path / "designs" / "x.yaml", limited(PASSING))
    write_document(tmp_path / "designs" / "*.yaml", limited(PASSING, name="other"))
    rules = write_document(tmp_path / "policy.yaml", policy("designs/*.yaml", limit_mm=0.6))
    code, record = gate_in(tmp_path, "designs/*.yaml", "--policy", rules)
    assert code == 1
    assert [(design.file, design.design_class) for design in record.designs] == [
        ("designs/*.yaml", "lax"), ("designs/x.yaml", "lax"),
    ]  # fmt: skip


# --- what can match nothing ---------------------------------------------------------------------------------------

SLIPS = [
    "!released/*", "{released,series}/*.yaml", "rev{1..3}/*", "{a}.yaml", "$HOME/designs/*", "${ROOT}/*", "%ROOT%/*",
    "{{ root }}/*", "@(a|b)/*", "!(a)/*", "+(a)/*", "a|b", "?(a|b)/*", " a/*", "a/* ", "\u00a0a/*", "'a/*'", '"a"',
    "^a/.*", "a/.*$", "a\\*.yaml", "[ab]*.yaml", "[ab/*", "ab]", "[[:digit:]]/*", "a,b}.yaml",
]  # fmt: skip
SIGNS = "and of signs a pattern has * and ? alone"
OF_FILES = {
    "~/designs/*": "no path from the root", "~joe/designs/*": "no path from the root",
    "/designs/*": "no path from the root", "C:/designs/*": "no path from the root",
    "file:///designs/*": "no path from the root", "https://git.example.com/*": "no path from the root",
    "released/": "is a folder", ".": "is a folder", "..": "is a folder", "a//b.yaml": "no name has",
    "a/./b.yaml": "no name has", "a/../b.yaml": "no name has", "././a.yaml": "no name has",
    "../../../a.yaml": "leads out",
}  # fmt: skip
SOUND = [
    "*", "**", "*.yaml", "designs/*", "**/designs/**/*.yaml", "./designs/*", "a b/*.yaml", "x (2).yaml", "x*(2).yaml",
    "rev-?*", "??-*.y?ml", "a+b.yaml", "a@b.yaml", "50%.yaml", "a,b.yaml", "~x.yaml", "x~", "x!.yaml", "#1.yaml",
    "geprüft/*", "?a,b?.yaml", "my first carrier", "Guide: rev A", "x.yaml.bak", "..hidden/*",
    "a..b/*", "?HOME/*",
]  # fmt: skip


def test_what_is_sound_is_not_refused() -> None:
    assert {pattern: slip for pattern in SOUND if (slip := find_slip(pattern))} == {}


@pytest.mark.parametrize("pattern", [pattern for pattern in OF_FILES if not pattern.startswith("..")])
def test_the_cure_of_a_path_is_sound(pattern: str) -> None:
    slip = find_slip(pattern)
    (meant,) = re.findall(r"'([^']+)'", slip.cure)
    assert find_slip(meant) is None


def list_pattern_fields(model: type[BaseModel]) -> Iterator[str]:
    """Fields of a document that hold patterns, from its schema."""
    schema = model.model_json_schema(by_alias=True)
    (of_patterns,) = typing.get_args(typing.get_args(Patterns)[0])
    expression = typing.get_args(of_patterns)[1].metadata[-1].pattern
    pending = [("", schema)]
    while pending:
        at, node = pending.pop()
        if node.get("items", {}).get("pattern") == expression:
            yield at
        below = [node.get("items", {}), *node.get("anyOf", ()), *node.get("allOf", ())]
        if "$ref" in node:
            below.append(schema["$defs"][node["$ref"].rpartition("/")[2]])
        pending += [(at, each) for each in below if each]
        pending += [(f"{at}/{name}", each) for name, each in node.get("properties", {}).items()]


def put(pattern: str) -> dict[str, tuple[dict[str, Any], dict[str, Any] | None, str]]:
    """By field: a policy and waivers with the pattern in it, and its pointer."""
    process = {"name": "mill", "tolerances": [pattern], "min_half_width_deg": 0.01}
    of_process = {"process-capability": {"processes": [process]}}
    plain = policy("*.yaml")
    in_rules = {**plain, "rules": {**plain["rules"], **of_process}}
    in_class = {**plain, "classes": [{**plain["classes"][0], "rules": of_process}]}
    return {
        "/classes/files": (policy(pattern), None, "/classes/0/files/0"),
        "/rules/process-capability/processes/tolerances": (
            in_rules, None, "/rules/process-capability/processes/0/tolerances/0"),
        "/classes/rules/process-capability/processes/tolerances": (
            in_class, None, "/classes/0/rules/process-capability/processes/0/tolerances/0"),
        "/waivers/designs": (plain, waivers_of_today(pattern), "/waivers/0/designs/0"),
    }  # fmt: skip


def test_every_field_with_patterns_is_known_here() -> None:
    known = {*list_pattern_fields(Policy), *list_pattern_fields(Waivers)}
    assert known == {*put("*")}


@pytest.fixture(scope="module")
def sent() -> dict[str, Any]:
    return {"designs": [{"file": "designs/x.yaml", "design": limited(PASSING)}], "mode": "analytic"}


@pytest.mark.parametrize("pattern", [*SLIPS, *OF_FILES, "designs", "d*s"])
def test_what_can_match_nothing_is_refused_over_http(pattern: str, sent: dict[str, Any]) -> None:
    for field, (rules, waivers, pointer) in put(pattern).items():
        if pattern not in SLIPS and "tolerances" in field:
            continue
        body = {**sent, "policy": rules, **({"waivers": waivers} if waivers else {})}
        (problem,) = problems_of(admit_gate, body, today=TODAY, error=GateError)
        document = "/waivers" if waivers else "/policy"
        assert (problem.code, problem.pointer) == ("bad-pattern", document + pointer), field
        assert (SIGNS if pattern in SLIPS else OF_FILES.get(pattern, "is a folder")) in problem.detail
        assert problem.hint


@pytest.mark.parametrize(
    "name", ["!designs/*", "{a,b}.yaml", "designs/{x,y}.yaml", "$DIR/*.yaml", "designs\\x.yaml", "@(a|b).yaml"]
)
def test_a_slip_on_the_command_line_is_told(tmp_path: Path, name: str) -> None:
    write_document(tmp_path / "designs" / "x.yaml", limited(PASSING))
    code, record = gate_in(tmp_path, "designs/x.yaml", name)
    (finding,) = record.findings
    assert code == 2
    assert f"no file matches {name!r}" in finding.message
    assert SIGNS in finding.message


def test_signs_of_a_name_are_written_as_question_marks(tmp_path: Path) -> None:
    write_document(tmp_path / "{a,b}" / "[released]" / "x.yaml", limited(PASSING))
    rules = write_document(tmp_path / "policy.yaml", policy("?a,b?/?released?/*"))
    assert gate_in(tmp_path, "{a,b}/[released]/x.yaml", "--policy", rules)[1].designs[0].design_class == "lax"


# --- folders are looked through once ------------------------------------------------------------------------------


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The folders that are looked through, as often as they are."""
    seen: list[str] = []
    for name in ("scandir", "listdir"):
        look = getattr(os, name)

        def count(path: Any = ".", look: Any = look) -> Any:
            seen.append(os.path.realpath(path))
            return look(path)

        monkeypatch.setattr(os, name, count)
    return seen


def test_packages_that_are_linked_in_each_other_are_looked_through_once(tmp_path: Path, looks: list[str]) -> None:
    """A workspace of pnpm, of npm, and folders with links to themselves, above and to each other."""
    names = [f"p{number}" for number in range(12)]
    for name in names:
        write_document(tmp_path / "packages" / name / "designs" / "x.yaml", "")
        for other in names:
            modules = tmp_path / "packages" / name / "node_modules"
            modules.mkdir(exist_ok=True)
            (modules / other).symlink_to(f"../../{other}")
        (tmp_path / "packages" / name / "self").symlink_to(".")
        (tmp_path / "packages" / name / "above").symlink_to("..")
    (tmp_path / "packages" / "outside").mkdir()
    (tmp_path / "packages" / "outside" / "link").symlink_to(tmp_path / "elsewhere")
    write_document(tmp_path / "elsewhere" / "designs" / "y.yaml", "")
    every = {str(tmp_path / "packages" / name / "designs" / "x.yaml") for name in names}
    folders = 1 + 12 * 3 + 1 + 2
    for pattern, parts in (
        ("packages/**/*.yaml", 2), ("packages/**/designs/*.yaml", 3), ("packages/**/**/*.yaml", 3), ("packages/**", 2),
        ("*/*/*/*/*/*/*/*/*/x.yaml", 10), ("packages/**/self/**/above/**/*.yaml", 6),
        ("**/node_modules/*/designs/*", 4),
    ):  # fmt: skip
        looks.clear()
        with chdir(tmp_path):
            found = {os.path.realpath(path) for path in find_paths(pattern)}
        assert len(looks) <= parts * (folders + 4), pattern
        assert found - {str(tmp_path / "elsewhere" / "designs" / "y.yaml")} == every, pattern


def test_what_only_a_link_leads_to_is_found(tmp_path: Path) -> None:
    write_document(tmp_path / "store" / "v3" / "x.yaml", "")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "released").symlink_to("../store/v3")
    with chdir(tmp_path):
        assert find_paths("**/released/*.yaml") == ["parts/released/x.yaml"]
        assert find_paths("parts/**/*.yaml") == ["parts/released/x.yaml"]
        assert find_paths("**/*.yaml") == ["store/v3/x.yaml"]
        assert find_paths("p*/**/r*/**/x*") == ["parts/released/x.yaml"]


def test_patterns_of_the_command_line_as_people_know_them(tmp_path: Path) -> None:
    for name in ("a/x.yaml", "a/b/y.yaml", "a/.hidden/z.yaml", "a/n.txt"):
        write_document(tmp_path / name, "")
    with chdir(tmp_path):
        assert find_paths("a/*.yaml") == ["a/x.yaml"]
        assert find_paths("a/**/*.yaml") == ["a/b/y.yaml", "a/x.yaml"]
        assert find_paths("**/y.yaml") == ["a/b/y.yaml"]
        assert find_paths("?/?.yaml") == ["a/x.yaml"]
        assert find_paths(f"{tmp_path}/*/b/*") == [f"{tmp_path}/a/b/y.yaml"]
        assert find_paths("a/.hid*/*") == ["a/.hidden/z.yaml"]
        assert find_paths("c/*.yaml") == find_paths("a/x.yml") == find_paths("a/x.yaml/*") == []
