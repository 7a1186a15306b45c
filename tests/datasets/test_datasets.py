"""Generated volumes against what defines them; downloads from a server of our own that also misbehaves."""

from __future__ import annotations

import contextlib
import hashlib
import http.server
import threading
import time

import numpy as np
import pooch
import pytest

from wvr import datasets
from wvr.datasets import downloads, fields
from wvr.datasets.fields import SHEPP_LOGAN
from wvr.io import read

from ..helpers import DATA

# --- Generated ------------------------------------------------------------------------------------------------------


def field(name, size, **options):
    return datasets.load(name, size, **options).numpy()


@pytest.mark.parametrize("name", datasets.GENERATED)
def test_generated_volumes(name):
    volume = datasets.load(name, 24)
    assert volume.shape == (24, 24, 24) and np.all(volume.spacing == 1)
    assert volume.dtype == (np.uint8 if name in ("spheres", "blobs", "tree", "heart") else np.float32)
    assert volume.range[0] < volume.range[1]
    np.testing.assert_array_equal(volume.numpy(), field(name, 24))
    assert datasets.load(name).shape == (128, 128, 128)
    assert datasets.load(name, 2).shape == (2, 2, 2)


@pytest.mark.parametrize("name", ["blobs", "turbulence", "tree", "heart"])
def test_seeds_differ(name):
    assert not np.array_equal(field(name, 32, seed=1), field(name, 32, seed=2))
    np.testing.assert_array_equal(field(name, 32, seed=1), field(name, 32))


def test_marschner_lobb():
    values = field("marschner_lobb", 41)
    assert values[20, 20, 20] == pytest.approx((1 + 0.25 * 2) / 2.5)
    x, y, z = (-1 + 2 * np.array([33, 7, 12]) / 40).tolist()
    ripple = np.cos(12 * np.pi * np.cos(np.pi * np.hypot(x, y) / 2))
    assert values[12, 7, 33] == pytest.approx((1 - np.sin(np.pi * z / 2) + 0.25 * (1 + ripple)) / 2.5, abs=1e-6)
    assert values[0].mean() > values[-1].mean()  # falls along z


def test_spheres():
    values = field("spheres", 101)
    assert [values[50, 50, i] for i in (50, 67, 75, 83, 90, 99)] == [255, 0, 170, 0, 85, 0]
    for other in (values[::-1], values[:, ::-1], values[..., ::-1], values.transpose(2, 0, 1)):
        np.testing.assert_allclose(values.astype(int), other, atol=1)
    assert np.abs(np.diff(values.astype(int), axis=0)).max() < 0.55 * 255  # an edge takes two voxels


def test_shepp_logan():
    size = 121
    values = field("shepp_logan", size)
    np.testing.assert_array_equal(np.unique(values), np.float32([0, 0.1, 0.2, 0.3, 1]))
    total = sum(grey / 10 * 4 / 3 * np.pi * np.prod(axes) for grey, axes, _, _ in SHEPP_LOGAN)
    assert values.sum() * (2 / (size - 1)) ** 3 == pytest.approx(total, rel=0.01)

    def at(x, y, z):
        return values[tuple(np.rint((np.array([z, y, x]) + 1) / 2 * (size - 1)).astype(int))]

    assert at(0, 0, 0) == np.float32(0.2) and at(0.22, 0, 0) == at(-0.22, 0, 0) == 0 and at(0, 0.9, 0) == 1
    # The ventricles' upper ends lean outwards: rotated by -18 degrees the long axis points to (sin 18, cos 18).
    lean = 0.33 * np.array([np.sin(np.radians(18)), np.cos(np.radians(18))])
    assert at(-0.22 - lean[0], lean[1], 0) == 0 and at(-0.22 + lean[0], lean[1], 0) != 0


def test_blobs():
    values = field("blobs", 64)
    assert (values.min(), values.max()) == (0, 255)
    assert np.abs(np.diff(values.astype(int), axis=2)).max() < 20
    assert not np.array_equal(values, field("blobs", 64, count=10))


def test_gyroid():
    x, y, z = np.pi * 3 * (-1 + 2 * np.array([3, 17, 29]) / 40)
    expected = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    assert field("gyroid", 41)[29, 17, 3] == pytest.approx(expected, abs=1e-5)
    periodic = field("gyroid", 41, periods=1.0)
    np.testing.assert_allclose(periodic[0], periodic[-1], atol=1e-5)


