"""The cubic mean of 4 x 4 pixels of three bands with vector instructions: twelve values of a row at a time.

numba does not combine neighbouring values of one pixel into vectors (its compiler's pass for that is off), so the vectors are
written out in LLVM's language, which every processor is translated from. Multiplications are joined with additions where the
processor can, in one fixed order: the result of a place does not depend on what is computed around it.

Source: Keys 1981, a = -1/2.
"""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_FLOAT, _INDEX = ir.FloatType(), ir.IntType(32)
_POWERS = ((-0.5, 1.5, -1.5, 0.5), (1.0, -2.5, 2.0, -0.5), (-0.5, 0.0, 0.5, 0.0), (0.0, 1.0, 0.0, 0.0))
"""Coefficients of t^3, t^2, t and 1 in the weights of the four neighbours of a place t behind the second one."""


def _vector(count: int, kind: ir.Type) -> ir.VectorType:
    return ir.VectorType(kind, count)


def _picked(b: ir.IRBuilder, one: ir.Value, other: ir.Value, places: list[int]) -> ir.Value:
    """The values at `places` of two vectors that follow each other."""
    return b.shuffle_vector(one, other, ir.Constant(_vector(len(places), _INDEX), places))


def _spread(b: ir.IRBuilder, vector: ir.Value, place: int, count: int) -> ir.Value:
    """A vector of `count` times the value at a place of another."""
    return _picked(b, vector, vector, [place] * count)


def _add_product(b: ir.IRBuilder, one: ir.Value, other: ir.Value, total: ir.Value) -> ir.Value:
    """one * other + total."""
    kind = ir.FunctionType(one.type, [one.type] * 3)
    return b.call(cgutils.get_or_insert_function(b.module, kind, f"llvm.fmuladd.v{one.type.count}f32"), [one, other, total])


def _weights(b: ir.IRBuilder, t: ir.Value) -> ir.Value:
    """The weights of the four neighbours as a vector."""
    single = b.insert_element(ir.Constant(_vector(4, _FLOAT), ir.Undefined), t, ir.Constant(_INDEX, 0))
    place = _spread(b, single, 0, 4)
    total = ir.Constant(_vector(4, _FLOAT), _POWERS[0])
    for power in _POWERS[1:]:
        total = _add_product(b, total, place, ir.Constant(_vector(4, _FLOAT), power))
    return total


def _loaded(b: ir.IRBuilder, pixels: ir.Value, first: ir.Value, count: int) -> ir.Value:
    """float32 vector of `count` pixels, unsigned whole numbers or float32, from position `first` on."""
    kind = pixels.type.pointee
    values = b.load(b.bitcast(b.gep(pixels, [first]), _vector(count, kind).as_pointer()))
    values.align = 1
    return values if kind == _FLOAT else b.uitofp(values, _vector(count, _FLOAT))


def _three_bands(typing_context: Any, flat: Any, first: Any, step: Any, x: Any, y: Any) -> Any:
    """The signature for numba, and what writes the instructions."""
    if flat.dtype not in (types.uint8, types.uint16, types.float32):
        return None

    def generate(context: Any, b: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        pixels = context.make_array(signature.args[0])(context, b, arguments[0]).data
        across, down = _weights(b, arguments[3]), _weights(b, arguments[4])
        place = arguments[1]
        # Twelve values of a row as eight and four, as wide as registers are.
        eight, four = ir.Constant(_vector(8, _FLOAT), None), ir.Constant(_vector(4, _FLOAT), None)
        for row in range(4):
            behind = b.add(place, ir.Constant(place.type, 8))
            eight = _add_product(b, _loaded(b, pixels, place, 8), _spread(b, down, row, 8), eight)
            four = _add_product(b, _loaded(b, pixels, behind, 4), _spread(b, down, row, 4), four)
            place = b.add(place, arguments[2])
        last = _picked(b, eight, eight, [6, 7, 6, 7])
        pixels_of_row = (
            _picked(b, eight, eight, [0, 1, 2, 2]),
            _picked(b, eight, eight, [3, 4, 5, 5]),
            _picked(b, last, four, [0, 1, 4, 4]),
            _picked(b, four, four, [1, 2, 3, 3]),
        )
        total = ir.Constant(_vector(4, _FLOAT), None)
        for column, values in enumerate(pixels_of_row):
            total = _add_product(b, values, _spread(b, across, column, 4), total)
        return cgutils.pack_array(b, [b.extract_element(total, ir.Constant(_INDEX, band)) for band in range(3)])

    return types.UniTuple(types.float32, 3)(flat, first, step, x, y), generate


three_bands: Any = intrinsic(_three_bands)
"""(flat, first, step, x, y): the cubic means (3,) float32 of three bands, uint8, uint16 or float32.

The pixels `flat` are read from position `first` on and in three rows `step` behind each other; x, y float32: the place between the
second and the third pixel.
"""
