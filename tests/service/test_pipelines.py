"""What ships for pipelines, run as far as that goes without the vendors' runners: the GitHub Action, the GitLab
template, the pre-commit hook, and the worked example that uses them."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import sys
from datetime import timedelta
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jsonschema
import pytest
import yaml
from pipeline_scenes import (
    ACTION,
    EXAMPLE,
    Ran,
    call,
    environment,
    git,
    inputs,
    interpolated,
    python_with_libraries,
    redate,
    repository,
    run_job,
    run_step,
    shipped,
    step,
    template,
)
from service_scenes import ROOT

from family import run_process
from plain_data import places_of, read_cases, value_at
from tailstack.design.fiducial_files import ENDINGS
from tailstack.design.reading import DOCUMENTS
from tailstack.version import __version__
from tailstack_service.cli.gate_changes import list_affected
from tailstack_service.cli.main import main
from tailstack_service.gate.waivers import read_waivers

SCHEMAS = ROOT / "tests" / "data" / "schemas"
HOOKS = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8"))
PAGE = (ROOT / "docs" / "pipelines.md").read_text(encoding="utf-8")
WORKFLOW = EXAMPLE / ".github" / "workflows" / "gate.yml"
# Keys of a hook, from "Creating new hooks" at https://pre-commit.com/#creating-new-hooks
HOOK_KEYS = {
    "id", "name", "entry", "language", "files", "exclude", "types", "types_or", "exclude_types", "always_run",
    "fail_fast", "verbose", "pass_filenames", "require_serial", "description", "language_version", "args", "stages",
    "minimum_pre_commit_version", "additional_dependencies", "log_file", "alias",
}  # fmt: skip
HOOK_NEEDS = {"id", "name", "entry", "language"}


def schema(name: str) -> dict[str, Any]:
    return json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The temporary folder of a GitHub runner."""
    return tmp_path_factory.mktemp("runner")


@pytest.fixture(scope="module")
def installed(room: Path) -> Ran:
    """The action's environment, made by its own step: locked requirements with their hashes, then this checkout."""
    python = python_with_libraries(room / "python")
    return run_step("install", inputs(designs="-", python=str(python)), room, room)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return repository(tmp_path / "guides")


# --- the GitHub Action ----------------------------------------------------------------------------


def gate(installed: Ran, project: Path, room: Path, **given: str) -> Ran:
    known = {**inputs(**given), "steps.install.outputs.bin": installed.outputs["bin"]}
    return run_step("gate", known, project, room)


def test_the_action_is_metadata_as_published_and_no_input_becomes_part_of_a_script() -> None:
    jsonschema.Draft7Validator(schema("github-actions")).validate(ACTION)
    assert all("uses" not in entry for entry in ACTION["runs"]["steps"])
    for output in ACTION["outputs"].values():
        assert re.fullmatch(r"\$\{\{ steps\.gate\.outputs\.[a-z-]+ \}\}", output["value"])
    # A name of a file comes from a stranger's pull request: it is handed over in the environment.
    for entry in ACTION["runs"]["steps"]:
        assert "${{" not in entry["run"]
    read = {found for entry in ACTION["runs"]["steps"] for found in re.findall(r"inputs\.([\w-]+)", str(entry))}
    assert read == ACTION["inputs"].keys()
    assert [step(name)["name"] for name in ("install", "gate")] == ["Install tailstack", "Gate"]


@pytest.mark.long
def test_the_action_installs_what_it_was_checked_out_with(installed: Ran) -> None:
    assert installed.code == 0, installed.said
    bin_ = Path(installed.outputs["bin"])
    code = "import importlib.metadata as m; print(m.version('tailstack'), m.distribution('tailstack').locate_file(''))"
    done = run_process(bin_ / "python", "-c", code, env=environment(PYTHONPATH=""), check=True)
    assert done.stdout.startswith(f"{__version__} {bin_.parent}")
    assert (bin_ / "tailstack").exists()


