"""What must not change the answer: moving and turning everything, the order of fiducials, units, threads, batches."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenes import execution, mount, random_rigid, random_system, read_only
from tailstack import score, verify
from tailstack.geometry.arrays import Array
from tailstack.system import DirectEffect, Law, System

pytestmark = pytest.mark.hostile

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def well_posed(seed: int, **changes) -> System:
    """Zero-bias system: the finite angles of a bias are tied to the axes, first order is not."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, fiducials=int(rng.integers(8, 14)), views=int(rng.integers(2, 4)))
    # Beads of one size: their law is then the same along any axes.
    count = len(system.fiducials_mm)
    changes.setdefault("manufacturing_half_width_mm", read_only(np.full((count, 3), 0.05)))
    changes.setdefault("manufacturing_law", Law.NORMAL)
    for name in ("structure_connector", "connector_flange", "hand_eye"):
        changes.setdefault(name, replace(getattr(system, name), known=read_only(np.zeros(6))))
    return replace(system, **changes)


def moved_mount(there: DirectEffect, transform: Array) -> DirectEffect:
    turn = np.kron(np.eye(2), transform[:3, :3])
    sources = replace(there.sources, direction=read_only(turn @ there.sources.direction))
    return replace(there, pivot_mm=read_only(transform[:3, :3] @ there.pivot_mm + transform[:3, 3]), sources=sources)


def moved(system: System, transform: Array) -> System:
    """The same hardware described in another connector frame."""
    back = np.linalg.inv(transform)

    def points(values: Array) -> Array:
        return read_only(values @ transform[:3, :3].T + transform[:3, 3])

    return replace(
        system,
        views=tuple(replace(v, projection=read_only(v.projection @ back)) for v in system.views),
        fiducials_mm=points(system.fiducials_mm),
        targets=tuple(replace(t, position_mm=points(t.position_mm)) for t in system.targets),
        structure_connector=moved_mount(system.structure_connector, transform),
        connector_flange=moved_mount(system.connector_flange, transform),
        T_flange_con=read_only(system.T_flange_con @ back),
    )


def in_other_units(system: System, factor: float) -> System:
    """Every length multiplied: the same design in inches, say."""

    def pose(transform: Array) -> Array:
        out = transform.copy()
        out[:3, 3] *= factor
        return read_only(out)

    def mount_in(there: DirectEffect) -> DirectEffect:
        scale = np.diag([1, 1, 1, factor, factor, factor])
        sources = replace(there.sources, direction=read_only(scale @ there.sources.direction))
        return replace(
            there, pivot_mm=read_only(factor * there.pivot_mm), known=read_only(scale @ there.known), sources=sources
        )

    return replace(
        system,
        views=tuple(replace(v, projection=read_only(v.projection * np.array([1, 1, 1, factor]))) for v in system.views),
        fiducials_mm=read_only(factor * system.fiducials_mm),
        manufacturing_half_width_mm=read_only(factor * system.manufacturing_half_width_mm),
        targets=tuple(replace(t, position_mm=read_only(factor * t.position_mm)) for t in system.targets),
        structure_connector=mount_in(system.structure_connector),
        connector_flange=mount_in(system.connector_flange),
        hand_eye=mount_in(system.hand_eye),
        T_flange_con=pose(system.T_flange_con),
        T_tcp_flange=pose(system.T_tcp_flange),
        execution=replace(
            system.execution,
            known=read_only(factor * system.execution.known),
            sources=replace(system.execution.sources, direction=read_only(factor * system.execution.sources.direction)),
        ),
    )


def noise_only(system: System) -> System:
    bare: dict[str, Any] = {
        n: mount(n, getattr(system, n).pivot_mm) for n in ("structure_connector", "connector_flange", "hand_eye")
    }
    return replace(
        system, **bare, manufacturing_half_width_mm=read_only(np.zeros_like(system.fiducials_mm)),
        execution=execution(0.0),
    )  # fmt: skip


@pytest.mark.long
@few
@given(seeds)
def test_score_does_not_see_a_change_of_connector_frame(seed):
    system = well_posed(seed)
    other = moved(system, random_rigid(np.random.default_rng(seed + 1)))
    one, two = score(system, losses=False).targets[0], score(other, losses=False).targets[0]
    assert two.p95_mm == pytest.approx(one.p95_mm, rel=1e-6)
    assert np.allclose(two.covariance_mm2, one.covariance_mm2, rtol=1e-6, atol=1e-9)  # the tcp frame is the same


@few
@given(seeds)
def test_simulation_does_not_see_a_change_of_connector_frame(seed):
    """Trial by trial: the estimator itself is equivariant, so the same noise gives the same error."""
    system = noise_only(well_posed(seed))
    other = moved(system, random_rigid(np.random.default_rng(seed + 1)))
    one, two = (verify(s, trials=3000, seed=1).targets[0] for s in (system, other))
    assert two.p95_mm == pytest.approx(one.p95_mm, rel=1e-7)
    assert two.worst_mm == pytest.approx(one.worst_mm, rel=1e-6)


@pytest.mark.long
@few
@given(seeds, st.floats(0.01, 100.0))
def test_units_change_nothing_but_the_unit(seed, factor):
    system = well_posed(seed)
    other = in_other_units(system, factor)
    one, two = score(system, losses=False).targets[0], score(other, losses=False).targets[0]
    assert two.p95_mm == pytest.approx(factor * one.p95_mm, rel=1e-6)
    drawn, other_drawn = (verify(s, trials=3000, seed=1).targets[0] for s in (system, other))
    assert other_drawn.p95_mm == pytest.approx(factor * drawn.p95_mm, rel=1e-7)


@pytest.mark.long
@few
@given(seeds)
def test_order_of_fiducials_and_of_views_does_not_matter(seed):
    system = well_posed(seed)
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(system.fiducials_mm))
    other = replace(
        system,
        fiducials_mm=read_only(system.fiducials_mm[order]),
        manufacturing_half_width_mm=read_only(system.manufacturing_half_width_mm[order]),
        views=system.views[::-1],
    )
    assert score(other, losses=False).targets[0].p95_mm == pytest.approx(
        score(system, losses=False).targets[0].p95_mm, rel=1e-7
    )


@pytest.mark.long
@few
@given(seeds, st.floats(1.01, 3.0))
def test_more_noise_is_never_less_risk(seed, factor):
    """At zero bias every law here is symmetric-unimodal: Anderson's theorem."""
    system = well_posed(seed)
    system = replace(system, execution=replace(system.execution, known=read_only(np.zeros(3))))
    louder = replace(
        system, views=tuple(replace(v, fiducial_noise_px=factor * v.fiducial_noise_px) for v in system.views)
    )
    assert score(louder, losses=False).targets[0].p95_mm >= score(system, losses=False).targets[0].p95_mm * (1 - 1e-7)
    sloppier = replace(system, manufacturing_half_width_mm=factor * system.manufacturing_half_width_mm)
    assert score(sloppier, losses=False).targets[0].p95_mm >= score(system, losses=False).targets[0].p95_mm * (1 - 1e-7)
