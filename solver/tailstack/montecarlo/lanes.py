"""Eight trials side by side: ``<8 x double>``, ``<8 x i64>`` and ``<8 x i1>`` as numba types.

LLVM does not vectorise the long straight-line body of a trial by itself; given explicit vectors it
does, at whatever register width the machine has (8 doubles are one AVX-512 register, two AVX2 or four
NEON ones).  Every operation here is a single IEEE operation per lane: nothing is contracted,
reassociated or handed to a maths library, so a trial has the same digits on every machine and in every
company of seven neighbours.  Multiply-add is fused only where ``fma`` is written.

Lanes (double) know ``+ - * /``, unary ``-``, ``< <= >``; Bits (integer, wrapping) ``+ * ^ & | << >>``
with ``>>`` logical; Mask ``& | ~``.
"""

# mypy: ignore-errors
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

from ..kernels import kernel

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
    (operator.add, "add"), (operator.mul, "mul"), (operator.xor, "xor"), (operator.and_, "and_"),
    (operator.or_, "or_"), (operator.lshift, "shl"), (operator.rshift, "lshr"),
):  # fmt: skip
    _operator(_symbol, BITS, (BITS, BITS), lambda b, x, y, name=_name: getattr(b, name)(x, y))
_operator(operator.and_, MASK, (MASK, MASK), lambda b, x, y: b.and_(x, y))
_operator(operator.or_, MASK, (MASK, MASK), lambda b, x, y: b.or_(x, y))
_operator(operator.invert, MASK, (MASK,), lambda b, x: b.not_(x))


def _splat(builder: Any, value: Any, vector: ir.VectorType) -> Any:
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), order)


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
