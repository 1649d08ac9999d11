"""What keeps the project in order where nobody looks: workflows, citation, bill of materials, changelog."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from service_scenes import ROOT
from trove_classifiers import classifiers

import changelog
import release
import sbom
from tailstack.version import __version__

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGE = (ROOT / "docs" / "releasing.md").read_text(encoding="utf-8")
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
# What a job of ours may have beside reading the sources
MORE = {"publish.yml": {"id-token": "write"}}


def read(path: Path) -> dict[str, Any]:
    """As plain texts: ``on`` is no boolean of YAML 1.1."""
    return dict(yaml.load(path.read_text(encoding="utf-8"), yaml.BaseLoader))


def jobs() -> list[tuple[str, str, dict[str, Any]]]:
    return [(path.name, name, job) for path in WORKFLOWS for name, job in read(path)["jobs"].items()]


# --- workflows --------------------------------------------------------------------------------------


def test_workflows_say_that_they_were_not_run_and_call_what_is_there() -> None:
    assert [path.stem for path in WORKFLOWS] == ["docs", "nightly", "publish", "tests", "wheels"]
    for path in WORKFLOWS:
        assert "not run yet" in path.read_text(encoding="utf-8").partition("\nname:")[0]
    usage = (ROOT / "run").read_text(encoding="utf-8")
    called = {found for _, _, job in jobs() for found in re.findall(r"\./run (\w+)", str(job))}
    assert called == {"test", "release", "docs", "chaos", "bench"}
    assert all(f"\n  {verb} " in usage for verb in called)
    for workflow, name, job in jobs():
        for step in job.get("steps", ()):
            assert "${{" not in step.get("run", ""), (workflow, name)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_is_what_github_reads(path: Path) -> None:
    """oracle: SchemaStore's schema; its patterns want numbers and booleans as such."""
    schema = json.loads((ROOT / "tests" / "data" / "schemas" / "github-workflows.json").read_text(encoding="utf-8"))
    plain = yaml.safe_load(path.read_text(encoding="utf-8"))
    plain["on"] = plain.pop(True)
    jsonschema.Draft7Validator(schema).validate(plain)


@pytest.mark.parametrize(("workflow", "name", "job"), jobs(), ids=lambda value: value if isinstance(value, str) else "")
def test_a_job_is_bounded_and_may_do_no_more_than_it_must(workflow: str, name: str, job: dict[str, Any]) -> None:
    assert read(ROOT / ".github" / "workflows" / workflow)["permissions"] == {}
    assert job["permissions"] in ({"contents": "read"}, MORE.get(workflow)), name
    if "uses" in job:  # of a workflow of ours, whose jobs are bounded there
        assert (ROOT / job["uses"]).is_file()
        return
    assert 0 < int(job["timeout-minutes"]) <= 120
    assert not any("secrets." in str(step) for step in job["steps"])
    for step in job["steps"]:
        if step.get("uses", "").startswith("actions/checkout@"):
            assert step["with"]["persist-credentials"] == "false"


def test_actions_are_named_by_their_commit_or_the_owner_is_told_to_pin_them() -> None:
    used = {step["uses"] for _, _, job in jobs() for step in job.get("steps", ()) if "uses" in step}
    named = {name for name in used if not re.fullmatch(r"[\w.-]+/[\w.-]+@[0-9a-f]{40}", name)}
    listed = PAGE.partition("Actions named by a tag")[2].partition("\n8.")[0]
    assert [name for name in named if f"`{name.partition('@')[0]}`" not in listed] == []
    for path in WORKFLOWS:  # and a reader sees which version a commit is
        for line in path.read_text(encoding="utf-8").splitlines():
            assert re.search(r"@[0-9a-f]{40}", line) is None or re.search(r"# v\d+\.\d+\.\d+$", line), line


def test_forms_for_issues_have_what_github_asks_for() -> None:
    """Keys of a form, from "Syntax for issue forms" of GitHub's documentation."""
    for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("[!c]*.yml"):
        form = yaml.safe_load(path.read_text(encoding="utf-8"))
        assert {"name", "description", "body"} <= form.keys()
        fields = [field for field in form["body"] if field["type"] != "markdown"]
        assert len({field["id"] for field in fields}) == len(fields) > 1
        assert all(field["attributes"]["label"] for field in fields)


