"""Compiled systems that tests build directly: the reference C-arm, the cube of the oracles, random ones.

Every builder takes keyword changes and hands them to :func:`dataclasses.replace`, so a test says only
what it changes: ``cube8_system(reading=Reading.EQ18)``, ``cios_system(views=with_noise(2.0))``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from tailstack.design import compile_design, load_design
from tailstack.effects.ball_images import ball_images
from tailstack.effects.image_field import image_field
from tailstack.effects.intrinsics import UNITS, intrinsics_error
from tailstack.effects.motion import motion
from tailstack.effects.temperature import temperature
from tailstack.geometry.arrays import Array
from tailstack.system import (
    INTRINSICS,
    DirectEffect,
    Effect,
    Estimator,
    Law,
    Sources,
    System,
    Target,
    View,
    execution_of,
    no_sources,
)
from tailstack.system import mount as mount_of
from typical import declare_all

TORSOR = ("rx", "ry", "rz", "tx", "ty", "tz")
FOCAL_PX = 1020.0 / 0.194
PRINCIPAL_PX = 767.5
TARGET_MM = (0.0, 0.0, 70.0)


def read_only(values: Any) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


def projection_looking(azimuth_rad: float, depth_mm: float = 700.0, elevation_rad: float = 0.0) -> Array:
    """(3, 4) projection of a source at ``depth_mm`` from the origin, detector rows along -z at elevation 0.

    Azimuth 0 looks along +y (the oracles' AP), azimuth pi/2 along -x (their LAT).
    """
    c, s = np.cos(azimuth_rad), np.sin(azimuth_rad)
    ce, se = np.cos(elevation_rad), np.sin(elevation_rad)
    right = np.array([c, s, 0.0])
    forward = np.array([-s * ce, c * ce, se])
    down = np.cross(forward, right)
    pose = np.column_stack([np.array([right, down, forward]), [0.0, 0.0, depth_mm]])
    camera = np.array([[FOCAL_PX, 0, PRINCIPAL_PX], [0, FOCAL_PX, PRINCIPAL_PX], [0, 0, 1.0]])
    return read_only(camera @ pose)


def with_noise(
    fiducial_px: float = 0.5, target_px: float | None = None, azimuths_rad: tuple[float, ...] = (0.0, np.pi / 2)
) -> tuple[View, ...]:
    """Views of the reference C-arm (AP and LAT unless other azimuths are given)."""
    target_px = fiducial_px if target_px is None else target_px
    return tuple(
        View(f"view{k}", projection_looking(angle), fiducial_px, target_px, (1536, 1536))
        for k, angle in enumerate(azimuths_rad)
    )


def mount(
    name: str,
    pivot_mm: Any = (0.0, 0.0, 0.0),
    *,
    bias: Any = (0.0,) * 6,
    half_width: Any = (0.0,) * 6,
    law: Law | tuple[Law, ...] = Law.NORMAL,
    coverage_factor: float = 1.0,
) -> DirectEffect:
    """A mount with one source per torsor component whose half-width (rad, mm) is not zero."""
    laws = law if isinstance(law, tuple) else (law,) * 6
    kept = [j for j in range(6) if half_width[j] != 0]
    sources = Sources(
        names=tuple(TORSOR[j] for j in kept),
        laws=tuple(laws[j] for j in kept),
        half_width=read_only([half_width[j] for j in kept]),
        coverage_factor=read_only([coverage_factor if laws[j] is Law.NORMAL else 1.0 for j in kept]),
        units=tuple("rad" if j < 3 else "mm" for j in kept),
        direction=read_only(np.eye(6)[:, kept]),
    )
    return mount_of(name, read_only(pivot_mm), read_only(bias), sources)


def execution(half_width_mm: float, law: Law = Law.NORMAL, known_mm: Any = (0.0,) * 3) -> DirectEffect:
    """Repeatability of the same half-width along each axis of tcp."""
    sources = Sources(
        ("x", "y", "z"),
        (law,) * 3,
        read_only([half_width_mm] * 3),
        read_only(np.ones(3)),
        ("mm",) * 3,
        read_only(np.eye(3)),
    )
    return execution_of(sources, read_only(known_mm))


def target(position_mm: Any, name: str = "target") -> Target:
    return Target(name, read_only(position_mm))


def system_of(fiducials_mm: Any, **changes: Any) -> System:
    """Reference C-arm, 0.5 px, everything else exact and in place."""
    fiducials = read_only(fiducials_mm)
    base = System(
        name="scene",
        views=with_noise(0.5),
        fiducial_labels=tuple(f"F{i + 1}" for i in range(len(fiducials))),
        fiducials_mm=fiducials,
        manufacturing_law=Law.NORMAL,
        manufacturing_half_width_mm=read_only(np.zeros_like(fiducials)),
        manufacturing_coverage_factor=1.0,
        structure_connector=mount("structure_connector", (0.0, 0.0, -95.0)),
        connector_flange=mount("connector_flange", (0.0, 0.0, -145.0)),
        T_flange_con=read_only(np.eye(4)),
        T_tcp_flange=read_only(np.eye(4)),
        hand_eye=mount("hand_eye"),
        execution=execution_of(no_sources(3), read_only(np.zeros(3))),
        targets=(target(TARGET_MM),),
        requirements=(),
    )
    return replace(base, **changes)


def cube_fiducials(half_mm: float = 50.0, centre_mm: Any = (0.0, 0.0, -40.0)) -> Array:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return read_only(np.asarray(centre_mm) + half_mm * signs)


def cube8_system(**changes: Any) -> System:
    """The oracles' eight corners of a 100 mm cube about (0, 0, -40), target (0, 0, 70), 0.5 px."""
    return system_of(cube_fiducials(), **changes)


def broken_system(**changes: Any) -> System:
    """Seven fiducials in 10 mm, target 30 mm away: half a pixel is beyond the range of any linearisation."""
    points = np.random.default_rng(5).uniform(-5, 5, (7, 3))
    return replace(system_of(points, targets=(target((0, 0, 30)),)), **changes)


CIOS_FIDUCIALS_MM = (
    (-50, -50, -90), (50, -50, -90), (50, 50, -90), (-50, 50, -90),
    (-50, -46, 10), (46, -50, 10), (50, 46, 10), (-46, 50, 10),
    (-22, -48, -35), (48, -18, -52), (20, 50, -44), (-50, 24, -28),
)  # fmt: skip


def installation(name: str, pivot_mm: Any, rotation_deg: float = 0.5, translation_mm: float = 0.5) -> DirectEffect:
    """Six normal components whose *standard deviations* are the given ones (half-width at factor 2)."""
    half = 2 * np.array([np.deg2rad(rotation_deg)] * 3 + [translation_mm] * 3)
    return mount(name, pivot_mm, half_width=half, coverage_factor=2.0)


def cios_system(**changes: Any) -> System:
    """The performance scene: 12 fiducials in a 100 mm box, 0.5 px, both interfaces 3 x 0.5 deg + 3 x 0.5 mm
    (standard deviations): 64 normal deviates a trial."""
    base = system_of(
        CIOS_FIDUCIALS_MM,
        structure_connector=installation("structure_connector", (0.0, 0.0, -95.0)),
        connector_flange=installation("connector_flange", (0.0, 0.0, -145.0)),
    )
    return replace(base, **changes)


def random_rigid(rng: np.random.Generator, shift_mm: float = 100.0) -> Array:
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    transform = np.eye(4)
    transform[:3, :3] = q * np.sign(np.linalg.det(q))
    transform[:3, 3] = rng.uniform(-shift_mm, shift_mm, 3)
    return read_only(transform)


def random_system(
    rng: np.random.Generator, fiducials: int = 10, views: int = 2, targets: int = 1, **changes: Any
) -> System:
    """Random well-posed scene in which every error source is at work, laws mixed, transforms general."""
    azimuths = rng.uniform(0, 0.3) + np.linspace(0.0, np.pi / 2 * (1 + 0.2 * (views > 2)), views)
    seen = tuple(
        View(f"view{k}", projection_looking(a, rng.uniform(600, 850), rng.uniform(-0.2, 0.2)),
             rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.8), (1536, 1536))
        for k, a in enumerate(azimuths)
    )  # fmt: skip
    laws = tuple(Law(str(law)) for law in rng.choice([Law.NORMAL, Law.UNIFORM, Law.TRIANGULAR], 6))
    half = np.array([np.deg2rad(0.4)] * 3 + [0.4] * 3)

    def tilted(name: str) -> DirectEffect:
        made = mount(name, rng.uniform(-100, 100, 3), bias=rng.normal(size=6) * half, half_width=half, law=laws)
        mixed = rng.normal(size=(6, 6)) * 0.3 + np.eye(6)
        return replace(
            made, sources=replace(made.sources, direction=read_only(np.diag(half) @ mixed @ np.diag(1 / half)))
        )

    base = system_of(
        rng.uniform(-50, 50, (fiducials, 3)) + np.array([0, 0, -20.0]),
        views=seen,
        manufacturing_half_width_mm=read_only(rng.uniform(0.01, 0.05, (fiducials, 3))),
        manufacturing_law=Law(str(rng.choice([Law.NORMAL, Law.UNIFORM, Law.TRIANGULAR]))),
        structure_connector=tilted("structure_connector"),
        connector_flange=tilted("connector_flange"),
        T_flange_con=random_rigid(rng),
        T_tcp_flange=random_rigid(rng),
        hand_eye=tilted("hand_eye"),
        execution=execution(0.1, Law.UNIFORM, rng.normal(size=3) * 0.1),
        targets=tuple(target(rng.uniform(-30, 60, 3), f"t{k}") for k in range(targets)),
    )
    return replace(base, **changes)


