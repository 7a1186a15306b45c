"""Cubics whose coefficients are balls, and where on an interval they may cross a level.

A ball (``flint.arb``) is a number and a radius; whatever is computed of balls has in it what is computed of any numbers
in them. Nothing here decides what it cannot: a place where something may change is a :class:`Break`, an interval, and
outside of all breaks everything is as it is anywhere between the same two.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from flint import arb, ctx


class Cubic(NamedTuple):
    """Its coefficients, constant first. Not ``smooth`` where what is meant is no cubic but, anywhere, within the radius
    of the constant of one: it reaches a level where a cubic does that differs by a constant, but more than once there.
    """

    a: arb
    b: arb
    c: arb
    d: arb
    smooth: bool = True


class Break(NamedTuple):
    """Where something may change, from ``low`` to ``high``, both exact; ``once``: at one place in there at most."""

    low: arb
    high: arb
    once: bool = True

    @property
    def ball(self) -> arb:
        return self.low.union(self.high)


class Gap(NamedTuple):
    """What is between two breaks: from somewhere in ``start`` to somewhere in ``end``, with ``middle`` inside."""

    start: arb
    end: arb
    middle: arb

    @property
    def ball(self) -> arb:
        return self.start.union(self.end)

    @property
    def length(self) -> arb:
        return self.end - self.start


def break_of(ball: arb, once: bool = True) -> Break:
    """A change somewhere in a ball."""
    return Break(ball.lower(), ball.upper(), once)


def parts(breaks: Iterable[Break]) -> Iterator[Break | Gap]:
    """Breaks in order, those that overlap as one that is not ``once``, and the gaps between them."""
    held: Break | None = None
    for one in sorted(breaks, key=lambda one: one.low):
        if held is None:
            held = one
        elif one.low <= held.high:
            held = Break(held.low, held.high if held.high >= one.high else one.high, False)
        elif not held.high < (between := middle(held.high, one.low)) < one.low:
            # There is no number between them at this precision.
            held = Break(held.low, one.high, False)
        else:
            yield held
            yield Gap(held.ball, one.ball, between)
            held = one
    if held is not None:
        yield held


def middle(low: arb, high: arb) -> arb:
    """An exact number between two."""
    return ((low + high) / 2).mid()


def within(size: arb) -> arb:
    """All numbers up to a size, of either sign."""
    return arb(0, size.upper())


def lerp(low: Sequence[arb], high: Sequence[arb], place: arb, speed: arb) -> list[arb]:
    """``low + (place + speed u) (high - low)``, of polynomials in u of the same degree."""
    change = [b - a for a, b in zip(low, high, strict=True)]
    result = [a + place * d for a, d in zip(low, change, strict=True)] + [arb(0)]
    for n, d in enumerate(change):
        result[n + 1] += speed * d
    return result


def moved(c: Cubic, u: arb) -> Cubic:
    """The cubic about ``u``: its value at h is that of ``c`` at u + h."""
    three = 3 * u * c.d
    return Cubic(c.a + u * (c.b + u * (c.c + u * c.d)), c.b + u * (2 * c.c + three), c.c + three, c.d, c.smooth)


def value(c: Cubic, low: arb, high: arb) -> arb:
    """What the cubic is between two places."""
    m = middle(low, high)
    r = (high - m).max(m - low).upper()
    s = moved(c, m)
    return s.a + within(_spread(s, r))


def _spread(s: Cubic, r: arb) -> arb:
    """How far the cubic is from its value at 0, up to r away."""
    return r * (abs(s.b) + r * (abs(s.c) + r * abs(s.d)))


def _slope(s: Cubic, r: arb) -> arb:
    """Its slope up to r away."""
    return s.b + within(r * (2 * abs(s.c) + 3 * r * abs(s.d)))


def zeros(c: Cubic, levels: Sequence[arb], low: arb, high: arb, least: arb) -> list[Break]:
    """Where a cubic may cross any of the levels on [low, high], to ``least`` where it only just touches one."""
    found: list[Break] = []
    if c.a.is_exact() and c.b.is_zero() and c.c.is_zero() and c.d.is_zero():
        return found
    todo = [(low, high, levels)]
    while todo:
        a, b, levels = todo.pop()
        m = middle(a, b)
        r = (b - m).max(m - a).upper()
        s = moved(c, m)
        spread = _spread(s, r)
        here = s.a + within(spread)
        levels = [level for level in levels if here.overlaps(level)]
        if not levels:
            continue
        slope = _slope(s, r)
        if not slope.contains(0):
            found += [one for level in levels if (one := _only(c, slope, level, a, b)) is not None]
        elif b - a <= least or not spread > 4 * s.a.rad():
            # The second where no part of it is known better.
            found.append(Break(a, b, False))
        else:
            todo += [(a, m, levels), (m, b, levels)]
    return found


def _only(c: Cubic, slope: arb, level: arb, low: arb, high: arb) -> Break | None:
    """The one place where a cubic of a slope that is nowhere zero may be at a level: Newton's method for intervals."""
    enough = (high - low) * arb(2) ** -ctx.prec  # numbers next to 0 may be halved for ever
    while True:
        m = middle(low, high)
        off = moved(c, m).a - level
        root = m - off / slope
        if root.lower() > high or root.upper() < low:
            return None
        a = root.lower() if root.lower() > low else low
        b = root.upper() if root.upper() < high else high
        stuck = not 2 * (b - a) < high - low
        if b - a < enough or (stuck and (off.contains(0) or not low < m < high)):
            return Break(a, b, c.smooth)
        if stuck:
            # The slope is not known well enough, but the half is.
            a, b = (a, m) if (off > 0) == (slope > 0) else (m, b)
        low, high = a, b
        m = middle(low, high)
        narrower = _slope(moved(c, m), (high - m).max(m - low).upper())
        slope = slope if narrower.contains(0) else narrower
