"""``tailstack report --verify``: what is untouched is verified, whatever the format; what was touched is found."""

from __future__ import annotations

import importlib.metadata
import io
import json
import re
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from service_scenes import limited, small_design, write_json

from plain_data import replaced, value_at
from tailstack import TailstackError, load_design, optimise, score, verify
from tailstack.sweeping import read_axes, sweep
from tailstack_service import audit as audit_module
from tailstack_service.audit import Audit, Effort, audit
from tailstack_service.documents import to_json
from tailstack_service.operations.rendering import FORMATS, document_of, render
from tailstack_service.report.assembling import ReportContents, compute_report
from tailstack_service.report.comparing import compute_comparison
from tailstack_service.report.html import html_report
from tailstack_service.schemas import record_of

TRIALS = 4_000
DESIGN = limited(0.9)


@pytest.fixture(scope="module")
def body() -> bytes:
    return to_json(compute_report(load_design(DESIGN), ReportContents(trials=TRIALS, seed=3)))


@pytest.fixture(scope="module")
def files(body: bytes) -> dict[str, bytes]:
    return {form: render("report", body, form) for form in FORMATS}


@pytest.fixture(scope="module")
def summary(body: bytes) -> bytes:
    """The first page as PDF, by the writer of all pages."""
    return render("report", body, "pdf", summary=True)


def answers(found: Audit) -> dict[str, str]:
    return {question.what: question.answer for question in found.questions}


def details(found: Audit) -> str:
    return "\n".join(detail for question in found.questions for detail in (question.words, *question.details))


def changed(body: bytes, change: Callable[[Any], object]) -> bytes:
    """The record with something else in it, as canonical JSON."""
    data = json.loads(body)
    change(data)
    return to_json(record_of(data["schema"].split("/")[1], data))


# --- what is untouched ----------------------------------------------------------------------------


@pytest.mark.long("html-False", "pdf-True")
@pytest.mark.parametrize(
    ("form", "fast"), [*((form, True) for form in FORMATS), ("html", False), ("json", False)]
)  # what is computed again does not depend on where the record was read
def test_an_untouched_report_is_verified(files: dict[str, bytes], form: str, fast: bool) -> None:
    found = audit(files[form], "x", fast=fast)
    assert found.verdict == "verified", details(found)
    assert answers(found)["numbers"] == "same"
    assert ("taken on trust" in answers(found)) == fast


def test_json_that_was_laid_out_anew_is_the_same_record(body: bytes) -> None:
    assert audit(json.dumps(json.loads(body), indent=2).encode(), "x").verdict == "verified"


def test_an_adaptive_check_of_a_service_is_drawn_again() -> None:
    """A service allows another number of trials, which sets the looks and so the intervals."""
    options = ReportContents(precision=0.05, max_trials=30_000)
    made = compute_report(load_design(DESIGN), options)
    assert made.verification is not None
    assert made.verification.max_trials == 30_000
    assert "--max-trials 30000" in made.reproduction.commands[1]
    assert audit(to_json(made), "x").verdict == "verified"


@pytest.mark.long
def test_a_comparison_is_verified_and_its_numbers_are_its_own() -> None:
    second = replaced(DESIGN, ("views", 0, "fiducial_noise_px"), 0.2)
    made = to_json(compute_comparison(load_design(DESIGN), load_design(second), ReportContents(trials=TRIALS)))
    assert audit(render("comparison", made, "html"), "x").verdict == "verified"
    forged = changed(made, lambda data: data["differences"][0].update(difference_mm=-0.5))
    found = audit(render("comparison", forged, "html"), "x", fast=True)
    assert found.verdict == "differs"
    assert "/differences/0/difference_mm: recorded -0.5" in details(found)


