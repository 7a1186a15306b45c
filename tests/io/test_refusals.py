"""What is no volume is refused, files that are damaged are noticed, and real volumes are what they are listed as."""

from __future__ import annotations

import gzip
import hashlib
import re
import zlib
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
import tifffile
from PIL import Image

from wvr.io import from_pyvista, read

from ..helpers import DATA
from .files import (
    FIELD,
    LITTLE,
    ORIGIN,
    dicom,
    image,
    legacy,
    meta,
    nifti,
    npy,
    nrrd,
    vti,
)

# --- Refusals -------------------------------------------------------------------------------------------------------


def test_components(tmp_path):
    grid = image()
    grid.point_data["values"] = np.zeros((60, 3))
    with pytest.raises(ValueError, match="3 components"):
        from_pyvista(grid)
    four = nrrd(b"").replace(b"dimension: 3", b"dimension: 4").replace(b"sizes: 5 3 4", b"sizes: 6 5 3 4")
    (tmp_path / "a.nrrd").write_bytes(four.replace(b"directions: ", b"directions: none "))
    (tmp_path / "a.mha").write_bytes(meta(b"", more="ElementNumberOfChannels = 2\n"))
    (tmp_path / "a.nii").write_bytes(nifti(b"", code=128))
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((6, 5, 3), np.uint8), photometric="rgb")
    for name, count in (("a.nrrd", 6), ("a.mha", 2), ("a.nii", 3), ("a.tif", 3)):
        with pytest.raises(ValueError, match=rf"{count} components a sample.*array\[\.\.\., 0\]"):
            read(tmp_path / name)


def test_other_grids(tmp_path):
    grid = pv.RectilinearGrid([0.0, 1, 3], [0.0, 1], [0.0, 1])
    grid["s"] = np.arange(12.0)
    legacy(tmp_path / "a.vtk", grid)
    grid.save(tmp_path / "a.vtr")
    for name in ("a.vtk", "a.vtr"):
        with pytest.raises(ValueError, match=r"(?i)rectilinear ?grid; .*resample"):
            read(tmp_path / name)
    with pytest.raises(TypeError, match="got RectilinearGrid"):
        from_pyvista(grid)


