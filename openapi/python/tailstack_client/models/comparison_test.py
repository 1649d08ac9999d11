from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.comparison_test_sides import check_comparison_test_sides
from ..models.comparison_test_sides import ComparisonTestSides
from ..models.comparison_test_test import check_comparison_test_test
from ..models.comparison_test_test import ComparisonTestTest
from typing import cast


T = TypeVar("T", bound="ComparisonTest")


@_attrs_define
class ComparisonTest:
    """One test of one level at one target.

    Attributes:
        test (ComparisonTestTest): What is tested.
        statistic (float): The test's statistic.
        sides (ComparisonTestSides): Whether large values alone count, or small ones too.
        p_value (float): How often a bench as predicted would be as far off, 0 to 1.
        p_adjusted (float): The same for all tests of the file together (Holm).
        differs (bool): Whether the adjusted one is below one less the confidence.
        says (str): What the test says, in a sentence.
    """

    test: ComparisonTestTest
    statistic: float
    sides: ComparisonTestSides
    p_value: float
    p_adjusted: float
    differs: bool
    says: str

    def to_dict(self) -> dict[str, Any]:
        test: str = self.test

        statistic = self.statistic

        sides: str = self.sides

        p_value = self.p_value

        p_adjusted = self.p_adjusted

        differs = self.differs

        says = self.says

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "test": test,
                "statistic": statistic,
                "sides": sides,
                "p_value": p_value,
                "p_adjusted": p_adjusted,
                "differs": differs,
                "says": says,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        test = check_comparison_test_test(d.pop("test"))

        statistic = d.pop("statistic")

        sides = check_comparison_test_sides(d.pop("sides"))

        p_value = d.pop("p_value")

        p_adjusted = d.pop("p_adjusted")

        differs = d.pop("differs")

        says = d.pop("says")

        comparison_test = cls(
            test=test,
            statistic=statistic,
            sides=sides,
            p_value=p_value,
            p_adjusted=p_adjusted,
            differs=differs,
            says=says,
        )

        return comparison_test