@pytest.mark.long
def test_an_optimisation_is_run_again() -> None:
    design = small_design()
    design["optimise"] |= {"starts": 1, "seed": 5}
    made = to_json(optimise(load_design(design)))
    found = audit(changed(made, lambda data: data.update(cost_after=1.0)), "x")
    assert "/cost_after: recorded 1.0" in details(found)
    assert "\n1 of " in details(found)  # and nothing else
    moved = changed(made, lambda data: data["design"]["fiducials"]["points"][0]["position_mm"].__setitem__(0, 1.25))
    assert answers(audit(moved, "x", fast=True))["new design"] == "different"


def swept() -> bytes:
    design = load_design(DESIGN)
    axes = read_axes(design, [{"pointer": "/views/0/fiducial_noise_px", "values": [0.2, 0.3]}])
    return to_json(sweep(design, axes, check="verification", trials=500))


def optimised() -> bytes:
    design = small_design()
    design["optimise"] |= {"starts": 1, "seed": 5}
    return to_json(compute_report(load_design(design), ReportContents(parts=("score", "optimisation"))))


def per_unit() -> bytes:
    requirement = {"name": "each", "limit_mm": 2.0, "risk": "per_unit", "min_yield": 0.5}
    design = load_design(small_design(requirements=[{**requirement, "name": f"each {k}"} for k in range(2)]))
    return to_json(compute_report(design, ReportContents(trials=500)))


@pytest.mark.long("optimisation-change6-started 9,999 times-enough6")
@pytest.mark.parametrize(
    ("made", "change", "words", "enough"),
    [
        ("report", {"reproduction": {"trials": 10**9}}, "up to 1,000,000,000 trials", ["--max-trials", 10**9]),
        ("report", {"reproduction": {"trials": None, "max_trials": 10**9}}, "up to 1,000,000,000 trials",
         ["--max-trials", 10**9]),
        ("comparison", {"first": {"reproduction": {"trials": 10**8}}}, "up to 200,000,000 trials",
         ["--max-trials", 2 * 10**8]),
        ("verification", {"trials": 10**9}, "up to 1,000,000,000 trials", ["--max-trials", 10**9]),
        ("verification", {"precision_requested": 1e-6, "max_trials": 10**9}, "up to 1,000,000,000 trials",
         ["--max-trials", 10**9]),
        ("sweep", {"trials": 10**8}, "up to 200,000,000 trials", ["--max-trials", 2 * 10**8]),
        ("optimisation", {"reproduction": {"starts": 9999}}, "started 9,999 times", ["--starts", 9999]),
    ],
)  # fmt: skip
def test_a_record_that_asks_for_too_much_is_refused_at_once(
    body: bytes, tmp_path: Path, call: Any, monkeypatch: pytest.MonkeyPatch,
    made: str, change: dict[str, Any], words: str, enough: list[Any],
) -> None:  # fmt: skip
    """The refusal says what to type; typed, it is computed (which is not waited for here)."""

    def update(data: dict[str, Any], new: dict[str, Any]) -> None:
        for key, value in new.items():
            if isinstance(value, dict):
                update(data[key], value)
            else:
                data[key] = value

    design = load_design(DESIGN)
    honest = {
        "report": lambda: body,
        "comparison": lambda: to_json(compute_comparison(design, design, ReportContents(trials=TRIALS))),
        "verification": lambda: to_json(verify(design, trials=500)),
        "sweep": swept,
        "optimisation": optimised,
    }[made]()
    (tmp_path / "forged.json").write_bytes(changed(honest, lambda data: update(data, change)))
    given = [write_json(tmp_path / "design.json", DESIGN)] if made in ("verification", "sweep") else []
    monkeypatch.setattr(audit_module, "_number_questions", lambda *_, **__: pytest.fail("computed"))
    command = ["report", "--verify", tmp_path / "forged.json", *given]
    code, _, said = call(*command)
    assert (code, words in " ".join(said.split())) == (2, True)
    assert f"add {enough[0]} {enough[1]}, or --fast" in " ".join(said.split())
    asked = []
    monkeypatch.setattr(audit_module, "_number_questions", lambda *_, **__: asked.append(1) or [])
    assert call(*command, enough[0], str(enough[1] - 1))[0] == 2
    assert not asked
    assert call(*command, enough[0], str(enough[1]))[0] == 0
    assert call(*command, "--fast")[0] == 0
    assert len(asked) == 2