def test_turbulence_is_one_flow_at_any_size():
    fine, coarse = field("turbulence", 128), field("turbulence", 64)
    assert np.sqrt(np.mean(fine.astype(float) ** 2)) == pytest.approx(1)
    np.testing.assert_allclose(fine[::2, ::2, ::2] / fine[0, 0, 0], coarse / coarse[0, 0, 0], rtol=2e-3, atol=2e-3)


def test_turbulence_has_kolmogorovs_spectrum():
    size = 64
    waves = np.fft.fftfreq(size, 1 / size)
    k = np.stack(np.meshgrid(waves, waves, waves, indexing="ij"))
    length = np.sqrt((k**2).sum(axis=0))
    vorticity = np.array([np.fft.fftn(component) for component in fields.vorticity(size, 1)])
    assert np.abs((k * vorticity).sum(axis=0)).max() < 1e-5 * np.abs(k * vorticity).max()  # a curl has no divergence
    energy = (np.abs(vorticity) ** 2).sum(axis=0) / np.maximum(length, 1) ** 2
    shells = np.arange(3, 22)
    spectrum = [energy[np.abs(length - shell) < 0.5].sum() for shell in shells]
    slope = np.polyfit(np.log(shells), np.log(spectrum), 1)[0]
    assert slope == pytest.approx(-5 / 3, abs=0.1)
    assert energy[length > 24.5].sum() < 1e-9 * energy.sum()


def test_tree():
    values = field("tree", 128).astype(int)
    soil, wall = values[12:20, 60:68, 60:68], values[6:24].max(axis=(1, 2))
    assert 180 < soil.mean() < 200 and np.all((wall > 230) & (wall <= 255))
    trunk = values[32:36].max(axis=(1, 2))
    assert np.all((trunk > 100) & (trunk < 155))
    crown = values[50:]
    leaves, wood, air = (np.mean((crown >= lo) & (crown <= hi)) for lo, hi in ((30, 75), (95, 155), (0, 6)))
    assert leaves > 3 * wood > 0 and air > 0.9 and crown.max() < 160
    assert 0 < np.median(values[-4:]) <= 2 and values[-4:].max() < 8  # air, slightly noisy
    assert np.abs(np.diff(values, axis=2)).max() < 0.6 * 240  # surfaces take two voxels


def left_ventricle(phase, seeds=8, n=56):
    """Voxels of blood and muscle of the half of the left ventricle that faces the right one, speckle averaged out."""
    mean = np.mean([field("heart", n, phase=phase, seed=seed) for seed in range(seeds)], axis=0)
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, n)] * 3, indexing="ij")
    inside = (((x + 0.18) / 0.46) ** 2 + (y / 0.46) ** 2 + ((z + 0.1) / 0.75) ** 2 < 1) & (x > -0.18)
    core = inside & (((x + 0.18) / 0.35) ** 2 + (y / 0.35) ** 2 + ((z + 0.1) / 0.66) ** 2 < 1)
    return np.count_nonzero(core & (mean < 70)), np.count_nonzero(inside & (mean >= 80))


def test_heart_ejects_blood_and_keeps_its_muscle():
    (full, relaxed), (emptied, contracted) = (left_ventricle(phase) for phase in (0, 0.35))
    assert 1 - emptied / full == pytest.approx(0.58, abs=0.05)
    assert contracted == pytest.approx(relaxed, rel=0.1)


def test_heart_beats_smoothly_and_speckles():
    np.testing.assert_array_equal(field("heart", 32, phase=1.25), field("heart", 32, phase=0.25))
    still, soon, later = (field("heart", 48, phase=p).astype(float) for p in (0.2, 0.21, 0.5))
    # A frame of a hundred is nearly the one before; blood and muscle are where they were, their speckle is not.
    seen = still > 0
    assert np.corrcoef(still[seen], soon[seen])[0, 1] > 0.98 > 0.9 > np.corrcoef(still[seen], later[seen])[0, 1]
    # Rayleigh: the deviation is 0.52 of the mean, of which 0.55 is shown.
    tissue = field("heart", 64)[16:28, 3:9, 14:50].astype(float)
    assert tissue.std() / tissue.mean() == pytest.approx(0.55 * 0.523, abs=0.03)
    with pytest.raises(ValueError, match="phase"):
        datasets.load("heart", 8, phase=np.inf)


