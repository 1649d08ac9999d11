"""Eight trials side by side: ``<8 x double>``, ``<8 x i64>`` and ``<8 x i1>`` as numba types.

LLVM does not vectorise the long straight-line body of a trial by itself; given explicit vectors it
does, at whatever register width the machine has (8 doubles are one AVX-512 register, two AVX2 or four
NEON ones).  Every operation here is a single IEEE operation per lane: nothing is contracted,
reassociated or handed to a maths library, so a trial has the same digits on every machine and in every
company of seven neighbours.  Multiply-add is fused only where ``fma`` is written.

A tuple of vectors (of one kind) is a vector or matrix of the trials; named functions take it element by element.

Lanes (double) know ``+ - * /``, unary ``-``, ``< <= >``; Bits (integer, wrapping) ``+ * ^ & | << >>``
with ``>>`` logical; Mask ``& | ~``.

Small symmetric linear algebra on them is at the end.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial
from inspect import Parameter, Signature
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing import signature
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

from ..kernels.store import kernel

# mypy: ignore-errors


WIDTH = 8
_I64 = ir.IntType(64)

# Compiled lane code touches arrays that its caller owns and makes none, so numba's reference counting (an atomic
# increment and decrement per array per call, half the run time here) is left out.
lane_jit = njit(_nrt=False)

# What Python calls: releases the interpreter lock, and is kept between processes
lane_entry: Any = kernel(nogil=True, error_model="python", _nrt=False)


class _Vector(types.Type):
    """A numba type that is nothing but an LLVM vector."""

    def __init__(self, name: str, element: ir.Type) -> None:
        self.llvm = ir.VectorType(element, WIDTH)
        super().__init__(name=name)


class _Lanes(_Vector):
    pass


class _Bits(_Vector):
    pass


class _Mask(_Vector):
    pass


LANES = _Lanes("Lanes8", ir.DoubleType())
BITS = _Bits("Bits8", _I64)
MASK = _Mask("Mask8", ir.IntType(1))


@register_model(_Lanes)
@register_model(_Bits)
@register_model(_Mask)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: _Vector) -> None:
        super().__init__(manager, fe_type, fe_type.llvm)


def _operator(symbol: Any, result: _Vector, operands: tuple[_Vector, ...], emit: Callable[..., Any]) -> None:
    """Teach numba ``symbol`` on vector operands: one LLVM instruction made by ``emit(builder, *values)``."""

    class Template(ConcreteTemplate):
        cases = [signature(result, *operands)]  # noqa: RUF012

    infer_global(symbol)(Template)

    @lower_builtin(symbol, *operands)
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *args)


for _symbol, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _operator(_symbol, LANES, (LANES, LANES), lambda b, x, y, name=_name: getattr(b, name)(x, y))
_operator(operator.neg, LANES, (LANES,), lambda b, x: b.fneg(x))
for _symbol, _name in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">")):
    # ordered comparisons: false as soon as a NaN is involved, so that "within tolerance" is never true of one
    _operator(_symbol, MASK, (LANES, LANES), lambda b, x, y, name=_name: b.fcmp_ordered(name, x, y))
for _symbol, _name in (
    (operator.add, "add"),
    (operator.mul, "mul"),
    (operator.xor, "xor"),
    (operator.and_, "and_"),
    (operator.or_, "or_"),
    (operator.lshift, "shl"),
    (operator.rshift, "lshr"),
):
    _operator(_symbol, BITS, (BITS, BITS), lambda b, x, y, name=_name: getattr(b, name)(x, y))
_operator(operator.and_, MASK, (MASK, MASK), lambda b, x, y: b.and_(x, y))
_operator(operator.or_, MASK, (MASK, MASK), lambda b, x, y: b.or_(x, y))
_operator(operator.invert, MASK, (MASK,), lambda b, x: b.not_(x))


def _intrinsic(name: str, parameters: str, define: Callable[..., Any]) -> Any:
    """What ``define`` makes of the types of these parameters, as a function for compiled code."""

    def make_code(typingctx: Any, *arguments: Any) -> Any:
        return define(*arguments)

    make_code.__name__ = make_code.__qualname__ = name
    names = ["typingctx", *parameters.split()]
    make_code.__signature__ = Signature([Parameter(each, Parameter.POSITIONAL_OR_KEYWORD) for each in names])
    return intrinsic(prefer_literal=True)(make_code)


def _function(name: str, result: Any, operands: tuple[Any, ...], emit: Callable[..., Any]) -> Any:
    """A function on vectors made by ``emit(builder, *values)``; on tuples of vectors, element by element."""

    def define(*arguments: Any) -> Any:
        sizes = {each.count for each in arguments if isinstance(each, types.UniTuple)}
        if not sizes:
            return signature(result, *operands), lambda context, builder, sig, args: emit(builder, *args)

        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            each = [_parts(builder, *pair, sig.return_type.count) for pair in zip(args, sig.args, strict=True)]
            parts = [emit(builder, *values) for values in zip(*each, strict=True)]
            return context.make_tuple(builder, sig.return_type, parts)

        (size,) = sizes
        return signature(types.UniTuple(result, size), *arguments), codegen

    return _intrinsic(name, " ".join("abc"[: len(operands)]), define)


def _parts(builder: Any, value: Any, of: Any, count: int) -> list[Any]:
    """The vectors of a tuple; the same one so many times where there is one."""
    return [builder.extract_value(value, k) if isinstance(of, types.UniTuple) else value for k in range(count)]


def _splat(builder: Any, value: Any, vector: ir.VectorType) -> Any:
    first_lane = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first_lane, ir.Constant(vector, ir.Undefined), order)


def _call(builder: Any, name: str, *args: Any) -> Any:
    function_type = ir.FunctionType(LANES.llvm, [a.type for a in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), args)


def _any_lane(builder: Any, mask: Any) -> Any:
    return builder.icmp_unsigned("!=", builder.bitcast(mask, ir.IntType(8)), ir.Constant(ir.IntType(8), 0))


# The same number in all lanes
splat = _function("splat", LANES, (types.float64,), lambda b, x: _splat(b, x, LANES.llvm))
splat_bits = _function("splat_bits", BITS, (types.uint64,), lambda b, x: _splat(b, x, BITS.llvm))
# a * b + c, rounded once
fma = _function("fma", LANES, (LANES,) * 3, lambda b, *x: _call(b, "llvm.fma.v8f64", *x))
# The operators are for single vectors alone
add = _function("add", LANES, (LANES,) * 2, lambda b, *x: b.fadd(*x))
subtract = _function("subtract", LANES, (LANES,) * 2, lambda b, *x: b.fsub(*x))
multiply = _function("multiply", LANES, (LANES,) * 2, lambda b, *x: b.fmul(*x))
negative = _function("negative", LANES, (LANES,), lambda b, x: b.fneg(x))
square_root = _function("square_root", LANES, (LANES,), lambda b, x: _call(b, "llvm.sqrt.v8f64", x))
absolute = _function("absolute", LANES, (LANES,), lambda b, x: _call(b, "llvm.fabs.v8f64", x))
# Lane by lane the first where the mask is set, the second elsewhere
select = _function("select", LANES, (MASK, LANES, LANES), lambda b, *x: b.select(*x))
any_lane = _function("any_lane", types.boolean, (MASK,), _any_lane)
# Mask of the lanes whose integer is not zero
bits_set = _function("bits_set", MASK, (BITS,), lambda b, x: b.icmp_unsigned("!=", x, ir.Constant(BITS.llvm, [0] * 8)))
# The IEEE pattern of each double, and the doubles with these patterns
as_bits = _function("as_bits", BITS, (LANES,), lambda b, x: b.bitcast(x, BITS.llvm))
as_lanes = _function("as_lanes", LANES, (BITS,), lambda b, x: b.bitcast(x, LANES.llvm))


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any, vector: ir.VectorType) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _load(array: Any, index: Any) -> Any:
    vector = LANES if array.dtype == types.float64 else BITS

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _address(context, builder, sig.args[0], args[0], args[1], vector.llvm)
        return builder.load(pointer, align=8, typ=vector.llvm)

    return vector(array, types.intp), codegen


def _store(array: Any, index: Any, values: Any) -> Any:
    count = values.count if isinstance(values, types.UniTuple) else 1

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        for k, part in enumerate(_parts(builder, args[2], values, count)):
            at = builder.add(args[1], args[1].type(WIDTH * k))
            builder.store(part, _address(context, builder, sig.args[0], args[0], at, LANES.llvm), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, values if count > 1 else LANES), codegen


def _count(of: Any) -> int:
    return of.count if isinstance(of, types.UniTuple) else of.literal_value


def _tuple(parts: Callable[..., list[Any]], *arguments: Any) -> Any:
    """A tuple of vectors, as many as the last argument says or has."""
    count = _count(arguments[-1])

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_tuple(builder, sig.return_type, parts(context, builder, sig.args[0], args, range(count)))

    return signature(types.UniTuple(LANES, count), *arguments), codegen


def _loads(context: Any, builder: Any, array_type: Any, args: Any, places: range) -> list[Any]:
    at = [builder.add(args[1], args[1].type(WIDTH * k)) for k in places]
    pointers = [_address(context, builder, array_type, args[0], each, LANES.llvm) for each in at]
    return [builder.load(pointer, align=8, typ=LANES.llvm) for pointer in pointers]


def _splats(context: Any, builder: Any, array_type: Any, args: Any, places: range) -> list[Any]:
    row = context.make_array(array_type)(context, builder, args[0])
    at = [cgutils.get_item_pointer(context, builder, array_type, row, [ir.Constant(_I64, k)]) for k in places]
    return [_splat(builder, builder.load(each), LANES.llvm) for each in at]


def _join(a: Any, b: Any) -> Any:
    counts = [each.count if isinstance(each, types.UniTuple) else 1 for each in (a, b)]

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        parts = [part for three in zip(args, sig.args, counts, strict=True) for part in _parts(builder, *three)]
        return context.make_tuple(builder, sig.return_type, parts)

    return types.UniTuple(LANES, sum(counts))(a, b), codegen


def _dot(a: Any, b: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        *before, last = zip(*(_parts(builder, each, a, a.count) for each in args), strict=True)
        total = builder.fmul(*last)
        for pair in reversed(before):
            total = _call(builder, "llvm.fma.v8f64", *pair, total)
        return total

    return LANES(a, b), codegen


# Eight consecutive elements of a flat float64 array (Lanes) or (u)int64 array (Bits)
load = _intrinsic("load", "array index", _load)
# Write a vector, or the vectors of a tuple one after the other, to a flat float64 array
store = _intrinsic("store", "array index values", _store)
# Tuples of vectors, ``count`` of them or as many as another tuple has: what ``load`` gives one after the other, the
# first numbers of a row, and the same vector again
loads = _intrinsic("loads", "array index count", partial(_tuple, _loads))
splats = _intrinsic("splats", "row count", partial(_tuple, _splats))
repeat = _intrinsic("repeat", "value count", partial(_tuple, lambda c, b, t, args, places: [args[0] for _ in places]))
# The vectors of two tuples, either of which may be one vector, as one tuple
join = _intrinsic("join", "a b", _join)
# a'b of two tuples of vectors, fused from the last on
dot = _intrinsic("dot", "a b", _dot)


@lane_jit
def cross(a, b):
    """a x b."""
    return (
        fma(a[1], b[2], -(a[2] * b[1])),
        fma(a[2], b[0], -(a[0] * b[2])),
        fma(a[0], b[1], -(a[1] * b[0])),
    )


@lane_jit
def times(m, x):
    """M x of a matrix of three rows (9) and a vector (3)."""
    return dot(m[0:3], x), dot(m[3:6], x), dot(m[6:9], x)


@lane_jit
def times_from_left(a, m):
    """a'M."""
    return dot(a, (m[0], m[3], m[6])), dot(a, (m[1], m[4], m[7])), dot(a, (m[2], m[5], m[8]))


