"""How many pixels the first picture after an event has, from what pictures took before."""

from __future__ import annotations

# Seconds that a first picture may take: with what it takes to send and draw it, 20 of them a second.
BUDGET = 0.035
# A picture of one pixel for each k by k is one of these; a smaller k has to fit with so much to spare.
DIVISORS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16)
SPARE = 0.7
# Pixels that a side has at least.
LEAST = 32
# A final picture that takes so many seconds has none before it but the first.
AT_ONCE = 0.25


class Pace:
    """Seconds a pixel, of first pictures and of final ones, as they were measured last.

    Attributes
    ----------
    divisor
        Of the first pictures: one of their pixels is so many wide and high.
    """

    def __init__(self) -> None:
        self.divisor = 8
        self._coarse: float | None = None
        self._fine: float | None = None

    def took(self, seconds: float, pixels: int, coarse: bool) -> None:
        """A picture of so many pixels took so long; what is new counts as much as all before."""
        now = seconds / pixels
        if coarse:
            self._coarse = now if self._coarse is None else (self._coarse + now) / 2
        else:
            self._fine = now if self._fine is None else (self._fine + now) / 2

    def first(self, size: tuple[int, int]) -> int:
        """The divisor of the first picture of an image of a size."""
        accepted = [k for k in DIVISORS if k == 1 or min(shrunk(size, k)) >= LEAST]
        if self._coarse is not None:
            self.divisor = next((k for k in accepted if self._fits(size, k)), accepted[-1])
        self.divisor = min(self.divisor, accepted[-1])
        return self.divisor

    def _fits(self, size: tuple[int, int], k: int) -> bool:
        width, height = shrunk(size, k)
        assert self._coarse is not None
        return self._coarse * width * height <= BUDGET * (1.0 if k >= self.divisor else SPARE)

    def refinements(self, size: tuple[int, int]) -> list[int]:
        """Divisors of the pictures after the first; the last is 1."""
        if self._fine is not None and self._fine * size[0] * size[1] < AT_ONCE:
            return [1]
        return [*(k for k in (4, 2) if k < self.divisor and min(shrunk(size, k)) >= LEAST), 1]


def shrunk(size: tuple[int, int], k: int) -> tuple[int, int]:
    """The size of a picture with one pixel for each k by k, at least one."""
    return -(-size[0] // k), -(-size[1] // k)
