"""Pre-integration tables: how they are generated.

Entry (i, j) is the segment of length ``delta`` whose scalar runs linearly from table value i to j. The transfer
function comes cut into pieces at its own knots, so the table is that of the function itself and not of a resampling.
An elementary interval [k, k + 1] is made of the pieces ``first[k] .. first[k + 1]``; in an entry with r = |j - i|
intervals each has length delta / r. Entries (i, j) and (j, i) are the same range seen from its two ends and are
generated together: suffix "up" towards larger scalars, "down" towards smaller ones.

``incremental`` is the subrange integration of Lum, Wilson and Ma (2004), section 4.1: for each r the intervals are cut
in bins of r; the suffix of one bin over the prefix of the next is an entry. O(n^2) in all, and exact.
``brute`` composes the |j - i| intervals of every entry: O(n^3), the check.
``approximate`` neglects the attenuation inside a segment (Engel et al. 2001; Roettger et al. 2003): wrong where dense.

For lighting, a segment also carries the first moment of what it emits about its own start (``over_moment``), whose
share of the length is the back-weighted integral; nothing is subtracted to get it. (The way of Lum et al., section 4.3,
is the host's ``ramped``: tables of ramped colours, of which i times the unweighted entry is subtracted.)
"""

from functools import cache

import warp as wp

from ..precision import vec2_of, vec3_of, vec4_of
from ..segment import make_absorbed, over, over_moment, widened
from .linear import make_shares


@cache
def make_pieces(real):
    """The struct of a cut transfer function and ``elementary(pieces, p, length)`` -> what piece p contributes.

    Four vec4d: up, down: emission and opacity; up, down: the first moments of both, in table intervals.
    """
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    vec2 = vec2_of(real)
    shares = make_shares(real)

    @wp.struct
    class Pieces:
        first: wp.array(dtype=int)  # (n,) first piece of interval k; the last entry closes the last interval
        width: wp.array(dtype=real)  # share of the interval's length that the piece has
        low: wp.array(dtype=vec4)  # (r, g, b, extinction) at the piece's lower end
        high: wp.array(dtype=vec4)  # and at its upper end
        curve: wp.array(dtype=vec4)  # second-order coefficient of (r, g, b, 0); empty where all colours are linear
        value: wp.array(dtype=vec4)  # (n,) at the table values themselves
        nodes: wp.array(dtype=vec2)

    @wp.func
    def directed(front: vec4, back: vec4, curve: vec4, A: real, W: vec3, width: real):
        slope = back - front - curve
        segment = A * front + W[0] * slope + W[1] * curve
        segment[3] = A
        moment = W[0] * front + W[1] * slope + W[2] * curve
        moment[3] = W[0]
        return widened(segment), widened(width * moment)

    @wp.func
    def elementary(pieces: Pieces, p: int, length: real):
        low = pieces.low[p]
        high = pieces.high[p]
        width = pieces.width[p]
        curve = vec4()
        if pieces.curve.shape[0] > 0:
            curve = pieces.curve[p]
        A, U, D = shares(pieces.nodes, low[3] * length * width, high[3] * length * width)
        up, up_moment = directed(low, high, curve, A, U, width)
        down, down_moment = directed(high, low, curve, A, D, width)
        return up, down, up_moment, down_moment

    return Pieces, elementary


