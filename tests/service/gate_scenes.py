"""Gates of every exit code, run as a user runs them, in every format at once.

``python tests/service/gate_scenes.py`` (with PYTHONPATH=solver:service:tests) writes the golden files anew; look at
what has changed with ``git diff tests/data/gate`` before it is committed.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any
from unittest.mock import patch

from service_scenes import ROOT, coplanar_design, limited, sound_design

from tailstack.design.write import data_to_yaml
from tailstack.version import __version__
from tailstack_service.cli.main import main
from tailstack_service.documents import to_json
from tailstack_service.gate.judge import judge
from tailstack_service.gate.records import GateFinding, GateRecord
from tailstack_service.gate.request import admit_gate
from tailstack_service.schemas import record_of

GOLDEN = ROOT / "tests" / "data" / "gate"
RULES = GOLDEN / "rules.json"  # of every SARIF file
FORMATS = {
    "text": "txt", "json": "json", "sarif": "sarif", "junit": "xml", "github": "github", "gitlab": "gitlab.json",
    "markdown": "md", "needs": "needs.json", "reqif": "reqif",
}  # fmt: skip
DERIVED = ("needs", "reqif")  # have no golden files: test_requirement_ids.py reads them beside the records
TODAY = date(2026, 11, 21)
PASSING, NEAR, FAILING = 1.4, 0.65, 0.3  # limits in mm; P95 of the small design is about 0.65 mm
STRICT: dict[str, Any] = {"schema": "tailstack/policy/1", "name": "guides", "rules": {"overlap": {"severity": "off"}}}
_DIGITS = re.compile(r"-?\d+\.\d{6,}(?:[eE][-+]?\d+)?")
_HASH = re.compile(r'("\w*[sS]ha256": )"[0-9a-f]{64}"')


@dataclass(frozen=True)
class Scene:
    """Files, the arguments of ``tailstack gate`` and the exit code that they come to."""

    exit_code: int
    files: dict[str, Any]  # name: document
    arguments: tuple[str, ...]
    broken_off_by: type[BaseException] | None = None
    before: dict[str, Any] | None = None  # files of an earlier gate, to first order: its record is baseline.json


def policy(rules: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """A policy; images of the small design come as near as 5 px, which is not what is tested here."""
    return {"schema": "tailstack/policy/1", "rules": {"overlap": {"severity": "off"}, **(rules or {})}, **more}


def judge_files(files: Mapping[str, dict[str, Any] | str], **more: Any) -> GateRecord:
    """What a gate in mode analytic says of designs, plain data or texts, by the names of their files."""
    entries = [
        {"file": name, "text" if isinstance(design, str) else "design": design} for name, design in files.items()
    ]
    body = {"designs": entries, "mode": "analytic", "policy": policy(), **more}
    return judge(admit_gate(body, today=TODAY).gate)


def plain_record(record: GateRecord) -> dict[str, Any]:
    """The record as a baseline has it."""
    plain: dict[str, Any] = json.loads(to_json(record))
    return plain


def of_rule(record: GateRecord, rule: str) -> list[GateFinding]:
    return [finding for finding in record.findings if finding.rule == rule]


def waivers(days: int, **changes: Any) -> dict[str, Any]:
    entry = {
        "rule": "p95", "owner": "J. Doe, systems", "reason": "first article only; the seat is reworked in rev C",
        "designs": ["good.yaml", "bad.yaml"], "max_value": 0.8,
        "expires": date.fromordinal(TODAY.toordinal() + days).isoformat(), **changes,
    }  # fmt: skip
    return {"schema": "tailstack/waivers/1", "waivers": [entry]}


CLOSE = {**STRICT, "rules": {"overlap": {"min_px": 30}}}  # nearer than that images are remarked, as a warning
GOOD, BAD, OPEN = limited(PASSING), limited(FAILING), limited(NEAR)
OFF = {**STRICT, "rules": {**STRICT["rules"], "p95": {"severity": "off"}}}
UNITS = {"name": "units", "limit_mm": PASSING, "risk": "per_unit", "min_yield": 0.5}
BOTH = sound_design(requirements=[{"name": "tip-accuracy", "limit_mm": FAILING}, UNITS], optimise=None)
WEAK = {"name": "weak", "files": ["new*"], "rules": {"p95": {"severity": "warning"}}}
QUICK = ("--policy", "policy.yaml", "--mode", "analytic")
SCENES: dict[str, Scene] = {
    "pass": Scene(0, {"good.yaml": GOOD, "policy.yaml": STRICT}, ("good.yaml", *QUICK)),
    "warned": Scene(0, {"good.yaml": GOOD, "policy.yaml": CLOSE}, ("good.yaml", *QUICK)),
    "waived": Scene(
        0, {"bad.yaml": BAD, "policy.yaml": STRICT, "waivers.yaml": waivers(30)},
        ("bad.yaml", *QUICK, "--waivers", "waivers.yaml"),
    ),
    "open-warned": Scene(
        0, {"open.yaml": OPEN, "policy.yaml": STRICT}, ("open.yaml", *QUICK, "--on-inconclusive", "warn")
    ),
    "fail": Scene(
        1, {"good.yaml": GOOD, "bad.yaml": BAD, "policy.yaml": STRICT}, ("good.yaml", "b*.yaml", *QUICK)
    ),
    "not-judged": Scene(0, {"both.yaml": BOTH, "policy.yaml": OFF}, ("both.yaml", *QUICK)),
    "relaxed": Scene(
        1, {"new.yaml": limited(50.0, name="drill guide, rev A"), "policy.yaml": {**STRICT, "classes": [WEAK]},
            "waivers.yaml": waivers(30, designs=["*"], max_value=200.0)},
        ("new.yaml", *QUICK, "--waivers", "waivers.yaml", "--baseline", "baseline.json"),
        before={"good.yaml": GOOD},
    ),
    "expired": Scene(
        1, {"good.yaml": GOOD, "policy.yaml": STRICT, "waivers.yaml": waivers(-1)},
        ("good.yaml", *QUICK, "--waivers", "waivers.yaml"),
    ),
    "decided": Scene(
        1, {"near.yaml": limited(0.62), "policy.yaml": STRICT}, ("near.yaml", "--policy", "policy.yaml")
    ),
    "invalid": Scene(
        2, {"good.yaml": GOOD, "broken.yaml": {"schema": "tailstack/design/1", "name": "half a design"}},
        ("broken.yaml", "good.yaml", "absent.yaml", "--mode", "analytic"),
    ),
    "refused": Scene(
        2, {"good.yaml": GOOD, "policy.yaml": {**STRICT, "rules": {"p95": {"limit": 2.0}}}}, ("good.yaml", *QUICK)
    ),
    "not-evaluated": Scene(
        3, {"flat.yaml": coplanar_design(), "good.yaml": GOOD, "policy.yaml": STRICT,
            "bare.yaml": sound_design(requirements=None, optimise=None)},
        ("flat.yaml", "good.yaml", "bare.yaml", *QUICK),
    ),
    "switched-off": Scene(3, {"bad.yaml": BAD, "policy.yaml": OFF}, ("bad.yaml", *QUICK)),
    "open": Scene(4, {"open.yaml": OPEN, "policy.yaml": STRICT}, ("open.yaml", *QUICK)),
    "interrupted": Scene(
        130, {"good.yaml": GOOD, "policy.yaml": STRICT}, ("good.yaml", *QUICK), broken_off_by=KeyboardInterrupt
    ),
}  # fmt: skip


def run(scene: Scene, folder: Path) -> tuple[int, dict[str, bytes]]:
    """Exit code and what was written in each format, by a gate that runs in ``folder``."""
    write_documents(folder, scene.files)
    wanted = [f"--format={name}=out.{end}" for name, end in FORMATS.items()]
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.chdir(folder))
        stack.enter_context(patch("tailstack_service.cli.gate.today", lambda: TODAY))
        stack.enter_context(patch.dict(os.environ))
        for variable in ("GITHUB_STEP_SUMMARY", "GITHUB_WORKSPACE", "CI_PROJECT_DIR", "TAILSTACK_TRACEBACK"):
            os.environ.pop(variable, None)
        if scene.before is not None:
            write_documents(folder, scene.before)
            main(["gate", *scene.before, "--mode", "analytic", "--format", "json=baseline.json"])
            for name in scene.before:
                (folder / name).unlink()
        if scene.broken_off_by is not None:
            failure = scene.broken_off_by("the linear algebra gave up")
            stack.enter_context(patch("tailstack_service.gate.judge.judge", side_effect=failure))
        code = main(["gate", *scene.arguments, *wanted])
    return code, {name: (folder / f"out.{end}").read_bytes() for name, end in FORMATS.items()}


def write_documents(folder: Path, documents: dict[str, Any]) -> None:
    for name, document in documents.items():
        write_document(folder / name, document)


def write_document(path: Path, document: Any) -> Path:
    """Writes a text as it is and plain data as YAML, with the folders above."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(document if isinstance(document, str) else data_to_yaml(document), encoding="utf-8")
    return path


