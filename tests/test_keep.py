"""Kept parts: built once for what they are, let go of when nothing asks for them, in memory that is used again."""

from dataclasses import dataclass
from typing import ClassVar

import pytest
import warp as wp

from wvr import keep
from wvr.keep import Keeper, Part
from wvr.launch import get_device


@dataclass(frozen=True)
class Numbers(Part):
    n: int
    size: int = 1000
    name: ClassVar[str] = "numbers"

    def build(self, keep: Keeper) -> wp.array:
        return keep.empty((self.size,), wp.float64)


@dataclass(frozen=True)
class Sum(Part):
    parts: tuple[Part, ...]
    name: ClassVar[str] = "sum"

    def build(self, keep: Keeper) -> list[wp.array]:
        return [keep(part) for part in self.parts]


@dataclass(frozen=True)
class Broken(Part):
    name: ClassVar[str] = "broken"

    def build(self, keep: Keeper) -> None:
        keep(Numbers(1))
        keep.empty((5,), wp.float64)
        raise ValueError("no")


@pytest.fixture
def keeper(device) -> Keeper:
    return Keeper(get_device(device))


def test_equal_parts_are_built_once(keeper):
    assert keeper(Numbers(1)) is keeper(Numbers(1)) and keeper(Numbers(1)) is not keeper(Numbers(2))
    keeper.end_of_frame()
    one = keeper(Numbers(1))
    assert keeper(Sum((Numbers(1), Numbers(3))))[0] is one
    assert keeper.builds == {"numbers": 3, "sum": 1}


def test_of_a_name_those_stay_that_a_frame_asked_for(keeper):
    for n in (1, 2, 3):
        keeper(Numbers(n))
        keeper.end_of_frame()
    keeper(Numbers(3))
    assert keeper.builds == {"numbers": 3}
    keeper(Numbers(2))
    assert keeper.builds == {"numbers": 4}


def test_what_a_part_was_built_from_stays_with_it(keeper):
    """Others may be built from it, without that anything is built twice."""
    parts = keeper(Sum((Sum((Numbers(1),)),)))
    for n in (2, 3):
        keeper.end_of_frame()
        assert keeper(Sum((Sum((Numbers(1),)),))) is parts
        keeper(Numbers(n))
    keeper.end_of_frame()
    assert keeper(Sum((Numbers(1), Numbers(3))))[0] is parts[0][0]
    assert keeper.builds == {"numbers": 3, "sum": 3}


def test_other_names_stay_while_there_is_room(keeper, monkeypatch):
    keeper(Numbers(1))
    keeper.end_of_frame()
    for _ in range(3):
        keeper(Sum(()))
        keeper.end_of_frame()
    keeper(Numbers(1))
    assert keeper.builds["numbers"] == 1
    keeper.end_of_frame()
    monkeypatch.setattr(keep, "SPARE", 100)
    keeper(Sum(()))
    keeper.end_of_frame()
    keeper(Numbers(1))
    assert keeper.builds["numbers"] == 2


def test_arrays_of_what_is_let_go_are_written_again(keeper):
    places = []
    for n in range(5):
        places.append(keeper(Numbers(n)).ptr)
        keeper.end_of_frame()
    # The one before is still there while one is built.
    assert places[0] != places[1] and places == [places[n % 2] for n in range(5)]
    assert keeper(Numbers(9, size=999)).ptr not in places


def test_an_error_leaves_nothing_half_built(keeper):
    for _ in range(3):
        with pytest.raises(ValueError, match="no"):
            keeper(Broken())
        keeper.end_of_frame()
    assert keeper.builds == {"numbers": 1} and not keeper._arrays.keys() - {Numbers(1)} and len(keeper._free) == 1
    assert keeper(Numbers(2)) is not keeper(Numbers(1))


def test_scratch_is_one_array_of_a_name(keeper):
    one = keeper.scratch("light", (3, 4), wp.float32)
    assert keeper.scratch("light", (3, 4), wp.float32) is one and keeper.scratch("rest", (3, 4), wp.float32) is not one
    assert keeper.scratch("light", (4, 3), wp.float32).shape == (4, 3)
