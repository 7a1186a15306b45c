"""Classic scans and simulations, which are downloaded once."""

from __future__ import annotations

import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..io import read_raw
from ..validation import choice, path_of
from ..volume import Volume

URL = "https://klacansky.com/open-scivis-datasets"
# How long nothing may come [s], how long a download may take whatever its size [s], and how slow it may be [bytes/s].
STALL = 30
PATIENCE = 120.0
SLOWEST = 50_000


class Download(NamedTuple):
    """A file of the Open SciVis Datasets: samples x fastest, little endian."""

    identifier: str
    dimensions: tuple[int, int, int]
    dtype: str
    spacing: tuple[float, float, float]
    sha512: str  # as the site publishes it
    verified: bool = False  # whether the sum was seen to be that of the real file; only then it is insisted on

    @property
    def file(self) -> str:
        """Path below the site's address, and below the cache."""
        nx, ny, nz = self.dimensions
        return f"{self.identifier}/{self.identifier}_{nx}x{ny}x{nz}_{self.dtype}.raw"

    @property
    def bytes(self) -> int:
        """Size of the file."""
        return int(np.prod(self.dimensions)) * np.dtype(self.dtype).itemsize


def fetch(name: str, cache: str | os.PathLike[str] | None = None) -> Volume:
    """A downloaded volume: from the cache, or the network the first time.

    Parameters
    ----------
    name
        One of ``DOWNLOADS``.
    cache
        Folder to keep files in; by default ``WVR_CACHE`` or the user's cache folder.

    Returns
    -------
    Volume
        Memory-mapped. Only a file of the right size and, where that is verified, SHA-512 sum stays in the cache.

    Warns
    -----
    UserWarning
        Where the published checksum was never verified: whether the file has it.

    Raises
    ------
    ValueError
        For an unknown name.
    OSError
        When the download fails or brings something else; the message says where to put the file by hand.
    """
    import pooch

    entry = DOWNLOADS[choice(name, "name", list(DOWNLOADS))]
    folder = path_of(cache or os.environ.get("WVR_CACHE") or pooch.os_cache("wvr"), "cache")
    url = f"{os.environ.get('WVR_DATASETS_URL', URL).rstrip('/')}/{entry.file}"

    def download(url: str, output: str, _: Any) -> None:
        _download(url, Path(output), entry.bytes, _Progress(name, entry.bytes))

    try:
        # Pooch downloads beside the file and moves it there once size and sum are right.
        known = f"sha512:{entry.sha512}" if entry.verified else None
        path = pooch.retrieve(url, known, entry.file, folder, downloader=download)
    except (OSError, ValueError) as error:
        raise OSError(
            f"could not download {name!r} from {url}: {error}; if you have the file, put it at {folder / entry.file} "
            f"(SHA-512 {entry.sha512}), or read another version with wvr.read_raw"
        ) from error
    if not entry.verified:
        same = pooch.file_hash(path, "sha512") == entry.sha512
        warnings.warn(
            f"the checksum of {name!r} is unverified: the published one, {entry.sha512[:16]}..., was never compared "
            f"with a real download; this file's is {'the same' if same else 'another'}",
            stacklevel=2,
        )
    return read_raw(path, entry.dimensions[::-1], entry.dtype, entry.spacing)


def _download(url: str, output: Path, size: int, progress: _Progress) -> None:
    """A file of a size that is known, in a time that such a size takes at most."""
    import requests
    from urllib3.exceptions import HTTPError

    end = time.monotonic() + PATIENCE + size / SLOWEST
    try:
        with requests.get(url, stream=True, timeout=STALL) as response, output.open("wb") as file:
            response.raise_for_status()
            # What has come, however little: read() waits for as much as is asked for.
            while part := response.raw.read1(2**16, decode_content=True):
                progress.update(len(part))
                file.write(part)
                if progress.done > size:
                    break
                if time.monotonic() > end:
                    raise TimeoutError(f"{progress.done} of {size} bytes came in {PATIENCE + size / SLOWEST:.0f} s")
    except HTTPError as error:
        raise OSError(str(error)) from error
    finally:
        progress.close()
    if progress.done != size:
        raise ValueError(f"{progress.done} bytes came, {size} are expected")


class _Progress:
    """A Rich bar, if it takes more than two seconds and someone is watching."""

    def __init__(self, name: str, total: int):
        self.name = name
        self.total = total
        self.done = 0
        self.start = time.monotonic()
        self.bar: Any = None

    def update(self, count: int) -> None:
        self.done += count
        if self.bar is None and time.monotonic() - self.start > 2 and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

            columns = (TextColumn(self.name), BarColumn(), DownloadColumn(), TransferSpeedColumn())
            self.bar = Progress(*columns, console=Console(stderr=True))
            self.task = self.bar.add_task(self.name, total=self.total)
            self.bar.start()
        if self.bar is not None:
            self.bar.update(self.task, completed=self.done)

    def close(self) -> None:
        if self.bar is not None:
            self.bar.stop()


