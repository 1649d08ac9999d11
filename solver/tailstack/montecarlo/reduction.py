"""Norms and moments of one block of error vectors, eight partial sums at a time.

Lane k sums trials k, k + 8, ...; the lanes are then added in order, and what does not fill eight last.  That is one
fixed order of summation on every machine.
"""

# mypy: ignore-errors
from __future__ import annotations

from math import sqrt

from .lanes import fma, lane_entry, lane_jit, load, splat, square_root, store


@lane_jit
def lane_sum(lanes, row):
    total = 0.0
    for k in range(8):
        total += lanes[8 * row + k]
    return total


@lane_entry
def reduce_block(errors, n, norms, mean, scatter, norm_mean, lanes):
    """Norms (flat m n), mean (m, 3), scatter about it (m, 3, 3) and mean norm (m,) of flat (m, 3, n) errors, mm.

    lanes: scratch of 48.  The norm is written without fused operations so that the last, incomplete eight have the
    digits they would have in a longer run.
    """
    zero = splat(0.0)
    whole = n - n % 8
    for m in range(norm_mean.size):
        at = 3 * m * n
        sx, sy, sz, sn = zero, zero, zero, zero
        for i in range(0, whole, 8):
            x, y, z = load(errors, at + i), load(errors, at + n + i), load(errors, at + 2 * n + i)
            norm = square_root(x * x + y * y + z * z)
            store(norms, m * n + i, norm)
            sx, sy, sz, sn = sx + x, sy + y, sz + z, sn + norm
        store(lanes, 0, sx)
        store(lanes, 8, sy)
        store(lanes, 16, sz)
        store(lanes, 24, sn)
        tx, ty, tz, tn = lane_sum(lanes, 0), lane_sum(lanes, 1), lane_sum(lanes, 2), lane_sum(lanes, 3)
        for i in range(whole, n):
            x, y, z = errors[at + i], errors[at + n + i], errors[at + 2 * n + i]
            norms[m * n + i] = sqrt(x * x + y * y + z * z)
            tx, ty, tz, tn = tx + x, ty + y, tz + z, tn + norms[m * n + i]
        ax, ay, az = tx / n, ty / n, tz / n
        mean[m, 0], mean[m, 1], mean[m, 2], norm_mean[m] = ax, ay, az, tn / n

        xx, xy, xz, yy, yz, zz = zero, zero, zero, zero, zero, zero
        for i in range(0, whole, 8):
            x = load(errors, at + i) - splat(ax)
            y = load(errors, at + n + i) - splat(ay)
            z = load(errors, at + 2 * n + i) - splat(az)
            xx, xy, xz = fma(x, x, xx), fma(x, y, xy), fma(x, z, xz)
            yy, yz, zz = fma(y, y, yy), fma(y, z, yz), fma(z, z, zz)
        store(lanes, 0, xx)
        store(lanes, 8, xy)
        store(lanes, 16, xz)
        store(lanes, 24, yy)
        store(lanes, 32, yz)
        store(lanes, 40, zz)
        cxx, cxy, cxz = lane_sum(lanes, 0), lane_sum(lanes, 1), lane_sum(lanes, 2)
        cyy, cyz, czz = lane_sum(lanes, 3), lane_sum(lanes, 4), lane_sum(lanes, 5)
        for i in range(whole, n):
            x, y, z = errors[at + i] - ax, errors[at + n + i] - ay, errors[at + 2 * n + i] - az
            cxx, cxy, cxz = cxx + x * x, cxy + x * y, cxz + x * z
            cyy, cyz, czz = cyy + y * y, cyz + y * z, czz + z * z
        scatter[m, 0, 0], scatter[m, 1, 1], scatter[m, 2, 2] = cxx, cyy, czz
        scatter[m, 0, 1] = scatter[m, 1, 0] = cxy
        scatter[m, 0, 2] = scatter[m, 2, 0] = cxz
        scatter[m, 1, 2] = scatter[m, 2, 1] = cyz
