"""Headers of C-arm images by the command and over HTTP; nothing of a patient is in what they write, answer or log.

Expected: the numbers that the files were written with (tests/dicom_files.py); geometry: tests/unit/test_dicom.py."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydicom.uid import DeflatedExplicitVRLittleEndian
from served import Served
from service_scenes import EXAMPLES, client_of, small_design

from dicom_files import PATIENT, write_image
from plain_data import read_cases
from tailstack import load_design, score
from tailstack.design.frames import find_detector
from tailstack_service.cli.main import main

AP = write_image(PositionerPrimaryAngle="0", PositionerSecondaryAngle="0")
LAT = write_image(PositionerPrimaryAngle="85", PositionerSecondaryAngle="-10")


def encoded(content: bytes) -> str:
    return base64.b64encode(content).decode()


def test_two_images_become_a_design_that_scores(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "one.dcm").write_bytes(AP + b"\0" * 5_000_000)  # pixels: more than is read
    (tmp_path / "IM0002").write_bytes(LAT)
    target = tmp_path / "design.yaml"
    assert main(["convert", str(tmp_path / "one.dcm"), str(tmp_path / "IM0002"), "-o", str(target)]) == 0
    said = capfd.readouterr()
    assert "shot1 is one.dcm: LAO 0 CRA 0" in said.err
    assert "shot2 is IM0002: LAO 85 CAU 10" in said.err
    assert "correct isocentre_mm" in said.err
    text, design = target.read_text(encoding="utf-8"), load_design(target)
    assert PATIENT not in said.out + said.err + text
    assert "# how well one is located" in text
    assert {"/views/0/isocentre_mm", "/views/1/fiducial_noise_px"} <= set(design.document.assumed or ())
    assert not [each for each in design.document.assumed or () if "detector" in each or "preset" in each]
    assert [find_detector(view) for view in design.document.views] == [1100.0, 1100.0]
    assert score(design).targets[0].p95_mm < 1.0


def test_a_base_keeps_what_headers_do_not_say(tmp_path: Path) -> None:
    files, target = [tmp_path / "one.dcm", tmp_path / "two.dcm", tmp_path / "three.dcm"], tmp_path / "new.yaml"
    for file, content in zip(files, (AP, LAT, write_image()), strict=True):
        file.write_bytes(content)
    base = EXAMPLES / "demo.yaml"
    assert main(["convert", *map(str, files), "--base", str(base), "-o", str(target)]) == 0
    before, after = load_design(base).document, load_design(target).document
    assert [view.name for view in after.views] == [*(view.name for view in before.views), "shot3"]
    for old, new in zip(before.views, after.views, strict=False):
        kept = {"isocentre_mm", "fiducial_noise_px"}
        assert new.model_dump(include=kept) == old.model_dump(include=kept)
    assert set(after.assumed or ()) - set(before.assumed or ()) == {
        f"/views/2/{field}" for field in ("isocentre_mm", "fiducial_noise_px", "target_noise_px")
    }
    assert after.targets == before.targets
    assert main(["convert", str(files[0]), "--base", str(base), "-o", str(target), "--force"]) == 0
    assert load_design(target).document.views[1] == before.views[1]


@pytest.mark.parametrize(("files", "target", "words"), read_cases("commands", "dicom"))
def test_what_the_command_refuses(
    tmp_path: Path, refused: Any, monkeypatch: pytest.MonkeyPatch, files: list[str], target: str, words: str
) -> None:
    (tmp_path / "one.dcm").write_bytes(AP)
    (tmp_path / "demo.yaml").write_bytes((EXAMPLES / "demo.yaml").read_bytes())
    monkeypatch.chdir(tmp_path)
    assert re.search(words, refused("convert", *files, "-o", target))
    assert not (tmp_path / target).exists()


def test_over_http_and_nothing_of_the_patient_is_answered_or_logged(services: Callable[..., Served]) -> None:
    service = services()
    with client_of(service.url) as client:
        body = {"format": "dicom", "content": encoded(AP), "more": [encoded(LAT)]}
        answers = [client.post("/v1/conversions", json=body)]
        assert answers[0].status_code == 200, answers[0].text
        assert "content.dicom: LAO 0" in " ".join(answers[0].json()["notes"])
        assert len(load_design(answers[0].json()["content"]).document.views) == 2
        answers.append(client.post("/v1/conversions", json={**body, "more": None, "base": small_design()}))
        assert answers[1].status_code == 200, answers[1].text
        for changes, pointer, words in (
            ({"content": "%%%"}, "/content", "base64 -w0 FILE"),
            ({"more": ["%%%"]}, "/more/0", "base64 -w0 FILE"),
            ({"content": encoded(AP[:300])}, "/content", "is missing"),
            ({"more": [encoded(write_image(DeflatedExplicitVRLittleEndian))]}, "/content", "dcmconv"),
            ({"more": [encoded(write_image(DistanceSourceToPatient=None))]}, "/content", "more.1.dicom"),
            ({"format": "csv", "content": "x_mm,y_mm,z_mm\n1,2,3\n"}, "/more", "at a time"),
        ):
            answers.append(client.post("/v1/conversions", json={**body, **changes}))
            assert answers[-1].status_code == 422, answers[-1].text
            said = json.dumps(answers[-1].json()["errors"])
            assert words in said
            assert f'"pointer": "{pointer}"' in said
    logged = service.log.read_text()
    assert logged
    assert not [text for text in (logged, *(answer.text for answer in answers)) if PATIENT in text]
