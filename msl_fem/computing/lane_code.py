"""What `msl_fem.computing.lanes` names, generated for numba: vectors of the machine, and rows by their address."""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.registry import cpu_target
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from msl_fem.computing.lanes import LANES
from msl_fem.computing.operator_types import remember_operators_of

_DOUBLE, _INDEX = ir.DoubleType(), ir.IntType(32)
_VECTOR, _BITS = ir.VectorType(_DOUBLE, LANES), ir.VectorType(ir.IntType(1), LANES)
_BITS_OF_ONE, _BITS_OF_LANES = ir.IntType(64), ir.VectorType(ir.IntType(64), LANES)
_MANTISSA, _BIAS = 52, 1023  # bits of a number's fraction, what its exponent is stored with
_BITS_OF_ROUNDER = 0x4338000000000000  # of 1.5 2^52


class LanesType(types.Type):
    """numba's name for a number a lane."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


class LaneFlagsType(types.Type):
    """numba's name for a truth value a lane."""

    def __init__(self) -> None:
        super().__init__(name="LaneFlags")


class RowsType(types.Type):
    """numba's name for the address of rows of numbers, or of lanes."""

    def __init__(self, width: int) -> None:
        super().__init__(name=f"Rows{width}")
        self.width = width


_LANES, _FLAGS = LanesType(), LaneFlagsType()
remember_operators_of(LanesType, LaneFlagsType, RowsType)
_NUMBERS = (LanesType, types.Float, types.Integer)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(LaneFlagsType)
class _LaneFlagsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


@register_model(RowsType)
class _RowsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLE.as_pointer())


def _wide(context: Any, builder: Any, value: Any, kind: Any) -> Any:
    """The value in every lane."""
    if isinstance(kind, LanesType):
        return value
    number = context.cast(builder, value, kind, types.float64)
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), _first_everywhere())


def _first_everywhere() -> Any:
    return ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES)


def _operator(function: Any, emit: Any, *, result: Any) -> None:
    """Teaches numba `function` of two numbers, of which one at least is of lanes."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            of_lanes = any(isinstance(a, LanesType) for a in args)
            if len(args) == 2 and of_lanes and all(isinstance(a, _NUMBERS) for a in args):
                return signature(result, *args)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *(_wide(context, builder, v, t) for v, t in zip(args, sig.args, strict=True)))

    for left in _NUMBERS:
        for right in _NUMBERS if left is LanesType else _NUMBERS[:1]:
            lower_builtin(function, left, right)(lower)


_operator(operator.add, lambda b, x, y: b.fadd(x, y), result=_LANES)
_operator(operator.sub, lambda b, x, y: b.fsub(x, y), result=_LANES)
_operator(operator.mul, lambda b, x, y: b.fmul(x, y), result=_LANES)
_operator(operator.truediv, lambda b, x, y: b.fdiv(x, y), result=_LANES)
for _function, _name in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
                         (operator.eq, "==")):  # fmt: skip
    _operator(_function, lambda b, x, y, name=_name: b.fcmp_ordered(name, x, y), result=_FLAGS)


@infer_global(operator.and_)
class _And(AbstractTemplate):
    key = operator.and_

    def generic(self, args: Any, kws: Any) -> Any:
        return signature(_FLAGS, *args) if all(isinstance(a, LaneFlagsType) for a in args) else None


@lower_builtin(operator.and_, LaneFlagsType, LaneFlagsType)
def _lower_and(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.and_(*args)


def _call(name: str, n: int) -> Any:
    """An intrinsic of LLVM with n arguments, of numbers or of lanes by its first argument."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        of_lanes = isinstance(sig.return_type, LanesType)
        kind = _VECTOR if of_lanes else _DOUBLE
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(kind, [kind] * n), f"llvm.{name}.{'v8f64' if of_lanes else 'f64'}"
        )
        if of_lanes:
            values = [_wide(context, builder, v, t) for v, t in zip(args, sig.args, strict=True)]
        else:
            values = [context.cast(builder, v, t, types.float64) for v, t in zip(args, sig.args, strict=True)]
        return builder.call(function, values)

    return generate