@lane_jit
def rows_of(g):
    """The four rows of a symmetric 4x4: of its 10 entries, the upper triangle by rows."""
    return g[0:4], (g[1], g[4], g[5], g[6]), (g[2], g[5], g[7], g[8]), (g[3], g[6], g[8], g[9])


@lane_jit
def symmetric_times(g, x):
    """Product of a symmetric 4x4 and a 4-vector."""
    r0, r1, r2, r3 = rows_of(g)
    return dot(r0, x), dot(r1, x), dot(r2, x), dot(r3, x)


@lane_jit
def add_square(g, x, y):
    """The symmetric 4x4 with x y' added, whose upper triangle is what counts."""
    x0, x1, x2, x3 = x
    y0, y1, y2, y3 = y
    return fma((x0, x0, x0, x0, x1, x1, x1, x2, x2, x3), (y0, y1, y2, y3, y1, y2, y3, y2, y3, y3), g)


@lane_jit
def add_to_diagonal(g, a, d):
    """The symmetric 4x4 with ``a diag(d)`` added."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    g00, g11, g22, g33 = fma(a, d, (g00, g11, g22, g33))
    return g00, g01, g02, g03, g11, g12, g13, g22, g23, g33


@lane_jit
def factor3(g):
    """LDL' of the leading 3x3 of a symmetric 4x4: (l10, l20, l21, 1/d0, 1/d1, 1/d2, mask of lanes where all d > 0)."""
    k00, k01, k02, _, k11, k12, _, k22, _, _ = g
    one, zero = splat(1.0), splat(0.0)
    i0 = one / k00
    l10, l20 = k01 * i0, k02 * i0
    d1 = fma(-l10, k01, k11)
    i1 = one / d1
    c = fma(-l20, k01, k12)
    l21 = c * i1
    d2 = fma(-l21, c, fma(-l20, k02, k22))
    i2 = one / d2
    return l10, l20, l21, i0, i1, i2, (k00 > zero) & (d1 > zero) & (d2 > zero)