def test_an_environment_that_is_there_is_used_again(installed: Ran, room: Path) -> None:
    marker = Path(installed.outputs["bin"]).parent / "installed"
    before = marker.stat().st_mtime_ns
    again = run_step("install", inputs(designs="-", python=str(room / "python" / "python3")), room, room)
    assert (again.code, again.outputs) == (0, installed.outputs)
    assert marker.stat().st_mtime_ns == before


@pytest.mark.parametrize("failing", ["version", "venv"])
def test_what_cannot_be_installed_is_no_verdict(failing: str, tmp_path: Path) -> None:
    """Exit code 3, an annotation, and no output that looks like a path."""
    python = tmp_path / "python3"
    excuse = "case $3 in *version_info*) exit 1;; esac" if failing == "version" else '[ "$3" != venv ] || exit 1'
    python.write_text(f'#!/bin/sh\n{excuse}\nexec "{sys.executable}" "$@"\n', encoding="utf-8")
    python.chmod(0o755)
    done = run_step("install", inputs(designs="-", python=str(python)), tmp_path, tmp_path)
    assert done.code == 3
    assert done.said.splitlines()[-1].startswith("::error title=tailstack gate::")
    assert ("3.11" in done.said) == (failing == "version")
    assert done.outputs == {}


@pytest.mark.long
@pytest.mark.parametrize(
    ("designs", "days", "code", "verdict"),
    [
        ("pass.yaml\nwaived.yaml\n", 30, 0, "pass"),
        ("waived.yaml", -1, 1, "fail"),
        ("  \n", 30, 2, "not evaluated"),
    ],
)
def test_the_exit_code_of_the_gate_is_that_of_the_action(
    installed: Ran, project: Path, room: Path, designs: str, days: int, code: int, verdict: str
) -> None:
    redate(project, days)
    done = gate(
        installed, project, room, designs=designs, policy="policy.yaml", waivers="waivers.yaml", mode="analytic",
        formats="\n  junit=gate.xml\nmarkdown=gate.md  \n",
    )  # fmt: skip
    assert done.code == code, done.said
    assert (done.outputs["exit-code"], done.outputs["verdict"]) == (str(code), verdict)
    assert f"tailstack gate: {verdict} (exit code {code}" in done.said
    assert verdict in done.summary
    record = json.loads(Path(done.outputs["record"]).read_text(encoding="utf-8"))
    assert (record["exit_code"], record["verdict"]) == (code, verdict)
    sarif = json.loads(Path(done.outputs["sarif"]).read_text(encoding="utf-8"))
    assert len(sarif["runs"][0]["results"]) == len(record["findings"])
    assert ElementTree.parse(project / "gate.xml").getroot().tag == "testsuites"
    assert (project / "gate.md").read_text(encoding="utf-8") in done.summary


@pytest.mark.long
def test_findings_are_annotations_at_their_lines_named_from_the_root(
    installed: Ran, tmp_path: Path, room: Path
) -> None:
    (tmp_path / "parts").mkdir()
    guides = repository(tmp_path / "parts" / "guides")
    done = gate(installed, tmp_path, room, designs="f*.yaml", mode="analytic", working_directory="parts/guides")
    assert done.code == 1
    line = 1 + (guides / "fail.yaml").read_text(encoding="utf-8").splitlines().index("    limit_mm: 0.8")
    place = rf"file=parts/guides/fail\.yaml,line={line},col=\d+,title=tailstack p95::tip-accuracy"
    assert re.search(rf"^::error {place}", done.said, re.M), done.said
    assert re.search(rf"^fail\.yaml:{line}:\d+: error: tip-accuracy", done.said, re.M)  # the text, below them
    assert '"uri": "parts/guides/fail.yaml"' in Path(done.outputs["sarif"]).read_text(encoding="utf-8")