@cache
def make_generators(real, weighted):
    """Kernels ``diagonal`` (n items), ``incremental`` (items of ``bins``) and ``brute`` (n * n items).

    ``weighted``: ``moments`` receives the back-weighted entries.
    """
    vec4 = vec4_of(real)
    Pieces, elementary = make_pieces(real)
    absorbed, _ = make_absorbed(real)
    shares = make_shares(real)

    @wp.func
    def rounded(segment: wp.vec4d):
        return vec4(segment)

    @wp.kernel(enable_backward=False, module="unique")
    def incremental(
        base: int,
        pieces: Pieces,
        bins: wp.array(dtype=wp.vec2i),
        delta: real,
        table: wp.array2d(dtype=vec4),
        moments: wp.array2d(dtype=vec4),
    ):
        item = bins[wp.tid() + base]
        r = item[0]
        start = item[1]
        n = table.shape[0]
        length = delta / real(r)
        # Suffixes of the bin [start, start + r], kept in the table until their prefix is there.
        up = wp.vec4d()
        down = wp.vec4d()
        up_moment = wp.vec4d()
        down_moment = wp.vec4d()
        reach = wp.float64(0.0)
        for o in range(r - 1, -1, -1):
            i = start + o
            for p in range(pieces.first[i + 1] - 1, pieces.first[i] - 1, -1):
                u, d, mu, md = elementary(pieces, p, length)
                if wp.static(weighted):
                    width = wp.float64(pieces.width[p])
                    up_moment = over_moment(u, mu, width, up, up_moment)
                    down_moment = over_moment(down, down_moment, reach, d, md)
                    reach += width
                up = over(u, up)
                down = over(down, d)
            if i + r < n:
                table[i, i + r] = rounded(up)
                table[i + r, i] = rounded(down)
                if wp.static(weighted):
                    moments[i, i + r] = rounded(up_moment)
                    moments[i + r, i] = rounded(down_moment)
        # Prefixes of the next bin complete them.
        up = wp.vec4d()
        down = wp.vec4d()
        up_moment = wp.vec4d()
        down_moment = wp.vec4d()
        reach = wp.float64(0.0)
        for o in range(wp.min(r, n - start - r)):
            i = start + o
            j = i + r
            if o > 0:
                for p in range(pieces.first[j - 1], pieces.first[j]):
                    u, d, mu, md = elementary(pieces, p, length)
                    if wp.static(weighted):
                        width = wp.float64(pieces.width[p])
                        up_moment = over_moment(up, up_moment, reach, u, mu)
                        down_moment = over_moment(d, md, width, down, down_moment)
                        reach += width
                    up = over(up, u)
                    down = over(d, down)
            low = widened(table[i, j])
            high = widened(table[j, i])
            rise = over(low, up)
            fall = over(down, high)
            table[i, j] = rounded(rise)
            table[j, i] = rounded(fall)
            if wp.static(weighted):
                m = over_moment(low, widened(moments[i, j]), wp.float64(r - o), up, up_moment)
                w = over_moment(down, down_moment, wp.float64(o), high, widened(moments[j, i]))
                moments[i, j] = rounded(m / wp.float64(r))
                moments[j, i] = rounded(w / wp.float64(r))

    @wp.kernel(enable_backward=False, module="unique")
    def brute(
        base: int,
        pieces: Pieces,
        delta: real,
        table: wp.array2d(dtype=vec4),
        moments: wp.array2d(dtype=vec4),
    ):
        item = wp.tid() + base
        i = item // table.shape[1]
        j = item - i * table.shape[1]
        r = wp.abs(j - i)
        segment = wp.vec4d()
        moment = wp.vec4d()
        reach = wp.float64(0.0)
        for k in range(wp.min(i, j), wp.max(i, j)):
            for p in range(pieces.first[k], pieces.first[k + 1]):
                u, d, mu, md = elementary(pieces, p, delta / real(r))
                width = wp.float64(pieces.width[p])
                if i < j:
                    if wp.static(weighted):
                        moment = over_moment(segment, moment, reach, u, mu)
                    segment = over(segment, u)
                else:
                    if wp.static(weighted):
                        moment = over_moment(d, md, width, segment, moment)
                    segment = over(d, segment)
                reach += width
        if r > 0:
            table[i, j] = rounded(segment)
            if wp.static(weighted):
                moments[i, j] = rounded(moment / wp.float64(r))

    @wp.kernel(enable_backward=False, module="unique")
    def diagonal(
        base: int, pieces: Pieces, delta: real, table: wp.array2d(dtype=vec4), moments: wp.array2d(dtype=vec4)
    ):
        i = wp.tid() + base
        emission = pieces.value[i]
        depth = wp.max(emission[3], real(0.0)) * delta
        emission[3] = real(1.0)
        table[i, i] = absorbed(depth) * emission
        if wp.static(weighted):
            # The ramp is in ray length.
            _A, U, _D = shares(pieces.nodes, depth, depth)
            moments[i, i] = U[0] * emission

    return diagonal, incremental, brute


@cache
def make_approximate(real):
    """Kernel over n * n items: entries from running integrals of extinction and emission, attenuation left out."""
    vec4 = vec4_of(real)
    absorbed, _ = make_absorbed(real)

    @wp.kernel(enable_backward=False, module="unique")
    def approximate(
        base: int,
        running: wp.array(dtype=wp.vec4d),  # (n,) integral of (emission, extinction) up to table value k, in intervals
        value: wp.array(dtype=vec4),  # (n,) (r, g, b, extinction) at the table values
        delta: real,
        table: wp.array2d(dtype=vec4),
    ):
        item = wp.tid() + base
        i = item // table.shape[1]
        j = item - i * table.shape[1]
        mean = value[i]
        if i == j:
            mean = vec4(mean[3] * mean[0], mean[3] * mean[1], mean[3] * mean[2], mean[3])
        else:
            mean = vec4((running[j] - running[i]) / wp.float64(j - i))
        entry = delta * mean
        entry[3] = absorbed(wp.max(entry[3], real(0.0)))
        table[i, j] = entry

    return approximate


@cache
def make_stretchable(real):
    """Kernel over n * n items: from a table of short segments to one for segments of any length.

    An entry becomes (mean emission, mean extinction). Extinction is that of the running integrals, exact for any
    length; emission is what makes colour exact for the table's own length, and else right to first order.
    """
    vec4 = vec4_of(real)

    @wp.kernel(enable_backward=False, module="unique")
    def stretchable(
        base: int,
        running: wp.array(dtype=wp.vec4d),  # as of ``make_approximate``
        value: wp.array(dtype=vec4),
        table: wp.array2d(dtype=vec4),
        result: wp.array2d(dtype=vec4),
    ):
        item = wp.tid() + base
        i = item // table.shape[1]
        j = item - i * table.shape[1]
        tau = value[i][3]
        if i != j:
            tau = real((running[j][3] - running[i][3]) / wp.float64(j - i))
        entry = table[i, j]
        if entry[3] > real(0.0):
            entry *= tau / entry[3]
        entry[3] = wp.max(tau, real(0.0))
        result[i, j] = entry

    return stretchable
