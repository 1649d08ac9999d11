"""The compiled tables: their frame against LAPACK, their digits against the processor's BLAS, their blocks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scenes import cios_system, cube8_system, random_system
from tailstack.estimation.resection import hartley_similarity, homogeneous
from tailstack.montecarlo.plan import compile_plan, object_frame, principal_axes
from tailstack.system import Law

ORACLE = Path(__file__).parents[1] / "data" / "oracles" / "noise_covariance_cube8.json"


@pytest.mark.parametrize("seed", range(5))
def test_principal_axes_against_lapack(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    spectra = np.array([[3, 2, 1], [5, 5, 1], [1, 1, 1], [4, 1e-9, 0], [1e6, 1, 1e-6]])
    moment = basis @ np.diag(spectra[seed]) @ basis.T
    axes = principal_axes((moment + moment.T) / 2)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(axes) > 0
    turned = axes @ moment @ axes.T
    np.testing.assert_allclose(turned, np.diag(np.diag(turned)), atol=1e-14 * np.abs(moment).max())
    np.testing.assert_allclose(np.sort(np.diag(turned)), np.linalg.eigvalsh(moment), atol=1e-9 * np.abs(moment).max())


def test_object_frame_is_hartleys_turned() -> None:
    points = random_system(np.random.default_rng(0), 15).fiducials_mm
    out, into, centroid, y = object_frame(points)
    np.testing.assert_allclose(out @ into, np.eye(3), atol=1e-13)
    np.testing.assert_allclose(y @ out.T + centroid, points, atol=1e-11)
    hartley = (homogeneous(points) @ hartley_similarity(points).T)[:, :3]
    np.testing.assert_allclose(np.linalg.norm(y, axis=1), np.linalg.norm(hartley, axis=1), rtol=1e-12)
    moment = y.T @ y
    np.testing.assert_allclose(moment, np.diag(np.diag(moment)), atol=1e-12 * moment.max())


def test_blocks_cover_the_columns_in_order() -> None:
    plan = compile_plan(random_system(np.random.default_rng(1), 9, 3, targets=2))
    assert [block.start for block in plan.blocks] == [0, *[block.stop for block in plan.blocks[:-1]]]
    assert plan.blocks[-1].stop == plan.dimension == len(plan.laws) == len(plan.standard_std)
    names = [block.name for block in plan.blocks]
    assert names[:2] == ["fiducial_noise:view0", "target_noise:view0"]
    assert names[6:] == ["fiducial_manufacturing", "structure_connector", "connector_flange", "hand_eye", "execution"]
    std = {Law.NORMAL: 1, Law.UNIFORM: 1 / np.sqrt(3), Law.TRIANGULAR: 1 / np.sqrt(6)}
    np.testing.assert_allclose(plan.standard_std, [std[law] for law in plan.laws])


def test_the_performance_scene_has_64_deviates() -> None:
    assert compile_plan(cios_system()).dimension == 64
    assert compile_plan(cube8_system()).dimension == 36


def test_tables_are_read_only() -> None:
    for table in compile_plan(cios_system()).tables:
        with pytest.raises(ValueError, match="read-only"):
            table[...] = 0


@pytest.mark.long
def test_digits_do_not_come_from_the_processors_blas() -> None:
    """The same system compiled on two of OpenBLAS's kernel sets, and without NumPy's wide instructions."""
    program = f"""
import hashlib, json
from dataclasses import replace
import numpy as np
from scenes import CIOS_FIDUCIALS_MM, installation, read_only, system_of, with_noise
from tailstack.montecarlo.plan import compile_plan
views = [replace(v, projection=read_only(p)) for v, p in zip(with_noise(), json.load(open({str(ORACLE)!r}))["P"])]
mounts = {{name: installation(name, (1, 2, -95)) for name in ("structure_connector", "connector_flange")}}
plan = compile_plan(system_of(np.array(CIOS_FIDUCIALS_MM) * 1.01, views=tuple(views), **mounts))
print(hashlib.sha256(b"".join(t.tobytes() for t in plan.tables)).hexdigest())
"""
    digests = set()
    for changes in ({}, {"OPENBLAS_CORETYPE": "Nehalem"}, {"OPENBLAS_CORETYPE": "Haswell"}):
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | changes
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        digests.add(done.stdout)
    assert len(digests) == 1