@pytest.mark.long
def test_names_of_files_are_names_of_files(installed: Ran, project: Path, room: Path) -> None:
    """Spaces, quotes, substitutions and dashes mean nothing to the shell and nothing to the parser."""
    name = "-a 'b\"$(touch pwned)`touch pwned`; *.yaml"
    shutil.copy(project / "pass.yaml", project / name)
    done = gate(installed, project, room, designs=f"  {name}\npass.yaml", mode="analytic")
    assert done.code == 0, done.said
    record = json.loads(Path(done.outputs["record"]).read_text(encoding="utf-8"))
    assert [entry["file"] for entry in record["designs"]] == [name, "pass.yaml"]
    assert not (project / "pwned").exists()


@pytest.mark.parametrize("given", [{"mode": "quick"}, {"max_regression": "-1"}, {"formats": "xml=a.xml"}])
def test_an_option_that_is_none_is_bad_input_and_leaves_no_record(
    installed: Ran, project: Path, room: Path, given: dict[str, str]
) -> None:
    done = gate(installed, project, room, designs="pass.yaml", **given)
    assert done.code == 2
    assert done.outputs == {"exit-code": "2", "verdict": "not evaluated"}


@pytest.mark.long
def test_a_baseline_makes_a_regression_a_finding(
    installed: Ran, project: Path, room: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(project)
    assert main(["gate", "pass.yaml", "--mode", "analytic", "--format", "json=baseline.json"]) == 0
    capsys.readouterr()
    wider = (project / "pass.yaml").read_text(encoding="utf-8").replace("half_width_deg: 0.10", "half_width_deg: 0.12")
    (project / "pass.yaml").write_text(wider, encoding="utf-8")
    options = {"designs": "pass.yaml", "mode": "analytic", "baseline": "baseline.json"}
    worse = gate(installed, project, room, **options)
    assert worse.code == 1
    assert "title=tailstack regression::" in worse.said
    assert gate(installed, project, room, **options, max_regression="50").code == 0


# --- the GitLab template --------------------------------------------------------------------------


def test_the_template_is_what_gitlab_reads() -> None:
    declared, body = template()
    validator = jsonschema.Draft7Validator(schema("gitlab-ci"))
    validator.validate({"spec": {"inputs": declared}})
    validator.validate(interpolated(source="https://git.example.com/g/tailstack.git", commit="c" * 40))
    assert set(re.findall(r"inputs\.(\w+)", body)) == declared.keys()
    for entry in declared.values():
        assert "options" not in entry or entry["default"] in entry["options"]
    assert {name for name, entry in declared.items() if "default" not in entry} == {"source", "commit"}
    script = "\n".join(next(iter(yaml.safe_load(body).values()))["script"])
    assert "$[[" not in script  # inputs reach the shell as variables


@pytest.mark.long
def test_the_job_gates_and_leaves_its_reports(project: Path, tmp_path: Path) -> None:
    """Installed from this checkout, then again from what the cache kept; the designs that fail fail the job."""
    python = python_with_libraries(tmp_path / "python").parent
    source, commit = shipped(tmp_path / "shipped")
    given = {
        "source": source, "commit": commit, "policy": "policy.yaml", "waivers": "waivers.yaml", "mode": "analytic",
        "job": "guides",
    }  # fmt: skip
    job = interpolated(**given, designs="pass.yaml w*d.yaml")["guides"]
    (project / ".tailstack").mkdir()  # the environment that a cache brings, of another commit
    (project / ".tailstack" / "installed").write_text("of before", encoding="utf-8")
    (project / "tailstack-gate").mkdir()
    (project / "tailstack-gate" / "stale").write_text("of before", encoding="utf-8")
    done = run_job(job, project, ["bash", "-eo", "pipefail"], python)
    assert done.code == 0, done.said
    assert not (project / "tailstack-gate" / "stale").exists()
    assert "accepted by waivers.yaml" in done.said
    made = project / ".tailstack" / "installed"
    before = made.stat().st_mtime_ns
    job = interpolated(**given, designs="pass.yaml fail.yaml waived.yaml")["guides"]
    assert run_job(job, project, ["bash", "-eo", "pipefail"], python).code == 1
    assert made.stat().st_mtime_ns == before
    reports = job["artifacts"]["reports"]
    quality = json.loads((project / reports["codequality"]).read_text(encoding="utf-8"))
    jsonschema.validate(quality, schema("gitlab-codequality"))
    assert [(entry["location"]["path"], entry["severity"]) for entry in quality] == [("fail.yaml", "critical")]
    suites = ElementTree.parse(project / reports["junit"]).getroot()
    assert [suite.get("name") for suite in suites] == ["pass.yaml", "fail.yaml", "waived.yaml"]
    assert job["artifacts"]["when"] == "always"
    assert all(Path(path).parts[0] == Path(job["artifacts"]["paths"][0]).parts[0] for path in reports.values())
    assert json.loads((project / "tailstack-gate" / "gate.json").read_text(encoding="utf-8"))["exit_code"] == 1


@pytest.mark.long("given0-2", "given2-2", "given5-3")
@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({"designs": "*.yaml"}, 2),  # policy.yaml and waivers.yaml are no designs
        ({"designs": "nothing/*.yaml"}, 2),
        ({"designs": ""}, 2),
        ({"designs": "pass.yaml", "policy": "no policy.yaml"}, 2),
        ({"designs": "p?ss.yaml", "source": "/nowhere", "commit": "f" * 40}, 3),
        ({"designs": "p?ss.yaml", "source": "--upload-pack=touch pwned", "commit": "f" * 40}, 3),
    ],
)
def test_a_job_never_passes_what_was_not_judged(
    given: dict[str, str], code: int, project: Path, tmp_path: Path
) -> None:
    """The environment that is there is taken for that of the commit; its command is the checkout's."""
    kept = "c" * 40
    job = interpolated(**{"mode": "analytic", "source": "/nowhere", "commit": kept, **given})["tailstack-gate"]
    python = python_with_libraries(tmp_path / "python")
    made = project / ".tailstack" / "bin"
    made.mkdir(parents=True)
    shutil.copy(python, made / "python")
    version = "Python " + ".".join(map(str, sys.version_info[:3]))
    stamp = f"{version} {project} {kept}"
    (project / ".tailstack" / "installed").write_text(stamp, encoding="utf-8")
    assert run_job(job, project, ["sh", "-e"], python.parent).code == code
    assert not (project / "pwned").exists()


