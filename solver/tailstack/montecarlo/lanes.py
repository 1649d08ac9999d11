"""Eight trials side by side: ``<8 x double>``, ``<8 x i64>`` and ``<8 x i1>`` as numba types.

LLVM does not vectorise the long straight-line body of a trial by itself; given explicit vectors it
does, at whatever register width the machine has (8 doubles are one AVX-512 register, two AVX2 or four
NEON ones).  Every operation here is a single IEEE operation per lane: nothing is contracted,
reassociated or handed to a maths library, so a trial has the same digits on every machine and in every
company of seven neighbours.  Multiply-add is fused only where ``fma`` is written.

Lanes (double) know ``+ - * /``, unary ``-``, ``< <= >``; Bits (integer, wrapping) ``+ * ^ & | << >>``
with ``>>`` logical; Mask ``& | ~``.

Small symmetric linear algebra on them is at the end.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
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


def _splat(builder: Any, value: Any, vector: ir.VectorType) -> Any:
    first_lane = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first_lane, ir.Constant(vector, ir.Undefined), order)


def _call(builder: Any, name: str, result: ir.Type, args: list[Any]) -> Any:
    function_type = ir.FunctionType(result, [a.type for a in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), args)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any, vector: ir.VectorType) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


@intrinsic
def splat(typingctx, value):
    """The same double in all lanes."""

    def codegen(context, builder, sig, args):
        return _splat(builder, args[0], LANES.llvm)

    return LANES(types.float64), codegen


@intrinsic
def splat_bits(typingctx, value):
    """The same 64-bit integer in all lanes."""

    def codegen(context, builder, sig, args):
        return _splat(builder, args[0], BITS.llvm)

    return BITS(types.uint64), codegen


@intrinsic
def load(typingctx, array, index):
    """Eight consecutive elements of a flat float64 array (Lanes) or (u)int64 array (Bits)."""
    vector = LANES if array.dtype == types.float64 else BITS

    def codegen(context, builder, sig, args):
        pointer = _address(context, builder, sig.args[0], args[0], args[1], vector.llvm)
        return builder.load(pointer, align=8, typ=vector.llvm)

    return vector(array, types.intp), codegen


@intrinsic
def store(typingctx, array, index, value):
    """Write eight consecutive elements of a flat float64 array."""

    def codegen(context, builder, sig, args):
        builder.store(args[2], _address(context, builder, sig.args[0], args[0], args[1], LANES.llvm), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, LANES), codegen


@intrinsic
def fma(typingctx, a, b, c):
    """a * b + c, rounded once."""

    def codegen(context, builder, sig, args):
        return _call(builder, "llvm.fma.v8f64", LANES.llvm, list(args))

    return LANES(LANES, LANES, LANES), codegen


@intrinsic
def square_root(typingctx, a):
    def codegen(context, builder, sig, args):
        return _call(builder, "llvm.sqrt.v8f64", LANES.llvm, list(args))

    return LANES(LANES), codegen


@intrinsic
def absolute(typingctx, a):
    def codegen(context, builder, sig, args):
        return _call(builder, "llvm.fabs.v8f64", LANES.llvm, list(args))

    return LANES(LANES), codegen


@intrinsic
def select(typingctx, mask, yes, no):
    """Lane by lane: ``yes`` where the mask is set, ``no`` elsewhere."""

    def codegen(context, builder, sig, args):
        return builder.select(*args)

    return LANES(MASK, LANES, LANES), codegen


@intrinsic
def any_lane(typingctx, mask):
    def codegen(context, builder, sig, args):
        byte = builder.bitcast(args[0], ir.IntType(8))
        return builder.icmp_unsigned("!=", byte, ir.Constant(ir.IntType(8), 0))

    return types.boolean(MASK), codegen


@intrinsic
def bits_set(typingctx, bits):
    """Mask of the lanes whose integer is not zero."""

    def codegen(context, builder, sig, args):
        return builder.icmp_unsigned("!=", args[0], ir.Constant(BITS.llvm, [0] * WIDTH))

    return MASK(BITS), codegen


@intrinsic
def as_bits(typingctx, lanes):
    """The IEEE pattern of each double."""

    def codegen(context, builder, sig, args):
        return builder.bitcast(args[0], BITS.llvm)

    return BITS(LANES), codegen


@intrinsic
def as_lanes(typingctx, bits):
    """The doubles with these IEEE patterns."""

    def codegen(context, builder, sig, args):
        return builder.bitcast(args[0], LANES.llvm)

    return LANES(BITS), codegen


# mypy: ignore-errors


@lane_jit
def dot3(ax, ay, az, bx, by, bz):
    return fma(ax, bx, fma(ay, by, az * bz))


@lane_jit
def symmetric_times(g, x0, x1, x2, x3):
    """Product of a symmetric 4x4 (10 entries, upper triangle by rows) and a 4-vector."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    return (
        fma(g00, x0, fma(g01, x1, fma(g02, x2, g03 * x3))),
        fma(g01, x0, fma(g11, x1, fma(g12, x2, g13 * x3))),
        fma(g02, x0, fma(g12, x1, fma(g22, x2, g23 * x3))),
        fma(g03, x0, fma(g13, x1, fma(g23, x2, g33 * x3))),
    )