@lane_jit
def solve3(f, b):
    l10, l20, l21, i0, i1, i2, _ = f
    b0, b1, b2 = b
    y1 = fma(-l10, b0, b1)
    y2 = fma(-l21, y1, fma(-l20, b0, b2))
    x2 = y2 * i2
    x1 = fma(-l21, x2, y1 * i1)
    x0 = fma(-l10, x1, fma(-l20, x2, b0 * i0))
    return x0, x1, x2


@lane_jit
def size_of(x):
    """The sum of the sizes of three numbers."""
    return absolute(x[0]) + absolute(x[1]) + absolute(x[2])


@lane_jit
def reciprocal_shifted(d, inverse, shift):
    """1 / (d - shift) by Newton's iteration from 1/d; relative error (shift/d)^8."""
    x = fma(inverse, shift * inverse, inverse)
    gap, one = splat(d) - shift, splat(1.0)
    x = fma(x, fma(-gap, x, one), x)
    return fma(x, fma(-gap, x, one), x)


@lane_jit
def sandwich(g, d):
    """Upper triangle of G diag(d) G for a symmetric G."""
    r0, r1, r2, r3 = rows_of(g)
    a, b, c, e = multiply(r0, d), multiply(r1, d), multiply(r2, d), multiply(r3, d)
    return (
        dot(a, r0), dot(a, r1), dot(a, r2), dot(a, r3),
        dot(b, r1), dot(b, r2), dot(b, r3),
        dot(c, r2), dot(c, r3),
        dot(e, r3),
    )  # fmt: skip