def _result(*arguments: Any) -> Any:
    return _LANES if any(isinstance(a, LanesType) for a in arguments) else types.float64


@intrinsic
def fma(context: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once where the machine can, whatever surrounds it: equal in every function that says it."""
    return _result(a, b, c)(a, b, c), _call("fmuladd", 3)


@intrinsic
def size(context: Any, a: Any) -> Any:
    """|a|"""
    return _result(a)(a), _call("fabs", 1)


def _by_bits(emit: Any) -> Any:
    """`emit` of the builder, the value, its type, and a maker of constants of its bits, for a number or for lanes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if isinstance(sig.return_type, LanesType):
            return emit(builder, args[0], _VECTOR, lambda n: ir.Constant(_BITS_OF_LANES, [n] * LANES))
        value = context.cast(builder, args[0], sig.args[0], types.float64)
        return emit(builder, value, _DOUBLE, lambda n: ir.Constant(_BITS_OF_ONE, n))

    return generate


def _power_of_two(builder: Any, value: Any, kind: Any, bits: Any) -> Any:
    """The last bits of the value and 1.5 2^52 are those of the whole number; they become an exponent."""
    shifted = builder.fadd(value, builder.bitcast(bits(_BITS_OF_ROUNDER), kind))
    whole = builder.sub(builder.bitcast(shifted, bits(0).type), bits(_BITS_OF_ROUNDER))
    return builder.bitcast(builder.shl(builder.add(whole, bits(_BIAS)), bits(_MANTISSA)), kind)


def _exponent_of(builder: Any, value: Any, kind: Any, bits: Any) -> Any:
    """The exponent becomes the last bits of a number beside 1.5 2^52, which is taken away again."""
    exponent = builder.sub(builder.lshr(builder.bitcast(value, bits(0).type), bits(_MANTISSA)), bits(_BIAS))
    rounder = builder.bitcast(bits(_BITS_OF_ROUNDER), kind)
    return builder.fsub(builder.bitcast(builder.add(exponent, bits(_BITS_OF_ROUNDER)), kind), rounder)


@intrinsic
def power_of_two(context: Any, a: Any) -> Any:
    """2^a, of a whole number from -1022 to 1023."""
    return _result(a)(a), _by_bits(_power_of_two)


@intrinsic
def exponent_of(context: Any, a: Any) -> Any:
    """The largest n with 2^n <= a, of a number above 2^-1022."""
    return _result(a)(a), _by_bits(_exponent_of)


@intrinsic
def square_root(context: Any, a: Any) -> Any:
    return _result(a)(a), _call("sqrt", 1)


@intrinsic
def sine_of(context: Any, a: Any) -> Any:
    return _result(a)(a), _call("sin", 1)


@intrinsic
def cosine_of(context: Any, a: Any) -> Any:
    return _result(a)(a), _call("cos", 1)


@intrinsic
def choose(context: Any, flag: Any, a: Any, b: Any) -> Any:
    """a where the flag is up, else b; both are computed."""
    result = _LANES if isinstance(flag, LaneFlagsType) else _result(a, b)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        wide = isinstance(sig.return_type, LanesType)
        if wide:
            values = [_wide(context, builder, v, t) for v, t in zip(args[1:], sig.args[1:], strict=True)]
        else:
            values = [context.cast(builder, v, t, types.float64) for v, t in zip(args[1:], sig.args[1:], strict=True)]
        return builder.select(args[0], *values)

    return result(flag, a, b), generate


@intrinsic
def rows_of(context: Any, array: Any) -> Any:
    """The rows of a C-ordered array: lanes of (n_row, LANES), else numbers; None of None."""
    if isinstance(array, types.NoneType):
        return types.none(array), lambda context, builder, sig, args: context.get_dummy_value()
    if array.layout != "C":
        raise TypeError(f"rows are those of an array in C order, not of the kind {array}")

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_array(sig.args[0])(context, builder, args[0]).data

    return RowsType(LANES if array.ndim == 2 else 1)(array), generate


@intrinsic
def keep(context: Any, array: Any) -> Any:
    """Nothing: the array lives until here."""
    return types.void(array), lambda context, builder, sig, args: context.get_dummy_value()


@infer_global(operator.getitem)
class _GetRow(AbstractTemplate):
    key = operator.getitem

    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], RowsType) and isinstance(args[1], types.Integer):
            return signature(types.float64 if args[0].width == 1 else _LANES, args[0], types.intp)
        return None


