from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_linearity_error import check_study_linearity_error
from ..models.study_linearity_error import StudyLinearityError
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.calibration import Calibration
    from ..models.linearity_point import LinearityPoint
    from ..models.provenance import Provenance


T = TypeVar("T", bound="StudyLinearity")


@_attrs_define
class StudyLinearity:
    """Where first order is good, and where it is optimistic.

    Attributes:
        schema (Literal['tailstack/study-linearity/1']): Name and version of this record's schema.
        target (str): Name of the target.
        error (StudyLinearityError): Error that is studied: tcp (at the tool) or localisation (of the target).
        quantile (float): Quantile of the error's norm, 0.95 for P95.
        seed (int): Seed of the trials.
        trials (int): Trials of each point, at most.
        confidence (float): Confidence of each interval by itself, 0 to 1.
        interval_method (str): How intervals are made, in words.
        noises_px (list[float]): Noises of the grid, px.
        rotations_deg (list[float]): Standard deviations of the rotations of the grid, deg.
        spreads (list[float]): Factors on the layout of the grid.
        counts (list[int]): Numbers of fiducials of the grid.
        points (list[LinearityPoint]): Every combination: count, spread, noise, rotation; the last runs fastest.
        calibration (list[Calibration]): How the validity statement did, one entry for each thing that it may say.
        sentences (list[str]): What can be said of the grid.
        varied (str): What was changed in the design, in words.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/study-linearity/1"]
    target: str
    error: StudyLinearityError
    quantile: float
    seed: int
    trials: int
    confidence: float
    interval_method: str
    noises_px: list[float]
    rotations_deg: list[float]
    spreads: list[float]
    counts: list[int]
    points: list[LinearityPoint]
    calibration: list[Calibration]
    sentences: list[str]
    varied: str
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.calibration import Calibration  # noqa: PLC0415
        from ..models.linearity_point import LinearityPoint  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        schema = self.schema

        target = self.target

        error: str = self.error

        quantile = self.quantile

        seed = self.seed

        trials = self.trials

        confidence = self.confidence

        interval_method = self.interval_method

        noises_px = self.noises_px

        rotations_deg = self.rotations_deg

        spreads = self.spreads

        counts = self.counts

        points = []
        for points_item_data in self.points:
            points_item = points_item_data.to_dict()
            points.append(points_item)

        calibration = []
        for calibration_item_data in self.calibration:
            calibration_item = calibration_item_data.to_dict()
            calibration.append(calibration_item)

        sentences = self.sentences

        varied = self.varied

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "target": target,
                "error": error,
                "quantile": quantile,
                "seed": seed,
                "trials": trials,
                "confidence": confidence,
                "interval_method": interval_method,
                "noises_px": noises_px,
                "rotations_deg": rotations_deg,
                "spreads": spreads,
                "counts": counts,
                "points": points,
                "calibration": calibration,
                "sentences": sentences,
                "varied": varied,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.calibration import Calibration  # noqa: PLC0415
        from ..models.linearity_point import LinearityPoint  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/study-linearity/1"], d.pop("schema"))
        if schema != "tailstack/study-linearity/1":
            raise ValueError(f"schema must match const 'tailstack/study-linearity/1', got '{schema}'")

        target = d.pop("target")

        error = check_study_linearity_error(d.pop("error"))

        quantile = d.pop("quantile")

        seed = d.pop("seed")

        trials = d.pop("trials")

        confidence = d.pop("confidence")

        interval_method = d.pop("interval_method")

        noises_px = cast(list[float], d.pop("noises_px"))

        rotations_deg = cast(list[float], d.pop("rotations_deg"))

        spreads = cast(list[float], d.pop("spreads"))

        counts = cast(list[int], d.pop("counts"))

        points = []
        _points = d.pop("points")
        for points_item_data in _points:
            points_item = LinearityPoint.from_dict(points_item_data)

            points.append(points_item)

        calibration = []
        _calibration = d.pop("calibration")
        for calibration_item_data in _calibration:
            calibration_item = Calibration.from_dict(calibration_item_data)

            calibration.append(calibration_item)

        sentences = cast(list[str], d.pop("sentences"))

        varied = d.pop("varied")

        provenance = Provenance.from_dict(d.pop("provenance"))

        study_linearity = cls(
            schema=schema,
            target=target,
            error=error,
            quantile=quantile,
            seed=seed,
            trials=trials,
            confidence=confidence,
            interval_method=interval_method,
            noises_px=noises_px,
            rotations_deg=rotations_deg,
            spreads=spreads,
            counts=counts,
            points=points,
            calibration=calibration,
            sentences=sentences,
            varied=varied,
            provenance=provenance,
        )

        return study_linearity