# --- readers ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reader", "page"),
    [
        ("You design a structure", "docs/tutorials/first_carrier.md"),
        ("You answer for the system's error", "docs/tutorials/why_this_p95.md"),
        ("You keep a pipeline", "docs/pipelines.md"),
        ("You run the service", "docs/deploy.md"),
        ("You do research", "docs/method.md"),
    ],
    ids=["designer", "systems engineer", "CI maintainer", "operator", "researcher"],
)
def test_a_reader_finds_the_page_from_the_readme_in_one_step(reader: str, page: str) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (line,) = [line for line in readme.splitlines() if line.startswith(f"- **{reader}**: ")]
    assert f"({page})" in line
    assert (ROOT / page).is_file()


def test_what_is_at_the_root_is_explained_in_a_line() -> None:
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## What is at the root")[2]
    patterns = re.findall(r"`([^`]+)`", "".join(re.findall(r"^\|([^|]+)\|", table, re.MULTILINE)))
    there = {Path(name).parts[0] for name in release.files_of(ROOT)} - {"README.md", "CONTRIBUTING.md"}
    unexplained = [name for name in there if not any(fnmatch(name, one.rstrip("/")) for one in patterns)]
    assert unexplained == []
    assert [one for one in patterns if not list(ROOT.glob(one.rstrip("/")))] == []


def test_a_newcomer_reads_little_and_files_that_can_be_read() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Tests")[0]
    assert len([line for line in text.splitlines()[1:] if line]) <= 12
    for name in (".pre-commit-config.yaml", ".github/ISSUE_TEMPLATE/problem.yml", "renovate.json"):
        assert yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


# --- metadata ---------------------------------------------------------------------------------------


def test_the_metadata_say_who_what_and_for_whom() -> None:
    assert PROJECT["authors"] == [{"name": "the tailstack authors"}]
    assert set(PROJECT["classifiers"]) <= classifiers
    assert not any(entry.startswith("License ::") for entry in PROJECT["classifiers"])  # PEP 639
    assert "urls" not in PROJECT or "TO BE" not in str(PROJECT["urls"])
    assert "[project.urls]" in PAGE
    assert release.version_of(ROOT) == __version__
    # Those of the packages' folders, however many there will be.
    found = [
        path for path in (ROOT / "service" / "tailstack_service").rglob("*") if re.match("(?i)licen|notice", path.name)
    ]
    assert {path.relative_to(ROOT).as_posix() for path in found} | {"LICENSE"} == set(release.licence_files(ROOT))


