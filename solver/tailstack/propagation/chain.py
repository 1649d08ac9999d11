"""What a system does at its bias for all targets alike: effective projections, displacements, the sources' blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..geometry.rotation import Displacement, displacement
from ..system import Law, Reading, System
from .nonlinearity import matrix_covariance


class Block(NamedTuple):
    """One contributor: k independent scalar sources and what one native unit of each does to the error."""

    contributor: str
    components: tuple[str, ...]
    laws: tuple[Law, ...]
    half_width: Array  # (k,) native unit: rad, mm, px, N; sigma for image noise
    std: Array  # (k,) native unit
    units: tuple[str, ...]
    localisation: Array  # (3, k) con, mm per native unit
    tcp: Array  # (3, k) tcp, mm per native unit
    grouped: bool  # reported as one line (all columns are alike), not component by component
    per_unit: bool  # drawn once per installed unit (True) or at each shot (False)


class Kind(NamedTuple):
    """A block but for its gains."""

    place: slice  # of its sources among those of all blocks
    contributor: str
    components: tuple[str, ...]
    laws: tuple[Law, ...]
    half_width: Array
    std: Array
    units: tuple[str, ...]
    grouped: bool
    per_unit: bool

    def block(self, localisation: Array, tcp: Array) -> Block:
        """With its columns of the gains (3, K) of all sources."""
        return Block(
            self.contributor, self.components, self.laws, self.half_width, self.std, self.units,
            localisation[:, self.place], tcp[:, self.place], self.grouped, self.per_unit,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """What a system does at its bias, for all targets alike."""

    system: System
    projections: Array  # (V, 3, 4), |p3| = 1: effective ones
    points: Array  # (N, 3) mm, the fiducials as the estimator is told them
    per_error: Array  # (3, 3) from a manufacturing error to a displacement of those
    first: Displacement
    undone: Array  # (3, 3) inverse of the first interface's rotation
    second: Displacement
    third: Displacement
    to_tool: Array  # (4, 4) con -> tcp
    manufacturing_std_mm: Array  # (N, 3)
    target_noise_px: Array  # (V,)
    matrix_covariance: Array  # (12 V, 12 V) of the resected matrices (``nonlinearity.matrix_covariance``)
    manufactured: bool  # whether fiducials have manufacturing errors, which the views share
    kinds: tuple[Kind, ...]  # of every block, in the order of the chain


def estimator_geometry(system: System) -> tuple[Array, Array, Array]:
    """What the estimator meets at the bias, in its own coordinates.

    Returns projections (V, 3, 4) with ``|p3| = 1``, the fiducials it is told (N, 3), and the linear map
    (3, 3) from a manufacturing error to a displacement of those.  Physical: ``P_v T_err1`` and the nominal
    fiducials.  Eq 18: ``P_v T_err1^-1`` and the moved ones.  The rescaling matters for the small-angle form,
    which is not rigid.
    """
    mount = system.interface_1
    return _estimator_geometry(system, displacement(mount.bias, mount.pivot_mm, system.rotation_form))


def _estimator_geometry(system: System, first: Displacement) -> tuple[Array, Array, Array]:
    projections = system.projections
    if system.reading is Reading.PHYSICAL:
        told, per_error, seen = system.fiducials_mm.copy(), np.eye(3), projections @ first.matrix()
    else:
        per_error = first.rotation.copy()  # writable as the identity is: kernels see one kind
        told = system.fiducials_mm @ per_error.T + first.shift_mm
        seen = projections @ np.linalg.inv(first.matrix())
    return seen / np.linalg.norm(seen[:, 2, :3], axis=1)[:, None, None], told, per_error


def _kinds(system: System, std: Array) -> tuple[Kind, ...]:
    """Blocks in the order of the chain: image noise view by view, manufacturing, mounts, execution."""
    kinds: list[Kind] = []
    count = len(system.fiducials_mm)
    start = 0

    def add(
        name: str, laws: tuple[Law, ...], half_width: Array, std: Array, units: tuple[str, ...], *,
        components: tuple[str, ...] = (), per_unit: bool,
    ) -> None:  # fmt: skip
        nonlocal start
        place = slice(start, start := start + len(laws))
        named = components or ("all",) * len(laws)
        kinds.append(Kind(place, name, named, laws, half_width, std, units, not components, per_unit))

    for view in system.views:
        for name, px, scalars in (
            (f"fiducial_noise:{view.name}", view.fiducial_noise_px, 2 * count),
            (f"target_noise:{view.name}", view.target_noise_px, 2),
        ):
            sigma = np.full(scalars, px)
            add(name, (Law.NORMAL,) * scalars, sigma, sigma, ("px",) * scalars, per_unit=False)
    if std.any():
        laws, wide = (system.manufacturing_law,) * (3 * count), system.manufacturing_half_width_mm.ravel()
        add("fiducial_manufacturing", laws, wide, std.ravel(), ("mm",) * (3 * count), per_unit=True)
    mounts = ((mount.name, mount.sources, True) for mount in (system.interface_1, system.interface_2, system.hand_eye))
    for name, sources, per_unit in (*mounts, ("execution", system.execution, False)):
        if sources.names:
            add(
                name, sources.laws, sources.half_width, sources.std, sources.units,
                components=sources.names, per_unit=per_unit,
            )  # fmt: skip
    return tuple(kinds)


def chain_of(system: System) -> Chain:
    """Everything :func:`linearise` needs that does not depend on the target."""
    form = system.rotation_form
    first, second, third = (
        displacement(mount.bias, mount.pivot_mm, form)
        for mount in (system.interface_1, system.interface_2, system.hand_eye)
    )
    projections, points, per_error = _estimator_geometry(system, first)
    std = system.manufacturing_std_mm
    fiducial_noise = np.array([view.fiducial_noise_px for view in system.views])
    return Chain(
        system=system,
        projections=projections,
        points=points,
        per_error=per_error,
        first=first,
        undone=np.asarray(np.linalg.inv(first.rotation)),
        second=second,
        third=third,
        to_tool=system.T_tcp_con,
        manufacturing_std_mm=std,
        target_noise_px=np.array([view.target_noise_px for view in system.views]),
        matrix_covariance=matrix_covariance(projections, points, per_error, std, fiducial_noise),
        manufactured=bool(std.any()),
        kinds=_kinds(system, std),
    )
