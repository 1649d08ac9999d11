"""The assembly of a STEP file: where each solid and each named frame is, in mm of the file's own frame."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import LimitError, Problem
from ...geometry.arrays import Array
from .part21 import Instance, Part21, Reference, decode_text
from .shapes import Shapes, invert, reference_of

MOST_PLACEMENTS = 50_000  # instances of parts, and parts of instances
MOST_LEVELS = 32  # of an assembly

SOLIDS = ("MANIFOLD_SOLID_BREP", "BREP_WITH_VOIDS", "FACETED_BREP", "SHELL_BASED_SURFACE_MODEL")
_PRODUCTS = ("PRODUCT_DEFINITION", "PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS")
_LINKS = ("SHAPE_REPRESENTATION_RELATIONSHIP", "CONSTRUCTIVE_GEOMETRY_REPRESENTATION_RELATIONSHIP")
_TRANSFORMED = "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION"
WANTED = (*SOLIDS, *_PRODUCTS, *_LINKS, _TRANSFORMED, "SHAPE_DEFINITION_REPRESENTATION",
           "NEXT_ASSEMBLY_USAGE_OCCURRENCE", "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION")  # fmt: skip
_PREFIXES = {"GIGA": 1e9, "MEGA": 1e6, "KILO": 1e3, "HECTO": 1e2, "DECA": 1e1, "DECI": 1e-1, "CENTI": 1e-2,
             "MILLI": 1e-3, "MICRO": 1e-6, "NANO": 1e-9}  # fmt: skip
_INCHES = {"INCH": 25.4, "FOOT": 304.8, "MIL": 0.0254}  # mm, of units that are called so
_UNNAMED = re.compile(
    r"|NONE|NAUO\d*|\d+|=>\[[\d:]+\]|Open CASCADE STEP translator.*|(SOLID|COMPOUND|COMPSOLID|SHELL)\d*", re.IGNORECASE
)


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """A solid where the assembly has it; a part that stands there twice is two of them."""

    number: int
    names: tuple[str, ...]  # the one to call it by first
    path: str
    matrix: Array  # (4, 4) from the unit of the file, in the part, to mm in the file's own frame


@dataclass(frozen=True, slots=True, eq=False)
class _Solid:
    """A solid in a part."""

    number: Reference
    name: str
    matrix: Array  # (4, 4) from the unit of the file to mm of the part


@dataclass(frozen=True, slots=True, eq=False)
class _ProductContents:
    """What a product holds itself, without the instances of others in it."""

    name: str
    solids: list[_Solid]
    frames: list[tuple[str, Array]]  # named coordinate systems, in mm of the part


@dataclass(frozen=True, slots=True, eq=False)
class _Visit:
    """A part where the walk through the assembly has come to it."""

    product: Reference
    matrix: Array  # (4, 4) from mm of the part to mm of the file's own frame
    names: tuple[str, ...]  # of the instance, if it has one
    path: tuple[str, ...]
    above: tuple[int, ...]  # products that it is in


class Assembly(Shapes):
    """Every solid and every named frame of a file, where the assembly has it."""

    def __init__(self, file: Part21) -> None:
        super().__init__(file)
        self._factors: dict[int, tuple[str, float]] = {}
        self._parts: dict[int, _ProductContents] = {}
        self._read_shapes()
        self._read_occurrences()
        self.bodies: list[_Body] = []
        self.frames: list[tuple[str, Array]] = []
        self.unit = ("mm", 1.0)
        self._walk()

    # --- what belongs to what ------------------------------------------------------------------------------

    def _read_shapes(self) -> None:
        """Representations of each product, and which of them say the same or hold one another."""
        file = self.file
        self._shapes: dict[int, list[Reference]] = defaultdict(list)
        self._links: dict[int, list[Reference]] = defaultdict(list)
        self._held: dict[int, list[tuple[int, Any, Reference]]] = defaultdict(list)  # by representation, what is in it
        for number, (definition, shape) in file.list_values("SHAPE_DEFINITION_REPRESENTATION", 2):
            if file.keyword_of(definition, number) == "PRODUCT_DEFINITION_SHAPE":
                product = file.values(definition, "PRODUCT_DEFINITION_SHAPE", 3, number)[2]
                if file.keyword_of(product, definition) in _PRODUCTS:
                    self._shapes[product].append(reference_of(file, shape, number))
        self._own = {shape for shapes in self._shapes.values() for shape in shapes}
        used = {relation for _, (relation, _) in file.list_values("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", 2)}
        for keyword in _LINKS:
            for number in file.list_numbers(keyword):
                instance = file.read(number)
                if _TRANSFORMED in instance.parts:
                    if number not in used:
                        first, second, operator = self._relation(instance)
                        self._held[second].append((number, operator, first))
                elif len(values := instance.parts.get(keyword, ())) == 4:
                    first, second = (reference_of(file, each, number) for each in values[2:])
                    self._links[first].append(second)
                    self._links[second].append(first)

    def _relation(self, instance: Instance) -> tuple[Reference, Reference, Any]:
        """Both representations of a relationship with a transformation, and the transformation."""
        file, number = self.file, instance.number
        ends = file.part(instance, "REPRESENTATION_RELATIONSHIP", 4)[2:]
        first, second = (reference_of(file, each, number) for each in ends)
        return first, second, file.part(instance, _TRANSFORMED, 1)[0]

    def _read_occurrences(self) -> None:
        """Instances of products in products, and how each is placed."""
        file = self.file
        self._children: dict[int, list[tuple[int, Reference, str]]] = defaultdict(list)
        self._placements: dict[int, Reference] = {}
        self._placed: set[int] = set()  # products that are in another
        for number, values in file.list_values("NEXT_ASSEMBLY_USAGE_OCCURRENCE", 6):
            parent, child = (reference_of(file, each, number) for each in values[3:5])
            self._children[parent].append((number, child, _name(values[1]) or _name(values[5])))
            self._placed.add(child)
        for number, (relation, shape) in file.list_values("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", 2):
            occurrence = file.values(shape, "PRODUCT_DEFINITION_SHAPE", 3, number)[2]
            self._placements.setdefault(reference_of(file, occurrence, number), reference_of(file, relation, number))

    def _reach(self, product: Reference) -> list[Reference]:
        """The representations of a product: those that are stated and those linked to them."""
        reached = dict.fromkeys(self._shapes[product])
        waiting = list(reached)
        while waiting:
            for other in self._links[waiting.pop()]:
                if other not in reached and other not in self._own:
                    reached[other] = None
                    waiting.append(other)
        return list(reached)

    # --- the walk ------------------------------------------------------------------------------------------

    def _walk(self) -> None:
        file = self.file
        products = [Reference(number) for keyword in _PRODUCTS for number in file.list_numbers(keyword)]
        roots = [product for product in reversed(products) if product not in self._placed]
        waiting = [_Visit(product, np.eye(4), (), (), ()) for product in roots]
        if not waiting:
            first = products[0] if products else None
            detail = "every product is part of another one" if products else "the file holds no product"
            raise file.refuse(first, "no-product", detail, "export the assembly with its parts")
        places: dict[int, Array] = {}  # by instance, as many visits come to one
        count = 0
        while waiting:
            visit = waiting.pop()
            part = self._part(visit.product)
            path = (*visit.path, visit.names[0] if visit.names else part.name or "(no name)")
            names = tuple(dict.fromkeys(each for each in (*visit.names, part.name) if each))
            self.frames += [(name, visit.matrix) for name in names]
            self.frames += [(name, visit.matrix @ frame) for name, frame in part.frames]
            for solid in part.solids:
                own = (solid.name,) if solid.name else ()
                called = (*names, *own) if len(part.solids) == 1 and (visit.names or not own) else own
                place = " / ".join((*path, *(own if len(part.solids) > 1 else ())))
                self.bodies.append(_Body(solid.number, called, place, visit.matrix @ solid.matrix))
            above = (*visit.above, visit.product)
            for number, child, name in reversed(self._children[visit.product]):
                if child in above:
                    detail = f"{' / '.join(path)[:200]} is a part of itself"
                    raise file.refuse(number, "cycle", detail, "export it anew")
                if number in self._placements:
                    if number not in places:
                        places[number] = self._place(self._placements[number], visit.product, child)
                    waiting.append(_Visit(child, visit.matrix @ places[number], (name,) if name else (), path, above))
            count += 1 + len(part.solids) + len(part.frames)
            if count + len(waiting) > MOST_PLACEMENTS or len(above) > MOST_LEVELS:
                detail = f"{file.name} has more than {MOST_PLACEMENTS} instances, or more than {MOST_LEVELS} levels"
                raise LimitError(Problem("", "too-many", detail, "export the reference structure alone", file.name))

    def _place(self, number: Reference, parent: Reference, child: Reference) -> Array:
        """The matrix from mm of an instance's part to mm of the product that it is in."""
        first, second, operator = self._relation(self.file.read(number))
        of_parent, of_child = self._reach(parent), self._reach(child)
        if first in of_child or second in of_parent:
            return self._transform(operator, first, second, number)
        if second in of_child or first in of_parent:  # the wrong way round, as some programs write it
            return invert(self._transform(operator, first, second, number))
        detail = f"#{number} places representations that belong to neither product of the instance"
        raise self.file.refuse(number, "wrong-placement", detail, "export it anew")

    def _transform(self, operator: Any, first: Reference, second: Reference, number: int) -> Array:
        """The matrix from mm of the first representation to mm of the second."""
        operator = reference_of(self.file, operator, number)
        if self.file.keyword_of(operator, number) != "ITEM_DEFINED_TRANSFORMATION":
            return _in_mm(self.operator(operator), self._factor(second))
        _, _, origin, target = self.file.values(operator, "ITEM_DEFINED_TRANSFORMATION", 4, number)
        start = _in_mm(self.placement(origin, operator), self._factor(first))
        return _in_mm(self.placement(target, operator), self._factor(second)) @ invert(start)

    # --- one part ------------------------------------------------------------------------------------------

    def _part(self, product: Reference) -> _ProductContents:
        if product not in self._parts:
            part = _ProductContents(self._product_name(product), [], [])
            shapes = self._reach(product)
            for shape in shapes:
                self._collect(part, shape)
            if shapes and not self._parts:
                self.unit = self._unit_of(shapes[0])
            self._parts[product] = part
        return self._parts[product]

    def _product_name(self, product: Reference) -> str:
        file = self.file
        formation = next(iter(file.read(product).parts.values()))[2:3]
        if not formation or not isinstance(formation[0], Reference):
            return ""
        item = next(iter(file.read(formation[0], product).parts.values()))[2:3]
        if not item or file.keyword_of(item[0], formation[0]) != "PRODUCT":
            return ""
        values = file.values(item[0], "PRODUCT", 4, product)
        return _name(values[1]) or _name(values[0])

    def _collect(self, part: _ProductContents, shape: Reference) -> None:
        """Solids and named coordinate systems of a representation, and of those that it holds."""
        waiting: list[tuple[Reference, Array, tuple[int, ...]]] = [(shape, np.eye(4), ())]
        count = 0
        while waiting:
            shape, matrix, above = waiting.pop()
            if shape in above:
                raise self.file.refuse(shape, "cycle", f"#{shape} holds itself", "export it anew")
            count += 1
            if len(above) > MOST_LEVELS or count > MOST_PLACEMENTS:
                detail = f"representations are nested at most {MOST_LEVELS} deep, {MOST_PLACEMENTS} in a part"
                raise self.file.refuse(shape, "too-deep", detail)
            above = (*above, shape)
            items, _ = self._representation(shape)
            for item in items:
                word = self.file.keyword_of(item, shape)
                if word in SOLIDS:
                    name = _name(self.file.read(item, shape).parts[word][0])
                    part.solids.append(_Solid(item, name, _in_file_units(matrix, self._factor(shape))))
                elif word == "AXIS2_PLACEMENT_3D":
                    if name := _name(self.file.values(item, word, 4, shape)[0]):
                        frame = _in_mm(self.placement(item, shape), self._factor(shape))
                        part.frames.append((name, matrix @ frame))
                elif word == "MAPPED_ITEM":
                    _, source, target = self.file.values(item, word, 3, shape)
                    origin, mapped = self.file.values(source, "REPRESENTATION_MAP", 2, item)
                    mapped = reference_of(self.file, mapped, item)
                    waiting.append((mapped, matrix @ self._map(origin, mapped, target, shape, item), above))
            for number, operator, held in self._held[shape]:
                waiting.append((held, matrix @ self._transform(operator, held, shape, number), above))

    def _map(self, origin: Any, mapped: Reference, target: Any, shape: Reference, item: int) -> Array:
        """The matrix of a MAPPED_ITEM, from mm of what is mapped to mm of where it goes."""
        start = _in_mm(self.placement(origin, item), self._factor(mapped))
        if self.file.keyword_of(target, item) == "AXIS2_PLACEMENT_3D":
            end = self.placement(target, item)
        else:
            end = self.operator(reference_of(self.file, target, item))
        return _in_mm(end, self._factor(shape)) @ invert(start)

    def _representation(self, shape: Reference) -> tuple[list[Reference], Any]:
        """Items and context."""
        instance = self.file.read(shape)
        values = instance.parts.get("REPRESENTATION") or next(iter(instance.parts.values()))
        if len(values) < 3:
            detail = f"a representation has a name, items and a context; #{shape} has {len(values)} values"
            raise self.file.refuse(shape, "wrong-count", detail)
        return self.file.references(values[1], shape), values[2]

    # --- units -----------------------------------------------------------------------------------------------

    def _factor(self, shape: Reference) -> float:
        """mm in the unit of length of a representation."""
        return self._unit_of(shape)[1]

    def _unit_of(self, shape: Reference) -> tuple[str, float]:
        """Its symbol, empty for one that has none here, and mm in it.  Raises StepError if the file states none."""
        _, context = self._representation(shape)
        context = reference_of(self.file, context, shape)
        if context not in self._factors:
            units = self.file.read(context, shape).parts.get("GLOBAL_UNIT_ASSIGNED_CONTEXT")
            for number in self.file.references(units[0], context) if units else ():
                unit = self.file.read(number, context)
                if "LENGTH_UNIT" in unit.parts:
                    factor = self.millimetres(unit, 0)
                    symbols = {1.0: "mm", 25.4: "in", 10.0: "cm", 1000.0: "m", 1e-3: "um"}
                    near = [symbol for known, symbol in symbols.items() if abs(factor / known - 1) < 1e-9]
                    self._factors[context] = (near[0] if near else "", factor)
                    break
            else:
                detail = "the shapes have no unit of length, and none is guessed"
                raise self.file.refuse(context, "no-unit", detail, "export it with units")
        return self._factors[context]

    def measure(self, number: Any, referrer: int) -> tuple[float, Instance]:
        """A number, and the unit that it is in.  Raises StepError."""
        instance = self.file.read(reference_of(self.file, number, referrer), referrer)
        parts = instance.parts
        values = next(iter(parts.values())) if len(parts) == 1 else parts.get("MEASURE_WITH_UNIT", [])
        if len(values) != 2:
            raise self.file.refuse(instance.number, "wrong-count", f"#{instance.number} is a measure and its unit")
        unit = self.file.read(reference_of(self.file, values[1], instance.number), instance.number)
        return self.file.number(values[0], instance.number), unit

    def millimetres(self, unit: Instance, depth: int = 0) -> float:
        """mm in a unit of length.  Raises StepError for one that is not known."""
        file, number = self.file, unit.number
        if "SI_UNIT" in unit.parts:
            prefix, name = file.part(unit, "SI_UNIT", 2)
            if name != "METRE" or (prefix is not None and prefix not in _PREFIXES):
                detail = f"#{number} is no unit of length that is known: {prefix} {name}"
                raise file.refuse(number, "unknown-unit", detail)
            return 1000.0 if prefix is None else 1000.0 * _PREFIXES[prefix]
        name, measure = file.part(unit, "CONVERSION_BASED_UNIT", 2)
        if depth > 3:
            raise file.refuse(number, "wrong-count", f"#{number} is a unit of a unit of a unit, and so on")
        size, inner = self.measure(measure, number)
        factor = size * self.millimetres(inner, depth + 1)
        called = decode_text(name).upper()
        known = _INCHES.get(called)
        if factor <= 0 or (known is not None and abs(factor / known - 1) > 1e-6):
            wanted = f"{known:g} mm" if known else "a positive length"
            detail = f"a unit called {called[:40]} is {wanted}; #{number} makes it {factor:g} mm"
            raise file.refuse(number, "unit-contradicts-name", detail, "export it anew")
        return factor


def _in_mm(matrix: Array, factor: float) -> Array:
    """A placement whose translation is in mm."""
    made = matrix.copy()
    made[:3, 3] *= factor
    return made


def _in_file_units(matrix: Array, factor: float) -> Array:
    """The matrix for points in the unit of the file."""
    made = matrix.copy()
    made[:3, :3] *= factor
    return made


def _name(value: Any) -> str:
    """A name that somebody gave, at most 72 characters; empty for none and for those that programs give."""
    text = decode_text(value)
    return "" if _UNNAMED.fullmatch(text) else text[:72]