def test_the_citation_has_the_keys_that_its_format_requires() -> None:
    """Required by the Citation File Format 1.2.0: cff-version, message, title and authors, each with a name."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert citation["message"]
    assert citation["title"]
    assert citation["authors"] == PROJECT["authors"]
    assert (str(citation["version"]), citation["license"]) == (__version__, PROJECT["license"])
    for reference in citation["references"]:
        assert {"type", "title", "authors"} <= reference.keys()


# --- what a release says ----------------------------------------------------------------------------


def test_the_changelog_begins_with_the_next_version_and_what_one_must_do_fits_a_page() -> None:
    section = changelog.next_section(CHANGES)
    numbers = [tuple(map(int, version.split("."))) for version in (section.version, __version__)]
    assert numbers[0] > numbers[1]
    assert len(section.part(changelog.MUST).split()) <= 450
    assert f"## {section.version} (2031-02-03)" in changelog.cut(CHANGES, "2031-02-03")
    with pytest.raises(LookupError, match="was released on 2031-02-03"):
        changelog.next_section(changelog.cut(CHANGES, "2031-02-03"))
    with pytest.raises(LookupError, match="not a version's"):
        changelog.next_section("# Changelog\n\n## Unreleased\n")


def test_the_text_of_the_tag_is_plain_and_narrow() -> None:
    lines = changelog.tag_text(changelog.next_section(CHANGES)).splitlines()
    assert lines[0] == f"tailstack {changelog.next_section(CHANGES).version}"
    assert max(map(len, lines)) <= 72
    assert not [line for line in lines if line.startswith("#") or "**" in line or "](" in line]


def test_the_bill_of_materials_lists_the_locks_and_what_is_bundled() -> None:
    """Required by CycloneDX 1.6: bomFormat, specVersion; of a component type and name. The rest is of the locks."""
    bill = sbom.bill(ROOT, "9.8.7", 1_700_000_000)
    assert (bill["bomFormat"], bill["specVersion"], bill["version"]) == ("CycloneDX", "1.6", 1)
    assert re.fullmatch(r"urn:uuid:[0-9a-f-]{36}", bill["serialNumber"])
    assert bill["metadata"]["timestamp"] == "2023-11-14T22:13:20Z"
    lock = (ROOT / "requirements-run.lock").read_text(encoding="utf-8")
    pins = re.findall(r"^([a-z0-9._-]+)==(\S+)", lock, re.MULTILINE)
    python = [
        (entry["name"], entry["version"]) for entry in bill["components"] if entry["purl"].startswith("pkg:pypi/")
    ]
    assert python == pins
    hashes = [h for entry in bill["components"] for r in entry.get("externalReferences", ()) for h in r["hashes"]]
    assert len(hashes) == lock.count("--hash=sha256:")
    required = {entry["name"] for entry in bill["components"] if entry["scope"] == "required"}
    assert {"numba", "numpy", "swagger-ui-dist", "@codemirror/view"} <= required
    assert "fastapi" not in required
    assert len({entry["bom-ref"] for entry in bill["components"]}) == len(bill["components"])
    assert bill == sbom.bill(ROOT, "9.8.7", 1_700_000_000)


def test_a_copy_gets_the_next_version_and_this_checkout_keeps_its_own(tmp_path: Path) -> None:
    names = ["pyproject.toml", "CHANGELOG.md", "CITATION.cff", "solver/tailstack/version.py"]
    tree = release.prepare(ROOT, names, tmp_path, 1_700_000_000)
    version = changelog.next_section(CHANGES).version
    assert release.version_of(tree) == version != release.version_of(ROOT)
    assert f"\nversion: {version}\n" in (tree / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {version} (2023-11-14)" in (tree / "CHANGELOG.md").read_text(encoding="utf-8")


def test_what_is_not_to_be_released_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    release.check_same({"a": "1", "b": "2"}, {"a": "1"})
    with pytest.raises(release.Refusal, match=r"not the same: b, c$"):
        release.check_same({"a": "1", "b": "2"}, {"a": "1", "b": "3", "c": "4"})
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    assert release.main(["--dry-run", "-o", str(tmp_path)]) == 1
    assert "name another folder" in capsys.readouterr().err
    assert (tmp_path / "mine.txt").exists()
    with pytest.raises(SystemExit):
        release.main([])
    assert "--dry-run" in capsys.readouterr().err


def test_kernels_are_refused_where_a_level_is_missing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The backend that cibuildwheel calls."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("PYTHONPATH", "")
    from kernels_wheel import backend

    monkeypatch.setattr("tailstack.kernels.processor.levels_here", lambda: ["x86-64-v3"])
    with pytest.raises(SystemExit, match="x86-64-v4"):
        backend.build_wheel(str(tmp_path))
    monkeypatch.setattr("tailstack.kernels.processor.levels_here", lambda: ["x86-64-v4", "x86-64-v3"])
    monkeypatch.setattr("build.build_kernels", lambda folder, levels, names: folder / f"{len(levels)}.whl")
    assert backend.build_wheel(str(tmp_path)) == "2.whl"


@pytest.mark.long
def test_a_dry_run_builds_tries_and_compares(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The kernels are built and tried in test_compilation.py."""
    assert release.main(["--dry-run", "--kernels", "none", "--offline", "-o", str(tmp_path / "out")]) == 0
    version = changelog.next_section(CHANGES).version
    said = capsys.readouterr().out
    assert "the same to the last byte" in said
    assert "the demo is scored" in said
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        f"tailstack-{version}.tar.gz", f"tailstack-{version}-py3-none-any.whl",
        f"tailstack_kernels-{version}-py3-none-any.whl", f"tailstack-{version}.cdx.json", "tag.txt", "notes.md",
        "SHA256SUMS",
    }  # fmt: skip
    sums = (tmp_path / "out" / "SHA256SUMS").read_text(encoding="utf-8")
    listed = {name: digest for digest, name in (line.split("  ") for line in sums.splitlines())}
    there = release.digests(tmp_path / "out")
    assert listed == {name: digest for name, digest in there.items() if name != "SHA256SUMS"}
