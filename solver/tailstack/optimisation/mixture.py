"""The mixture of layouts that knows most, or has the least mean square, by columns and Newton's method, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.store import kernel

FADED, KEPT = 1e-3, 8  # the share below which a layout is forgotten for the next aims, and how many are not
SINGULAR = 1e-14  # of an entry on the diagonal: what is left of it at least
WIDER = 4  # than the cells that beads are in: how many are looked at between two looks at all
BARRIER, SOFTER, NEARLY = 0.1, 0.7, 0.9  # of what is told, at first; from layout to layout; how near a share comes to 0


class MixedParts(NamedTuple):
    """Of all groups of cells, one after the other."""

    slopes: Array  # (R, D, n) whitened; 0 where a group has fewer rows
    first: NDArray[np.int64]  # (G + 1,) where each group begins
    kept: NDArray[np.int64]  # (G,) in how many of its cells beads are where they know most
    in_each: NDArray[np.int64]  # (G,) beads in each of these
    base: Array  # (D, D) information of the target's own images
    evenly: Array  # (D, D) of that and of beads spread evenly


class Mixed(NamedTuple):
    """What each aim comes to, and, of a single one, the shares of layouts and what was added."""

    z: Array  # (K, A, D)
    shares: Array  # (1 + rounds,) of the even one, and of those that were added
    cells: NDArray[np.int64]  # (rounds, sum of kept) of each layout that was added


@kernel(nogil=True)
def factorise(matrix: Array) -> None:
    """Replace the lower half of a symmetric and positive matrix (D, D) by its triangular factor."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(max(total, SINGULAR * matrix[i, i])) if i == j else total / matrix[j, j]


@kernel(nogil=True)
def solve_positive(matrix: Array, right: Array) -> None:
    """Replace right (A, D) by the solutions x of ``matrix x = right``, one in each row; matrix (D, D) symmetric and
    positive becomes its triangular factor."""
    factorise(matrix)
    substitute(matrix, right)


@kernel(nogil=True)
def substitute(matrix: Array, right: Array) -> None:
    """The same, of the triangular factor (D, D)."""
    size = len(matrix)
    for a in range(len(right)):
        for i in range(size):
            for k in range(i):
                right[a, i] -= matrix[i, k] * right[a, k]
            right[a, i] /= matrix[i, i]
        for i in range(size - 1, -1, -1):
            right[a, i] /= matrix[i, i]
            for k in range(i):
                right[a, k] -= matrix[i, k] * right[a, i]


@kernel(nogil=True)
def find_unknowns(known: Array, aims: Array, fixed: bool, z: Array) -> None:
    """Fill z (A, D): ``known^-1`` times aims (A, 3), or the least ``z' known z`` whose target part is the aim."""
    size = len(known)
    if fixed:
        rest = known[3:, 3:].copy()
        right = np.zeros((len(aims), size - 3))
        for a in range(len(aims)):
            for i in range(size - 3):
                for k in range(3):
                    right[a, i] -= known[3 + i, k] * aims[a, k]
        solve_positive(rest, right)
        z[:, :3] = aims
        z[:, 3:] = right
    else:
        z[:] = 0.0
        z[:, :3] = aims
        solve_positive(known.copy(), z)


@kernel(nogil=True)
def add_times(total: Array, factor: float, row: Array) -> None:
    """Add a multiple of row (n,) to total (n,): in lanes, and nothing is kept between."""
    for i in range(len(total)):
        total[i] += factor * row[i]


@kernel(nogil=True)
def told_along(matrix: Array, z: Array, turned: Array) -> float:
    """The sum of ``z' matrix z`` over z (A, D), matrix (D, D) symmetric; ``matrix z`` fills turned (A, D)."""
    total = 0.0
    for a in range(len(z)):
        turned[a] = 0.0
        for i in range(len(matrix)):
            add_times(turned[a], z[a, i], matrix[i])
        for i in range(len(matrix)):
            total += turned[a, i] * z[a, i]
    return total