DOWNLOADS: dict[str, Download] = {
    "aneurism": Download(
        "aneurism",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "31f1232cbf75b0182f172375e46cc57fe013c0edaae292f2358e2477052ca974"
        "faae92efd803a2d229172b851b5ddaa461129872b89bd6ce45d43bfe595eed43",
        verified=True,
    ),
    "backpack": Download(
        "backpack",
        (512, 512, 373),
        "uint16",
        (0.9766, 0.9766, 1.25),
        "f929fb231367792b260db6de2214fb64a27785870f472503930cf34c6cc7b1c2"
        "2603c1eb2164381ec1f799c8e1040a151edca4e094d2ed1cbfc70a85d4f1eba8",
    ),
    "blunt_fin": Download(
        "blunt_fin",
        (256, 128, 64),
        "uint8",
        (1, 0.75, 1),
        "d5da3701268d92dd84e9a18db3ad126d01408983ce4efde38ffa0c096029d9b1"
        "c80c9094c5d1dc9baeff4e076c97c195137d200c99b3eee862dcf1d22dfe9df7",
    ),
    "bonsai": Download(
        "bonsai",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "b34156a0ffc80ffaf84d069f3d05a40fdd999a35f05492829a2b0c13403a3147"
        "e73712b1d10c2cc34da66a59540a1632dae6adc96f3ebf3efa5d4d6c10598997",
        verified=True,
    ),
    "bunny": Download(
        "bunny",
        (512, 512, 361),
        "uint16",
        (0.337891, 0.337891, 0.5),
        "58c8de50e5e9638278a36c9ddb10d0948721b5821e62dff3dada7b783341b6e5"
        "d346014b8545f504eb33952ea5c91e3ca93d10a5ce6a78b32ecabd10bb9438f3",
    ),
    "carp": Download(
        "carp",
        (256, 256, 512),
        "uint16",
        (0.78125, 0.390625, 1),
        "0ec57ca05d700e25a87cc2ca976c066f52e254c0269aa5fb7decb08ba3607cbf"
        "996b5d72aac8671dfe6589a794935d3fd820aaa756e6f6d32b84def15455fea5",
    ),
    "engine": Download(
        "engine",
        (256, 256, 128),
        "uint8",
        (1, 1, 1),
        "f17228483b1b5edb90146eac90ba979531629a2880d9e7a0493a98290da8af6a"
        "c2cf80f2c567a3d08695dc7dd854916c861dad8856b2d5721501954e913de13f",
        verified=True,
    ),
    "foot": Download(
        "foot",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "56a73bd1f694a09809688f5b0bbf0dfff0ef3e853a34c60c4d51bef02dd96fbf"
        "e5191f47c7762bdf7caab6f9a22f1d0e830652779f87c70cc519f345221edd0e",
    ),
    "frog": Download(
        "frog",
        (256, 256, 44),
        "uint8",
        (0.5, 0.5, 1),
        "0421e05c1c3fdce41f96ac93d0ba59c0aed29bb9d53a5d395f859e737b67db19"
        "e6ab39806028bddc6e5b2acde1d97581f81745d380f141ae144cec923974b0d1",
    ),
    "fuel": Download(
        "fuel",
        (64, 64, 64),
        "uint8",
        (1, 1, 1),
        "77fdd7c657da1946bafc84e88c6b8a03ae104a79a5bdec3c7db9257480ef4bf7"
        "2551a08d22fd237c8e387dd2571b575f1a1a11f5f32b1fa4d4ef385d9fe1d613",
        verified=True,
    ),
    "hydrogen_atom": Download(
        "hydrogen_atom",
        (128, 128, 128),
        "uint8",
        (1, 1, 1),
        "bc80b55ffc983f41b3981433707b59f6c8b3f16cc9cd3ea18087cb9e734b702e"
        "b1ad0410f36f38881b2e2fa85617dc0858bb2d9fbd3188abb39af43ea84e3521",
        verified=True,
    ),
    "lobster": Download(
        "lobster",
        (301, 324, 56),
        "uint8",
        (1, 1, 1.4),
        "efb1c15bfda13b6899b923d2c51caea00d2eaffb95d89343e64298266d231a12"
        "902e376353d5c258a6ccffd54c363bc186aea19de631982f85158a4b70e0e671",
    ),
    "mri_ventricles": Download(
        "mri_ventricles",
        (256, 256, 124),
        "uint8",
        (0.9, 0.9, 0.9),
        "fd522a0c616d3367ec5c8f63efe918825f032882bf2e50c10d4e155c4db6a14d"
        "139a5b6a0e7cedd0cda69aaf1c89d3aad60a984a72b57fc6e2eca48f34ef54e0",
    ),
    "mri_woman": Download(
        "mri_woman",
        (256, 256, 109),
        "uint16",
        (1, 1, 1.5),
        "f14941ef8e9cabd751fe2c433b4cfaef7ad846c05eeea8026d541e3e32dcc5b0"
        "4cb04ea4f605188059d371d0967218bef9529429be53d9e88ff72f964f73938f",
    ),
    "mrt_angio": Download(
        "mrt_angio",
        (416, 512, 112),
        "uint16",
        (0.412, 0.412, 0.412),
        "81ee88eabd067b7929a5337d7c709b0b44408394a40318aae917df8b8a72735d"
        "3766105c1580938da6ab1670315f93cbc92bb940ae988e6c72b7157c9018d7c4",
    ),
    "neghip": Download(
        "neghip",
        (64, 64, 64),
        "uint8",
        (1, 1, 1),
        "d00f95d1f4cb1da2f3260a722059527ace73514cd57e1c31b6724d18468fd810"
        "02f5da704a0c3c7ccf06a329a975dede38cfacf13387dea9ffd8d7542cae62d0",
        verified=True,
    ),
    "nucleon": Download(
        "nucleon",
        (41, 41, 41),
        "uint8",
        (1, 1, 1),
        "5703198390210caac5a9aaa51cfffd822bbf1835cb40bb183cfd946dd1d4c0f0"
        "b72030431c5eed1eb9a30eaaaeb48b00cb97ba3a50b01367c90e00b9ecf00210",
    ),
    "shockwave": Download(
        "shockwave",
        (64, 64, 512),
        "uint8",
        (1, 1, 1),
        "b483bdee37e943e284e146ec2097ed6f263f19e5007916e3eff7e1ad5f8ecd99"
        "db4419cd5eedff236c22727bc2f920fb7dab28ff8e8de4c64866c3efb4e33e6d",
    ),
    "silicium": Download(
        "silicium",
        (98, 34, 34),
        "uint8",
        (1, 1, 1),
        "8ef2b9a84eb94693596b57f3f21f5ea75c1c25654011e3aed39a27f5e4259ebb"
        "bd2486ff39bb32b551bb44f3fa25123e7128cfd3fc053134f0806e23bb24a819",
    ),
    "skull": Download(
        "skull",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "6b31b8c3c056e4fca2c908c8feffe1ad4872e1201feafe136ed22178d2593f54"
        "9c4a8328b2f6ec7d7855271f28f7a4981ffae8ced9ff21df11652abe7c0766bc",
    ),
    "statue_leg": Download(
        "statue_leg",
        (341, 341, 93),
        "uint8",
        (1, 1, 4),
        "79f4f46fceb019c2d08a95c69e11735df52cfd933cda1d56624e10f38558ee09"
        "e87c754171be8c553e7b3df5eded2c8de92d837058b29394c577c925a96d41d0",
    ),
    "stent": Download(
        "stent",
        (512, 512, 174),
        "uint16",
        (0.8398, 0.8398, 3.2),
        "b6f3ddccbb2a5585664a3173b86a034f12540f8d306a050074619d7c52780d6b"
        "7252757d754682e8b38c4419ac3c3caaab38e12628cbbf18b3814b239429155e",
    ),
    "teapot": Download(
        "boston_teapot",
        (256, 256, 178),
        "uint8",
        (1, 1, 1),
        "b2bf7ba8ba7a7d5a8ea76ccd8fd2c0f5f043079a83cd6a3055e85f5e0a40c1c4"
        "d872b9bbc7aedf628989eb57bffd5729767c29fe8ae018c581406b196caa6359",
        verified=True,
    ),
    "tooth": Download(
        "tooth",
        (103, 94, 161),
        "uint8",
        (1, 1, 1),
        "5ee3d77ae951e129d29062a4fd4d8730fd8670bdaf4d01ddf907848072180cbf"
        "ea8ab897880147d2a79dc7f1d1806a34b32853074eca88f6758e01382469f9f6",
        verified=True,
    ),
    "vis_male": Download(
        "vis_male",
        (128, 256, 256),
        "uint8",
        (1.57774, 0.995861, 1.00797),
        "55a3ecfb1e40685b993d51e713c9752609d5eb09359e86365c53bfbd535e77ea"
        "ebfddf0eeacc73f42650726c82ed4b9ce4d0929a265ed84e1c59f39c6dd66e78",
    ),
}
