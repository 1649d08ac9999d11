"""What ``tailstack optimise`` leaves on the disk: the author's text with the new numbers, fiducials, a patch."""

from __future__ import annotations

import difflib
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from openapi_scenes import changed_document
from optimisation_scenes import full_result
from service_scenes import EXAMPLES
from test_plain_words import met_in

from plain_data import read_cases
from tailstack.design import Design, Revision, design_to_data, load_design, revise_design
from tailstack.optimisation import optimise
from tailstack.results import Finding
from tailstack_service.cli.main import main
from tailstack_service.operations.optimisation import OPERATION
from tailstack_service.schemas import read_record

WITH_FREEDOM = [path for path in sorted(EXAMPLES.glob("*.yaml")) if "\noptimise:\n" in path.read_text(encoding="utf-8")]
Found = Callable[[Design, Revision], Design]


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A folder with the example designs, and nothing else."""
    shutil.copytree(EXAMPLES, tmp_path / "room", ignore=shutil.ignore_patterns("ci-gate", "measurements", "paper"))
    return tmp_path / "room"


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Found:
    """Make the optimiser answer with a revision of a design, and give that."""

    def answer(design: Design, revision: Revision) -> Design:
        new, before = revise_design(design, revision), design_to_data(load_design(EXAMPLES / "demo.yaml"))
        result = full_result(design=design_to_data(new), design_before=before)
        monkeypatch.setattr("tailstack.optimise", lambda _design, **_options: result, raising=False)
        monkeypatch.setattr("tailstack.optimisation.influence", lambda _d: (Finding("floor", "note", "n"),))
        return new

    return answer


def comments_of(text: str) -> list[str]:
    return re.findall(r"(?m)(?:^|\s)(#.*)$", text)


def lines_that_differ(before: str, after: str) -> list[str]:
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm="")
    return [line[1:] for line in lines if line[0] == "-" and not line.startswith("---")]


@pytest.mark.long
@pytest.mark.parametrize("path", WITH_FREEDOM, ids=lambda path: path.stem)
def test_an_existing_file_keeps_everything_but_the_numbers_that_were_asked_for_and_the_answer_is_plain(
    call: Any, room: Path, path: Path
) -> None:
    """The optimiser's own answer, in each example; what a terminal shows of it is read off its record."""
    new = room / path.name  # the design itself
    before = new.read_text(encoding="utf-8")
    code, out, _ = call("optimise", new, "-o", new, "--starts", "1", "--json")
    assert code in (0, 1, 4)
    after = new.read_text(encoding="utf-8")
    record = read_record("optimisation", out.encode())
    assert load_design(new).sha256 == record.provenance.design_sha256
    text = OPERATION.write(record)
    assert met_in(text) == []
    assert "how sure" in text.lower()
    assert max(map(len, text.splitlines())) <= 80
    numbers = r"position_mm|half_width|pivot_mm"
    differing = lines_that_differ(before, after)
    assert differing
    assert all(re.search(numbers, line) for line in differing)
    lost = [line for line in comments_of(before) if line not in comments_of(after)]
    assert all(any(comment in line for line in differing) for comment in lost)  # only of fiducials that were left out
    assert len(lost) <= 1


def test_a_new_file_is_the_designs_own_text_with_the_new_numbers(call: Any, room: Path, found: Found) -> None:
    path, new = room / "demo.yaml", room / "new.yaml"
    moved = found(load_design(path), Revision(half_width={("structure_connector", "rx"): 0.003}))
    assert call("optimise", path, "-o", new)[0] == 0
    before, after = path.read_text(encoding="utf-8"), new.read_text(encoding="utf-8")
    assert comments_of(after) == comments_of(before)
    assert lines_that_differ(before, after) == [
        "      rx: { half_width_deg: 0.10, distribution: uniform } # flatness of the seat"
    ]
    assert load_design(new).sha256 == moved.sha256


