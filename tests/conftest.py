"""What all tests share: the devices there are, and small scenes."""

import gc

import pytest
import warp as wp
from hypothesis import settings

import wvr
from wvr.launch import get_device

# On a busy machine what is slow is not wrong.
settings.register_profile("wvr", deadline=None)
settings.load_profile("wvr")

# What kernels are made of stays, and Python would look through all of it a thousand times: a twentieth of compiling.
gc.set_threshold(200_000, 20, 20)


def devices() -> list[str]:
    get_device()
    return [d.alias for d in wp.get_devices()]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A file of a few long tests first, so that no worker is left with it at the end."""
    items.sort(key=lambda item: item.path.name != "test_browser.py")


@pytest.fixture(params=devices())
def device(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def threads():
    """Sets the number of threads, and puts it back."""
    before = wvr.get_num_threads()
    yield wvr.set_num_threads
    wvr.set_num_threads(before)


@pytest.fixture
def smooth_tf() -> wvr.TransferFunction:
    """Colour and extinction that vary together over 0..1, without kinks inside."""
    return wvr.TransferFunction.from_arrays([0, 1], [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]], [0.1, 0.7])


@pytest.fixture
def blobs() -> wvr.Volume:
    return wvr.datasets.load("blobs", 32)
