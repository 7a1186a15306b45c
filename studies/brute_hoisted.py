"""Brute-force pre-integration whose inner loop only composes: what the paper's baseline could have been."""
# mypy: ignore-errors

import warp as wp

from wvr.kernels.segment import over
from wvr.kernels.transfer.preintegration import make_pieces
from wvr.launch import launch
from wvr.transfer.running import Cut


def make_hoisted():
    """Brute force with the opacity correction taken out of its inner loop: once an interval and entry length."""
    Pieces, elementary = make_pieces(wp.float32)

    @wp.kernel(enable_backward=False, module="unique")
    def brute(
        base: int,
        pieces: Pieces,
        length: float,
        up: wp.array2d(dtype=wp.vec4d),
        down: wp.array2d(dtype=wp.vec4d),
        table: wp.array2d(dtype=wp.vec4),
    ):
        # All entries of r intervals; the work of r and of n - r together is about the same.
        item = wp.tid() + base
        n = table.shape[0]
        r = wp.where(item % 2 == 0, 1 + item // 2, n - 1 - item // 2)
        for k in range(n - 1):
            u = wp.vec4d()
            d = wp.vec4d()
            for p in range(pieces.first[k], pieces.first[k + 1]):
                a, b, _ma, _mb = elementary(pieces, p, length / float(r))
                u = over(u, a)
                d = over(b, d)
            up[item, k] = u
            down[item, k] = d
        for i in range(n - r):
            u = wp.vec4d()
            d = wp.vec4d()
            for k in range(i, i + r):
                u = over(u, up[item, k])
                d = over(down[item, k], d)
            table[i, i + r] = wp.vec4(float(u[0]), float(u[1]), float(u[2]), float(u[3]))
            table[i + r, i] = wp.vec4(float(d[0]), float(d[1]), float(d[2]), float(d[3]))

    return brute


def build_hoisted(brute, cut: Cut, device: wp.Device) -> wp.array:
    """The table by :func:`make_hoisted`, without its diagonal; one launch."""
    n = cut.n
    pieces = cut.pieces(cut.colors(None), wp.float32, device)
    up, down = (wp.empty((n - 1, n - 1), dtype=wp.vec4d, device=device) for _ in range(2))
    table = wp.zeros((n, n), dtype=wp.vec4, device=device)
    launch(brute, n - 1, [pieces, 1.0, up, down, table], device, grain=1)
    return table
