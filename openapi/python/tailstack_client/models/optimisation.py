from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.optimisation_verdict_status import check_optimisation_verdict_status
from ..models.optimisation_verdict_status import OptimisationVerdictStatus
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.certificate import Certificate
    from ..models.changed_spacing import ChangedSpacing
    from ..models.changed_tolerance import ChangedTolerance
    from ..models.count_tried import CountTried
    from ..models.finding import Finding
    from ..models.front_point import FrontPoint
    from ..models.moved_fiducial import MovedFiducial
    from ..models.moved_pivot import MovedPivot
    from ..models.optimisation_design import OptimisationDesign
    from ..models.optimisation_design_before import OptimisationDesignBefore
    from ..models.placement_value import PlacementValue
    from ..models.provenance import Provenance
    from ..models.shadow_price import ShadowPrice
    from ..models.survived_loss import SurvivedLoss
    from ..models.view_offer import ViewOffer
    from ..models.view_search import ViewSearch


T = TypeVar("T", bound="Optimisation")


@_attrs_define
class Optimisation:
    """A design that keeps its limit at least cost (or what was asked for), verified by Monte Carlo.

    ``status``: what was asked for is verified.  The check in the certificate judges all of the design's requirements,
    those that ``optimise.requirement`` left out among them, and ``verdict_status`` is that of all.

        Attributes:
            schema (Literal['tailstack/optimisation/1']): Name and version of this record's schema.
            status (Literal['verified']): The new design keeps what was asked for by its Monte Carlo check; what does not is
                refused, not answered.
            objective (str): What was minimised, in a sentence.
            cost_before (float | None): Cost of the design as it stood, in the unit of its prices; null: some of it has no
                price.
            cost_after (float): Cost of the new design, that of a view that was added included.
            cost_closed_form (float | None): Cost of the optimum by the smooth closed form that drives the search; null
                where no cost is minimised.
            cost_exact_law (float | None): Cost of the optimum by the exact law at the limit itself, before the check's
                margin; null where no cost is minimised.
            p95_before_mm (float | None): First-order P95 of the worst target before, mm; null: the layout as it stood does
                not determine it.
            p95_after_mm (float): P95 of the worst target after, mm.
            moved (list[MovedFiducial]): Fiducials that could move.
            tolerances (list[ChangedTolerance]): Half-widths that were free.
            pivots (list[MovedPivot]): Pivots that were free.
            spacings (list[ChangedSpacing]): Locators whose spacing was free.
            scaling (float | None): Objective scaling: the common factor on all half-widths; otherwise null.
            certificate (Certificate): What the optimum rests on.
            shadow_prices (list[ShadowPrice]): What one unit of each limit and bound is worth.
            binding (list[str]): Limits and bounds that hold the optimum where it is.
            influence (list[Finding]): What the free variables can and cannot do, known before solving.
            placement_value (None | PlacementValue): What the placement bought; null where nothing was placed.
            counts (list[CountTried]): The numbers of fiducials that were tried; empty where it was given.
            front (list[FrontPoint]): Points of the front of cost and limit; empty unless asked for.
            design_before (OptimisationDesignBefore): The design document that it started from, complete.
            design (OptimisationDesign): The new design document, complete.
            provenance (Provenance): Which design, by which version, under which model, and what is not included.
            survived (None | SurvivedLoss): The worst loss of so many fiducials as `optimise.survive` says; null where that
                was not asked for.
            not_asked (list[str]): Requirements that `optimise.requirement` left out; the check judges them all the same.
            verdict_status (OptimisationVerdictStatus): Of all requirements of the new design, asked for or not: that of the
                check's verdict. Default: 'pass'.
            aimed (None | ViewSearch): How the views of `optimise.views` were aimed; null where none was free. All else
                holds for the views so aimed.
            view_offer (None | ViewOffer): What became of a view that `optimise.views` may add at a price; null where it
                names none.
    """

    schema: Literal["tailstack/optimisation/1"]
    status: Literal["verified"]
    objective: str
    cost_before: float | None
    cost_after: float
    cost_closed_form: float | None
    cost_exact_law: float | None
    p95_before_mm: float | None
    p95_after_mm: float
    moved: list[MovedFiducial]
    tolerances: list[ChangedTolerance]
    pivots: list[MovedPivot]
    spacings: list[ChangedSpacing]
    scaling: float | None
    certificate: Certificate
    shadow_prices: list[ShadowPrice]
    binding: list[str]
    influence: list[Finding]
    placement_value: None | PlacementValue
    counts: list[CountTried]
    front: list[FrontPoint]
    design_before: OptimisationDesignBefore
    design: OptimisationDesign
    provenance: Provenance
    survived: None | SurvivedLoss
    not_asked: list[str]
    aimed: None | ViewSearch
    view_offer: None | ViewOffer
    verdict_status: OptimisationVerdictStatus = "pass"

    def to_dict(self) -> dict[str, Any]:
        from ..models.certificate import Certificate  # noqa: PLC0415
        from ..models.changed_spacing import ChangedSpacing  # noqa: PLC0415
        from ..models.changed_tolerance import ChangedTolerance  # noqa: PLC0415
        from ..models.count_tried import CountTried  # noqa: PLC0415
        from ..models.finding import Finding  # noqa: PLC0415
        from ..models.front_point import FrontPoint  # noqa: PLC0415
        from ..models.moved_fiducial import MovedFiducial  # noqa: PLC0415
        from ..models.moved_pivot import MovedPivot  # noqa: PLC0415
        from ..models.optimisation_design import OptimisationDesign  # noqa: PLC0415
        from ..models.optimisation_design_before import OptimisationDesignBefore  # noqa: PLC0415
        from ..models.placement_value import PlacementValue  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.shadow_price import ShadowPrice  # noqa: PLC0415
        from ..models.survived_loss import SurvivedLoss  # noqa: PLC0415
        from ..models.view_offer import ViewOffer  # noqa: PLC0415
        from ..models.view_search import ViewSearch  # noqa: PLC0415

        schema = self.schema

        status = self.status

        objective = self.objective

        cost_before: float | None
        cost_before = self.cost_before

        cost_after = self.cost_after

        cost_closed_form: float | None
        cost_closed_form = self.cost_closed_form

        cost_exact_law: float | None
        cost_exact_law = self.cost_exact_law

        p95_before_mm: float | None
        p95_before_mm = self.p95_before_mm

        p95_after_mm = self.p95_after_mm

        moved = []
        for moved_item_data in self.moved:
            moved_item = moved_item_data.to_dict()
            moved.append(moved_item)

        tolerances = []
        for tolerances_item_data in self.tolerances:
            tolerances_item = tolerances_item_data.to_dict()
            tolerances.append(tolerances_item)

        pivots = []
        for pivots_item_data in self.pivots:
            pivots_item = pivots_item_data.to_dict()
            pivots.append(pivots_item)

        spacings = []
        for spacings_item_data in self.spacings:
            spacings_item = spacings_item_data.to_dict()
            spacings.append(spacings_item)

        scaling: float | None
        scaling = self.scaling

        certificate = self.certificate.to_dict()

        shadow_prices = []
        for shadow_prices_item_data in self.shadow_prices:
            shadow_prices_item = shadow_prices_item_data.to_dict()
            shadow_prices.append(shadow_prices_item)

        binding = self.binding

        influence = []
        for influence_item_data in self.influence:
            influence_item = influence_item_data.to_dict()
            influence.append(influence_item)

        placement_value: dict[str, Any] | None
        if isinstance(self.placement_value, PlacementValue):
            placement_value = self.placement_value.to_dict()
        else:
            placement_value = self.placement_value

        counts = []
        for counts_item_data in self.counts:
            counts_item = counts_item_data.to_dict()
            counts.append(counts_item)

        front = []
        for front_item_data in self.front:
            front_item = front_item_data.to_dict()
            front.append(front_item)

        design_before = self.design_before.to_dict()

        design = self.design.to_dict()

        provenance = self.provenance.to_dict()

        survived: dict[str, Any] | None
        if isinstance(self.survived, SurvivedLoss):
            survived = self.survived.to_dict()
        else:
            survived = self.survived

        not_asked = self.not_asked

        verdict_status: str = self.verdict_status

        aimed: dict[str, Any] | None
        if isinstance(self.aimed, ViewSearch):
            aimed = self.aimed.to_dict()
        else:
            aimed = self.aimed

        view_offer: dict[str, Any] | None
        if isinstance(self.view_offer, ViewOffer):
            view_offer = self.view_offer.to_dict()
        else:
            view_offer = self.view_offer

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "status": status,
                "objective": objective,
                "cost_before": cost_before,
                "cost_after": cost_after,
                "cost_closed_form": cost_closed_form,
                "cost_exact_law": cost_exact_law,
                "p95_before_mm": p95_before_mm,
                "p95_after_mm": p95_after_mm,
                "moved": moved,
                "tolerances": tolerances,
                "pivots": pivots,
                "spacings": spacings,
                "scaling": scaling,
                "certificate": certificate,
                "shadow_prices": shadow_prices,
                "binding": binding,
                "influence": influence,
                "placement_value": placement_value,
                "counts": counts,
                "front": front,
                "design_before": design_before,
                "design": design,
                "provenance": provenance,
                "survived": survived,
                "not_asked": not_asked,
                "verdict_status": verdict_status,
                "aimed": aimed,
                "view_offer": view_offer,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.certificate import Certificate  # noqa: PLC0415
        from ..models.changed_spacing import ChangedSpacing  # noqa: PLC0415
        from ..models.changed_tolerance import ChangedTolerance  # noqa: PLC0415
        from ..models.count_tried import CountTried  # noqa: PLC0415
        from ..models.finding import Finding  # noqa: PLC0415
        from ..models.front_point import FrontPoint  # noqa: PLC0415
        from ..models.moved_fiducial import MovedFiducial  # noqa: PLC0415
        from ..models.moved_pivot import MovedPivot  # noqa: PLC0415
        from ..models.optimisation_design import OptimisationDesign  # noqa: PLC0415
        from ..models.optimisation_design_before import OptimisationDesignBefore  # noqa: PLC0415
        from ..models.placement_value import PlacementValue  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.shadow_price import ShadowPrice  # noqa: PLC0415
        from ..models.survived_loss import SurvivedLoss  # noqa: PLC0415
        from ..models.view_offer import ViewOffer  # noqa: PLC0415
        from ..models.view_search import ViewSearch  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/optimisation/1"], d.pop("schema"))
        if schema != "tailstack/optimisation/1":
            raise ValueError(f"schema must match const 'tailstack/optimisation/1', got '{schema}'")

        status = cast(Literal["verified"], d.pop("status"))
        if status != "verified":
            raise ValueError(f"status must match const 'verified', got '{status}'")

        objective = d.pop("objective")

        def _parse_cost_before(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost_before = _parse_cost_before(d.pop("cost_before"))

        cost_after = d.pop("cost_after")

        def _parse_cost_closed_form(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost_closed_form = _parse_cost_closed_form(d.pop("cost_closed_form"))

        def _parse_cost_exact_law(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost_exact_law = _parse_cost_exact_law(d.pop("cost_exact_law"))

        def _parse_p95_before_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_before_mm = _parse_p95_before_mm(d.pop("p95_before_mm"))

        p95_after_mm = d.pop("p95_after_mm")

        moved = []
        _moved = d.pop("moved")
        for moved_item_data in _moved:
            moved_item = MovedFiducial.from_dict(moved_item_data)

            moved.append(moved_item)

        tolerances = []
        _tolerances = d.pop("tolerances")
        for tolerances_item_data in _tolerances:
            tolerances_item = ChangedTolerance.from_dict(tolerances_item_data)

            tolerances.append(tolerances_item)

        pivots = []
        _pivots = d.pop("pivots")
        for pivots_item_data in _pivots:
            pivots_item = MovedPivot.from_dict(pivots_item_data)

            pivots.append(pivots_item)

        spacings = []
        _spacings = d.pop("spacings")
        for spacings_item_data in _spacings:
            spacings_item = ChangedSpacing.from_dict(spacings_item_data)

            spacings.append(spacings_item)

        def _parse_scaling(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        scaling = _parse_scaling(d.pop("scaling"))

        certificate = Certificate.from_dict(d.pop("certificate"))

        shadow_prices = []
        _shadow_prices = d.pop("shadow_prices")
        for shadow_prices_item_data in _shadow_prices:
            shadow_prices_item = ShadowPrice.from_dict(shadow_prices_item_data)

            shadow_prices.append(shadow_prices_item)

        binding = cast(list[str], d.pop("binding"))

        influence = []
        _influence = d.pop("influence")
        for influence_item_data in _influence:
            influence_item = Finding.from_dict(influence_item_data)

            influence.append(influence_item)

        def _parse_placement_value(data: object) -> None | PlacementValue:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                placement_value_type_0 = PlacementValue.from_dict(data)

                return placement_value_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | PlacementValue, data)

        placement_value = _parse_placement_value(d.pop("placement_value"))

        counts = []
        _counts = d.pop("counts")
        for counts_item_data in _counts:
            counts_item = CountTried.from_dict(counts_item_data)

            counts.append(counts_item)

        front = []
        _front = d.pop("front")
        for front_item_data in _front:
            front_item = FrontPoint.from_dict(front_item_data)

            front.append(front_item)

        design_before = OptimisationDesignBefore.from_dict(d.pop("design_before"))

        design = OptimisationDesign.from_dict(d.pop("design"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        def _parse_survived(data: object) -> None | SurvivedLoss:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                survived_type_0 = SurvivedLoss.from_dict(data)

                return survived_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | SurvivedLoss, data)

        survived = _parse_survived(d.pop("survived"))

        not_asked = cast(list[str], d.pop("not_asked"))

        verdict_status = check_optimisation_verdict_status(d.pop("verdict_status"))

        def _parse_aimed(data: object) -> None | ViewSearch:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                aimed_type_0 = ViewSearch.from_dict(data)

                return aimed_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | ViewSearch, data)

        aimed = _parse_aimed(d.pop("aimed"))

        def _parse_view_offer(data: object) -> None | ViewOffer:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                view_offer_type_0 = ViewOffer.from_dict(data)

                return view_offer_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | ViewOffer, data)

        view_offer = _parse_view_offer(d.pop("view_offer"))

        optimisation = cls(
            schema=schema,
            status=status,
            objective=objective,
            cost_before=cost_before,
            cost_after=cost_after,
            cost_closed_form=cost_closed_form,
            cost_exact_law=cost_exact_law,
            p95_before_mm=p95_before_mm,
            p95_after_mm=p95_after_mm,
            moved=moved,
            tolerances=tolerances,
            pivots=pivots,
            spacings=spacings,
            scaling=scaling,
            certificate=certificate,
            shadow_prices=shadow_prices,
            binding=binding,
            influence=influence,
            placement_value=placement_value,
            counts=counts,
            front=front,
            design_before=design_before,
            design=design,
            provenance=provenance,
            survived=survived,
            not_asked=not_asked,
            verdict_status=verdict_status,
            aimed=aimed,
            view_offer=view_offer,
        )

        return optimisation