@pytest.mark.long
def test_units_of_requirements_are_counted_as_trials() -> None:
    """closed form: 2 requirements of 2048 units with 512 shots each, and 500 trials."""
    made, needed = per_unit(), 2 * 2048 * 512 + 500
    assert audit(made, "x", most=Effort(trials=needed)).verdict == "verified"
    with pytest.raises(TailstackError, match="up to 2,097,652 trials would be drawn to verify this, 2,097,152 of them"):
        audit(made, "x", most=Effort(trials=needed - 1))


def test_a_sweep_whose_axes_make_other_points_is_no_sweep() -> None:
    forged = changed(swept(), lambda data: data["axes"][0].update(values=[0.1 * k for k in range(1, 100_000)]))
    with pytest.raises(TailstackError, match="its axes make 99,999 points, the record holds 2"):
        audit(forged, "x", load_design(DESIGN))


@pytest.mark.parametrize("kind", ["score", "verification", "sweep"])
def test_a_result_without_its_design_takes_the_design(kind: str) -> None:
    design = load_design(DESIGN)
    axis = {"pointer": "/views/0/fiducial_noise_px", "values": [0.2, 0.3]}
    made = {
        "score": lambda: score(design, second_order=True),
        "verification": lambda: verify(design, trials=TRIALS, seed=9),
        "sweep": lambda: sweep(design, read_axes(design, [axis]), check="verification", trials=TRIALS, seed=4),
    }[kind]()
    content = render(kind, to_json(made), "html")
    assert audit(content, "x", design).verdict == "verified"
    assert answers(audit(content, "x", fast=True))["numbers"] == "trusted"


# --- what was touched -----------------------------------------------------------------------------


@pytest.mark.long
def test_a_changed_number_of_a_page_is_found(files: dict[str, bytes]) -> None:
    page = files["html"].decode()
    cell = re.search(r'<td class="number">(0\.\d{4})</td>', page)
    assert cell is not None
    forged = page[: cell.start(1)] + "0.1234" + page[cell.end(1) :]
    found = audit(forged.encode(), "x", fast=True)
    assert answers(found)["pages"] == "different"
    assert "0.1234" in details(found)
    assert f"line {page[: cell.start()].count(chr(10)) + 1}:" in details(found)


CHANGED = (
    ("score", "targets", 0, "p95_mm"), ("verification", "targets", 0, "worst_mm"),
    ("verification", "reprojection", "mean_px"), ("headline", "value"), ("allowances", 5, "cost"),
    ("distributions", 0, "sampled", 4),
)  # fmt: skip


@pytest.mark.long
def test_changed_numbers_of_the_record_are_found_even_if_the_pages_were_made_from_it(body: bytes) -> None:
    def forge(data: Any) -> None:
        for path in CHANGED:
            value_at(data, path[:-1])[path[-1]] *= 1.001

    found = audit(render("report", changed(body, forge), "html"), "x")
    assert answers(found)["pages"] == "same"
    assert answers(found)["numbers"] == "different"
    for path in CHANGED:
        assert "/" + "/".join(map(str, path)) + ": recorded" in details(found)
    assert f"\n{len(CHANGED)} of " in details(found)  # and nothing else


def test_another_design_under_the_same_numbers_is_found(body: bytes) -> None:
    def forge(data: Any) -> None:
        data["design"]["views"][0]["fiducial_noise_px"] = 0.31

    found = audit(changed(body, forge), "x", fast=True)
    assert answers(found)["design"] == "different"
    assert answers(found)["numbers"] == "different"


