"""What a budget leaves: bytes, and seconds by what work took so far."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from .reading import Reading


class Allowance:
    """Of one image, from now on.

    Parameters
    ----------
    reading
        With its budget; without one there is no end.
    clock
        Seconds.
    """

    def __init__(self, reading: Reading, clock: Callable[[], float] = perf_counter):
        self.seconds, self.bytes, self.clock = reading.seconds, reading.bytes, clock
        self.begun = clock()
        self._rates: dict[str, float] = {}

    @property
    def left(self) -> float | None:
        """Seconds; None where they are not counted."""
        return None if self.seconds is None else self.seconds - (self.clock() - self.begun)

    @contextmanager
    def work(self, what: str, amount: float = 1.0) -> Iterator[None]:
        """Measure what an amount of some work takes."""
        start = self.clock()
        yield
        rate = (self.clock() - start) / amount
        # A machine that others use gets slower at once; that it got faster is believed by and by.
        self._rates[what] = max(rate, 0.5 * (rate + self._rates.get(what, rate)))

    def expected(self, what: str, amount: float = 1.0) -> float:
        """Seconds that some work will take; 0 while nothing is known of such."""
        return amount * self._rates.get(what, 0.0)

    def ends(self, read: int, coming: float = 0.0) -> bool:
        """Whether so many bytes are all, or work that takes so many seconds no longer fits."""
        if self.bytes is not None and read >= self.bytes:
            return True
        return self.left is not None and self.left <= coming