@kernel(nogil=True)
def improve_shares(layouts: Array, shares: Array, fixed: bool, z: Array, known: Array, barrier: float) -> None:
    """One step of Newton's method for the shares (S,) of layouts (S, D, D), which add up to 1, each kept from 0 by a
    barrier; z (A, D) is that of their mixture known (D, D).

    What they are told by is a sum of squares, whose slopes by the shares are ``z' F z`` (of its inverse: the
    opposite), and whose second derivatives ``-2 (F z)' known^-1 (F' z)``.
    """
    count, begin, size = len(shares), 3 if fixed else 0, z.shape[1]
    told, turned = np.zeros(count), np.zeros((count, *z.shape))
    for s in range(count):
        told[s] = told_along(layouts[s], z, turned[s])
    soft = barrier * (shares * told).sum() / count
    bent, factor = np.zeros((count, count)), known[begin:, begin:].copy()
    lead, solved = np.zeros((count, size - begin)), np.zeros((count, size - begin))
    for a in range(len(z)):
        lead[:] = turned[:, a, begin:]
        solved[:] = lead
        if a == 0:
            solve_positive(factor, solved)
        else:
            substitute(factor, solved)
        for s in range(count):
            for other in range(count):
                total = 0.0
                for i in range(size - begin):
                    total += lead[s, i] * solved[other, i]
                bent[s, other] += 2 * total
    right = np.ones((2, count))
    for s in range(count):
        right[0, s] = told[s] + soft / shares[s]
        bent[s, s] += soft / shares[s] ** 2
    solve_positive(bent, right)
    step = right[0] - right[0].sum() / right[1].sum() * right[1]
    longest = 1.0 if np.isfinite(step).all() else 0.0
    for s in range(count):
        if step[s] < 0:
            longest = min(longest, -NEARLY * shares[s] / step[s])
    if longest > 0:
        shares += longest * step
        shares /= shares.sum()


@kernel(nogil=True)
def whiten_rows(slopes: Array, moved: Array) -> None:
    """Replace slopes (n, R, D), those of unit variances, by ``C^-1 slopes``, C the triangular factor of the covariance
    ``1 + B B'`` that they have beside what moves a bead, B (n, R, 3) = moved."""
    rows = slopes.shape[1]
    factor = np.zeros((rows, rows))
    for n in range(len(slopes)):
        own, by = slopes[n], moved[n]
        for i in range(rows):
            for j in range(i + 1):
                factor[i, j] = by[i, 0] * by[j, 0] + by[i, 1] * by[j, 1] + by[i, 2] * by[j, 2]
            factor[i, i] += 1.0
        factorise(factor)
        for i in range(rows):
            for j in range(i):
                add_times(own[i], -factor[i, j], own[j])
            for d in range(own.shape[1]):
                own[i, d] /= factor[i, i]


@kernel(nogil=True)
def told_by_rows(slopes: Array, along: Array) -> Array:
    """(n, K) what a bead in each of n cells tells along K columns of unknowns (D, K), slopes (n, R, D)."""
    told, line = np.zeros((len(slopes), along.shape[1])), np.zeros(along.shape[1])
    for i in range(len(slopes)):
        for r in range(slopes.shape[1]):
            line[:] = 0.0
            for d in range(slopes.shape[2]):
                slope = slopes[i, r, d]
                for k in range(len(line)):
                    line[k] += slope * along[d, k]
            for k in range(len(line)):
                told[i, k] += line[k] * line[k]
    return told


@kernel(nogil=True)
def information_by_rows(slopes: Array, weights: Array) -> Array:
    """(D, D) information of beads in n cells, as many as weights (n,) say, slopes (n, R, D)."""
    size = slopes.shape[2]
    total = np.zeros((size, size))
    for i in range(len(slopes)):
        for r in range(slopes.shape[1]):
            for d in range(size):
                own = weights[i] * slopes[i, r, d]
                for e in range(size):
                    total[d, e] += own * slopes[i, r, e]
    return total


@kernel(nogil=True)
def fill_told(slopes: Array, z: Array, line: Array, values: Array) -> None:
    """Fill values (n,) with what a bead in each of the first cells tells along all z (A, D), slopes (R, D, n or more);
    line (n,) is used."""
    values[:] = 0.0
    for r in range(slopes.shape[0]):
        for a in range(len(z)):
            line[:] = 0.0
            for d in range(slopes.shape[1]):
                add_times(line, z[a, d], slopes[r, d, : len(values)])
            for i in range(len(values)):
                values[i] += line[i] * line[i]