@pytest.mark.long
@pytest.mark.hostile
def test_every_number_of_the_record_counts(files: dict[str, bytes], run_seed: int) -> None:
    """Digits all over the record of the HTML file, one at a time, 8 places: each is found, or the record refused.

    Error rate: none, whatever the places are.
    """
    page = files["html"].decode()
    start = page.index('id="tailstack-record">') + len('id="tailstack-record">')
    end = page.index("</script>", start)
    places = [start + match.start() for match in re.finditer(r"(?<=[.\d])[1-8](?=\d)", page[start:end])]
    apart = len(places) // 8
    for place in places[(7 + 101 * run_seed) % apart :: apart]:
        forged = page[:place] + str(int(page[place]) + 1) + page[place + 1 :]
        assert judged(forged.encode()) != "verified", page[place - 60 : place + 10]


def judged(content: bytes) -> str:
    """The verdict on a file, or that it was refused."""
    try:
        return audit(content, "x", fast=True).verdict
    except TailstackError:
        return "refused"


def repacked(content: bytes, member: str, change: Callable[[str], str]) -> bytes:
    """A spreadsheet with one part changed."""
    target = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as new:
        for part in old.infolist():
            data = old.read(part)
            new.writestr(part, change(data.decode()).encode() if part.filename == member else data)
    return target.getvalue()


@pytest.mark.long
def test_the_part_of_a_changed_cell_is_named(files: dict[str, bytes]) -> None:
    book = files["xlsx"]
    same = repacked(book, "xl/workbook.xml", lambda text: text)
    assert audit(same, "x", fast=True).verdict == "verified"
    with zipfile.ZipFile(io.BytesIO(book)) as archive:
        names = re.findall(r'<sheet name="([^"]*)"', archive.read("xl/workbook.xml").decode())
        member = f"xl/worksheets/sheet{names.index('Budget') + 1}.xml"
    forged = repacked(book, member, lambda text: re.sub(r"(<c r=\"F4\"[^>]*><v>)[^<]*", r"\g<1>9.75", text))
    found = audit(forged, "x", fast=True)
    assert answers(found)["pages"] == "different"
    assert re.search(rf"{member}: the file has '.*9\.75", details(found))
    shared = repacked(book, "xl/sharedStrings.xml", lambda text: text.replace("The design ", "No design ", 1))
    assert re.search(r"xl/sharedStrings.xml: the file has '.*No design ", details(audit(shared, "x", fast=True)))


def test_a_changed_page_of_a_pdf_is_found(summary: bytes) -> None:
    content = summary
    streams = list(re.finditer(rb"/Length (\d+)>>\nstream\n", content))
    for found in streams:
        packed = content[found.end() : found.end() + int(found.group(1))]
        try:
            text = zlib.decompress(packed)
        except zlib.error:
            continue
        if b" re\n" not in text or b"BT" not in text:
            continue
        again = zlib.compress(text.replace(b" re\n", b" re \n", 1))
        head = content[: found.start()] + b"/Length %d>>\nstream\n" % len(again)
        forged = head + again + content[found.end() + len(packed) :]
        assert answers(audit(forged, "x", fast=True))["pages"] == "different"
        return
    pytest.fail("no page was found in the PDF")


@pytest.mark.long
def test_a_pdf_that_was_changed_between_its_streams_is_found(files: dict[str, bytes]) -> None:
    """A drawing of the same length that is clipped away, and a table of places that was changed."""
    content = files["pdf"]
    box = re.search(rb"/BBox \[[^\]]*\]", content)
    assert box is not None
    clipped = content[: box.start()] + re.sub(rb"[1-9]", b"0", box.group()) + content[box.end() :]
    found = audit(clipped, "x", fast=True)
    assert (answers(found)["pages"], found.verdict) == ("different", "differs")
    start = content.rindex(b"stream\n", 0, content.rindex(b"endstream")) + len(b"stream\n")
    end = content.rindex(b"\nendstream")
    places = bytearray(zlib.decompress(content[start:end]))
    places[-1] ^= 1
    moved = content[:start] + zlib.compress(bytes(places), 1) + content[end:]
    moved = re.sub(
        rb"(/Type /XRef.*?/Length )\d+", lambda m: m[1] + b"%d" % (len(moved) - len(content) + end - start), moved
    )
    assert audit(moved, "x", fast=True).verdict == "not verified"


