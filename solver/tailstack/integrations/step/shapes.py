"""Solids of a STEP file in their own unit: which of them is a ball, and what the others with a spherical face are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...geometry.arrays import Array
from .part21 import Instance, Part21, Reference

MOST_BALL_FACES = 100
# Keywords of surfaces as which a sphere may be exported that is not told as one; rational B-splines have several
_FREE = ("B_SPLINE_SURFACE", "SURFACE_OF_REVOLUTION")
ON_SPHERE = 5e-3  # of the radius: how far a ball's own vertices may be from it


@dataclass(frozen=True, slots=True, eq=False)
class SphericalSurface:
    centre: Array  # (3,)
    radius: float
    reason: str  # why it is no ball; empty: it is one


@dataclass(frozen=True, slots=True, eq=False)
class _Face:
    number: int
    surface: str  # keyword; empty: a surface of several types
    geometry: Reference
    outward: bool  # the face's normal is that of its surface
    bounds: list[Reference]


class Shapes:
    """Solids, their faces and what lies in them."""

    def __init__(self, file: Part21) -> None:
        self.file = file
        self._spheres: dict[int, list[SphericalSurface]] = {}
        self._free_form: set[int] = set()

    def is_free_form(self, number: int) -> bool:
        """Whether all faces of a solid are free-form or revolved, as a sphere may be exported, and on no sphere."""
        self.spheres(number)
        return number in self._free_form

    def spheres(self, number: int) -> list[SphericalSurface]:
        """The spheres on which a solid has faces, and of each why the solid is not the ball in it."""
        if number not in self._spheres:
            self._spheres[number] = self._judge(self.file.read(number))
        return self._spheres[number]

    def axis(self, number: int) -> tuple[Array, Array] | None:
        """The point in the middle of a solid's cylindrical faces and their direction, if they are about one axis."""
        outer, _ = self._shells(self.file.read(number))[0]
        faces = [face for face in self._faces(outer) if face.surface == "CYLINDRICAL_SURFACE"]
        if not faces:
            return None
        frames = [
            self.placement(self.file.values(face.geometry, face.surface, 3, face.number)[1], face.geometry)
            for face in faces
        ]
        origin, axis = frames[0][:3, 3], frames[0][:3, 2]
        if not all(is_on_axis(frame, origin, axis) for frame in frames):
            return None
        heights = [float((vertex - origin) @ axis) for face in faces for vertex in self._vertices(face)]
        return origin + axis * (min(heights) + max(heights)) / 2 if heights else origin, axis

    def face_numbers(self, number: int) -> list[int]:
        """Instances of the faces of a solid."""
        return [face.number for shell, _ in self._shells(self.file.read(number)) for face in self._faces(shell)]

    def describe_face(self, number: Reference) -> tuple[str, Array | None, float, Array]:
        """Its surface ("plane", "cylinder", or the keyword of another one), frame (4, 4) with z the normal or the axis
        (None of another one), radius, and points (n, 3) round it, in the unit of the file."""
        face = self._face(number, number)
        points = np.array([*self._vertices(face), *self._circles(face)]).reshape(-1, 3)
        if face.surface == "CYLINDRICAL_SURFACE":
            _, place, radius = self.file.values(face.geometry, face.surface, 3, number)
            return "cylinder", self.placement(place, face.geometry), self.file.number(radius, face.geometry), points
        if face.surface == "PLANE":
            place = self.file.values(face.geometry, face.surface, 2, number)[1]
            return "plane", self.placement(place, face.geometry), 0.0, points
        return face.surface.lower().replace("_", " "), None, 0.0, points

    def _shells(self, solid: Instance) -> list[tuple[Reference, str]]:
        """The shells of a solid, each with why a sphere in it is no ball; empty: it may be one."""
        keyword, number, file = next(iter(solid.parts)), solid.number, self.file
        if keyword == "SHELL_BASED_SURFACE_MODEL":
            shells = file.references(file.part(solid, keyword, 2)[1], number)
            return [(shell, "it is a surface, not a solid") for shell in shells]
        if keyword == "BREP_WITH_VOIDS":
            _, outer, voids = file.part(solid, keyword, 3)
            return [
                (reference_of(file, outer, number), "it is hollow"),
                *((shell, "it is a void inside a body") for shell in file.references(voids, number)),
            ]
        return [(reference_of(file, file.part(solid, keyword, 2)[1], number), "")]

    def _faces(self, shell: Reference) -> list[_Face]:
        file = self.file
        instance = file.read(shell)
        if "ORIENTED_CLOSED_SHELL" in instance.parts:
            shell = reference_of(file, file.part(instance, "ORIENTED_CLOSED_SHELL", 4)[2], shell)
            instance = file.read(shell)
        keyword = "OPEN_SHELL" if "OPEN_SHELL" in instance.parts else "CLOSED_SHELL"
        return [self._face(number, shell) for number in file.references(file.part(instance, keyword, 2)[1], shell)]

    def _face(self, number: Reference, referrer: int) -> _Face:
        file = self.file
        face = file.read(number, referrer)
        word = "FACE_SURFACE" if "FACE_SURFACE" in face.parts else "ADVANCED_FACE"
        _, bounds, surface, same = file.part(face, word, 4)
        surface = reference_of(file, surface, number)
        return _Face(number, file.keyword_of(surface, number), surface, same != "F", file.references(bounds, number))

    def _judge(self, solid: Instance) -> list[SphericalSurface]:
        spheres: list[SphericalSurface] = []
        for shell, flaw in self._shells(solid):
            faces = self._faces(shell)
            groups: dict[tuple[float, ...], tuple[Array, float, list[_Face]]] = {}
            for face in faces:
                if (sphere := self._sphere_of(face)) is not None:
                    groups.setdefault((*np.round(sphere[0], 6), round(sphere[1], 6)), (*sphere, []))[2].append(face)
            if faces and not groups and all(face.surface.startswith(_FREE) or not face.surface for face in faces):
                self._free_form.add(solid.number)
            for centre, size, own in groups.values():
                reason = self._describe_flaw(faces, own) or flaw or self._find_gap(centre, size, own)
                spheres.append(SphericalSurface(centre, size, reason))
        return spheres

    def _sphere_of(self, face: _Face) -> tuple[Array, float] | None:
        """Centre and radius of the sphere on which a face lies: a stated one, or a circle turned about a diameter."""
        file, geometry = self.file, face.geometry
        if face.surface not in ("SPHERICAL_SURFACE", "SURFACE_OF_REVOLUTION"):
            return None
        _, place, last = file.values(geometry, face.surface, 3, face.number)
        if face.surface == "SPHERICAL_SURFACE":
            centre, size = self.placement(place, geometry)[:3, 3], file.number(last, geometry)
        else:
            curve = reference_of(file, place, geometry)
            if file.keyword_of(curve, geometry) == "TRIMMED_CURVE":
                curve = reference_of(file, file.values(curve, "TRIMMED_CURVE", 6, geometry)[1], curve)
            if file.keyword_of(curve, geometry) != "CIRCLE":
                return None
            _, plane, radius = file.values(curve, "CIRCLE", 3, geometry)
            frame, size = self.placement(plane, curve), file.number(radius, curve)
            _, at, along = file.values(last, "AXIS1_PLACEMENT", 3, geometry)
            axis = np.eye(4)
            axis[:3, 2], axis[:3, 3] = self._direction(along, (0.0, 0.0, 1.0), last), self.point(at, last)
            centre = frame[:3, 3]
            if abs(float(frame[:3, 2] @ axis[:3, 2])) > 1e-6 or not is_on_axis(axis, centre, axis[:3, 2]):
                return None
        if size <= 0:
            raise file.refuse(geometry, "out-of-range", f"the radius of a sphere is positive; #{geometry} has {size:g}")
        return centre, size

    def _describe_flaw(self, faces: list[_Face], own: list[_Face]) -> str:
        """What else the shell with a sphere consists of, in words; empty: nothing else."""
        if len(own) == len(faces):
            return ""
        # which side of a revolved circle is outside hangs on how its edges run: only of a stated sphere it is known
        if all(face.surface == "SPHERICAL_SURFACE" and not face.outward for face in own):
            return "it is a spherical pocket, such as a seat of a ball"
        kinds = Counter(face.surface.removesuffix("_SURFACE") or "free-form" for face in faces if face not in own)
        listed = ", ".join(f"{count} {kind.replace('_', ' ').lower()}" for kind, count in kinds.items())
        return f"its body has faces beside those of a ball: {listed}"

    def _find_gap(self, centre: Array, radius: float, faces: list[_Face]) -> str:
        """Why faces of one sphere do not cover it, in words; empty: they do."""
        if len(faces) > MOST_BALL_FACES:
            return f"it has more than {MOST_BALL_FACES} faces"
        uses: Counter[tuple[int, bool]] = Counter()
        for face in faces:
            for edge, forward in self._edges(face):
                uses[edge, forward] += 1
            for vertex in self._vertices(face):
                if abs(float(np.linalg.norm(vertex - centre)) - radius) > ON_SPHERE * radius:
                    return "its edges do not lie on the sphere that it states"
        if any(count != 1 or uses[edge, not forward] != 1 for (edge, forward), count in list(uses.items())):
            return "its faces do not close"
        if not uses and len(faces) > 1:
            return "its faces lie upon one another"
        return ""

    def _edges(self, face: _Face) -> Iterator[tuple[int, bool]]:
        """Edge curves round a face, and whether each is passed forward."""
        file = self.file
        for bound in face.bounds:
            instance = file.read(bound, face.number)
            word = "FACE_BOUND" if "FACE_BOUND" in instance.parts else "FACE_OUTER_BOUND"
            _, loop, ahead = file.part(instance, word, 3)
            if file.keyword_of(loop, bound) == "VERTEX_LOOP":
                continue
            for each in file.references(file.values(loop, "EDGE_LOOP", 2, bound)[1], bound):
                oriented = file.values(each, "ORIENTED_EDGE", 5, bound)
                yield int(reference_of(file, oriented[3], each)), (oriented[4] != "F") == (ahead != "F")

    def _vertices(self, face: _Face) -> Iterator[Array]:
        file = self.file
        for bound in face.bounds:
            loop = next(iter(file.read(bound, face.number).parts.values()))[1:2]
            if loop and file.keyword_of(loop[0], bound) == "VERTEX_LOOP":
                yield self._vertex(file.values(loop[0], "VERTEX_LOOP", 2, bound)[1], bound)
        for edge, _ in self._edges(face):
            _, first, second, *_ = file.values(Reference(edge), "EDGE_CURVE", 5, face.number)
            yield self._vertex(first, edge)
            yield self._vertex(second, edge)

    def _circles(self, face: _Face) -> Iterator[Array]:
        """Corners of the squares about the full circles round a face."""
        file = self.file
        for edge, _ in self._edges(face):
            _, first, second, curve, _ = file.values(Reference(edge), "EDGE_CURVE", 5, face.number)
            if file.keyword_of(curve, edge) in ("SURFACE_CURVE", "SEAM_CURVE"):
                curve = file.values(curve, file.keyword_of(curve, edge), 4, edge)[1]
            if first == second and file.keyword_of(curve, edge) == "CIRCLE":
                _, place, radius = file.values(curve, "CIRCLE", 3, edge)
                frame, size = self.placement(place, curve), file.number(radius, curve)
                for u, v in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)):
                    yield frame[:3, 3] + size * (u * frame[:3, 0] + v * frame[:3, 1])

    def _vertex(self, number: Any, referrer: int) -> Array:
        return self.point(self.file.values(number, "VERTEX_POINT", 2, referrer)[1], number)

    # --- points and placements ---------------------------------------------------------------------------

    def point(self, number: Any, referrer: int) -> Array:
        """A point, in the unit of the file."""
        return self._triple(self.file.values(number, "CARTESIAN_POINT", 2, referrer)[1], number)

    def _triple(self, value: Any, referrer: int) -> Array:
        if not isinstance(value, list) or len(value) != 3:
            detail = f"a point or direction has 3 coordinates; #{referrer} has not"
            cure = "export it anew; decimals are written with a point, 1.5"
            raise self.file.refuse(referrer, "wrong-count", detail, cure)
        return np.array([self.file.number(item, referrer) for item in value])

    def _direction(self, number: Any, otherwise: Sequence[float], referrer: int) -> Array:
        if number is None:
            return np.array(otherwise)
        vector = self._triple(self.file.values(number, "DIRECTION", 2, referrer)[1], number)
        size = float(np.linalg.norm(vector))
        if size < 1e-12:
            raise self.file.refuse(number, "zero-direction", f"a direction has a length; #{number} has none")
        return vector / size

    def placement(self, number: Any, referrer: int) -> Array:
        """The matrix of an AXIS2_PLACEMENT_3D: its frame in that of its representation, in the unit of the file."""
        _, at, z, x = self.file.values(number, "AXIS2_PLACEMENT_3D", 4, referrer)
        return self._matrix(number, self.point(at, number), z, x, None, 1.0)

    def operator(self, number: Reference) -> Array:
        """The matrix of a CARTESIAN_TRANSFORMATION_OPERATOR_3D, which can mirror and scale."""
        values = [value for part in self.file.read(number).parts.values() for value in part]
        if len(values) < 6:
            detail = f"a transformation operator has two axes, an origin, a scale and an axis; #{number} has not"
            raise self.file.refuse(number, "wrong-count", detail)
        x, y, at, scale, z = values[-5:]
        factor = 1.0 if scale is None else self.file.number(scale, number)
        if factor <= 0:
            detail = f"the scale of a transformation is positive; #{number} has {factor:g}"
            raise self.file.refuse(number, "out-of-range", detail)
        return self._matrix(number, self.point(at, number), z, x, y, factor)

    def _matrix(self, number: int, origin: Array, z: Any, x: Any, y: Any, scale: float) -> Array:
        third = self._direction(z, (0.0, 0.0, 1.0), number)
        first = self._direction(x, (1.0, 0.0, 0.0) if abs(third[0]) < 0.999999 else (0.0, 1.0, 0.0), number)
        first = first - third * (third @ first)
        if np.linalg.norm(first) < 1e-9:
            raise self.file.refuse(number, "parallel-directions", f"both directions of #{number} are the same")
        first = first / np.linalg.norm(first)
        second = np.cross(third, first)
        if y is not None and self._direction(y, (0.0, 1.0, 0.0), number) @ second < 0:
            second = -second
        matrix = np.eye(4)
        matrix[:3, :3] = scale * np.column_stack([first, second, third])
        matrix[:3, 3] = origin
        return matrix


def reference_of(file: Part21, value: Any, referrer: int) -> Reference:
    if not isinstance(value, Reference):
        raise file.refuse(referrer, "wrong-type", f"#{referrer} holds something else where an instance belongs")
    return value


def is_on_axis(frame: Array, point: Array, axis: Array) -> bool:
    """Whether the z axis of a frame is the line through a point along an axis."""
    z, away = frame[:3, 2], point - frame[:3, 3]
    parallel = np.linalg.norm(np.cross(z, axis)) < 1e-6
    return bool(parallel and np.linalg.norm(np.cross(z, away)) < 1e-6 + 1e-9 * np.abs(away).max())


def invert(matrix: Array) -> Array:
    """The inverse of a placement."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
