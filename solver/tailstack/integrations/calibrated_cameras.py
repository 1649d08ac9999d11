"""Calibrated cameras of XMALab: a MayaCam 2.0 file (``.txt``), one camera in each.

It holds four sections, each with its name on a line of its own: the size of the image (width, height), the camera
matrix K, the rotation R and the translation t of the calibration object's frame to the camera's, as OpenCV has them:
pixels are K (R x + t), x right, y down, z towards the detector.  Lengths are in the unit of the cage that was
calibrated with, which the file does not state.
"""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np

from ..design.fiducial_files import read_number, refuse
from ..design.reading import Limits, decode, show
from ..errors import LimitError, Problem
from ..geometry.arrays import Array
from .calibration_cages import UNITS, CageForm

CAMERA_FILES = (".txt",)
NOISE_PX = 0.3  # of the images, which the file does not state: a start, typical of well-segmented beads
_SECTIONS = {"image size": (1, 2), "camera matrix": (3, 3), "rotation": (3, 3), "translation": (3, 1)}


class CalibratedCamera(NamedTuple):
    """A view of a design, as plain data, and what to mind of it."""

    view: dict[str, Any]
    notes: tuple[str, ...]


def read_camera(content: bytes, name: str, form: CageForm, limits: Limits) -> CalibratedCamera:
    """The view that a MayaCam 2.0 file is, its frame con; called by ``form.view``, or as the file is.

    Raises DesignError, LimitError.
    """
    if len(content) > limits.fiducial_file_bytes:
        raise LimitError(Problem("", "too-large", f"{name} is longer than {limits.fiducial_file_bytes} bytes"))
    sections = _read_sections(decode(content, name).removeprefix("\ufeff").splitlines(), name)
    size, camera, rotation, shift = (sections[section] for section in _SECTIONS)
    width, height = size[0]
    if not (width.is_integer() and height.is_integer()):
        raise refuse(name, None, "camera-file", f"the image size is two whole numbers; got {width:g}, {height:g}")
    if np.abs(np.append(camera[1:, 0], camera[2, 1:] - [0, 1])).max() > 0:
        hint = "a camera matrix is [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]"
        raise refuse(name, None, "camera-file", "the camera matrix is of another form", hint)
    translation = UNITS[form.unit] * shift[:, 0]
    view = {
        "name": form.view or PurePath(name).stem,
        "intrinsics": {
            "focal_px": [camera[0, 0], camera[1, 1]],
            "principal_point_px": [camera[0, 2], camera[1, 2]],
            **({"skew_px": camera[0, 1]} if camera[0, 1] else {}),
        },
        "pose": {"rotation": rotation.tolist(), "translation_mm": translation.tolist()},
        "image_size_px": [int(width), int(height)],
        "fiducial_noise_px": NOISE_PX,
        "target_noise_px": NOISE_PX,
    }
    notes = [f"{name}: lengths were read as {form.unit}, in which the cage was calibrated", *_doubt(view, name)]
    notes.append(f"image noise of {NOISE_PX} px is a start, as the file states none; correct it")
    return CalibratedCamera(_plain(view), tuple(notes))


def _doubt(view: dict[str, Any], name: str) -> list[str]:
    (width, height), (cx, cy) = view["image_size_px"], view["intrinsics"]["principal_point_px"]
    if 0 <= cx <= width and 0 <= cy <= height:
        return []
    return [f"{name}: the principal point ({cx:g}, {cy:g}) lies outside the image of {width} x {height} px"]


def _plain(value: Any) -> Any:
    """Without types of NumPy."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    return float(value) if isinstance(value, np.floating) else value


def _read_sections(lines: list[str], name: str) -> dict[str, Array]:
    """The numbers of each section, every one of its rows read."""
    rows: dict[str, list[tuple[int, list[str]]]] = {}
    section = ""
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if re.fullmatch(r"[A-Za-z][A-Za-z ]*", text):
            section = text.lower()
            if section in rows:
                raise refuse(name, number, "camera-file", f"there are two sections {section!r}", "one camera in a file")
            rows[section] = []
        elif text:
            if not section:
                hint = "export MayaCam 2.0 from XMALab; MayaCam 1.0, five lines of three numbers, has no camera matrix"
                raise refuse(name, number, "camera-file", f"the first line is 'image size'; got {show(line)}", hint)
            rows[section].append((number, text.split(",")))
    missing = [each for each in _SECTIONS if each not in rows]
    if missing:
        hint = "a MayaCam 2.0 file has image size, camera matrix, rotation and translation"
        raise refuse(name, None, "camera-file", f"there is no section {missing[0]!r}", hint)
    if unknown := [each for each in rows if each not in _SECTIONS]:
        hint = "what a correction of distortion leaves is image_field of the view" if "dist" in unknown[0] else ""
        raise refuse(name, None, "camera-file", f"the section {unknown[0]!r} is not read", hint)
    return {each: _read_matrix(rows[each], each, name) for each in _SECTIONS}


def _read_matrix(rows: list[tuple[int, list[str]]], section: str, name: str) -> Array:
    height, width = _SECTIONS[section]
    if len(rows) != height:
        at = rows[-1][0] if rows else None
        raise refuse(name, at, "camera-file", f"{section} has {height} rows of numbers; got {len(rows)}")
    for number, cells in rows:
        if len(cells) != width:
            detail = f"a row of {section} has {width} numbers with commas between; got {len(cells)}"
            raise refuse(name, number, "camera-file", detail)
    return np.array([[read_number(cell, name, number, section) for cell in cells] for number, cells in rows])