@lane_jit
def factor3(k00, k01, k02, k11, k12, k22):
    """LDL' of a symmetric 3x3: (l10, l20, l21, 1/d0, 1/d1, 1/d2, smallest pivot's sign mask)."""
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
def solve3(f, b0, b1, b2):
    l10, l20, l21, i0, i1, i2, _ = f
    y1 = fma(-l10, b0, b1)
    y2 = fma(-l21, y1, fma(-l20, b0, b2))
    x2 = y2 * i2
    x1 = fma(-l21, x2, y1 * i1)
    x0 = fma(-l10, x1, fma(-l20, x2, b0 * i0))
    return x0, x1, x2


@lane_jit
def reciprocal_shifted(d, inverse, shift):
    """1 / (d - shift) by Newton's iteration from 1/d; relative error (shift/d)^8."""
    x = fma(inverse, shift * inverse, inverse)
    gap = splat(d) - shift
    two = splat(1.0)
    x = fma(x, fma(-gap, x, two), x)
    return fma(x, fma(-gap, x, two), x)


@lane_jit
def sandwich(g, d0, d1, d2, d3):
    """Upper triangle of G diag(d) G for a symmetric G."""
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = g
    a00, a01, a02, a03 = g00 * d0, g01 * d1, g02 * d2, g03 * d3
    a10, a11, a12, a13 = g01 * d0, g11 * d1, g12 * d2, g13 * d3
    a20, a21, a22, a23 = g02 * d0, g12 * d1, g22 * d2, g23 * d3
    a30, a31, a32, a33 = g03 * d0, g13 * d1, g23 * d2, g33 * d3
    return (
        fma(a00, g00, fma(a01, g01, fma(a02, g02, a03 * g03))),
        fma(a00, g01, fma(a01, g11, fma(a02, g12, a03 * g13))),
        fma(a00, g02, fma(a01, g12, fma(a02, g22, a03 * g23))),
        fma(a00, g03, fma(a01, g13, fma(a02, g23, a03 * g33))),
        fma(a10, g01, fma(a11, g11, fma(a12, g12, a13 * g13))),
        fma(a10, g02, fma(a11, g12, fma(a12, g22, a13 * g23))),
        fma(a10, g03, fma(a11, g13, fma(a12, g23, a13 * g33))),
        fma(a20, g02, fma(a21, g12, fma(a22, g22, a23 * g23))),
        fma(a20, g03, fma(a21, g13, fma(a22, g23, a23 * g33))),
        fma(a30, g03, fma(a31, g13, fma(a32, g23, a33 * g33))),
    )