def read_gate_record(path: Path) -> GateRecord:
    found: GateRecord = record_of("gate", json.loads(path.read_text(encoding="utf-8")))
    return found


def gate_in(folder: Path, *arguments: object) -> tuple[int, GateRecord]:
    """Exit code and record of ``tailstack gate`` in mode analytic, run in the folder."""
    out = folder / "gate.json"
    with contextlib.chdir(folder):
        code = main(["gate", *map(str, arguments), "--mode", "analytic", f"--format=json={out}"])
    record = read_gate_record(out)
    out.unlink()
    return code, record


def waivers_of_today(*designs: str) -> dict[str, Any]:
    """Waivers of these designs that hold for another month, whatever day it is."""
    return waivers((datetime.now(UTC).date() - TODAY).days + 30, designs=list(designs))


def laid_out(data: Any) -> str:
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


def settled(name: str, content: bytes) -> str:
    """What does not change from machine to machine: six digits, no version, no hash of a document; without the rules
    of SARIF, which are the same in all of them."""
    text = content.decode()
    if name == "sarif":
        log = json.loads(text)
        del log["runs"][0]["tool"]["driver"]["rules"]
        text = laid_out(log)
    if name == "json":
        text = laid_out(json.loads(text))
    text = _DIGITS.sub(lambda found: f"{float(found.group()):.6g}", text)
    return _HASH.sub(r'\1"..."', text).replace(__version__, "VERSION")


def sarif_rules(content: bytes) -> str:
    """The rules of a SARIF file, without their texts, which are the pages of ``--explain``."""
    rules = json.loads(content)["runs"][0]["tool"]["driver"]["rules"]
    for rule in rules:
        for field in ("fullDescription", "help"):
            rule[field] = dict.fromkeys(rule[field], "...")
    return laid_out(rules).replace(__version__, "VERSION")


def golden(scene: str, name: str) -> Path:
    return GOLDEN / f"{scene}.{FORMATS[name]}"


def regenerate() -> None:
    GOLDEN.mkdir(parents=True, exist_ok=True)
    for old in GOLDEN.iterdir():
        old.unlink()
    for title, scene in SCENES.items():
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()):
            code, contents = run(scene, Path(folder))
        print(f"{title}: exit code {code}" + ("" if code == scene.exit_code else f", EXPECTED {scene.exit_code}"))
        for name in FORMATS.keys() - DERIVED:
            content = contents[name]
            golden(title, name).write_text(settled(name, content), encoding="utf-8")
        RULES.write_text(sarif_rules(contents["sarif"]), encoding="utf-8")


if __name__ == "__main__":
    regenerate()