# --- what cannot be compared ----------------------------------------------------------------------


@pytest.mark.long
def test_pages_of_another_version_are_not_compared(body: bytes) -> None:
    old = changed(body, lambda data: [data[part]["provenance"].update(tailstack_version="0.0.9")
                                      for part in ("score", "verification")]
                  + [data["provenance"].update(tailstack_version="0.0.9")])  # fmt: skip
    found = audit(html_report(document_of("report", old), old).encode(), "x", fast=True)
    assert answers(found) | {"numbers": "same"} == answers(found)
    assert found.verdict == "not verified"
    assert "install that version" in details(found)


def test_other_sources_of_the_same_version_may_compute_the_same(body: bytes) -> None:
    """Then it is verified; and where a number differs, it says that another code computed it."""

    def elsewhere(data: Any, factor: float = 1.0) -> None:
        for part in (data, data["score"], data["verification"]):
            part["provenance"]["sources_sha256"] = "0" * 64
        data["score"]["targets"][0]["p95_mm"] *= factor

    found = audit(changed(body, elsewhere), "x", fast=True)
    assert found.verdict == "verified", details(found)
    found = audit(changed(body, lambda data: elsewhere(data, 1.01)), "x", fast=True)
    assert found.verdict == "differs"
    assert "by other sources of tailstack" in details(found)
    older = changed(body, lambda data: [part["provenance"].pop("sources_sha256") for part in (data, data["score"])])
    assert audit(older, "x", fast=True).verdict == "verified"


def test_charts_of_another_matplotlib_are_not_compared(files: dict[str, bytes]) -> None:
    """Another version may draw the same chart in other bytes: that is no sign of a change."""
    version = importlib.metadata.version("matplotlib")
    assert f"charts by matplotlib {version}".encode() in files["html"]
    other = files["html"].replace(f"matplotlib {version}".encode(), b"matplotlib 3.9.0").replace(b'r="3.', b'r="2.')
    found = audit(other, "x", fast=True)
    assert found.verdict == "not verified"
    assert f"made with matplotlib 3.9.0, here with matplotlib {version}" in details(found)


# --- the command ----------------------------------------------------------------------------------


