"""Sums of weighted rows that stay in vector registers: what the compiler does not make of a loop by itself.

    sums[j] += inputs[used[0]] * weights[used[0], j];  sums[j] += inputs[used[1]] * weights[used[1], j];  ...

Vectors run across the units j; each unit's sum has its order. Products and sums are rounded one by one (no fused
multiplication and addition), so the bits are those of the loop above on any processor, whatever the width of its
registers. A block of units is chosen so narrow that its sums fit them.
"""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

WIDTHS = (16, 8, 4)  # float32 in a vector; a processor with narrower registers takes two or four for one
_FLOAT, _INDEX, _INT32 = ir.FloatType(), ir.IntType(64), ir.IntType(32)


def pieces(width: int) -> list[tuple[int, int]]:
    """The vectors that cover `width` units: where each begins and how wide it is.

    >>> pieces(36)
    [(0, 16), (16, 16), (32, 4)]
    """
    if width < 1 or width % WIDTHS[-1]:
        raise ValueError(
            f"a block of {width} units: give a multiple of {WIDTHS[-1]}, as the narrowest vector has"
        )
    found, at = [], 0
    for size in WIDTHS:
        while width - at >= size:
            found.append((at, size))
            at += size
    return found


def _is_row(given: Any, dtype: Any) -> bool:
    return isinstance(given, types.Array) and given.layout == "C" and given.dtype == dtype


def _add_rows(
    _typing: Any,
    inputs: Any,
    used: Any,
    count: Any,
    weights: Any,
    row: Any,
    first: Any,
    width: Any,
    sums: Any,
) -> Any:
    """Add inputs[i] * weights[i] to sums[first : first + width] for i in used[:count], in that order.

    inputs, weights, sums: contiguous float32; used: contiguous int32; nothing checks that indices are within them
    row: units in a row of `weights`, which may be flat
    width: a multiple of 4; `row`, `first` and `width` are literal numbers
    """
    arrays = all(_is_row(a, types.float32) for a in (inputs, weights, sums)) and _is_row(used, types.int32)
    numbers = all(isinstance(a, types.IntegerLiteral) for a in (row, first, width))
    if not (arrays and numbers and isinstance(count, types.Integer)):
        return None
    signature = types.void(inputs, used, types.intp, weights, row, first, width, sums)

    def code(context: Any, builder: Any, typed: Any, given: Any) -> Any:
        x, index, w, out = (
            context.make_array(typed.args[k])(context, builder, given[k]).data for k in (0, 1, 3, 7)
        )
        units, begin = row.literal_value, first.literal_value
        parts = pieces(width.literal_value)
        places = [_place(builder, out, ir.Constant(_INDEX, begin + at), size) for at, size in parts]
        before = [builder.load(place, align=4) for place in places]
        entry, head, body, done = builder.block, *(builder.append_basic_block() for _ in range(3))
        builder.branch(head)
        builder.position_at_end(head)
        k = builder.phi(_INDEX)
        k.add_incoming(ir.Constant(_INDEX, 0), entry)
        totals = [builder.phi(vector.type) for vector in before]
        builder.cbranch(builder.icmp_signed("<", k, given[2]), body, done)
        builder.position_at_end(body)
        i = builder.sext(builder.load(builder.gep(index, [k])), _INDEX)
        value = builder.load(builder.gep(x, [i]))
        at_row = builder.add(builder.mul(i, ir.Constant(_INDEX, units)), ir.Constant(_INDEX, begin))
        for total, vector, (at, size) in zip(totals, before, parts, strict=True):
            weight = builder.load(
                _place(builder, w, builder.add(at_row, ir.Constant(_INDEX, at)), size), align=4
            )
            total.add_incoming(vector, entry)
            total.add_incoming(
                builder.fadd(total, builder.fmul(_everywhere(builder, value, size), weight)), body
            )
        k.add_incoming(builder.add(k, ir.Constant(_INDEX, 1)), body)
        builder.branch(head)
        builder.position_at_end(done)
        for total, place in zip(totals, places, strict=True):
            builder.store(total, place, align=4)
        return context.get_dummy_value()

    return signature, code


add_rows: Any = intrinsic(_add_rows)  # its first argument is the compiler's


def _place(builder: Any, base: Any, offset: Any, size: int) -> Any:
    """Where `size` float32 lie, as a vector's address."""
    return builder.bitcast(builder.gep(base, [offset]), ir.VectorType(_FLOAT, size).as_pointer())


def _everywhere(builder: Any, value: Any, size: int) -> Any:
    """A vector with that value in each of its places."""
    kind = ir.VectorType(_FLOAT, size)
    alone = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(_INT32, 0))
    first = ir.Constant(ir.VectorType(_INT32, size), [0] * size)
    return builder.shuffle_vector(alone, ir.Constant(kind, ir.Undefined), first)
