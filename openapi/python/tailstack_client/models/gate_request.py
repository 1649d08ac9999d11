from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.gate_request_fail_level import check_gate_request_fail_level
from ..models.gate_request_fail_level import GateRequestFailLevel
from ..models.gate_request_mode import check_gate_request_mode
from ..models.gate_request_mode import GateRequestMode
from ..models.gate_request_on_inconclusive_type_0 import check_gate_request_on_inconclusive_type_0
from ..models.gate_request_on_inconclusive_type_0 import GateRequestOnInconclusiveType0
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.gate_request_baseline_type_0 import GateRequestBaselineType0
    from ..models.gate_request_design import GateRequestDesign
    from ..models.gate_request_policy_type_0 import GateRequestPolicyType0
    from ..models.gate_request_waivers_type_0 import GateRequestWaiversType0


T = TypeVar("T", bound="GateRequest")


@_attrs_define
class GateRequest:
    """Body of ``POST /v1/gates``.

    Attributes:
        designs (list[GateRequestDesign]): The designs to judge.
        policy (GateRequestPolicyType0 | None | Unset): The policy (schema policy). Absent: the designs' own
            requirements, default rules.
        waivers (GateRequestWaiversType0 | None | Unset): Waivers (schema waivers).
        baseline (GateRequestBaselineType0 | None | Unset): The answer of an earlier gate (schema gate).
        present (list[str] | None | Unset): Files of the baseline that are still there and not among these designs. A
            design of the baseline whose file is neither here nor judged may be one of these designs under another name.
        mode (GateRequestMode | Unset): analytic: first order, answered at once. verify: Monte Carlo for every design.
            auto: Monte Carlo where first order is near a limit. Default: 'auto'.
        seed (int | None | Unset): Seed. Absent: the baseline's, else the policy's.
        today (None | str | Unset): Day by which waivers are judged, YYYY-MM-DD. Absent: the service's, UTC.
        fail_level (GateRequestFailLevel | Unset): Findings of this severity fail the gate. Default: 'error'.
        on_inconclusive (GateRequestOnInconclusiveType0 | None | Unset): What an open question counts as. Absent: 4.
        max_regression_percent (float | None | Unset): Allowed rise of P95 over the baseline. Absent: the policy's.
    """

    designs: list[GateRequestDesign]
    policy: GateRequestPolicyType0 | None | Unset = UNSET
    waivers: GateRequestWaiversType0 | None | Unset = UNSET
    baseline: GateRequestBaselineType0 | None | Unset = UNSET
    present: list[str] | None | Unset = UNSET
    mode: GateRequestMode | Unset = "auto"
    seed: int | None | Unset = UNSET
    today: None | str | Unset = UNSET
    fail_level: GateRequestFailLevel | Unset = "error"
    on_inconclusive: GateRequestOnInconclusiveType0 | None | Unset = UNSET
    max_regression_percent: float | None | Unset = UNSET

    def to_dict(self) -> dict[str, Any]:
        from ..models.gate_request_baseline_type_0 import GateRequestBaselineType0  # noqa: PLC0415
        from ..models.gate_request_design import GateRequestDesign  # noqa: PLC0415
        from ..models.gate_request_policy_type_0 import GateRequestPolicyType0  # noqa: PLC0415
        from ..models.gate_request_waivers_type_0 import GateRequestWaiversType0  # noqa: PLC0415

        designs = []
        for designs_item_data in self.designs:
            designs_item = designs_item_data.to_dict()
            designs.append(designs_item)

        policy: dict[str, Any] | None | Unset
        if isinstance(self.policy, Unset):
            policy = UNSET
        elif isinstance(self.policy, GateRequestPolicyType0):
            policy = self.policy.to_dict()
        else:
            policy = self.policy

        waivers: dict[str, Any] | None | Unset
        if isinstance(self.waivers, Unset):
            waivers = UNSET
        elif isinstance(self.waivers, GateRequestWaiversType0):
            waivers = self.waivers.to_dict()
        else:
            waivers = self.waivers

        baseline: dict[str, Any] | None | Unset
        if isinstance(self.baseline, Unset):
            baseline = UNSET
        elif isinstance(self.baseline, GateRequestBaselineType0):
            baseline = self.baseline.to_dict()
        else:
            baseline = self.baseline

        present: list[str] | None | Unset
        if isinstance(self.present, Unset):
            present = UNSET
        elif isinstance(self.present, list):
            present = self.present

        else:
            present = self.present

        mode: str | Unset = UNSET
        if not isinstance(self.mode, Unset):
            mode = self.mode

        seed: int | None | Unset
        if isinstance(self.seed, Unset):
            seed = UNSET
        else:
            seed = self.seed

        today: None | str | Unset
        if isinstance(self.today, Unset):
            today = UNSET
        else:
            today = self.today

        fail_level: str | Unset = UNSET
        if not isinstance(self.fail_level, Unset):
            fail_level = self.fail_level

        on_inconclusive: None | str | Unset
        if isinstance(self.on_inconclusive, Unset):
            on_inconclusive = UNSET
        elif isinstance(self.on_inconclusive, str):
            on_inconclusive = self.on_inconclusive
        else:
            on_inconclusive = self.on_inconclusive

        max_regression_percent: float | None | Unset
        if isinstance(self.max_regression_percent, Unset):
            max_regression_percent = UNSET
        else:
            max_regression_percent = self.max_regression_percent

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "designs": designs,
            }
        )
        if policy is not UNSET:
            field_dict["policy"] = policy
        if waivers is not UNSET:
            field_dict["waivers"] = waivers
        if baseline is not UNSET:
            field_dict["baseline"] = baseline
        if present is not UNSET:
            field_dict["present"] = present
        if mode is not UNSET:
            field_dict["mode"] = mode
        if seed is not UNSET:
            field_dict["seed"] = seed
        if today is not UNSET:
            field_dict["today"] = today
        if fail_level is not UNSET:
            field_dict["fail_level"] = fail_level
        if on_inconclusive is not UNSET:
            field_dict["on_inconclusive"] = on_inconclusive
        if max_regression_percent is not UNSET:
            field_dict["max_regression_percent"] = max_regression_percent

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.gate_request_baseline_type_0 import GateRequestBaselineType0  # noqa: PLC0415
        from ..models.gate_request_design import GateRequestDesign  # noqa: PLC0415
        from ..models.gate_request_policy_type_0 import GateRequestPolicyType0  # noqa: PLC0415
        from ..models.gate_request_waivers_type_0 import GateRequestWaiversType0  # noqa: PLC0415

        d = dict(src_dict)
        designs = []
        _designs = d.pop("designs")
        for designs_item_data in _designs:
            designs_item = GateRequestDesign.from_dict(designs_item_data)

            designs.append(designs_item)

        def _parse_policy(data: object) -> GateRequestPolicyType0 | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                policy_type_0 = GateRequestPolicyType0.from_dict(data)

                return policy_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(GateRequestPolicyType0 | None | Unset, data)

        policy = _parse_policy(d.pop("policy", UNSET))

        def _parse_waivers(data: object) -> GateRequestWaiversType0 | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                waivers_type_0 = GateRequestWaiversType0.from_dict(data)

                return waivers_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(GateRequestWaiversType0 | None | Unset, data)

        waivers = _parse_waivers(d.pop("waivers", UNSET))

        def _parse_baseline(data: object) -> GateRequestBaselineType0 | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                baseline_type_0 = GateRequestBaselineType0.from_dict(data)

                return baseline_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(GateRequestBaselineType0 | None | Unset, data)

        baseline = _parse_baseline(d.pop("baseline", UNSET))

        def _parse_present(data: object) -> list[str] | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                present_type_0 = cast(list[str], data)

                return present_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[str] | None | Unset, data)

        present = _parse_present(d.pop("present", UNSET))

        _mode = d.pop("mode", UNSET)
        mode: GateRequestMode | Unset
        if isinstance(_mode, Unset):
            mode = UNSET
        else:
            mode = check_gate_request_mode(_mode)

        def _parse_seed(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        seed = _parse_seed(d.pop("seed", UNSET))

        def _parse_today(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        today = _parse_today(d.pop("today", UNSET))

        _fail_level = d.pop("fail_level", UNSET)
        fail_level: GateRequestFailLevel | Unset
        if isinstance(_fail_level, Unset):
            fail_level = UNSET
        else:
            fail_level = check_gate_request_fail_level(_fail_level)

        def _parse_on_inconclusive(data: object) -> GateRequestOnInconclusiveType0 | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, str):
                    raise TypeError()
                on_inconclusive_type_0 = check_gate_request_on_inconclusive_type_0(data)

                return on_inconclusive_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(GateRequestOnInconclusiveType0 | None | Unset, data)

        on_inconclusive = _parse_on_inconclusive(d.pop("on_inconclusive", UNSET))

        def _parse_max_regression_percent(data: object) -> float | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(float | None | Unset, data)

        max_regression_percent = _parse_max_regression_percent(d.pop("max_regression_percent", UNSET))

        gate_request = cls(
            designs=designs,
            policy=policy,
            waivers=waivers,
            baseline=baseline,
            present=present,
            mode=mode,
            seed=seed,
            today=today,
            fail_level=fail_level,
            on_inconclusive=on_inconclusive,
            max_regression_percent=max_regression_percent,
        )

        return gate_request
