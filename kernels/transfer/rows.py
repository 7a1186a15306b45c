"""Rows of a transfer function: a polynomial in a window of scalars, and how far it is off there."""

import warp as wp


@wp.struct
class Rows:
    """Rows of a transfer function, as of ``wvr.transfer.rows``: of its intervals, then fitted ones."""

    row: wp.array2d(dtype=wp.float32)  # (n, 16)
    jumps: wp.array2d(dtype=wp.float32)  # (n, 8) of intervals
    knots: wp.array(dtype=wp.float64)  # where intervals begin, of the transfer function
    # (n, 4): of equal bins from ``low`` on, the interval of the middle, and the first two numbers of its row
    bins: wp.array2d(dtype=wp.float32)
    low: wp.float32
    scale: wp.float32  # bins per scalar
    fine: wp.float32  # narrowest windows per scalar
    least: wp.float32  # one over the R that surely fits into a narrowest window
    narrow: wp.float32  # intervals are wider that those beside them know what is beyond their ends
    levels: int  # windows of level j are 2^j times as wide as the narrowest
    fitted: int  # the first of them


# With one address for all that is read of a row: compilers for GPUs make one of each place in an array.
@wp.func_native("return *(rows.row.data + 16 * (size_t)k + n);")
def number(rows: Rows, k: int, n: int) -> wp.float32:
    """Number n of row k."""
    ...


@wp.func_native("return *(rows.jumps.data + 8 * (size_t)k + n);")
def jump(rows: Rows, k: int, n: int) -> wp.float32:
    """Number n of the jumps of interval k."""
    ...


@wp.func_native("return *(rows.knots.data + k);")
def knot(rows: Rows, k: int) -> wp.float64:
    """Where interval k begins."""
    ...


@wp.func_native("return (int)*(rows.bins.data + 4 * (size_t)k);")
def bin(rows: Rows, k: int) -> int:
    """The interval of bin k."""
    ...