@pytest.mark.long
def test_exit_codes(files: dict[str, bytes], tmp_path: Path, call: Any, refused: Any) -> None:
    page = tmp_path / "a.html"
    page.write_bytes(files["html"])
    code, out, _ = call("report", "--verify", "--fast", str(page))
    assert code == 0
    assert out.splitlines()[0].startswith(f"{page}: eight beads")
    assert out.splitlines()[-1] == "verified"
    page.write_bytes(files["html"].replace(b"<li>", b"<li> ", 1))
    code, out, _ = call("report", "--verify", "--fast", str(page))
    assert code == 1
    assert out.splitlines()[-1] == "differs"
    assert "--seed" in refused("report", "--verify", "--fast", "--seed", "3", page)
    assert "no such file" in refused("report", "--verify", tmp_path / "absent.html")
    assert "take the HTML, PDF, XLSX or JSON" in refused("report", "--verify", tmp_path / "a.supplier.csv")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.html", b"<!DOCTYPE html><p>no report</p>", "this file has 0"),
        ("a.pdf", b"%PDF-1.7\nnothing", "one attachment"),
        ("a.pdf", b"%PDF-1.7\n<< /Type /EmbeddedFile /Length " + b"1" * 5000 + b">>\nstream\n", "one attachment"),
        ("a.xlsx", b"PK\x03\x04broken", "cannot be unpacked"),
        ("a.json", b"", "empty"),
        ("a.json", b'{"schema": "tailstack/report/1"}', "title"),
        ("a.json", b'{"schema": "tailstack/report/9"}', "no report is made of"),
        ("a.json", b"[1, 2]", "of which schema"),
        ("a.yaml", b"schema: tailstack/design/1", "give a file that tailstack report wrote"),
        ("a.json", b"\xff\xfe\x00", "not"),
    ],
)
def test_what_is_no_report_is_refused(name: str, content: bytes, words: str, tmp_path: Path, refused: Any) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    said = refused("report", "--verify", path)
    assert words in said
    assert str(path) in said


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: data["score"]["targets"][0].update(p95_mm="wide"), "/score/targets/0/p95_mm"),
        (lambda data: data["score"]["targets"][0].pop("p95_mm"), "/score/targets/0"),
        (lambda data: data["score"].update(extra=1), "/score/extra"),
        (lambda data: data["verification"].update(trials=True), "/verification/trials"),
        (lambda data: data["headline"].update(status="fine"), "/headline/status"),
        (lambda data: data["score"].update(targets=[]), "/score/targets"),
        (lambda data: data["verification"].update(targets=[]), "/verification/targets"),
    ],
)
def test_a_malformed_result_is_refused_with_its_line(
    change: Callable[[Any], None], words: str, body: bytes, tmp_path: Path, refused: Any
) -> None:
    data = json.loads(body)
    change(data)
    path = tmp_path / "result.json"
    path.write_text(json.dumps(data, indent=1), encoding="utf-8")
    for arguments in ((path, "-o", tmp_path), ("--verify", path)):
        said = refused("report", *arguments)
        assert words in said
        assert re.search(rf"{re.escape(str(path))}:\d+:\d+: ", said), said


def test_a_result_without_its_design_asks_for_it(tmp_path: Path, call: Any, refused: Any) -> None:
    path, right = tmp_path / "score.json", write_json(tmp_path / "right.json", DESIGN)
    path.write_bytes(to_json(score(load_design(DESIGN))))
    wrong = write_json(tmp_path / "wrong.json", limited(0.9, name="another"))
    assert call("report", "--verify", path, right)[0] == 0
    assert "FILE DESIGN" in refused("report", "--verify", path)
    code, said, _ = call("report", "--verify", path, wrong)
    assert (code, said.splitlines()[-1]) == (1, "differs")
    assert "\n! design   this is another design: its SHA-256 is " in said
    assert "does not hold the design" in refused("report", path, right, "-o", tmp_path)


@pytest.mark.parametrize("form", FORMATS)
def test_a_report_in_any_format_is_rendered_again(
    files: dict[str, bytes], form: str, tmp_path: Path, call: Any
) -> None:
    path = tmp_path / f"old.{form}"
    path.write_bytes(files[form])
    code, _, _ = call("report", str(path), "--format", "html,json", "-o", str(tmp_path / "out"))
    assert code == 0
    assert (tmp_path / "out" / "old.html").read_bytes() == files["html"]
    assert (tmp_path / "out" / "old.report.json").read_bytes() == files["json"]


@pytest.mark.long
def test_an_audit_of_another_kind_of_number_is_exact() -> None:
    """A rate of 1e-10 is seen in a number, and 1e-8 is a difference."""
    made = compute_report(load_design(DESIGN), ReportContents(parts=("score",)))
    target = made.score.targets[0]
    for factor, verdict in ((1 + 1e-10, "verified"), (1 + 1e-8, "differs")):
        nudged = replace(target, mean_norm_mm=target.mean_norm_mm * factor)
        forged = replace(made, score=replace(made.score, targets=(nudged,)))
        found = audit(to_json(forged), "x")
        assert found.verdict == verdict
        assert "to the last digit" in details(found) or verdict == "differs"