def with_unseen(system: System, view: int, missing: tuple[str, ...]) -> System:
    """The system with a view that does not see these fiducials."""
    sees = tuple(label for label in system.fiducial_labels if label not in missing)
    views = tuple(replace(each, sees=sees) if v == view else each for v, each in enumerate(system.views))
    return replace(system, views=views)


def with_effects(system: System, *effects: Effect) -> System:
    """The system with these effects, in place of its own of the same name, in the order of the table of effects."""
    first = ("assumed_intrinsics", "motion", "image_field", "temperature", "ball_images")
    every = {effect.name: effect for effect in (*system.effects, *effects)}

    def place(effect: Effect) -> int:
        name = effect.name.split(":")[0]
        return first.index(name) if name in first else len(first)

    return replace(system, effects=tuple(sorted(every.values(), key=place)))


def effect_named(system: System, name: str) -> Any:
    """The effect; None: it is not declared."""
    return next((effect for effect in system.effects if effect.name == name), None)


def with_intrinsics(
    system: System,
    half_widths: Any = (0.0, 0.0, 0.0),
    bias: Any = (0.0, 0.0, 0.0),
    law: Law | tuple[Law, ...] = Law.NORMAL,
    *,
    prior: tuple[float, float] | None = None,
    coverage_factor: Any = (1.0, 1.0, 1.0),
) -> System:
    """The system whose views are told intrinsics (focal length, principal point) that are known so well, and off by
    as much."""
    sources = no_sources(3)
    if np.any(half_widths):
        laws = law if isinstance(law, tuple) else (law,) * 3
        sources = Sources(
            INTRINSICS, laws, read_only(half_widths), read_only(coverage_factor), UNITS, read_only(np.eye(3))
        )
    views = tuple(replace(view, intrinsics_prior=prior or view.intrinsics_prior) for view in system.views)
    return with_effects(
        replace(system, views=views), *(intrinsics_error(view.name, bias, sources) for view in system.views)
    )


