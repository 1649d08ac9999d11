from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.local_optimum import LocalOptimum
    from ..models.relaxation import Relaxation
    from ..models.verification import Verification


T = TypeVar("T", bound="Certificate")


@_attrs_define
class Certificate:
    """What the optimum rests on.

    Attributes:
        kkt_residual (float): Residual of the optimality conditions of the programme with the exact law, recomputed from
            the multipliers, relative.
        starts (int): Starts of the search.
        converged_starts (int): Those that came to an optimum.
        best_costs (list[float]): Distinct optima, ascending, by the closed form: costs, or objectives where no cost is
            minimised.
        optima (list[LocalOptimum]): The distinct optima among the starts.
        relaxation (Relaxation): A lower bound of the cost that no design within the given freedom (as said) can
            undercut.
        seed (int): Seed of the starts; the check draws with one that follows from it.
        tightening_rounds (int): How often the limit was tightened until the check passed.
        stopped (str): Why the search ended, in a sentence.
        verification (Verification): Monte Carlo on the full nonlinear chain.
    """

    kkt_residual: float
    starts: int
    converged_starts: int
    best_costs: list[float]
    optima: list[LocalOptimum]
    relaxation: Relaxation
    seed: int
    tightening_rounds: int
    stopped: str
    verification: Verification

    def to_dict(self) -> dict[str, Any]:
        from ..models.local_optimum import LocalOptimum  # noqa: PLC0415
        from ..models.relaxation import Relaxation  # noqa: PLC0415
        from ..models.verification import Verification  # noqa: PLC0415

        kkt_residual = self.kkt_residual

        starts = self.starts

        converged_starts = self.converged_starts

        best_costs = self.best_costs

        optima = []
        for optima_item_data in self.optima:
            optima_item = optima_item_data.to_dict()
            optima.append(optima_item)

        relaxation = self.relaxation.to_dict()

        seed = self.seed

        tightening_rounds = self.tightening_rounds

        stopped = self.stopped

        verification = self.verification.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "kkt_residual": kkt_residual,
                "starts": starts,
                "converged_starts": converged_starts,
                "best_costs": best_costs,
                "optima": optima,
                "relaxation": relaxation,
                "seed": seed,
                "tightening_rounds": tightening_rounds,
                "stopped": stopped,
                "verification": verification,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.local_optimum import LocalOptimum  # noqa: PLC0415
        from ..models.relaxation import Relaxation  # noqa: PLC0415
        from ..models.verification import Verification  # noqa: PLC0415

        d = dict(src_dict)
        kkt_residual = d.pop("kkt_residual")

        starts = d.pop("starts")

        converged_starts = d.pop("converged_starts")

        best_costs = cast(list[float], d.pop("best_costs"))

        optima = []
        _optima = d.pop("optima")
        for optima_item_data in _optima:
            optima_item = LocalOptimum.from_dict(optima_item_data)

            optima.append(optima_item)

        relaxation = Relaxation.from_dict(d.pop("relaxation"))

        seed = d.pop("seed")

        tightening_rounds = d.pop("tightening_rounds")

        stopped = d.pop("stopped")

        verification = Verification.from_dict(d.pop("verification"))

        certificate = cls(
            kkt_residual=kkt_residual,
            starts=starts,
            converged_starts=converged_starts,
            best_costs=best_costs,
            optima=optima,
            relaxation=relaxation,
            seed=seed,
            tightening_rounds=tightening_rounds,
            stopped=stopped,
            verification=verification,
        )

        return certificate
