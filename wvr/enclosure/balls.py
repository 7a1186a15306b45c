"""Cubics whose coefficients are balls, and where on an interval they may cross a level.

A ball (``flint.arb``) is a number and a radius; whatever is computed of balls has in it what is computed of any numbers
in them. Nothing here decides what it cannot: a place where something may change is a :class:`Break`, an interval, and
outside of all breaks everything is as it is anywhere between the same two.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from flint import arb

# Constant first.
Cubic = tuple[arb, arb, arb, arb]


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
        else:
            yield held
            yield Gap(held.ball, one.ball, middle(held.high, one.low))
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
    a, b, d, e = c
    return a + u * (b + u * (d + u * e)), b + u * (2 * d + 3 * u * e), d + 3 * u * e, e


def value(c: Cubic, low: arb, high: arb) -> arb:
    """What the cubic is between two places."""
    m = middle(low, high)
    r = (high - m).max(m - low).upper()
    s = moved(c, m)
    return s[0] + within(r * (abs(s[1]) + r * (abs(s[2]) + r * abs(s[3]))))


def zeros(c: Cubic, levels: Sequence[arb], low: arb, high: arb, least: arb) -> list[Break]:
    """Where a cubic may cross any of the levels on [low, high], to ``least`` where it only just touches one."""
    found: list[Break] = []
    if c[0].is_exact() and all(term.is_zero() for term in c[1:]):
        return found
    todo = [(low, high, levels)]
    while todo:
        a, b, levels = todo.pop()
        m = middle(a, b)
        r = (b - m).max(m - a).upper()
        s = moved(c, m)
        spread = (r * (abs(s[1]) + r * (abs(s[2]) + r * abs(s[3])))).upper()
        here = s[0] + within(spread)
        levels = [level for level in levels if here.overlaps(level)]
        if not levels:
            continue
        slope = s[1] + within(r * (2 * abs(s[2]) + 3 * r * abs(s[3])))
        if not slope.contains(0):
            found += [one for level in levels if (one := _only(c, slope, level, a, b)) is not None]
        elif b - a <= least or spread <= 4 * s[0].rad():
            # The second where no part of it is known better.
            found.append(Break(a, b, False))
        else:
            todo += [(a, m, levels), (m, b, levels)]
    return found


def _only(c: Cubic, slope: arb, level: arb, low: arb, high: arb) -> Break | None:
    """The one place where a cubic of a slope that is nowhere zero may be at a level, by Newton's method of intervals."""
    while True:
        m = middle(low, high)
        root = m - (moved(c, m)[0] - level) / slope
        if root.lower() > high or root.upper() < low:
            return None
        a = root.lower() if root.lower() > low else low
        b = root.upper() if root.upper() < high else high
        if not 2 * (b - a) < high - low:
            return Break(a, b)
        low, high = a, b
        r = (high - m).max(m - low).upper()
        s = moved(c, middle(low, high))
        narrower = s[1] + within(r * (2 * abs(s[2]) + 3 * r * abs(s[3])))
        slope = slope if narrower.contains(0) else narrower
