from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.coupling_case_coupling import check_coupling_case_coupling
from ..models.coupling_case_coupling import CouplingCaseCoupling
from ..models.coupling_case_reading import check_coupling_case_reading
from ..models.coupling_case_reading import CouplingCaseReading
from typing import cast

if TYPE_CHECKING:
    from ..models.ratio import Ratio


T = TypeVar("T", bound="CouplingCase")


@_attrs_define
class CouplingCase:
    """One installation error, in one reading, at one target.  All P95 are of the error norm, mm.

    Attributes:
        reading (CouplingCaseReading): Reading of the installation error.
        installation (str): as designed, or the level in words.
        rotation_deg (float | None): Of a level: about each axis, deg; null as designed.
        translation_mm (float | None): Of a level: along (1, 1, 1), mm; null as designed.
        target (str): Name of the target.
        p95_together_mm (float): P95 of installation error and noise together, mm.
        p95_installation_mm (float): P95 without noise, mm.
        p95_noise_mm (float): P95 of the noise at the nominal geometry, mm.
        p95_vector_sum_mm (float): P95 of the error without noise plus the noise at the nominal geometry, trial by
            trial, mm.
        p95_first_order_mm (float): P95 of the first-order law, linearised at the biased geometry, mm.
        nu (float): Validity number of depths and crossing, the larger of both geometries'; beyond 0.2 the noise has no
            standard deviation.
        largest_share (float): Largest share of one trial in the sum of squares of the noise, the larger of both
            geometries'.
        noise_rms_biased_mm (float | None): Root mean square of what image noise adds to the localisation error,
            installed, mm; null where there is no standard deviation.
        noise_rms_nominal_mm (float | None): The same at the nominal geometry, mm; null where there is no standard
            deviation.
        gain (None | Ratio): Ratio of the two; null where there is no standard deviation.
        against_quadrature (Ratio): A ratio of two sampled numbers, from the same trials.
        against_sum (Ratio): A ratio of two sampled numbers, from the same trials.
        against_vector_sum (Ratio): A ratio of two sampled numbers, from the same trials.
        against_first_order (Ratio): A ratio of two sampled numbers, from the same trials.
        coupling (CouplingCaseCoupling): What the interval of `against_vector_sum` says.
        sentence (str): The case as a sentence.
    """

    reading: CouplingCaseReading
    installation: str
    rotation_deg: float | None
    translation_mm: float | None
    target: str
    p95_together_mm: float
    p95_installation_mm: float
    p95_noise_mm: float
    p95_vector_sum_mm: float
    p95_first_order_mm: float
    nu: float
    largest_share: float
    noise_rms_biased_mm: float | None
    noise_rms_nominal_mm: float | None
    gain: None | Ratio
    against_quadrature: Ratio
    against_sum: Ratio
    against_vector_sum: Ratio
    against_first_order: Ratio
    coupling: CouplingCaseCoupling
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        from ..models.ratio import Ratio  # noqa: PLC0415

        reading: str = self.reading

        installation = self.installation

        rotation_deg: float | None
        rotation_deg = self.rotation_deg

        translation_mm: float | None
        translation_mm = self.translation_mm

        target = self.target

        p95_together_mm = self.p95_together_mm

        p95_installation_mm = self.p95_installation_mm

        p95_noise_mm = self.p95_noise_mm

        p95_vector_sum_mm = self.p95_vector_sum_mm

        p95_first_order_mm = self.p95_first_order_mm

        nu = self.nu

        largest_share = self.largest_share

        noise_rms_biased_mm: float | None
        noise_rms_biased_mm = self.noise_rms_biased_mm

        noise_rms_nominal_mm: float | None
        noise_rms_nominal_mm = self.noise_rms_nominal_mm

        gain: dict[str, Any] | None
        if isinstance(self.gain, Ratio):
            gain = self.gain.to_dict()
        else:
            gain = self.gain

        against_quadrature = self.against_quadrature.to_dict()

        against_sum = self.against_sum.to_dict()

        against_vector_sum = self.against_vector_sum.to_dict()

        against_first_order = self.against_first_order.to_dict()

        coupling: str = self.coupling

        sentence = self.sentence

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "reading": reading,
                "installation": installation,
                "rotation_deg": rotation_deg,
                "translation_mm": translation_mm,
                "target": target,
                "p95_together_mm": p95_together_mm,
                "p95_installation_mm": p95_installation_mm,
                "p95_noise_mm": p95_noise_mm,
                "p95_vector_sum_mm": p95_vector_sum_mm,
                "p95_first_order_mm": p95_first_order_mm,
                "nu": nu,
                "largest_share": largest_share,
                "noise_rms_biased_mm": noise_rms_biased_mm,
                "noise_rms_nominal_mm": noise_rms_nominal_mm,
                "gain": gain,
                "against_quadrature": against_quadrature,
                "against_sum": against_sum,
                "against_vector_sum": against_vector_sum,
                "against_first_order": against_first_order,
                "coupling": coupling,
                "sentence": sentence,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.ratio import Ratio  # noqa: PLC0415

        d = dict(src_dict)
        reading = check_coupling_case_reading(d.pop("reading"))

        installation = d.pop("installation")

        def _parse_rotation_deg(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        rotation_deg = _parse_rotation_deg(d.pop("rotation_deg"))

        def _parse_translation_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        translation_mm = _parse_translation_mm(d.pop("translation_mm"))

        target = d.pop("target")

        p95_together_mm = d.pop("p95_together_mm")

        p95_installation_mm = d.pop("p95_installation_mm")

        p95_noise_mm = d.pop("p95_noise_mm")

        p95_vector_sum_mm = d.pop("p95_vector_sum_mm")

        p95_first_order_mm = d.pop("p95_first_order_mm")

        nu = d.pop("nu")

        largest_share = d.pop("largest_share")

        def _parse_noise_rms_biased_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        noise_rms_biased_mm = _parse_noise_rms_biased_mm(d.pop("noise_rms_biased_mm"))

        def _parse_noise_rms_nominal_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        noise_rms_nominal_mm = _parse_noise_rms_nominal_mm(d.pop("noise_rms_nominal_mm"))

        def _parse_gain(data: object) -> None | Ratio:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                gain_type_0 = Ratio.from_dict(data)

                return gain_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | Ratio, data)

        gain = _parse_gain(d.pop("gain"))

        against_quadrature = Ratio.from_dict(d.pop("against_quadrature"))

        against_sum = Ratio.from_dict(d.pop("against_sum"))

        against_vector_sum = Ratio.from_dict(d.pop("against_vector_sum"))

        against_first_order = Ratio.from_dict(d.pop("against_first_order"))

        coupling = check_coupling_case_coupling(d.pop("coupling"))

        sentence = d.pop("sentence")

        coupling_case = cls(
            reading=reading,
            installation=installation,
            rotation_deg=rotation_deg,
            translation_mm=translation_mm,
            target=target,
            p95_together_mm=p95_together_mm,
            p95_installation_mm=p95_installation_mm,
            p95_noise_mm=p95_noise_mm,
            p95_vector_sum_mm=p95_vector_sum_mm,
            p95_first_order_mm=p95_first_order_mm,
            nu=nu,
            largest_share=largest_share,
            noise_rms_biased_mm=noise_rms_biased_mm,
            noise_rms_nominal_mm=noise_rms_nominal_mm,
            gain=gain,
            against_quadrature=against_quadrature,
            against_sum=against_sum,
            against_vector_sum=against_vector_sum,
            against_first_order=against_first_order,
            coupling=coupling,
            sentence=sentence,
        )

        return coupling_case
