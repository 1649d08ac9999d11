"""Design -> System: degrees to radians, views to projections, locators to torsors, regions to points, once."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, product
from math import radians
from typing import Any

import numpy as np

from ..errors import DesignError, IllPosedError
from ..system import (
    TORSOR_COMPONENTS,
    Array,
    Law,
    Mount,
    Requirement,
    Sources,
    System,
    Target,
    no_sources,
)
from .consistency import axis_counts, sample_count
from .document import Region, RequirementDocument, TargetDocument
from .loading import Design
from .locators import torsor_from_locators
from .mount_document import Bias, Compliance, Execution, HandEye, Interface, Repeatability, Tolerances
from .refusals import place
from .remembering import kept
from .view_compile import compile_transform, compile_view, frozen, refuse_behind_detector

DEFAULT_COVERAGE = 2.0


def compile_design(design: Design) -> System:
    """Compile a design; mm, rad and px from here on.

    Raises DesignError (a transform that is not rigid) and IllPosedError (locators that leave a motion
    free, a projection without a source), with the place in the document.
    """
    try:
        return _compile(design)
    except (DesignError, IllPosedError) as error:
        source = design.source.placed()
        raise type(error)([place(problem, source) for problem in error.problems]) from None


def _compile(design: Design) -> System:
    document = design.document
    fiducials = frozen(design.fiducials.positions_mm)
    notes = list(design.fiducials.notes)
    views = tuple(compile_view(view, f"/views/{index}", fiducials, notes) for index, view in enumerate(document.views))
    made = document.fiducials.manufacturing
    transforms = document.transforms
    if transforms.T_flange_con is None and transforms.T_tcp_flange is None:
        notes.append("no transforms are given: the tcp frame is the connector frame")
    samples = {target.name: expand_target(target) for target in document.targets}
    targets = tuple(chain.from_iterable(samples.values()))
    refuse_behind_detector(design, views, fiducials, targets)
    execution_bias, execution = _execution(document.execution)
    half_width = np.empty(fiducials.shape)
    half_width[:] = 0.0 if made is None else made.half_width_mm
    return System(
        design_sha256=design.sha256,
        name=document.name,
        views=views,
        fiducial_labels=design.fiducials.labels,
        fiducials_mm=fiducials,
        manufacturing_law=Law.NORMAL if made is None else Law(made.distribution),
        manufacturing_half_width_mm=frozen(half_width),
        manufacturing_coverage_factor=1.0 if made is None else _coverage(made.distribution, made.coverage_factor),
        interface_1=_interface(document.interfaces.structure_connector, "interface_1", "structure_connector"),
        interface_2=_interface(document.interfaces.connector_flange, "interface_2", "connector_flange"),
        T_flange_con=compile_transform(transforms.T_flange_con, "/transforms/T_flange_con", notes),
        T_tcp_flange=compile_transform(transforms.T_tcp_flange, "/transforms/T_tcp_flange", notes),
        hand_eye=_hand_eye(document.execution.hand_eye),
        execution_bias_mm=execution_bias,
        execution=execution,
        targets=targets,
        requirements=tuple([_requirement(item, samples) for item in document.requirements]),
        reading=document.model.installation_reading,
        rotation_form=document.model.rotation,
        triangulation=document.model.triangulation,
        notes=tuple(notes),
    )


# --- mounts -----------------------------------------------------------------------------------------


def _perfect(name: str) -> Mount:
    return Mount(name, frozen(np.zeros(3)), frozen(np.zeros(6)), no_sources(6))


def _coverage(distribution: str, factor: float | None) -> float:
    if distribution != "normal":
        return 1.0
    return DEFAULT_COVERAGE if factor is None else factor


@kept
def _interface(interface: Interface | None, name: str, field: str) -> Mount:
    if interface is None:
        return replace(_perfect(name), label=field.replace("_", "-"))
    pivot = frozen(interface.pivot_mm)
    sources = no_sources(6)
    if interface.tolerances is not None:
        sources = _torsor_sources(interface.tolerances)
    elif interface.locators is not None:
        held = interface.locators
        direction = torsor_from_locators(
            np.array([locator.position_mm for locator in held]),
            np.array([locator.normal for locator in held]),
            pivot,
            f"/interfaces/{field}/locators",
        )
        sources = Sources(
            tuple(locator.name for locator in held),
            tuple(Law(locator.distribution) for locator in held),
            frozen([locator.half_width_mm for locator in held]),
            frozen([_coverage(locator.distribution, locator.coverage_factor) for locator in held]),
            ("mm",) * 6,
            frozen(direction),
        )
    return Mount(name, pivot, _bias(interface.bias), sources, interface.label or field.replace("_", "-"))


@kept
def _hand_eye(hand_eye: HandEye | None) -> Mount:
    if hand_eye is None:
        return _perfect("hand_eye")
    sources = _torsor_sources(hand_eye.tolerances)
    return Mount("hand_eye", frozen(hand_eye.pivot_mm), _bias(hand_eye.bias), sources, "hand-eye calibration")


def _bias(bias: Bias) -> Array:
    turns = [radians(bias.rx_deg), radians(bias.ry_deg), radians(bias.rz_deg)]
    return frozen([*turns, bias.tx_mm, bias.ty_mm, bias.tz_mm])


def _torsor_sources(tolerances: Tolerances) -> Sources:
    """One source per declared component; its direction is that unit torsor."""
    given = [(k, name, getattr(tolerances, name)) for k, name in enumerate(TORSOR_COMPONENTS)]
    given = [entry for entry in given if entry[2] is not None]
    return Sources(
        tuple(name for _, name, _ in given),
        tuple(Law(item.distribution) for _, _, item in given),
        frozen([radians(item.half_width_deg) if k < 3 else item.half_width_mm for k, _, item in given]),
        frozen([_coverage(item.distribution, item.coverage_factor) for _, _, item in given]),
        tuple("rad" if k < 3 else "mm" for k, _, _ in given),
        frozen(np.eye(6)[:, [k for k, _, _ in given]]),
    )


@kept
def _execution(execution: Execution) -> tuple[Array, Sources]:
    parts = []
    bias = np.zeros(3)
    if execution.repeatability is not None:
        parts.append(_repeatability(execution.repeatability))
    if execution.compliance is not None:
        bias = np.array(execution.compliance.matrix_mm_per_n) @ np.array(execution.compliance.load_n)
        if execution.compliance.load_half_width_n is not None:
            parts.append(_load(execution.compliance))
    if not parts:
        return frozen(bias), no_sources(3)
    if len(parts) == 1:
        return frozen(bias), parts[0]
    return frozen(bias), Sources(
        tuple(name for part in parts for name in part.names),
        tuple(law for part in parts for law in part.laws),
        frozen(np.concatenate([part.half_width for part in parts])),
        frozen(np.concatenate([part.coverage_factor for part in parts])),
        tuple(unit for part in parts for unit in part.units),
        frozen(np.hstack([part.direction for part in parts])),
    )


def _along_axes(name: str, unit: str, half_width: Any, law: str, coverage: float, direction: Array) -> Sources:
    widths = [half_width] * 3 if isinstance(half_width, float | int) else half_width
    keep = [k for k in range(3) if direction[:, k].any()]
    return Sources(
        tuple(f"{name}.{'xyz'[k]}" for k in keep),
        (Law(law),) * len(keep),
        frozen([widths[k] for k in keep]),
        frozen([coverage] * len(keep)),
        (unit,) * len(keep),
        frozen(direction[:, keep]),
    )


def _repeatability(scatter: Repeatability) -> Sources:
    if scatter.std_mm is not None:
        return _along_axes("repeatability", "mm", scatter.std_mm, "normal", 1.0, np.eye(3))
    law = scatter.distribution or "normal"
    coverage = _coverage(law, scatter.coverage_factor)
    return _along_axes("repeatability", "mm", scatter.half_width_mm, law, coverage, np.eye(3))


def _load(compliance: Compliance) -> Sources:
    law = compliance.distribution or "normal"
    coverage = _coverage(law, compliance.coverage_factor)
    matrix = np.array(compliance.matrix_mm_per_n)
    return _along_axes("load", "N", compliance.load_half_width_n, str(law), coverage, matrix)


# --- targets ----------------------------------------------------------------------------------------


@kept
def expand_target(target: TargetDocument) -> tuple[Target, ...]:
    """The named points of a target; a region's are called name[0], name[1], ..."""
    if target.region is None:
        return (Target(target.name, frozen(target.position_mm)),)
    points = _box_points(target.region) if target.region.box is not None else _sphere_points(target.region)
    assert len(points) == sample_count(target)
    return tuple([Target(f"{target.name}[{k}]", frozen(point), target.name) for k, point in enumerate(points)])


def _box_points(region: Region) -> list[Array]:
    box = region.box
    assert box is not None
    axes = [
        centre + (np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1)) * size
        for centre, size, count in zip(box.centre_mm, box.size_mm, axis_counts(box), strict=True)
    ]
    return [np.array(point) for point in product(*axes)]


def _sphere_points(region: Region) -> list[Array]:
    """Centre, 6 axis points, 8 diagonals: the 14 surface points are a spherical design of degree 5."""
    sphere = region.sphere
    assert sphere is not None
    centre = np.array(sphere.centre_mm)
    axial = [sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)]
    diagonal = [np.array(signs) / np.sqrt(3) for signs in product((-1.0, 1.0), repeat=3)]
    return [centre, *(centre + sphere.radius_mm * direction for direction in axial + diagonal)]


def _requirement(item: RequirementDocument, samples: dict[str, tuple[Target, ...]]) -> Requirement:
    wanted = [found for name, found in samples.items() if item.targets == "all" or name in item.targets]
    names = tuple([sample.name for sample in chain.from_iterable(wanted)])
    return Requirement(
        item.name, item.error, item.quantile, item.limit_mm, item.confidence, names, item.risk, item.min_yield
    )