@infer_global(operator.setitem)
class _SetRow(AbstractTemplate):
    key = operator.setitem

    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], RowsType) and isinstance(args[1], types.Integer) and isinstance(args[2], _NUMBERS):
            value = types.float64 if args[0].width == 1 else args[2]
            return signature(types.none, args[0], types.intp, value)
        return None


def _row(builder: Any, sig: Any, args: Any) -> Any:
    """The pointer to row n: no negative n, no check."""
    width = sig.args[0].width
    if width == 1:
        return builder.gep(args[0], [args[1]])
    return builder.bitcast(builder.gep(args[0], [builder.mul(args[1], args[1].type(width))]), _VECTOR.as_pointer())


@lower_builtin(operator.getitem, RowsType, types.Integer)
def _get_row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_row(builder, sig, args), align=8)


@lower_builtin(operator.setitem, RowsType, types.Integer, types.Any)
def _set_row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    new = args[2] if sig.args[0].width == 1 else _wide(context, builder, args[2], sig.args[2])
    builder.store(new, _row(builder, sig, args), align=8)
    return context.get_dummy_value()


@intrinsic
def width(context: Any, rows: Any) -> Any:
    """How many lanes the rows have: 1 or LANES."""
    n = rows.width
    return types.intp(rows), lambda context, builder, sig, args: context.get_constant(types.intp, n)


def _place(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    n = context.cast(builder, args[1], sig.args[1], types.intp)
    lane = context.cast(builder, args[2], sig.args[2], types.intp)
    return builder.gep(args[0], [builder.add(builder.mul(n, n.type(sig.args[0].width)), lane)])


@intrinsic
def lane_of(context: Any, rows: Any, n: Any, lane: Any) -> Any:
    """Row n of one lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, sig, args))

    return types.float64(rows, n, lane), generate


@intrinsic
def set_lane(context: Any, rows: Any, n: Any, lane: Any, value: Any) -> Any:
    """Sets row n of one lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        number = context.cast(builder, args[3], sig.args[3], types.float64)
        builder.store(number, _place(context, builder, sig, args))
        return context.get_dummy_value()

    return types.void(rows, n, lane, value), generate


def _of_all(compare: str, value: int) -> Any:
    """Compares the flags of all lanes, as one integer, with one value; a flag that is no lanes' is itself."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not isinstance(sig.args[0], LaneFlagsType):
            return args[0]
        together = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned(compare, together, ir.Constant(ir.IntType(LANES), value))

    return generate


@intrinsic
def every(context: Any, flag: Any) -> Any:
    """Whether the flag is up in every lane."""
    return types.boolean(flag), _of_all("==", 2**LANES - 1)


@intrinsic
def some(context: Any, flag: Any) -> Any:
    """Whether the flag is up in one lane at least."""
    return types.boolean(flag), _of_all("!=", 0)


@intrinsic
def first(context: Any, value: Any) -> Any:
    """The number of the first lane, where all lanes are of one kind."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not isinstance(sig.args[0], LanesType):
            return args[0]
        return builder.extract_element(args[0], ir.Constant(_INDEX, 0))

    return types.float64(value), generate


@intrinsic
def call_at(context: Any, address: Any, first_rows: Any, second_rows: Any) -> Any:
    """Calls the function of two rows that stands at an address, which is given as a number."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _DOUBLE.as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer]).as_pointer()
        function = builder.inttoptr(builder.fptoui(args[0], ir.IntType(64)), kind)
        builder.call(function, [args[1], args[2]])
        return context.get_dummy_value()

    return types.void(address, first_rows, second_rows), generate


def type_of(generated: Any) -> Any:
    """What numba takes a name of this module for."""
    cpu_target.typing_context.refresh()
    return cpu_target.typing_context.resolve_value_type(generated)
