"""The progressive loop, with painters that take no time worth measuring."""

from __future__ import annotations

import random
import threading
import time
from collections import namedtuple

import pytest

import wvr
from wvr.viewer.loop import Loop

Shown = namedtuple("Shown", "number state stage newest")


class Painter:
    """Three stages of nothing; each asks now and then whether it is cancelled, as launches do."""

    def __init__(self, seconds=(2e-4, 4e-4, 8e-4)):
        self.seconds = seconds
        self.begun: list[tuple[int, int]] = []
        self.running = 0
        self.fail = None

    def stages(self, state):
        return range(3)

    def paint(self, state, stage, cancel):
        self.running += 1
        self.begun.append((state, stage))
        try:
            if self.fail is not None:
                raise self.fail
            end = time.monotonic() + self.seconds[stage]
            while time.monotonic() < end:
                if cancel.is_set():
                    raise wvr.Cancelled("cancel was set")
                time.sleep(min(self.seconds[stage] / 4, 0.005))
            return state, stage
        finally:
            self.running -= 1


class Screen:
    """What was shown, with the newest state there was at that time."""

    def __init__(self, painter):
        self.seen: list[Shown] = []
        self.errors: list[Exception] = []
        self.loop = Loop(-1, painter, self.show)
        self.loop.change(lambda state: 0)

    def show(self, number, picture):
        if isinstance(picture, Exception):
            self.errors.append(picture)
        else:
            self.seen.append(Shown(number, *picture, self.loop.state))


def test_no_stale_frame_over_ten_thousand_events():
    """In order, refinements only of the newest state, coarse ones of that at their beginning; the last one to the end.

    Events come in bursts from two threads, with pauses from none to longer than all stages.
    """
    painter = Painter()
    screen = Screen(painter)
    loop, count = screen.loop, 5_000

    def storm(seed):
        rng = random.Random(seed)
        for _ in range(count):
            loop.change(lambda state: state + 1)
            if rng.random() < 0.2:
                time.sleep(rng.choice([0, 1e-4, 5e-4]) if rng.random() < 0.97 else 3e-3)

    threads = [threading.Thread(target=storm, args=(seed,)) for seed in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert loop.settle(20)
    loop.close()
    seen = screen.seen
    assert loop.state == 2 * count
    assert [one.state for one in seen] == sorted(one.state for one in seen)
    assert all(one.state == one.newest for one in seen if one.stage > 0), "a refinement of an old state"
    order = [(one.state, one.stage) for one in seen]
    assert order == sorted(set(order))
    # None was begun of a state when a newer one had been shown or begun.
    assert painter.begun == sorted(painter.begun)
    assert order[-3:] == [(2 * count, 0), (2 * count, 1), (2 * count, 2)]
    assert len({one.state for one in seen}) > 100, "the picture stood still"


def test_pictures_go_on_while_events_come_faster_than_they():
    """As of a mouse that never rests: coarse ones all the time, and no other."""
    painter = Painter((5e-3, 5e-3, 5e-3))
    screen = Screen(painter)
    end = time.monotonic() + 0.3
    while time.monotonic() < end:
        screen.loop.change(lambda state: state + 1)
        time.sleep(5e-4)
    during = list(screen.seen)
    screen.loop.close()
    assert len(during) > 5
    assert max(one.stage for one in during[3:]) == 0


def test_an_event_ends_a_refinement():
    """At its next look at the cancel, not at its end, which would be in a minute."""
    painter = Painter((1e-3, 60.0, 1e-3))
    screen = Screen(painter)
    deadline = time.monotonic() + 10
    while (0, 1) not in painter.begun and time.monotonic() < deadline:
        time.sleep(1e-3)
    painter.seconds = (1e-3, 1e-3, 1e-3)
    screen.loop.change(lambda state: 1)
    assert screen.loop.settle(20)
    assert (0, 1) not in [one[1:3] for one in screen.seen]
    screen.loop.close()


def test_closing_leaves_nothing_running_and_shows_nothing_more():
    painter = Painter((0.02, 0.02, 0.02))
    screen = Screen(painter)
    screen.loop.change(lambda state: 1)
    screen.loop.close()
    seen = len(screen.seen)
    assert painter.running == 0 and not screen.loop._thread.is_alive()
    screen.loop.change(lambda state: 2)
    time.sleep(0.05)
    assert len(screen.seen) == seen
    assert not screen.loop.settle(0.01)
    screen.loop.close()


def test_an_error_is_shown_and_the_next_state_is_painted():
    painter = Painter()
    screen = Screen(painter)
    assert screen.loop.settle(5)
    painter.fail = MemoryError("no room")
    screen.loop.change(lambda state: 1)
    assert screen.loop.settle(5)
    assert [str(error) for error in screen.errors] == ["no room"]
    painter.fail = None
    screen.loop.change(lambda state: 2)
    assert screen.loop.settle(5) and screen.seen[-1][1:3] == (2, 2)
    screen.loop.close()


def test_an_event_that_changes_nothing_paints_nothing():
    painter = Painter()
    screen = Screen(painter)
    assert screen.loop.settle(5)
    assert screen.loop.change(lambda state: state) == 1
    assert len(painter.begun) == 3
    screen.loop.close()


@pytest.mark.parametrize("callers", [1, 3])
def test_it_may_be_closed_by_several(callers):
    screen = Screen(Painter())
    threads = [threading.Thread(target=screen.loop.close) for _ in range(callers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(5)
    assert not any(thread.is_alive() for thread in threads)
