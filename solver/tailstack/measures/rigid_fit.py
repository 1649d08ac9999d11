"""The rigid motion that fits the points of a body, and what is left of their errors: the arrays of ``rigid_body``, in
a file of their own, so that who only names measures waits for none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .measure import Measured, MeasuredBody, Site, degrees_between

if TYPE_CHECKING:
    from .measure import Array, Exact

NEWTON_STEPS = 8  # from no turn; each squares what is missing
TURNED = 1e-9  # largest last step, rad, of a turn that is found


class BodyFit:
    """The points of a body and of the one that it is read against, and what fits their errors."""

    def __init__(self, design: Measured, body: MeasuredBody) -> None:
        places = {each.name: design.T_tcp_con[:3, :3] @ each.position_mm for each in design.targets}
        self.name, self.targets, self.against = body.name, body.targets, body.against
        self.points = np.array([places[name] for name in self.targets])
        self.others = np.array([places[name] for name in self.against]).reshape(-1, 3)

    def weights(self) -> dict[str, Array]:
        """By target, (K, 3, 3) from its error to those of the K points."""
        count = len(self.points)
        weights = {name: np.zeros((count, 3, 3)) for name in dict.fromkeys((*self.targets, *self.against))}
        for k, name in enumerate(self.targets):
            weights[name][k] += np.eye(3)
        if self.against:
            arms = cross_matrices(self.points - self.others.mean(axis=0))
            for name, turn in zip(self.against, turn_weights(self.others), strict=True):
                weights[name] += arms @ turn - np.eye(3) / len(self.others)
        return weights

    def ways(self) -> dict[str, tuple[Array, Exact]]:
        """By measure: to first order, (K, 3, 3) from the errors of the K points; and what has it whole."""
        arms, each = ((self.points - self.points.mean(axis=0)) ** 2).sum(axis=1), np.ones((len(self.points), 1, 1))
        farthest = each * (np.arange(len(arms)) == arms.argmax())[:, None, None]
        return {
            "rotation": (
                np.rad2deg(turn_weights(self.points)),
                lambda errors: turn_vectors(self.points[:, :, None], self.errors_of_points(errors)),
            ),
            "translation": (each * np.eye(3) / len(arms), lambda errors: mean_in_order(self.errors_of_points(errors))),
            "worst_point": (farthest * np.eye(3), lambda errors: pick_longest(self.errors_of_points(errors))),
        }

    def site(self, measure: str, doubt: str) -> Site:
        """Where a measure of the body is read."""
        each, exact = self.ways()[measure]
        of_tool = {target: np.einsum("kij,kjl->il", each, weights) for target, weights in self.weights().items()}
        weights = {target: np.hstack([own, np.zeros((3, 3))]) for target, own in of_tool.items()}
        return Site(self.name, weights, exact, doubt=doubt)

    def errors_of_points(self, errors: Mapping[str, Array]) -> Array:
        """(K, 3, n) of the K points, of errors (6, n) by target."""
        own, others = (np.array([errors[name][:3] for name in names]) for names in (self.targets, self.against))
        return put_back(self.points[:, :, None], own, self.others[:, :, None], others)


def put_back(points: Array, errors: Array, others: Array, of_others: Array) -> Array:
    """(K, 3, n) what is left of errors of points (K, 3, n) when others, fitted by their own, are where they were;
    without others the errors themselves."""
    if not len(others):
        return errors
    shift, arms = mean_in_order(of_others), points - others.mean(axis=0)
    back = fit_turn(others, of_others) * np.array([1.0, -1.0, -1.0, -1.0])[:, None]
    return np.asarray(turn_points(back, arms + errors - shift) - arms)


def turn_vectors(points: Array, errors: Array) -> Array:
    """(3, n) axis times angle, deg, of the turns that :func:`fit_turn` finds."""
    turn = fit_turn(points, errors)
    size = np.sqrt(sum_in_order(turn[1:] ** 2))
    return np.asarray(turn[1:] * 2 * degrees_between(turn[0], size) / np.where(size > 0, size, 1))


def pick_longest(errors: Array) -> Array:
    """(3, n) of errors (K, 3, n) those of the point whose error is largest."""
    largest = (errors**2).sum(axis=1).argmax(axis=0)
    return np.asarray(np.take_along_axis(errors, largest[None, None], axis=0)[0])


def spread_of(points: Array) -> Array:
    """(3,) mm, largest first: singular values of points (K, 3) about their centroid."""
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), compute_uv=False))


def condition_number(points: Array) -> float:
    """1/m of points (K, 3) mm: the larger, the more their noise turns the body about the axis along which they lie
    (Soderkvist and Wedin 1993; ISO 16087, Annex A)."""
    return 1000 / float(np.hypot(*spread_of(points)[1:]))


def cross_matrices(points: Array) -> Array:
    """(K, 3, 3) that take a vector v to the cross product of each point (K, 3) and v."""
    return np.cross(points[:, None, :], np.eye(3)[None]).swapaxes(1, 2)


def turn_weights(points: Array) -> Array:
    """(K, 3, 3) from the error of each of points (K, 3) to the turn of the rigid motion that fits best, rad; not a
    number where points on a line leave one free."""
    crosses = cross_matrices(points - points.mean(axis=0))
    inertia = np.einsum("kij,klj->il", crosses, crosses)
    if np.linalg.cond(inertia) > 1e12:
        return np.full_like(crosses, np.nan)
    return np.asarray(np.linalg.solve(inertia, crosses))


def sum_in_order(each: Array) -> Array:
    """Over the first axis, one after the other: the same on every processor."""
    total: Array = each[0]
    for one in each[1:]:
        total = total + one
    return total


def mean_in_order(each: Array) -> Array:
    """:func:`sum_in_order` over their number."""
    return sum_in_order(each) / len(each)


def fit_turn(points: Array, errors: Array) -> Array:
    """(4, n) unit quaternions (w, x, y, z) of the turns that take points closest to points + errors (K, 3, n); points
    (K, 3, n), or (K, 3, 1) where they are the same throughout.

    Newton's method on the polar decomposition of their cross-covariance; where it does not end at its one maximum, the
    eigenvector of Horn's matrix.
    """
    arms = points - points.mean(axis=0)
    moved = arms + errors - mean_in_order(errors)
    covariance = sum_in_order(moved[:, :, None] * arms[:, None])  # (3, 3, n)
    turn = np.zeros((4, errors.shape[2]))
    turn[0] = 1.0
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            back = turn * np.array([1.0, -1.0, -1.0, -1.0])[:, None]
            left = np.stack([turn_points(back, covariance[:, j]) for j in range(3)], axis=1)
            odd = np.stack([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]])
            stiff = (left[0, 0] + left[1, 1] + left[2, 2]) * np.eye(3)[:, :, None] - (left + left.swapaxes(0, 1)) / 2
            columns = [np.cross(stiff[i - 2], stiff[i - 1], axis=0) for i in range(3)]
            size = sum_in_order(stiff[0] * columns[0])
            step = sum_in_order(np.stack([odd[i] * columns[i] for i in range(3)])) / size
            turn = multiply(turn, np.concatenate([np.ones((1, len(size))), step / 2]))
            turn = turn / np.sqrt(sum_in_order(turn**2))
        minor = stiff[0, 0] * stiff[1, 1] - stiff[0, 1] ** 2
        found = (np.abs(step).max(axis=0) < TURNED) & (stiff[0, 0] > 0) & (minor > 0) & (size > 0)
    for k in np.flatnonzero(~found & np.isfinite(covariance).all(axis=(0, 1))):
        turn[:, k] = horn(covariance[:, :, k])
    return np.where(turn[0] < 0, -turn, turn)


def horn(covariance: Array) -> Array:
    """(4,) the quaternion of the turn that fits best (Horn 1987), of a cross-covariance (3, 3) moved by planned."""
    odd = covariance - covariance.T
    matrix = np.empty((4, 4))
    matrix[0, 0] = np.trace(covariance)
    matrix[0, 1:] = matrix[1:, 0] = odd[2, 1], odd[0, 2], odd[1, 0]
    matrix[1:, 1:] = covariance + covariance.T - matrix[0, 0] * np.eye(3)
    return np.asarray(np.linalg.eigh(matrix)[1][:, -1])


def multiply(first: Array, second: Array) -> Array:
    """(4, n) products of quaternions."""
    scalar = first[0] * second[0] - sum_in_order(first[1:] * second[1:])
    vector = first[0] * second[1:] + second[0] * first[1:] + np.cross(first[1:], second[1:], axis=0)
    return np.concatenate([scalar[None], vector])


def turn_points(turn: Array, points: Array) -> Array:
    """Points (..., 3, n) turned by unit quaternions (4, n)."""
    axis = np.broadcast_to(turn[1:], points.shape)
    twice = 2 * np.cross(axis, points, axis=-2)
    return np.asarray(points + turn[0] * twice + np.cross(axis, twice, axis=-2))
