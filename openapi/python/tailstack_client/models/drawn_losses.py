from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="DrawnLosses")


@_attrs_define
class DrawnLosses:
    """Shots with fiducials missed, as often as the design says.

    Attributes:
        trials (int): Shots that were drawn.
        trials_with_losses (int): Of these, shots in which at least one fiducial is missed.
        trials_without_answer (int): Shots left with too few fiducials for an answer. In quantiles and exceedance their
            error counts as infinite; bias, spread, means, largest error and reprojection error are of the other shots.
    """

    trials: int
    trials_with_losses: int
    trials_without_answer: int

    def to_dict(self) -> dict[str, Any]:
        trials = self.trials

        trials_with_losses = self.trials_with_losses

        trials_without_answer = self.trials_without_answer

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "trials": trials,
                "trials_with_losses": trials_with_losses,
                "trials_without_answer": trials_without_answer,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        trials = d.pop("trials")

        trials_with_losses = d.pop("trials_with_losses")

        trials_without_answer = d.pop("trials_without_answer")

        drawn_losses = cls(
            trials=trials,
            trials_with_losses=trials_with_losses,
            trials_without_answer=trials_without_answer,
        )

        return drawn_losses