@kernel(nogil=True)
def fill_largest(values: Array, first: int, largest: NDArray[np.int64]) -> None:
    """Fill largest (kept,) with places of the largest of values from ``first`` on; there are as many or more."""
    for i in range(len(largest)):
        largest[i] = first + i
    least = 0
    for k in range(1, len(largest)):
        if values[largest[k]] < values[largest[least]]:
            least = k
    for i in range(first + len(largest), len(values)):
        if values[i] > values[largest[least]]:
            largest[least] = i
            least = 0
            for k in range(1, len(largest)):
                if values[largest[k]] < values[largest[least]]:
                    least = k


@kernel(nogil=True)
def mix(parts: MixedParts, aims: Array, fixed: bool, rounds: int, again: int, updates: int) -> Mixed:
    """For each of K sets of aims (K, A, 3), as in :func:`find_unknowns`, the z with nearly the most ``(aims . z)^2``
    over what the best layout knows along z.

    The layout that knows most along the z of the mixture so far is added to it, ``rounds`` times for the first,
    ``again`` for each of the others, which begin with the mixture of the one before; then shares are improved.  Between
    the first and the last only cells that were among the likely ones before are looked at.
    """
    size, count, rows = len(parts.base), parts.slopes.shape[2], len(parts.slopes)
    most = 1 + KEPT + max(rounds, again)
    layouts, shares, turned = np.zeros((most, size, size)), np.zeros(most), np.zeros((aims.shape[1], size))
    cells = np.zeros((rounds, parts.kept.sum()), dtype=np.int64)
    layouts[0], shares[0], held = parts.evenly, 1.0, 1
    found, z = np.zeros((aims.shape[0], aims.shape[1], size)), np.zeros((aims.shape[1], size))
    known, row, values, line = np.zeros((size, size)), np.zeros(size), np.zeros(count), np.zeros(count)
    likely, place, some = np.zeros(WIDER * parts.kept.max(), np.int64), np.full(count, -1), np.zeros(count, np.int64)
    slopes, told, few = np.zeros(parts.slopes.shape), np.zeros(count), 0
    for which in range(len(aims)):
        best = 0.0
        for turn in range(rounds if which == 0 else again):
            for update in range(updates + 1):
                known[:] = 0.0
                for s in range(held):
                    for d in range(size):
                        add_times(known[d], shares[s], layouts[s, d])
                find_unknowns(known, aims[which], fixed, z)
                if update < updates and held > 1:
                    softer = BARRIER * SOFTER ** (turn + update / updates)
                    improve_shares(layouts[:held], shares[:held], fixed, z, known, softer)
            if turn == 0 or which == 0:
                fill_told(parts.slopes, z, line, values)
                for g in range(len(parts.kept)):
                    wide = min(parts.kept[g] * WIDER, parts.first[g + 1] - parts.first[g])
                    fill_largest(values[: parts.first[g + 1]], parts.first[g], likely[:wide])
                    for i in likely[:wide]:
                        if place[i] < 0:
                            place[i] = few
                            some[few] = i
                            slopes[:, :, few] = parts.slopes[:, :, i]
                            few += 1
            else:
                fill_told(slopes, z, line[:few], told[:few])
                values[:] = -1.0
                for i in range(few):
                    values[some[i]] = told[i]
            layouts[held] = parts.base
            total, begin = told_along(parts.base, z, turned), 0
            for g in range(len(parts.kept)):
                largest = cells[turn if which == 0 else 0, begin : begin + parts.kept[g]]
                fill_largest(values[: parts.first[g + 1]], parts.first[g], largest)
                for i in largest:
                    total += parts.in_each[g] * values[i]
                    for r in range(rows):
                        for d in range(size):
                            row[d] = parts.slopes[r, d, i]
                        for d in range(size):
                            add_times(layouts[held, d], parts.in_each[g] * row[d], row)
                begin += parts.kept[g]
            reached = (aims[which] * z[:, :3]).sum() ** 2 / total
            if reached > best:
                best = reached
                found[which] = z
            shares[:held] *= held / (held + 1)
            shares[held] = 1 / (held + 1)
            held += 1
        if which + 1 < len(aims):
            order = np.argsort(-shares[:held])[:KEPT]
            remain = 0
            for s in np.sort(order):
                if shares[s] >= FADED:
                    layouts[remain], shares[remain] = layouts[s], shares[s]
                    remain += 1
            held = remain
            shares[:held] /= shares[:held].sum()
    return Mixed(found, shares[: 1 + rounds], cells)
