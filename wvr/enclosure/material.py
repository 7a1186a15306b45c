"""What a ray sees of a transfer function, in balls: segments, their composition, and the integral along a cubic.

Between two control points extinction and colour are linear in the scalar, so that with ``v`` from 0 at one to 1 at the
other, a cubic of the ray's length, a piece of optical depth X and opacity ``A = 1 - exp(-X)`` has the colour
``c0 A + (c1 - c0) J``, ``J = int v exp(-D) dD``. About the middle of the depth, ``y = D - X / 2``,

    J = exp(-X / 2) (int v q sum_{k < K} (-y)^k / k! dx + R),  |R| <= X exp(X / 2) (X / 2)^K / K!,

q the extinction: a polynomial, integrated as one. R is that since v is from 0 to 1, q integrates to X, and y is from
-X / 2 to X / 2, where the series of exp(-y) lacks ``exp(X / 2) (X / 2)^K / K!`` at most.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from typing import NamedTuple

from flint import arb, arb_poly, ctx

from ..transfer_function import TransferFunction
from .balls import Break, Cubic, Gap, break_of, moved, parts, value, within, zeros

# Opacity 1 stands for this: see the model.
MOST = 1 - 2.0**-24
# Optical depth of which the series is taken; what is deeper is halved.
DEEP = 2
SHARE = arb(0.5, 0.5)
HALF = arb(0.5)


class Segment(NamedTuple):
    """Premultiplied colour, and transparency."""

    color: tuple[arb, arb, arb]
    clear: arb


class Span(NamedTuple):
    """All extinctions and colours that there may be."""

    extinction: arb
    color: tuple[arb, arb, arb]

    def union(self, other: Span) -> Span:
        r, g, b = (one.union(two) for one, two in zip(self.color, other.color, strict=True))
        return Span(self.extinction.union(other.extinction), (r, g, b))

    def along(self, length: arb) -> Segment:
        """A segment of a length of which nothing else is known."""
        return self.within((self.extinction * length).nonnegative_part())

    def within(self, depth: arb) -> Segment:
        """The same by its optical depth."""
        return self._of(-(-depth).expm1(), (-depth).exp())

    def anyhow(self) -> Segment:
        """Of any depth."""
        return self._of(SHARE, SHARE)

    def _of(self, opacity: arb, clear: arb) -> Segment:
        r, g, b = (c * opacity for c in self.color)
        return Segment((r, g, b), clear)


CLEAR = Segment((arb(0), arb(0), arb(0)), arb(1))
NOTHING = Span(arb(0), (arb(0), arb(0), arb(0)))


def over(front: Segment, back: Segment) -> Segment:
    r, g, b = (one + front.clear * two for one, two in zip(front.color, back.color, strict=True))
    return Segment((r, g, b), front.clear * back.clear)


class Material:
    """A transfer function, its extinction per world length; ``smallest`` is the smallest spacing of samples.

    Interval k is that of scalars with k control points at or below them.
    """

    def __init__(self, tf: TransferFunction, smallest: arb):
        unit = smallest if tf.unit_distance is None else arb(tf.unit_distance)
        self.knots = [arb(knot) for knot in tf.knots.tolist()]
        points = []
        for opacity, (r, g, b) in zip(tf.opacities.tolist(), tf.colors.tolist(), strict=True):
            points.append(Span(-(-arb(min(opacity, MOST))).log1p() / unit, (arb(r), arb(g), arb(b))))
        # At both ends of each interval.
        self.ends = list(zip([points[0], *points], [*points, points[-1]], strict=True))
        self.seen = [not all(end.extinction.is_zero() for end in ends) for ends in self.ends]
        self.whole = union(points)

    def interval(self, s: arb) -> int | None:
        """The interval that a scalar is in, if it can be told."""
        k = bisect_right(self.knots, s.lower())
        return k if bisect_right(self.knots, s.upper()) == k else None

    def transparent(self, low: float, high: float) -> bool:
        """Whether nothing is seen of scalars from low to high."""
        return not any(self.seen[bisect_right(self.knots, arb(low)) : bisect_right(self.knots, arb(high)) + 1])

    def span(self, s: arb) -> Span:
        """All that there is at the scalars of a ball."""
        first, last = bisect_right(self.knots, s.lower()), bisect_right(self.knots, s.upper())
        if first == last:
            return self._at(first, s)
        between = [one for k in range(first, last) for one in (self.ends[k][1], self.ends[k + 1][0])]
        return union([self._at(first, s.lower()), *between, self._at(last, s.upper())])

    def _at(self, k: int, s: arb) -> Span:
        """Interpolated in an interval."""
        low, high = self.ends[k]
        if k in (0, len(self.knots)):
            return low
        v = (s - self.knots[k - 1]) / (self.knots[k] - self.knots[k - 1])
        r, g, b = (one + v * (two - one) for one, two in zip(low.color, high.color, strict=True))
        return Span(low.extinction + v * (high.extinction - low.extinction), (r, g, b))

    def segment(self, c: Cubic, start: arb, end: arb) -> Segment:
        """Of a scalar that is a cubic, from somewhere in a ball to somewhere in another."""
        low, high = start.lower(), end.upper()
        s = value(c, low, high)
        k = self.interval(s)
        if k is not None:
            return self._piece(c, start, end, k)
        first, last = bisect_right(self.knots, s.lower()), bisect_right(self.knots, s.upper())
        levels = sorted(set(self.knots[first:last]))
        least = (high - low) * small()
        result = CLEAR
        for part in parts([break_of(start), *zeros(c, levels, low, high, least), break_of(end)]):
            result = over(result, self._part(c, part))
        return result

    def _part(self, c: Cubic, part: Break | Gap) -> Segment:
        if isinstance(part, Break):
            if part.once:
                return CLEAR
            return self.span(value(c, part.low, part.high)).along((part.high - part.low) * SHARE)
        k = self.interval(moved(c, part.middle).a)
        if k is None:
            ball = part.ball
            return self.span(value(c, ball.lower(), ball.upper())).along(part.length)
        return self._piece(c, part.start, part.end, k)

    def _piece(self, c: Cubic, start: arb, end: arb, k: int) -> Segment:
        """Of a stretch in one interval."""
        if not self.seen[k]:
            return CLEAR
        low, high = self.ends[k]
        if k in (0, len(self.knots)):
            return low.along(end - start)
        width = self.knots[k] - self.knots[k - 1]
        about = moved(c, (start + end) / 2)
        r = (end - start) / 2
        # On [-1, 1].
        v = arb_poly([(about[0] - self.knots[k - 1]) / width, *(about[n] * r**n / width for n in (1, 2, 3))])
        q = r * (low.extinction + (high.extinction - low.extinction) * v)
        return Piece(low, high, v, q).segment()


def union(spans: Iterable[Span]) -> Span:
    first, *rest = spans
    for one in rest:
        first = first.union(one)
    return first


class Piece(NamedTuple):
    """Between the values at two control points: ``v`` from 0 to 1, the share of the second, and ``q``, extinction times
    length, polynomials on [-1, 1].
    """

    low: Span
    high: Span
    v: arb_poly
    q: arb_poly

    def segment(self) -> Segment:
        depth = self.q.integral()
        front, back = depth(arb(-1)), depth(arb(1))
        X = (back - front).nonnegative_part()
        between = self.low.union(self.high)
        if not X.is_finite():
            return between.anyhow()
        if X.rad() > 1:
            return between.within(X)
        if X > DEEP:
            near, far = (Piece(self.low, self.high, self.v(half), self.q(half) * HALF) for half in HALVES)
            front_one = near.segment()
            return over(front_one, between.anyhow() if front_one.clear < small() else far.segment())
        A = -(-X).expm1()
        J = self._moment(depth - (front + back) / 2, X).intersection(A * SHARE)
        r, g, b = (one * A + (two - one) * J for one, two in zip(self.low.color, self.high.color, strict=True))
        return Segment((r, g, b), (-X).exp())

    def _moment(self, y: arb_poly, X: arb) -> arb:
        """J."""
        if all(one == two for one, two in zip(self.low.color, self.high.color, strict=True)):
            return arb(0, 1)  # not needed
        h = X.upper() / 2
        K, rest = 1, h
        while not 2 * rest < small():
            K += 1
            rest = rest * h / K
        series = arb_poly([1])
        for n in range(K - 1, 0, -1):
            series = 1 - y * series * (arb(1) / n)
        total = (self.v * self.q * series).integral()
        return (-X / 2).exp() * (total(arb(1)) - total(arb(-1)) + within(2 * h * rest * h.exp()))


HALVES = [arb_poly([-0.5, 0.5]), arb_poly([0.5, 0.5])]


def small() -> arb:
    """What does not matter beside 1, at the precision that there is."""
    return arb(2) ** (-ctx.prec // 3)
