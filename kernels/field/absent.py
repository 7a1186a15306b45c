"""Rays that cross the face of an absent cell: where they do is known to rounding of their place over how steeply they
cross, so that nearly along it a length of them may be on either side (docs/proof.md, lemma 15).
"""

from functools import cache

import warp as wp

ZERO = wp.constant(wp.float64(0.0))
FAR = wp.constant(wp.float64(1.0e300))


@wp.func
def exact(proven: int, anchor: wp.float64, across: wp.float64):
    """Whether a ray is in a face to the last digit, where that is ``proven`` of those computed to be: it is then
    in the cell above (docs/proof.md).
    """
    return proven != 0 and across == ZERO and anchor == wp.rint(anchor)


@wp.func
def meets(a: wp.float64, b: wp.float64, e: wp.float64):
    """Whether there is a face between two places along an axis, or within e of them."""
    return wp.ceil(wp.min(a, b) - e) <= wp.floor(wp.max(a, b) + e)


@cache
def make_grazed(halves, outer=False):
    """``grazed(scene, anchor, p, d, start, stop, little)`` -> how long a ray from p along d, of this ``anchor``, may be
    on another side of faces between absent cells and others. What is not more than ``little`` is counted as if all
    faces were such. The ``outer`` faces of the grid may be such, as what is behind them is not known.
    """
    rim = 1 if outer else 0
    Scene = halves.Scene
    cubic = halves.field.cubic()

    @wp.func
    def absent(scene: Scene, cell: wp.vec3i):
        # Its last coefficient has all corners.
        way = wp.vec3d(wp.float64(0.5), wp.float64(0.25), wp.float64(0.125))
        return not wp.isfinite(cubic(scene.field, cell[0], cell[1], cell[2], way, way)[3])

    @wp.func
    def beside(scene: Scene, a: int, k: int, p: wp.vec3d, d: wp.vec3d, start: wp.float64, stop: wp.float64):
        """How much of a stretch is where one of the cells on both sides of face k along axis a is absent."""
        last = scene.field.last
        total = wp.float64(0.0)
        t = wp.float64(start)
        while t < stop:
            cell = wp.vec3i()
            next = wp.float64(stop)
            for b in range(3):
                if b != a:
                    at = int(wp.clamp(wp.floor(p[b] + t * d[b]), ZERO, wp.float64(last[b])))
                    # Along an axis that it does not move along it stays in its cell.
                    for _ in range(wp.where(d[b] != ZERO, 2, 0)):
                        # Where it is in a face to rounding, the cell behind that.
                        face = (wp.float64(wp.where(d[b] > ZERO, at + 1, at)) - p[b]) / d[b]
                        if face > t:
                            next = wp.min(next, face)
                        elif face <= t:
                            at = wp.clamp(at + wp.where(d[b] > ZERO, 1, -1), 0, last[b])
                    cell[b] = at
            cell[a] = k - 1
            below = absent(scene, cell)
            cell[a] = k
            if absent(scene, cell) != below:
                total += next - t
            t = next
        return total

    @wp.func
    def grazed(
        scene: Scene,
        anchor: wp.vec3d,
        p: wp.vec3d,
        d: wp.vec3d,
        start: wp.float64,
        stop: wp.float64,
        little: wp.float64,
    ):
        e = wp.float64(2.0) * scene.view.astray
        last = scene.field.last
        # How far along the ray a face may be from where it is crossed; all the way for a ray that is along it.
        wide = wp.vec3d()
        for a in range(3):
            across = wp.abs(d[a])
            if last[a] + rim > 0 and not exact(scene.proven[a], anchor[a], across):
                wide[a] = FAR
                if across > ZERO:
                    wide[a] = e / across
        total = wp.float64(0.0)
        for a in range(3):
            every = wp.float64(2.0) * (wide[a] + e * (stop - start))
            if wide[a] == ZERO or every <= little:
                total += wp.where(wide[a] > ZERO, every, ZERO)
            else:
                from_ = p[a] + start * d[a]
                to = p[a] + stop * d[a]
                first = wp.max(int(wp.ceil(wp.min(from_, to) - e)), 1 - rim)
                beyond = wp.min(int(wp.floor(wp.max(from_, to) + e)), last[a] + rim) + 1
                for k in range(first, beyond):
                    begin = wp.float64(start)
                    end = wp.float64(stop)
                    if wide[a] < FAR:
                        middle = (wp.float64(k) - p[a]) / d[a]
                        begin = wp.max(start, middle - wide[a])
                        end = wp.min(stop, middle + wide[a])
                    if end > begin:
                        edge = bool(False)
                        for b in range(3):
                            along = b != a and wide[b] > little
                            edge = edge or (along and meets(p[b] + begin * d[b], p[b] + end * d[b], e))
                        # Nearly along an edge nothing is looked at.
                        length = end - begin
                        if not edge and k > 0 and k <= last[a]:
                            length = beside(scene, a, k, p, d, begin, end)
                        total += length
        return total

    return grazed