def test_what_stands_in_the_file_goes_before_the_text_of_the_input(call: Any, room: Path, found: Found) -> None:
    """Notes that were made in an earlier answer outlive the next one."""
    path, new = room / "demo.yaml", room / "new.yaml"
    new.write_text("# approved by M.\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    found(load_design(path), Revision(half_width={("structure_connector", "rx"): 0.003}))
    assert call("optimise", path, "-o", new, "--force")[0] == 0
    assert new.read_text(encoding="utf-8").count("# approved by M.\n") == 1


def test_a_design_without_labels_gets_none(call: Any, room: Path, found: Found) -> None:
    path = room / "flat_plate.yaml"
    design = load_design(path)
    points = [list(point) for point in design.fiducials.positions_mm]
    points[2][0] = 12.5
    moved = found(design, Revision(fiducials_mm=np.array(points)))
    before = path.read_text(encoding="utf-8")
    assert call("optimise", path, "-o", path)[0] == 0
    after = path.read_text(encoding="utf-8")
    assert lines_that_differ(before, after) == ["    - { position_mm: [-36.0, 27.0, -6.0] }"]
    assert "    - { position_mm: [12.5, 27.0, -6.0] }" in after
    assert load_design(path).sha256 == moved.sha256


# --- fiducials in a file --------------------------------------------------------------------------


@pytest.fixture
def beside(room: Path, found: Found) -> tuple[Path, Any]:
    """A design with its fiducials in a file and a box to move them in, and the design with one moved."""
    path = room / "marker.yaml"
    text = (room / "small_cluster_far_target.yaml").read_text(encoding="utf-8")
    path.write_text(text + "\noptimise: # where beads fit\n  box: { min_mm: [-20, -20, -20], max_mm: [20, 20, 20] }\n")
    design = load_design(path)
    points = [list(point) for point in design.fiducials.positions_mm]
    points[0] = [1.25, -2.5, 3.75]
    return path, found(design, Revision(fiducials_mm=np.array(points)))


def test_a_file_of_fiducials_is_not_lost_without_asking(call: Any, beside: tuple[Path, Any]) -> None:
    path, _ = beside
    before = path.read_bytes()
    code, out, err = call("optimise", path, "-o", path)
    assert (code, out) == (2, "")
    assert "has its fiducials in fiducials/marker8.csv, and they are to move" in err
    assert "hint: --fiducials-out " in err
    assert path.read_bytes() == before


@pytest.mark.parametrize("name", ["beads.mrk.json", "fiducials/beads.csv", "beads.fcsv"])
def test_new_fiducials_are_written_beside_the_design_on_request(call: Any, beside: tuple[Path, Any], name: str) -> None:
    path, moved = beside
    before = path.read_text(encoding="utf-8")
    code, _, err = call("optimise", path, "-o", path, "--fiducials-out", path.parent / name)
    assert code == 0
    assert f"wrote {path.parent / name}\nwrote {path}\n" in err
    after = path.read_text(encoding="utf-8")
    assert after == before.replace("fiducials/marker8.csv", name)
    assert load_design(path).sha256 == moved.sha256


def test_the_old_file_stays_named_where_no_fiducial_moved(call: Any, room: Path, found: Found) -> None:
    path = room / "marker.yaml"
    text = (room / "small_cluster_far_target.yaml").read_text(encoding="utf-8")
    path.write_text(text + "\noptimise:\n  rotation_bounds: { min_deg: 0.01, max_deg: 1 }\n", encoding="utf-8")
    loose = found(load_design(path), Revision(half_width={("structure_connector", "rx"): 0.005}))
    before = path.read_text(encoding="utf-8")
    assert call("optimise", path, "-o", path)[0] == 0
    assert len(lines_that_differ(before, path.read_text(encoding="utf-8"))) == 1
    assert load_design(path).sha256 == loose.sha256


def test_a_new_design_stands_alone_unless_asked_otherwise(call: Any, beside: tuple[Path, Any], tmp_path: Path) -> None:
    path, moved = beside
    new = tmp_path / "new.yaml"
    assert call("optimise", path, "-o", new)[0] == 0
    assert load_design(new).sha256 == moved.sha256
    assert "# nobody knows its law" in new.read_text(encoding="utf-8")
    assert "origin:" in new.read_text(encoding="utf-8")


@pytest.mark.parametrize(("arguments", "said"), read_cases("commands", "fiducials_out"))
def test_fiducials_that_no_design_could_refer_to_are_refused(
    refused: Any, beside: tuple[Path, Any], monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: str
) -> None:
    path, _ = beside
    monkeypatch.chdir(path.parent.parent)
    assert said in refused("optimise", path, *arguments)


# --- a result that is written nowhere -------------------------------------------------------------


def test_what_to_change_is_printed_and_is_a_merge_patch(call: Any, beside: tuple[Path, Any]) -> None:
    """independent: the patch is applied by the few lines with which tests change the OpenAPI document."""
    path, moved = beside
    _, out, _ = call("optimise", path)
    assert f"\nwhat to change in {path} (a merge patch, RFC 7396):\nfiducials:\n" in out
    assert "position_mm: [1.25, -2.5, 3.75] }" in out
    patch = yaml.safe_load(out.partition("RFC 7396):\n")[2].rpartition("\nnext: ")[0])
    made = changed_document(yaml.safe_load(path.read_text(encoding="utf-8")), "", patch)
    assert load_design(made).sha256 == moved.sha256


def test_where_nothing_is_to_change_no_command_writes_a_new_design(call: Any, room: Path, found: Found) -> None:
    found(load_design(room / "demo.yaml"), Revision())
    out = call("optimise", room / "demo.yaml")[1]
    assert f"\nnothing to change in {room / 'demo.yaml'}" in out
    assert out.endswith(f"\nnext: tailstack verify {room / 'demo.yaml'}\n")


def test_values_of_a_drawing_come_back_as_a_table_and_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a seat that was read from a file of CAD: it is written out, and is no longer said to be that of the file."""
    target, source = tmp_path / "new.yaml", EXAMPLES / "gallery" / "seat_from_cad.yaml"
    result = optimise(load_design(source))
    monkeypatch.setattr("tailstack.optimise", lambda _design, **_options: result, raising=False)
    assert main(["optimise", str(source), "--csv", "-o", str(target)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "interface,tolerance,before,after,unit,cost_before,cost_after"
    assert lines[2].startswith('structure_connector,"pin 1 fit, pin 2 fit",H7/g6,')
    after = lines[2].split(",")[4]
    seats = yaml.safe_load(target.read_text(encoding="utf-8"))["interfaces"].values()
    assert [feature["fit"] for feature in next(iter(seats))["features"][1:]] == [after] * 2
    assert [{"origin", "drawing"} & seat.keys() for seat in seats] == [set(), set()]
    text = " ".join(OPERATION.write(result).split())
    assert f"pin 1 fit, pin 2 fit H7/g6 → {after}" in text
    assert "its ± is √3 standard deviations of what the play or zone gives" in text