def test_names_and_refusals():
    assert datasets.names() == [*datasets.GENERATED, *datasets.DOWNLOADS]
    assert len(set(datasets.names())) == len(datasets.names())
    with pytest.raises(ValueError, match=r"'marschner_lobb', .*'bonsai', .*got 'bonzai'; did you mean 'bonsai'"):
        datasets.load("bonzai")
    with pytest.raises(ValueError, match="got 'tree'"):
        datasets.fetch("tree")
    for size in (1, 0, -3, 2.5):
        with pytest.raises(ValueError, match="size must be an integer >= 2"):
            datasets.load("spheres", size)


# --- Downloads ------------------------------------------------------------------------------------------------------

CONTENT = np.arange(4 * 3 * 2, dtype="<u2").tobytes()
TINY = datasets.Download("tiny", (4, 3, 2), "uint16", (1.0, 0.5, 2.0), hashlib.sha512(CONTENT).hexdigest(), True)


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.server.paths.append(self.path)
        body = self.server.body
        self.send_response(404 if body is None else 200)
        self.send_header("Content-Length", str(len(body or b"") + self.server.withheld))
        self.end_headers()
        self.wfile.write(body or b"")

    def log_message(self, *_):
        pass


@pytest.fixture
def server(monkeypatch, tmp_path):
    """A site with the one dataset "tiny": it sends ``body`` and withholds so many of the bytes it promised."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.paths, server.body, server.withheld, server.cache = [], CONTENT, 0, tmp_path / "cache"
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    monkeypatch.setitem(datasets.DOWNLOADS, "tiny", TINY)
    monkeypatch.setenv("WVR_DATASETS_URL", f"http://127.0.0.1:{server.server_port}/data/")
    monkeypatch.setenv("WVR_CACHE", str(server.cache))
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    pooch.get_logger().setLevel("WARNING")
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


def cached(server) -> list[str]:
    return [path.name for path in server.cache.rglob("*") if path.is_file()]


def test_download_once(server, tmp_path):
    volume = datasets.load("tiny")
    assert server.paths == ["/data/tiny/tiny_4x3x2_uint16.raw"]
    np.testing.assert_array_equal(volume.numpy(), np.arange(24).reshape(2, 3, 4))
    assert volume.spacing.tolist() == [1, 0.5, 2] and volume.dtype == np.uint16
    assert cached(server) == ["tiny_4x3x2_uint16.raw"]
    server.body = None
    np.testing.assert_array_equal(datasets.fetch("tiny").numpy(), volume.numpy())
    assert len(server.paths) == 1
    with pytest.raises(OSError, match="404"):
        datasets.fetch("tiny", cache=tmp_path / "another")


@pytest.mark.parametrize(
    "body, withheld, message",
    [
        (None, 0, "404"),
        (CONTENT[:-2], 0, "46 bytes came, 48 are expected"),
        (CONTENT + b"!", 0, "49 bytes came, 48 are expected"),
        (CONTENT[:-1] + b"!", 0, "(?i)hash"),
        (CONTENT[:20], 28, "(?i)incomplete|broken|20 bytes came"),
    ],
    ids=["404", "short", "long", "sum", "cut"],
)
def test_failed_downloads_leave_nothing(server, body, withheld, message):
    server.body, server.withheld = body, withheld
    place = server.cache / "tiny" / "tiny_4x3x2_uint16.raw"
    with pytest.raises(OSError, match=message) as caught:
        datasets.fetch("tiny")
    assert str(place) in str(caught.value) and "127.0.0.1" in str(caught.value) and TINY.sha512 in str(caught.value)
    assert cached(server) == []
    server.body, server.withheld = CONTENT, 0
    assert datasets.fetch("tiny").shape == (2, 3, 4)


@pytest.mark.parametrize("body, seen", [(CONTENT, "the same"), (CONTENT[::-1], "another")])
def test_unverified_checksum_says_so(server, monkeypatch, body, seen):
    server.body = body
    monkeypatch.setitem(datasets.DOWNLOADS, "tiny", TINY._replace(verified=False))
    with pytest.warns(UserWarning, match=f"checksum of 'tiny' is unverified.*this file's is {seen}"):
        datasets.fetch("tiny")
    server.body = body[:-1]
    with pytest.raises(OSError, match="47 bytes came"):
        datasets.fetch("tiny", cache=server.cache / "other")


def test_endless_and_slow_downloads_end(server, monkeypatch):
    """Neither is more written than the file has, nor waited for ever, whatever the server sends."""

    def endless(self):
        self.send_response(200)
        self.end_headers()
        with contextlib.suppress(OSError):
            while not server.closing:
                self.wfile.write(server.body)
                self.wfile.flush()
                time.sleep(server.pause)

    server.closing, server.pause = False, 0.0
    monkeypatch.setattr(Handler, "do_GET", endless)
    server.body = bytes(1000)
    with pytest.raises(OSError, match=r"\d+ bytes came, 48 are expected"):
        datasets.fetch("tiny")
    server.body, server.pause = b"a", 0.1
    monkeypatch.setattr(downloads, "PATIENCE", 0.5)
    with pytest.raises(OSError, match=r"[1-9] of 48 bytes came in \d s"):
        datasets.fetch("tiny")
    server.closing = True
    assert cached(server) == []


def test_refused_connection(server, monkeypatch):
    monkeypatch.setenv("WVR_DATASETS_URL", "http://127.0.0.1:1")
    with pytest.raises(OSError, match=r"could not download 'tiny' from http://127\.0\.0\.1:1/tiny"):
        datasets.fetch("tiny")
    assert cached(server) == []


def test_interrupted_download_leaves_nothing(server, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(downloads._Progress, "update", interrupt)
    with pytest.raises(KeyboardInterrupt):
        datasets.fetch("tiny")
    assert cached(server) == []


def test_damaged_cache_is_replaced(server):
    datasets.fetch("tiny")
    place = server.cache / "tiny" / "tiny_4x3x2_uint16.raw"
    place.write_bytes(CONTENT[:10])
    np.testing.assert_array_equal(datasets.fetch("tiny").numpy().ravel(), np.arange(24))
    assert place.read_bytes() == CONTENT


def test_file_put_by_hand_is_used(server):
    place = server.cache / "tiny" / "tiny_4x3x2_uint16.raw"
    place.parent.mkdir(parents=True)
    place.write_bytes(CONTENT)
    assert datasets.fetch("tiny").shape == (2, 3, 4) and server.paths == []


def test_progress_bar_waits_and_needs_a_terminal(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(downloads.time, "monotonic", lambda: clock[0])

    def run(terminal):
        monkeypatch.setattr(downloads.sys.stderr, "isatty", lambda: terminal, raising=False)
        clock[0] = 0.0
        progress = downloads._Progress("tiny", 100)
        shown = []
        for clock[0] in (1.0, 1.9, 2.1):
            progress.update(30)
            shown.append(progress.bar is not None)
        progress.close()
        return shown

    assert run(True) == [False, False, True]
    assert "tiny" in capsys.readouterr().err
    assert run(False) == [False, False, False]
    assert capsys.readouterr().err == ""


def test_table_is_well_formed():
    for name, entry in datasets.DOWNLOADS.items():
        assert len(entry.sha512) == 128 and int(entry.sha512, 16), name
        assert np.dtype(entry.dtype).name == entry.dtype and min(entry.dimensions) > 1 and min(entry.spacing) > 0
    assert datasets.DOWNLOADS["bonsai"].file == "bonsai/bonsai_256x256x256_uint8.raw"
    assert datasets.DOWNLOADS["bonsai"].bytes == 2**24


@pytest.mark.skipif(not DATA.is_dir(), reason="no folder of real volumes beside the checkout")
@pytest.mark.parametrize("name", [name for name, entry in datasets.DOWNLOADS.items() if entry.verified])
def test_published_sums_are_those_of_the_real_volumes(name):
    volume, entry = read(DATA / f"{name}.nrrd"), datasets.DOWNLOADS[name]
    assert hashlib.sha512(volume.numpy().tobytes()).hexdigest() == entry.sha512
    assert tuple(volume.dimensions) == entry.dimensions and tuple(volume.spacing) == entry.spacing