# --- the pre-commit hook --------------------------------------------------------------------------


@pytest.mark.parametrize(("file", "taken"), read_cases("files", "hook"))
def test_the_hook_looks_at_what_a_verdict_hangs_on(file: str, taken: bool) -> None:
    assert chosen(HOOKS[0], [file]) == ([file] if taken else [])


def test_the_hook_is_one_that_pre_commit_takes_for_every_ending_of_what_a_design_names() -> None:
    assert all(chosen(HOOKS[0], [f"designs/beads{ending}"]) for ending in (*ENDINGS, *DOCUMENTS))
    (hook,) = HOOKS
    assert HOOK_NEEDS <= hook.keys() <= HOOK_KEYS
    assert hook["id"] == "tailstack-gate"
    assert (hook["language"], hook["pass_filenames"], hook["require_serial"]) == ("script", True, True)
    assert os.access(ROOT / shlex.split(hook["entry"])[0], os.X_OK)


def chosen(hook: dict[str, Any], files: list[str]) -> list[str]:
    """The files that pre-commit would hand over, of any type: it searches the expression."""
    assert not hook.keys() & {"types", "types_or", "exclude"}
    return [file for file in files if re.search(hook["files"], file)]


def test_what_hangs_on_a_change_is_judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A table of beads: the designs that name it; policy, waivers, baseline: all that Git has."""
    git(tmp_path, "init", "-q")
    text = (EXAMPLE / "pass.yaml").read_text(encoding="utf-8")
    for name in ("a", "b", "sub/c"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        file = "../beads.csv" if "/" in name else "beads.csv"
        body = text if name == "b" else f"schema: tailstack/design/1\nfiducials: {{ file: {file} }}\n"
        (tmp_path / f"{name}.yaml").write_text(body, encoding="utf-8")
    for name, body in {
        "beads.csv": "label,x_mm,y_mm,z_mm\n", "policy.yaml": "schema: tailstack/policy/1\n", "other.csv": "",
        "k8s/policy.yaml": "kind: NetworkPolicy\n", "damaged.yaml": "schema: tailstack/desgn/1\n",
        "waivers.yaml": "# of tailstack/design/1\nschema: tailstack/waivers/1\n",
        "result.json": '{"schema": "tailstack/score/1"}', "seat.step": "ISO-10303-21;",
        "d.yaml": "schema: tailstack/design/1\nfiducials: { origin: { file: other.csv } }\n"
        "interfaces: { connector_flange: { drawing: { file: seat.step } } }\n",
    }.items():  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(body, encoding="utf-8")
    git(tmp_path, "add", "--all")
    (tmp_path / "untracked.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "link.yaml").symlink_to("beads.csv")
    monkeypatch.chdir(tmp_path)
    every = {"a.yaml", "b.yaml", "d.yaml", "sub/c.yaml"}
    for changed, judged in {
        ("a.yaml",): {"a.yaml"}, ("beads.csv",): {"a.yaml", "sub/c.yaml"}, ("other.csv",): set(),
        ("policy.yaml",): every, ("waivers.yaml", "b.yaml"): every, ("k8s/policy.yaml",): set(),
        ("damaged.yaml",): {"damaged.yaml"}, ("result.json",): set(), ("beads.csv", "b.yaml"): every - {"d.yaml"},
        ("gone.yaml",): {"gone.yaml"}, ("seat.step",): {"d.yaml"}, ("link.yaml",): {"a.yaml", "sub/c.yaml"},
    }.items():  # fmt: skip
        found = list_affected(list(changed), ["policy.yaml", "waivers.yaml", None])
        assert {os.path.relpath(name) for name in found} == judged, changed


def test_a_policy_that_is_not_the_one_judged_by_changes_nothing(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(project)
    assert main(["gate", "--changed", "policy.yaml", "--mode", "analytic"]) == 0
    assert "no design hangs on what changes" in capsys.readouterr().err
    assert main(["gate", "--changed", "policy.yaml", "--policy", "policy.yaml", "--mode", "analytic"]) == 1
    monkeypatch.setenv("PATH", "")
    assert main(["gate", "--changed", "policy.yaml", "--mode", "analytic"]) == 2


def hooked(project: Path) -> Ran:
    """``pre-commit run --all-files``, as pre-commit runs a hook of language script: from its own copy of what ships,
    in the folder of the designs."""
    (entry,) = yaml.safe_load((project / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    (used,) = entry["hooks"]
    (hook,) = ({**hook, **used} for hook in HOOKS if hook["id"] == used["id"])
    files = chosen(hook, git(project, "ls-files").splitlines())
    program, *words = shlex.split(hook["entry"])
    return call(project, str(ROOT / program), *words, *hook["args"], *files)


@pytest.mark.long
def test_the_hook_stops_a_commit_that_fails_and_lets_one_pass(project: Path) -> None:
    done = hooked(project)
    assert done.code == 1
    assert re.search(r"fail\.yaml:\d+:\d+: error: tip-accuracy", done.said), done.said
    assert "accepted by waivers.yaml" in done.said
    (project / "fail.yaml").unlink()
    # On its limit to first order: the pipeline decides
    near = (project / "pass.yaml").read_text(encoding="utf-8").replace("limit_mm: 0.8", "limit_mm: 0.55")
    (project / "pass.yaml").write_text(near, encoding="utf-8")
    git(project, "add", "--all")
    done = hooked(project)
    assert done.code == 0, done.said
    assert "inconclusive" in done.said


# --- the worked example and the page --------------------------------------------------------------


def test_the_waivers_of_the_example_were_within_their_days() -> None:
    """Read on the first day on which they may be: nothing here fails on the day after the last."""
    (waiver,) = yaml.safe_load((EXAMPLE / "waivers.yaml").read_text(encoding="utf-8"))["waivers"]
    (read,) = read_waivers(EXAMPLE / "waivers.yaml", waiver["expires"] - timedelta(days=180)).entries
    assert read.rule == "p95"


def test_the_workflows_of_the_example_are_what_their_readers_take() -> None:
    workflow = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))
    workflow["on"] = workflow.pop(True)  # which "on" is in YAML 1.1, and not at GitHub
    jsonschema.Draft7Validator(schema("github-workflows")).validate(workflow)
    pipeline = yaml.safe_load((EXAMPLE / ".gitlab-ci.yml").read_text(encoding="utf-8"))
    jsonschema.Draft7Validator(schema("gitlab-ci")).validate(pipeline)


def blocks() -> list[tuple[str, Any]]:
    """YAML of the example and of the page that uses what ships."""
    found = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    files = [WORKFLOW, EXAMPLE / ".gitlab-ci.yml", EXAMPLE / ".pre-commit-config.yaml"]
    texts = [*found, *(path.read_text(encoding="utf-8") for path in files)]
    return [(text, yaml.load(text, yaml.BaseLoader)) for text in texts]


def mappings(node: Any) -> list[dict[str, Any]]:
    return [found for path in places_of(node) if isinstance(found := value_at(node, path), dict)]


def test_what_ships_is_used_with_inputs_that_it_has() -> None:
    used = {"action": 0, "template": 0, "hook": 0}
    for text, data in blocks():
        for entry in mappings(data):
            if "/tailstack@" in str(entry.get("uses")):
                used["action"] += 1
                assert entry.get("with", {}).keys() <= ACTION["inputs"].keys(), text
                assert "designs" in entry["with"]
            if "component" in entry or "remote" in entry:
                used["template"] += 1
                assert entry.get("inputs", {}).keys() <= template()[0].keys(), text
            if entry.get("id") == HOOKS[0]["id"]:
                used["hook"] += 1
                assert entry.keys() <= HOOK_KEYS
    assert all(count >= 2 for count in used.values()), used


def test_pipelines_name_commits_and_no_tag_that_is_not_there() -> None:
    """Whoever copies them says which commit; actions of others are named by the commits of their releases."""
    texts = [text for text, _ in blocks()] + [(ROOT / "templates" / "gate.yml").read_text(encoding="utf-8"), PAGE]
    named = {found for text in texts for found in re.findall(r"(?:tailstack(?:/gate)?@|rev: |/raw/)([\w.]+)", text)}
    assert named == {"COMMIT"}
    used = [str(entry["uses"]) for _, data in blocks() for entry in mappings(data) if "uses" in entry]
    others = [each for each in used if "/tailstack@" not in each]
    assert len(others) >= 8
    assert all(re.fullmatch(r"[\w-]+/[\w-]+(/[\w-]+)?@[0-9a-f]{40}", each) for each in others), others
    lines = [line for text in texts for line in text.splitlines() if "uses: " in line and "/tailstack@" not in line]
    assert all(re.search(r"@[0-9a-f]{40} # v\d+\.\d+\.\d+", line) for line in lines)


def test_jobs_are_bounded_and_may_do_no_more_than_they_must() -> None:
    workflow = yaml.load(WORKFLOW.read_text(encoding="utf-8"), yaml.BaseLoader)
    assert workflow["permissions"] == {}
    assert workflow["on"]["push"] == {"branches": ["main"]}  # a pull request is judged once, not twice
    for job in workflow["jobs"].values():
        assert int(job["timeout-minutes"]) <= 30
        assert job["permissions"] == {"contents": "read", "security-events": "write"}
        (key,) = (step["with"]["key"] for step in job["steps"] if step.get("uses", "").startswith("actions/cache@"))
        assert "steps.python.outputs.python-version" in key
    job = interpolated(source="-", commit="c" * 40)["tailstack-gate"]
    assert (job["timeout"], job["cache"]["key"]) == ("30 minutes", "tailstack-gate-" + "c" * 40)
    for installs in (job["script"], [entry["run"] for entry in ACTION["runs"]["steps"]]):
        text = "\n".join(installs)
        assert text.count("--require-hashes") == 1
        assert text.count("--no-deps --no-build-isolation") == 1