def with_balls(system: System, radius_mm: float) -> System:
    """The system whose fiducials are balls."""
    effect = ball_images(radius_mm, 1.0, tuple(view.name for view in system.views))
    return with_effects(replace(system, fiducial_radius_mm=radius_mm), effect)


def with_systematic(system: System, *, known: bool = False) -> System:
    """The system with a motion before its last view, image fields, temperature and, where ``known``, balls of 8 mm and
    a known difference of temperature."""
    half = np.array([np.deg2rad(0.3)] * 3 + [0.2] * 3)
    moved = mount("structure_connector", (5.0, -10.0, -90.0), half_width=half, law=Law.NORMAL)
    kelvin = Sources(("difference",), (Law.TRIANGULAR,), read_only([10.0]), np.ones(1), ("K",), read_only(np.eye(1)))
    seats = read_only([3, 4, -90]), read_only([0, 9, -190])
    system = with_effects(
        system,
        motion(system.views[-1].name, moved.pivot_mm, moved.sources),
        *(image_field(view.name, (1536, 1536), [0.0, 0.0, 0.4, 0.4], Law.UNIFORM) for view in system.views),
        temperature(15.0 if known else 0.0, kelvin, (47e-6, 23e-6), seats),
    )
    return with_balls(system, 4.0) if known else system


def every_effect(rng: np.random.Generator, **changes: Any) -> System:
    """A random scene in which everything that can be declared is at work, known and random, in every view: of every
    effect that there is what its fields say is typical, and where a document cannot state what is known, some of it."""
    base = random_system(rng, fiducials=12)
    views = [
        {
            "name": view.name, "fiducial_noise_px": 0.5, "target_noise_px": 0.5, "image_size_px": [1536, 1536],
            "projection": view.projection.tolist(), "fiducial_noise_shape": [[1.3, 0.4], [0.4, 0.7]],
        }
        for view in base.views
    ]  # fmt: skip
    document = {
        "schema": "tailstack/design/1", "name": base.name, "views": views,
        "fiducials": {"points": [{"position_mm": place} for place in base.fiducials_mm.tolist()]},
        "targets": [{"name": each.name, "position_mm": each.position_mm.tolist()} for each in base.targets],
        "model": {"estimator": str(Estimator.POSE)},
    }  # fmt: skip
    compiled = compile_design(load_design(declare_all(document, rng)))
    base = replace(base, effects=tuple(map(_known, compiled.effects)), fiducial_radius_mm=compiled.fiducial_radius_mm)
    shaped = zip(base.views, compiled.views, strict=True)
    base = replace(base, views=tuple(replace(view, noise_factors=each.noise_factors) for view, each in shaped))
    return replace(base, estimator=Estimator.POSE, **changes)


def _known(effect: Effect) -> Effect:
    """The effect with something known, a part of what is random where nothing is."""
    part = effect.sources.direction @ (0.3 * effect.sources.half_width)
    return effect if effect.known.any() else replace(effect, known=read_only(part))


def taken(system: System, lost: Collection[int]) -> System:
    """The system without these fiducials (indices), as if they had never been there."""
    rest = [i for i in range(len(system.fiducials_mm)) if i not in lost]
    labels = tuple(system.fiducial_labels[i] for i in rest)
    return replace(
        system,
        fiducial_labels=labels,
        fiducials_mm=read_only(system.fiducials_mm[rest]),
        manufacturing_half_width_mm=read_only(system.manufacturing_half_width_mm[rest]),
        views=tuple(
            view if view.sees is None else replace(view, sees=tuple(label for label in view.sees if label in labels))
            for view in system.views
        ),
        loss_probability=(),
    )