def test_missing_and_unknown(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.nrrd"):
        read(tmp_path / "none.nrrd")
    with pytest.raises(FileNotFoundError, match="no TIFF, PNG, JPEG, BMP or DICOM images"):
        read(tmp_path)
    (tmp_path / "a.xyz").write_text("x")
    with pytest.raises(ValueError, match=r"unknown extension; accepted are \.nrrd, .*\.npy"):
        read(tmp_path / "a.xyz")


def broken_candidates(folder: Path) -> list[Path]:
    for name, content in {
        "raw.nrrd": nrrd(LITTLE),
        "gzip.nrrd": nrrd(gzip.compress(LITTLE), "gzip"),
        "raw.mha": meta(LITTLE),
        "zlib.mha": meta(zlib.compress(LITTLE), True),
        "raw.nii": nifti(LITTLE),
        "gzip.nii.gz": gzip.compress(nifti(LITTLE)),
        "a.npy": npy(FIELD),
    }.items():
        (folder / name).write_bytes(content)
    vti(folder / "compressed.vti")
    vti(folder / "bare.vti", compress=False)
    vti(folder / "binary.vti", mode="binary")
    vti(folder / "ascii.vti", mode="ascii")
    legacy(folder / "binary.vtk", image())
    tifffile.imwrite(folder / "plain.tif", FIELD, photometric="minisblack")
    tifffile.imwrite(folder / "zlib.tif", FIELD, photometric="minisblack", compression="zlib")
    pages = [Image.fromarray(page) for page in FIELD.astype(np.uint16)]
    pages[0].save(folder / "lzw.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    with tifffile.TiffWriter(folder / "pages.tif") as file:
        for page in FIELD:
            file.write(page, contiguous=False, metadata=None)
    dicom(folder / "a.dcm", FIELD[0], ORIGIN)
    return sorted(folder.iterdir())


def test_truncated_files_are_noticed(tmp_path, capfd):
    """Cut anywhere, a file is refused, or it was only padding that went and the samples are all there."""
    (tmp_path / "good").mkdir()
    for path in broken_candidates(tmp_path / "good"):
        whole, content = read(path).numpy(), path.read_bytes()
        cut = tmp_path / path.name
        refused = 0
        cuts = sorted({0, 1, 10, *range(30, len(content), 37), *range(len(content) - 6, len(content))})
        for length in cuts:
            cut.write_bytes(content[:length])
            try:
                np.testing.assert_array_equal(read(cut).numpy(), whole, f"{path.name} cut to {length}")
            except OSError as error:
                assert path.name in str(error)
                refused += 1
        assert refused >= 0.75 * len(cuts), path.name
    printed = capfd.readouterr()
    assert printed.out == printed.err == ""


@pytest.mark.parametrize("name", ["gzip.nrrd", "zlib.mha", "gzip.nii.gz", "zlib.tif"])
def test_damaged_compressed_samples_are_noticed(tmp_path, name, capfd):
    """Formats with a check sum: whatever bit flips in the compressed samples, what is read is right or refused."""
    rng = np.random.default_rng(0)
    (tmp_path / "good").mkdir()
    broken_candidates(tmp_path / "good")
    content = (tmp_path / "good" / name).read_bytes()
    start = content.index(b"\x78\x9c" if "zlib" in name else b"\x1f\x8b")
    for _ in range(40):
        damaged = bytearray(content)
        damaged[rng.integers(start, min(start + 70, len(content)))] ^= 1 << rng.integers(8)
        (tmp_path / name).write_bytes(damaged)
        try:
            np.testing.assert_array_equal(read(tmp_path / name).numpy(), FIELD)
        except OSError as error:
            assert name in str(error)
    assert capfd.readouterr().err == ""


def test_nonsense_is_refused(tmp_path, capfd):
    noise = np.random.default_rng(0).bytes(5000)
    for ending in ("nrrd", "nhdr", "mha", "nii", "nii.gz", "vti", "vtk", "tif", "dcm", "npy"):
        for content in (b"", b"\n", noise, b"NRRD0004\nsizes: x y\n\n", b"\x93NUMPY" + noise, b"II*\0" + noise):
            path = tmp_path / f"a.{ending}"
            path.write_bytes(content)
            with pytest.raises(OSError, match=re.escape(path.name)):
                read(path)
    assert capfd.readouterr().err == ""


def test_too_many_bytes_are_refused(tmp_path):
    for name, content in (
        ("a.nrrd", nrrd(LITTLE + b"!")),
        ("a.mha", meta(LITTLE + b"!")),
        ("a.nii", nifti(LITTLE + b"!")),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(OSError, match="holds more than it declares: 1 bytes after 120 bytes of samples"):
            read(tmp_path / name)


# --- Real volumes ---------------------------------------------------------------------------------------------------


def listed_volumes() -> list[tuple[str, ...]]:
    """Rows of the data folder's table: file, dims, spacing, dtype, range, sha256."""
    if not (DATA / "README.md").exists():
        return []
    rows = [line.split("|") for line in (DATA / "README.md").read_text().splitlines() if line.startswith("| ")]
    return [tuple(c.strip() for c in (*r[1:6], r[9])) for r in rows if r[1].strip().endswith(".nrrd")]


@pytest.mark.skipif(not listed_volumes(), reason="no folder of real volumes beside the checkout")
def test_real_volumes():
    for file, dims, spacing, dtype, span, digest in listed_volumes():
        path = DATA / file
        assert hashlib.sha256(path.read_bytes()).hexdigest() == digest.strip("`")
        if "comp." in dims:
            with pytest.raises(ValueError, match="4 components"):
                read(path)
            continue
        volume = read(path)
        assert tuple(volume.dimensions) == tuple(int(n) for n in dims.split(" x ")), file
        np.testing.assert_allclose(volume.spacing, [float(s) for s in spacing.split(",")], atol=5e-6)
        assert volume.dtype == dtype
        np.testing.assert_allclose(volume.range, [float(s) for s in span.split(" .. ")], atol=5e-5)
        # The format stores x fastest: the same bytes in the same order.
        content = path.read_bytes()
        assert volume.numpy().tobytes() == gzip.decompress(content[content.index(b"\n\n") + 2 :])
        np.testing.assert_array_equal(volume.direction, np.eye(3))
    np.testing.assert_allclose(read(DATA / "bluntfin.nrrd").origin, (-7.8157, 0, 0), atol=1e-4)
