"""Rays of neighbouring pixels abreast, in vectors: what ``ray`` and ``raycast`` say of one, where nothing ends it."""

import warp as wp

from .bricks.brick import Brick
from .ray import TILE, View
from .vectors import VECTORS

REACHES = """
#define LESS(a, b) ((a) < (b) ? (a) : (b))
#define MORE(a, b) ((a) > (b) ? (a) : (b))
const double FAR = 1e300, clear = limits[0], most = limits[1], little = limits[2], e = 2.0 * view.astray;
const vd none = {};
const auto& world = view.to_index.data;
double* line = lines.data;
for (int b = 0; b < TILE / 8; ++b) {
    const vd column = (vd){0, 1, 2, 3, 4, 5, 6, 7} + (double)(x + 8 * b);
    vd anchor[3], way[3], along[3], inverse[3], point[3];
    for (int a = 0; a < 3; ++a) {
        anchor[a] = (view.anchor[a] + y * view.down[a]) + column * view.right[a];
        way[a] = (view.way[a] + y * view.way_down[a]) + column * view.way_right[a];
    }
    const vd size = __builtin_elementwise_sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
    const vd unit = view.unit / size;
    for (int a = 0; a < 3; ++a) {
        const double* m = &world[0][0] + 3 * a;
        along[a] = unit * (m[0] * way[0] + m[1] * way[1] + m[2] * way[2]);
        inverse[a] = along[a] != 0.0 ? 1.0 / along[a] : none;
    }
    const vd first = view.perspective ? size * (-view.depth / view.unit) : none - FAR;
    // As ``ray.inside``.
    auto inside = [&](const double* low, const double* high, const vd* from, vd& start, vd& end) {
        for (int a = 0; a < 3; ++a) {
            const vq moves = inverse[a] != 0.0;
            const vd t0 = (low[a] - from[a]) * inverse[a], t1 = (high[a] - from[a]) * inverse[a];
            const vd near = LESS(t0, t1), far = MORE(t0, t1);
            start = (moves & (near > start)) ? near : start;
            end = (moves & (far < end)) ? far : end;
            end = (~moves & ((from[a] < low[a]) | (from[a] > high[a]))) ? none - FAR : end;
        }
    };
    double low[3], high[3], closer_low[3], closer_high[3], seen_low[3], seen_high[3];
    for (int a = 0; a < 3; ++a) {
        low[a] = view.low[a];
        high[a] = view.high[a];
        seen_low[a] = view.seen_low[a];
        seen_high[a] = view.seen_high[a];
    }
    vd enter = first, leave = none + FAR;
    inside(low, high, anchor, enter, leave);
    for (int a = 0; a < 3; ++a) point[a] = MIN(MAX(anchor[a] + enter * along[a], none + low[a]), none + high[a]);
    if (view.grain > 0.0)
        for (int a = 0; a < 3; ++a) point[a] = view.grain * __builtin_elementwise_rint(point[a] / view.grain);
    vd start = none, stop = leave - enter;
    const vq meets = stop > 0.0;
    inside(seen_low, seen_high, point, start, stop);
    start = meets ? start : none;
    stop = meets ? stop : none;
    // As ``certified.make_edge``.
    vd steepest = none + 1.0, least = none + 1.0;
    for (int a = 0; a < 3; ++a) {
        const vd size = ABSD(inverse[a]);
        steepest = MORE(size, steepest);
        least = LESS(size, least);
    }
    vd off = 6.0 * most * e * steepest;
    const vq plain = (stop > start) & (least > 0.0) & (off < little);
    if (most > 0.0 && __builtin_reduce_and(plain) == 0) {
        bool thin = false;
        for (int a = 0; a < 3; ++a) {
            const bool from = seen_low[a] <= low[a], to = seen_high[a] >= high[a];
            low[a] = closer_low[a] = seen_low[a];
            high[a] = closer_high[a] = seen_high[a];
            if (from) low[a] -= e, closer_low[a] += e;
            if (to) high[a] += e, closer_high[a] -= e;
            thin |= closer_low[a] > closer_high[a];
        }
        vd begin = first - e, end = none + FAR, nearer = first + e, farther = none + FAR;
        inside(low, high, anchor, begin, end);
        inside(closer_low, closer_high, anchor, nearer, farther);
        const vd loose = end - begin - ((farther > nearer) & -(long long)!thin ? farther - nearer : none);
        const vd around = most * (loose + 0x1p-48 * (end - begin));
        off = plain ? off : end > begin ? around : none;
    }
    if (view.grain > 0.0)
        // As ``brick.owned``, and in the brick's coordinates.
        for (int a = 0; a < 3; ++a) {
            const vq moves = inverse[a] != 0.0;
            const vd t0 = (brick.low[a] - point[a]) * inverse[a], t1 = (brick.high[a] - point[a]) * inverse[a];
            const vd near = LESS(t0, t1), far = MORE(t0, t1);
            start = (moves & (near > start)) ? near : start;
            stop = (moves & (far < stop)) ? far : stop;
            stop = (~moves & ((point[a] < brick.low[a]) | (point[a] >= brick.high[a]))) ? none - FAR : stop;
            point[a] -= brick.offset[a];
        }
    const vd all[9] = {point[0], point[1], point[2], along[0], along[1], along[2], start, stop, none + clear};
    for (int l = 0; l < 8; ++l, line += lines.shape[1])
        for (int m = 0; m < 9; ++m) line[m] = all[m][l];
    *(vd*)(offs.data + 8 * b) = off;
}
"""


@wp.func_native(VECTORS + REACHES.replace("TILE", str(int(TILE))))
def reaches(
    view: View,
    brick: Brick,
    x: int,
    y: int,
    limits: wp.vec3d,
    lines: wp.array2d(dtype=wp.float64),
    offs: wp.array(dtype=wp.float64),
):
    """Of the rays of pixels from (x, y) on, a row of a tile: ``raycast.reach`` as ``lines`` (n, 10), and ``offs``, the
    bound of ``certified.make_edge``. ``limits`` are the transparency at which they end, and what ``most`` and
    ``little`` are to that. Where there is a grain, it is what the ``brick`` has of them.
    """
