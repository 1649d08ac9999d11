from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Reproduction")


@_attrs_define
class Reproduction:
    """How to get the same numbers again.

    Attributes:
        commands (list[str]): Commands that give the same numbers, with the design of this record saved as design.yaml.
        parts (list[str]): What was computed: score, verification, optimisation.
        seed (int | None): Seed of the check; null: nothing was drawn.
        trials (int | None): Trials asked for; null: as many as the precision takes.
        precision (float | None): Relative half-width asked for; null: the solver's own, or a number of trials.
        max_trials (int | None): At most so many trials; null: their number was asked for, or nothing was drawn.
        starts (int | None): Starts of the optimiser; null: as many as the design says.
        statement (str): What the commands reproduce, and how exactly.
    """

    commands: list[str]
    parts: list[str]
    seed: int | None
    trials: int | None
    precision: float | None
    max_trials: int | None
    starts: int | None
    statement: str

    def to_dict(self) -> dict[str, Any]:
        commands = self.commands

        parts = self.parts

        seed: int | None
        seed = self.seed

        trials: int | None
        trials = self.trials

        precision: float | None
        precision = self.precision

        max_trials: int | None
        max_trials = self.max_trials

        starts: int | None
        starts = self.starts

        statement = self.statement

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "commands": commands,
                "parts": parts,
                "seed": seed,
                "trials": trials,
                "precision": precision,
                "max_trials": max_trials,
                "starts": starts,
                "statement": statement,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        commands = cast(list[str], d.pop("commands"))

        parts = cast(list[str], d.pop("parts"))

        def _parse_seed(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        seed = _parse_seed(d.pop("seed"))

        def _parse_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        trials = _parse_trials(d.pop("trials"))

        def _parse_precision(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        precision = _parse_precision(d.pop("precision"))

        def _parse_max_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        max_trials = _parse_max_trials(d.pop("max_trials"))

        def _parse_starts(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        starts = _parse_starts(d.pop("starts"))

        statement = d.pop("statement")

        reproduction = cls(
            commands=commands,
            parts=parts,
            seed=seed,
            trials=trials,
            precision=precision,
            max_trials=max_trials,
            starts=starts,
            statement=statement,
        )

        return reproduction
