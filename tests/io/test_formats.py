"""Formats whose files well-kept packages write: samples, places and times are as they wrote them."""

from __future__ import annotations

import gzip
import importlib.util
import io
import struct
import warnings
import zipfile
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image

import wvr
from wvr.io import read

from .files import BIG, FIELD, LITTLE, ORIGIN, SPACING, TURNED, amira, check, dicom, meta, nifti, nrrd, runs

PLAIN = ((1, 1, 1), (0, 0, 0), np.eye(3))
TIMES = np.stack([FIELD, FIELD + 1000, FIELD - 1000])


def place() -> np.ndarray:
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = TURNED * SPACING, ORIGIN
    return affine


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.img"])
def test_nifti_of_nibabel(tmp_path, name):
    nibabel = pytest.importorskip("nibabel")
    kind = nibabel.Nifti1Pair if name.endswith("img") else nibabel.Nifti2Image
    nibabel.save(kind(FIELD.T, place()), tmp_path / name)
    name = name.replace(".img", ".hdr")
    check(read(tmp_path / name))
    assert read(tmp_path / name).anatomical == "RAS"
    assert {file.name for file in read(tmp_path / name).files} == ({"a.hdr", "a.img"} if "hdr" in name else {name})


def test_header_without_its_samples(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Pair(FIELD.T, place()), tmp_path / "a.img")
    (tmp_path / "a.img").unlink()
    with pytest.raises(FileNotFoundError, match=r"a\.img"):
        read(tmp_path / "a.hdr")


@pytest.mark.parametrize("name", ["a.mgh", "a.mgz"])
def test_mgh_of_nibabel(tmp_path, name):
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.MGHImage(FIELD.T, place()), tmp_path / name)
    check(read(tmp_path / name))
    nibabel.save(nibabel.MGHImage(TIMES.T.astype(np.float32), place()), tmp_path / name)
    check(read(tmp_path / name, frame=2), TIMES[2].astype(np.float32))


@pytest.mark.parametrize("sform, qform", [(1, 1), (0, 1)])
def test_nifti_with_a_zero_sform_falls_back(tmp_path, sform, qform):
    content = bytearray(nifti(LITTLE, form="qform"))
    content[252:256] = np.array([qform, sform], "<i2").tobytes()
    content[280:328] = bytes(48)
    (tmp_path / "a.nii").write_bytes(content)
    check(read(tmp_path / "a.nii"))


def test_mrc_of_mrcfile(tmp_path):
    mrcfile = pytest.importorskip("mrcfile")
    with mrcfile.new(tmp_path / "a.mrc") as file:
        file.set_data(FIELD)
        file.voxel_size = SPACING
        file.header.origin = ORIGIN
    check(read(tmp_path / "a.mrc"), direction=np.eye(3))
    (tmp_path / "a.map.gz").write_bytes(gzip.compress((tmp_path / "a.mrc").read_bytes()))
    check(read(tmp_path / "a.map.gz"), direction=np.eye(3))
    content = bytearray((tmp_path / "a.mrc").read_bytes())
    # Columns along z, rows along x, sections along y, and a start instead of an origin.
    content[64:76] = np.array([3, 1, 2], "<i4").tobytes()
    content[16:28] = np.array([2, 3, 4], "<i4").tobytes()
    content[28:40] = np.array([3, 4, 5], "<i4").tobytes()
    content[40:52] = np.array([3 * 1.5, 4 * 2.0, 5 * 3.0], "<f4").tobytes()
    content[196:208] = bytes(12)
    (tmp_path / "a.ccp4").write_bytes(content)
    volume = read(tmp_path / "a.ccp4")
    np.testing.assert_array_equal(volume.numpy(), FIELD)
    np.testing.assert_allclose(volume.index_to_world[:3, :3], [[0, 1.5, 0], [0, 0, 2], [3, 0, 0]])
    np.testing.assert_allclose(volume.origin, [1.5 * 3, 2 * 4, 3 * 2])
    (tmp_path / "a.mrc").write_bytes(content[:-1])
    with pytest.raises(OSError, match=r"a\.mrc is truncated .* 120 bytes, and holds 119"):
        read(tmp_path / "a.mrc")


def test_mrc_with_skewed_axes(tmp_path):
    mrcfile = pytest.importorskip("mrcfile")
    with mrcfile.new(tmp_path / "a.mrc") as file:
        file.set_data(FIELD)
        file.voxel_size = 2.0
        file.header.cellb = (90, 90, 120)
    steps = read(tmp_path / "a.mrc").index_to_world[:3, :3]
    np.testing.assert_allclose(steps, [[2, -1, 0], [0, np.sqrt(3), 0], [0, 0, 2]], atol=1e-6)


def test_tiff_values_are_those_of_imagej(tmp_path):
    """It keeps samples with a sign as such without, and a line that makes the others of them."""
    array = np.arange(-60, 60, dtype=np.int16).reshape(4, 5, 6)
    metadata = {"axes": "ZYX", "cf": 0, "c0": -32768.0, "c1": 1.0}
    stored = (array.astype(int) + 32768).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", stored, imagej=True, metadata=metadata)
    np.testing.assert_array_equal(read(tmp_path / "a.tif").numpy(), array)
    tifffile.imwrite(tmp_path / "a.tif", stored, imagej=True, metadata=metadata | {"cf": 4})
    with pytest.raises(ValueError, match=r"a\.tif: its ImageJ calibration is no straight line"):
        read(tmp_path / "a.tif")

    # Of 32 bits it has none, and some are clipped.
    tifffile.imwrite(tmp_path / "a.tif", array.astype(np.float32), imagej=True, metadata=metadata | {"spacing": -2.0})
    volume = read(tmp_path / "a.tif")
    np.testing.assert_array_equal(volume.numpy(), array)
    np.testing.assert_array_equal(volume.index_to_world, np.diag([1, 1, 2, 1]))
    tifffile.imwrite(tmp_path / "a.tif", stored, imagej=True, metadata=metadata | {"zeroclip": "true"})
    np.testing.assert_array_equal(read(tmp_path / "a.tif").numpy(), np.maximum(array, 0))


@pytest.mark.parametrize("bits", [1, 2, 4])
@pytest.mark.parametrize("packing", ["raw", "packbits", "tiff_lzw"])
def test_tiff_of_less_than_a_byte_a_sample(tmp_path, bits, packing):
    """They were refused as cut short, or spread over 8 bits."""
    samples = np.arange(8 * 16, dtype=np.uint8).reshape(8, 16) * 7 % 2**bits
    per = 8 // bits
    held = sum(samples[:, n::per] << (bits * (per - 1 - n)) for n in range(per))
    Image.fromarray(held.astype(np.uint8)).save(tmp_path / "a.tif", compression=packing)
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages[0].tags["ImageWidth"].overwrite(16)
        file.pages[0].tags["BitsPerSample"].overwrite(bits)
    np.testing.assert_array_equal(read(tmp_path / "a.tif").numpy()[0], samples)


def test_tiff_that_nothing_here_reads_says_what_does(tmp_path):
    if importlib.util.find_spec("imagecodecs"):
        pytest.skip("it reads it")
    image = Image.fromarray(np.ones((4, 5), np.int32))
    image.save(tmp_path / "a.tif", compression="tiff_lzw", tiffinfo={262: 0})
    with pytest.raises(ValueError, match=r"a\.tif: .* pip install imagecodecs"):
        read(tmp_path / "a.tif")


def test_tiff_in_which_0_is_white_is_the_same_however_packed(tmp_path):
    """What unpacks LZW turned samples round."""
    image = Image.fromarray(np.arange(20, dtype=np.uint8).reshape(4, 5))
    for packing in ("raw", "tiff_lzw"):
        image.save(tmp_path / f"{packing}.tif", compression=packing, tiffinfo={262: 0})
    plain, packed = (read(tmp_path / f"{name}.tif").numpy() for name in ("raw", "tiff_lzw"))
    assert plain[0, 0, 1] == 254
    np.testing.assert_array_equal(plain, packed)


@pytest.mark.parametrize(
    "options", [{}, {"chunks": (2, 3, 2), "compression": "gzip"}, {"chunks": True, "fletcher32": True}]
)
def test_hdf5(tmp_path, options):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("group/volume", data=FIELD, **options)
        file["group/volume"].attrs["element_size_um"] = SPACING[::-1]
        file["note"] = "text"
    check(read(tmp_path / "a.h5"), FIELD, SPACING, *PLAIN[1:])
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["times"] = TIMES
    with pytest.raises(
        ValueError, match=r"a\.h5 holds several arrays: scalars must name one of 'group/volume', 'times'"
    ):
        read(tmp_path / "a.h5")
    check(read(tmp_path / "a.h5", "/times", frame=1), TIMES[1], *PLAIN)


def test_hdf5_with_samples_elsewhere(tmp_path):
    """Nothing is made up, and no other file is read."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "sparse.h5", "w") as file:
        sparse = file.create_dataset("v", (1000, 1000, 1000), chunks=(10, 10, 10), dtype="u1")
        sparse[:10, :10, :10] = 1
    with h5py.File(tmp_path / "late.h5", "w") as file:
        file.create_dataset("v", (1000, 1000, 1000), dtype="u1")
    with h5py.File(tmp_path / "external.h5", "w") as file:
        file.create_dataset("v", (4, 3, 5), "i2", external=[(str(tmp_path / "s.raw"), 0, 120)])
    (tmp_path / "s.raw").write_bytes(LITTLE)
    for name, what in (("sparse", "chunks are missing"), ("late", "samples are missing"), ("external", "other files")):
        with pytest.raises(OSError, match=rf"{name}\.h5 .*{what}"):
            read(tmp_path / f"{name}.h5")


def test_npz(tmp_path):
    np.savez(tmp_path / "one.npz", volume=np.asfortranarray(FIELD))
    check(read(tmp_path / "one.npz"), FIELD, *PLAIN)
    np.savez_compressed(tmp_path / "two.npz", a=FIELD, b=FIELD + 1)
    check(read(tmp_path / "two.npz", "b"), FIELD + 1, *PLAIN)
    with pytest.raises(ValueError, match=r"two\.npz holds several arrays: scalars must name one of 'a', 'b'"):
        read(tmp_path / "two.npz")
    with pytest.raises(ValueError, match=r"'c' is not in .*two\.npz; there are 'a', 'b'"):
        read(tmp_path / "two.npz", "c")
    np.save(tmp_path / "o.npy", np.array([None], object), allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "o.npz", "w") as archive:
        archive.write(tmp_path / "o.npy", "o.npy")
    for name in ("o.npy", "o.npz"):
        with pytest.raises(OSError, match="Python objects"):
            read(tmp_path / name)


@pytest.mark.parametrize("color, bands", [(2, 3), (4, 2), (6, 4)])
def test_png_of_sixteen_bits_in_channels_is_refused(tmp_path, color, bands):
    """Of which Pillow keeps eight."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows = b"".join(b"\0" + FIELD[0, y].astype(">u2").repeat(bands).tobytes() for y in range(3))
    head = struct.pack(">IIBBBBB", 5, 3, 16, color, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    for name in ("a", "b"):
        (tmp_path / f"{name}.png").write_bytes(png)
    with pytest.raises(ValueError, match=r"a\.png has 16 bits a sample in . channels"):
        read(tmp_path)


@pytest.mark.parametrize("ending, dtype", [("png", "u1"), ("png", "u2"), ("bmp", "u1"), ("jpg", "u1")])
def test_folders_of_images(tmp_path, ending, dtype):
    array = np.concatenate([FIELD] * 3).astype(dtype)
    array[...] = np.arange(len(array))[:, None, None] * (20 if dtype == "u1" else 5000)  # JPEG keeps flat images
    for k, page in enumerate(array):
        Image.fromarray(page).save(tmp_path / f"slice{k}.{ending}")
    check(read(tmp_path), array, *PLAIN)
    assert len(read(tmp_path).files) == 12
    grey = np.repeat(array[0, :, :, None].astype("u1"), 3, axis=2)
    (tmp_path / "colours").mkdir()
    Image.fromarray(grey).save(tmp_path / "colours" / "a.png")
    check(read(tmp_path / "colours"), grey[None, ..., 0], *PLAIN)
    Image.fromarray(grey + np.array([0, 1, 2], np.uint8)).save(tmp_path / "colours" / "a.png")
    with pytest.raises(ValueError, match=r"a\.png, an image in colour, has 3 components"):
        read(tmp_path / "colours")


def test_a_slice_that_is_missing_is_warned_of(tmp_path):
    for k in (2, 4, 8, 10):
        tifffile.imwrite(tmp_path / f"day 3 slice {k}.tif", FIELD[0])
    with pytest.warns(UserWarning, match="no slice between day 3 slice 4.tif and day 3 slice 8.tif"):
        read(tmp_path)
    tifffile.imwrite(tmp_path / "day 3 slice 6.tif", FIELD[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(tmp_path)


def test_images_of_two_kinds_or_sizes(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FIELD[0])
    Image.fromarray(FIELD[0].astype("u1")).save(tmp_path / "b.png")
    with pytest.raises(ValueError, match="holds PNG and TIFF images"):
        read(tmp_path)


# --- Time -----------------------------------------------------------------------------------------------------------


def test_times(tmp_path):
    samples = TIMES.astype("<i2").tobytes()
    head = nrrd(samples).replace(b"dimension: 3", b"dimension: 4")
    first = head.replace(b"sizes: 5 3 4", b"sizes: 3 5 3 4\nkinds: list space space space")
    first = first.replace(b"directions: ", b"directions: none ")
    first = first[: -len(samples)] + np.moveaxis(TIMES, 0, -1).astype("<i2").tobytes()
    last = head.replace(b"sizes: 5 3 4", b"sizes: 5 3 4 3\nkinds: space space space time")
    last = last.replace(b"(0,0,3)\n", b"(0,0,3) none\n")
    space = head.replace(b"sizes: 5 3 4", b"sizes: 5 3 4 3").replace(b"superior\n", b"superior-time\n")
    space = space.replace(b"(0,1.5,0) (-2,0,0) (0,0,3)", b"(0,1.5,0,0) (-2,0,0,0) (0,0,3,0) (0,0,0,1)")
    space = space.replace(b"(10,20,30)", b"(10,20,30,0)")
    four = meta(samples).replace(b"NDims = 3", b"NDims = 4").replace(b"5 3 4", b"5 3 4 3")
    four = four.replace(b"1.5 2 3", b"1.5 2 3 1").replace(b"10 20 30", b"10 20 30 0")
    four = four.replace(b"0 1 0 -1 0 0 0 0 1", b"0 1 0 0 -1 0 0 0 0 0 1 0 0 0 0 1")
    for name, content in {
        "first.nrrd": first,
        "last.nrrd": last,
        "space.nrrd": space,
        "a.mha": four,
        "a.nii": nifti(samples, dims=(4, 5, 3, 4, 3)),
    }.items():
        path = tmp_path / name
        path.write_bytes(content)
        for time in range(3):
            check(read(path, frame=time), TIMES[time])
        with pytest.raises(ValueError, match=r"holds 3 volumes \(time\): pick one with frame=, from 0 to 2"):
            read(path)
        for wrong in (3, -1, 1.0, True):
            with pytest.raises(ValueError, match="frame must be an integer from 0 to 2"):
                read(path, frame=wrong)


def test_times_of_plain_arrays_and_tiff(tmp_path):
    np.save(tmp_path / "a.npy", TIMES)
    check(read(tmp_path / "a.npy", frame=1), TIMES[1], *PLAIN)
    array = TIMES.astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", array, imagej=True, metadata={"axes": "TZYX"})
    check(read(tmp_path / "a.tif", frame=2), array[2], *PLAIN)
    tifffile.imwrite(tmp_path / "b.ome.tif", array, metadata={"axes": "TZYX"})
    check(read(tmp_path / "b.ome.tif", frame=0), array[0], *PLAIN)
    np.save(tmp_path / "b.npy", FIELD)
    check(read(tmp_path / "b.npy", frame=0), FIELD, *PLAIN)
    with pytest.raises(ValueError, match="frame must be 0 or None for one volume"):
        read(tmp_path / "b.npy", frame=1)


# --- DICOM ----------------------------------------------------------------------------------------------------------


def test_dicom_series_in_time(tmp_path):
    for time in range(3):
        for k in range(4):
            dicom(tmp_path / f"{time}{k}", TIMES[time, k], (10, 20, 30 + 3 * k), number=4 * time + k)
    for time in range(3):
        check(read(tmp_path, frame=time), TIMES[time])
    (tmp_path / "12").unlink()
    with pytest.raises(ValueError, match="2 DICOM slices at the place of 02, 3 at that of 00: some are missing"):
        read(tmp_path)


def test_dicom_by_content(tmp_path):
    """Under any name, below a folder with nothing but a directory of it, without a suffix."""
    nested = tmp_path / "PAT0" / "ST0"
    nested.mkdir(parents=True)
    for k in range(4):
        dicom(nested / f"IM000{k}", FIELD[k], (10, 20, 30 + 3 * k), number=k)
    (tmp_path / "DICOMDIR").write_bytes(bytes(128) + b"DICM" + bytes(50))
    check(read(tmp_path))
    check(read(nested / "IM0002"), FIELD[2:3], spacing=(1.5, 2, 99), origin=(10, 20, 36))
    assert read(tmp_path).anatomical == "LPS"


def test_dicom_noise_of_orientations_is_none(tmp_path):
    for k in range(4):
        noise = 1e-5 * (-1) ** k
        dicom(tmp_path / str(k), FIELD[k], (10, 20, 30 + 3 * k), orientation=(noise, 1, -2e-10, -1, 0, noise))
    volume = read(tmp_path)
    np.testing.assert_allclose(volume.direction, TURNED, atol=1e-4)
    dicom(tmp_path / "3", FIELD[3], (10, 20, 39), orientation=(0.01, 1, 0, -1, 0.01, 0))
    with pytest.raises(ValueError, match=r"different orientation: 3 has \[.*\], 0 "):
        read(tmp_path)
    dicom(tmp_path / "3", FIELD[3], (10, 20, 39), spacing=(2.5, 1.5))
    with pytest.raises(ValueError, match=r"different spacing: 3 has \[2.5, 1.5\] mm, 0 \[2.0, 1.5\]"):
        read(tmp_path)
    dicom(tmp_path / "3", FIELD[3, :2], (10, 20, 39))
    with pytest.raises(ValueError, match=r"different size: 3 has \(2, 5\) samples, 0 \(3, 5\)"):
        read(tmp_path)


def test_dicom_gap_is_named(tmp_path):
    for k in (0, 1, 2, 4, 5):
        dicom(tmp_path / str(k), FIELD[0], (10, 20, 30 + 3 * k))
    with pytest.raises(ValueError, match="from 2 to 4 it is 6 mm, elsewhere 3 mm"):
        read(tmp_path)


def edited(path, **fields):
    pydicom = pytest.importorskip("pydicom")
    data = pydicom.dcmread(path)
    for name, value in fields.items():
        setattr(data, name, value)
    data.save_as(path)


def test_dicom_values_are_in_the_units_stated(tmp_path):
    path = tmp_path / "a.dcm"
    dicom(path, FIELD[0], ORIGIN)
    edited(path, RescaleSlope=None, RescaleIntercept=None)
    check(read(path), FIELD[:1], spacing=(1.5, 2, 99))
    edited(path, DoseGridScaling="1e-6")
    np.testing.assert_allclose(read(path).numpy(), FIELD[:1] * 1e-6, rtol=1e-6)


@pytest.mark.parametrize("offsets", [[0, 3, 6, 9], [30, 33, 36, 39]])
def test_dicom_of_several_frames(tmp_path, offsets):
    path = tmp_path / "a.dcm"
    dicom(path, FIELD[0], ORIGIN)
    edited(path, NumberOfFrames=4, PixelData=LITTLE, GridFrameOffsetVector=offsets)
    check(read(path))
    edited(path, FrameIncrementPointer=0x00181063)
    check(read(path, frame=3), FIELD[3:4], spacing=(1.5, 2, 99))


def test_enhanced_dicom(tmp_path):
    pydicom = pytest.importorskip("pydicom")

    def item(**fields):
        found = pydicom.Dataset()
        for name, value in fields.items():
            setattr(found, name, value)
        return pydicom.Sequence([found])

    path = tmp_path / "a.dcm"
    dicom(path, FIELD[0], (0, 0, 0))
    frames = [
        item(
            PlanePositionSequence=item(ImagePositionPatient=[10, 20, 30 + 3 * k]),
            PixelValueTransformationSequence=item(RescaleSlope=2, RescaleIntercept=k),
        )[0]
        for k in (3, 2, 1, 0)
    ]
    shared = item(
        PixelMeasuresSequence=item(PixelSpacing=[2, 1.5], SliceThickness=99),
        PlaneOrientationSequence=item(ImageOrientationPatient=[0, 1, 0, -1, 0, 0]),
    )
    fields = {"SharedFunctionalGroupsSequence": shared, "PerFrameFunctionalGroupsSequence": pydicom.Sequence(frames)}
    edited(path, NumberOfFrames=4, PixelData=FIELD[::-1].tobytes(), **fields)
    check(read(path), 2 * FIELD + np.arange(4)[:, None, None].astype(np.int16))


def test_dicom_whose_codec_is_not_there(tmp_path, monkeypatch):
    pydicom = pytest.importorskip("pydicom")
    path = tmp_path / "a.dcm"
    dicom(path, FIELD[0], ORIGIN)
    data = pydicom.dcmread(path)
    data.file_meta.TransferSyntaxUID = pydicom.uid.JPEGLSLossless
    data.PixelData = pydicom.encaps.encapsulate([b"\xff\xd8" + bytes(100)])
    data["PixelData"].is_undefined_length = True
    data.save_as(path)
    from pydicom.pixels.decoders import JPEGLSLosslessDecoder

    monkeypatch.setattr(JPEGLSLosslessDecoder, "_available", {})
    with pytest.raises(ImportError, match=r"a\.dcm is compressed \(JPEG-LS Lossless.*pip install 'wvr\[dicom\]'"):
        read(path)


def test_dicom_in_jpeg_2000(tmp_path):
    """Also with a box without a length, at which pydicom would look for ever."""
    pydicom = pytest.importorskip("pydicom")
    path, pixels, encoded = tmp_path / "a.dcm", FIELD[0].astype(np.uint8), io.BytesIO()
    Image.fromarray(pixels).save(encoded, "JPEG2000")
    dicom(path, pixels, ORIGIN)
    data = pydicom.dcmread(path)
    data.file_meta.TransferSyntaxUID = pydicom.uid.JPEG2000Lossless
    frame = encoded.getvalue()
    box = frame.index(b"ftyp") - 4
    for content in (frame, frame[:box] + bytes(4) + frame[box + 4 :]):
        data.PixelData = pydicom.encaps.encapsulate([content])
        data["PixelData"].is_undefined_length = True
        data.save_as(path)
        if content == frame:
            check(read(path), pixels[None], spacing=(1.5, 2, 99))
    with pytest.raises(OSError, match=r"a\.dcm .*a box of its JPEG 2000 is 0 bytes long"):
        read(path)


def test_nifti_forms_that_are_no_place(tmp_path):
    """Codes below 0 say nothing, as of 0; a form that is singular is not replaced without a word."""
    content = bytearray(nifti(LITTLE))
    content[254:256] = np.array([-3], "<i2").tobytes()
    (tmp_path / "a.nii").write_bytes(content)
    check(read(tmp_path / "a.nii"), origin=(0, 0, 0), direction=np.eye(3))
    content[254:256], content[280:292] = np.array([1], "<i2").tobytes(), bytes(12)
    (tmp_path / "a.nii").write_bytes(content)
    with pytest.raises(OSError, match=r"a\.nii .*its sform is .*which is no place in the world"):
        read(tmp_path / "a.nii")


def test_dicom_positions_are_three_numbers(tmp_path):
    for place in ([1, 2, 3, 4, 5, 6], [1, 2]):
        dicom(tmp_path / "a.dcm", FIELD[0], (1, 2, 3))
        edited(tmp_path / "a.dcm", ImagePositionPatient=place)
        with pytest.raises(OSError, match=r"a\.dcm .*its position must be three numbers"):
            read(tmp_path / "a.dcm")


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32", "float64"])
def test_text_may_be_shorter_than_what_it_says(tmp_path, dtype):
    """A digit and a space are a sample of up to eight bytes; VTK has bytes in text as parts of 255."""
    pyvista = pytest.importorskip("pyvista")
    samples = (np.arange(24, dtype=dtype) % 10).reshape(2, 3, 4)
    grid = pyvista.ImageData(dimensions=(4, 3, 2))
    grid["s"] = samples.ravel()
    for suffix in ("vtk", "vti"):
        grid.save(tmp_path / f"a.{suffix}", binary=False)
    text = " ".join(map(str, samples.astype(int).ravel()))
    kind = {"uint8": "uchar", "int16": "short", "float32": "float", "float64": "double"}[dtype]
    head = f"NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 4 3 2\nencoding: ascii\n\n"
    (tmp_path / "a.nrrd").write_text(head + text)
    head = f"ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_{kind.upper()}\nBinaryData = False\n"
    (tmp_path / "a.mha").write_text(f"{head}ElementDataFile = LOCAL\n{text}")
    for name in ("a.vtk", "a.vti", "a.nrrd", "a.mha"):
        array = read(tmp_path / name).numpy()
        assert array.dtype == dtype and np.array_equal(array, samples), name


TEXT = " ".join(map(str, FIELD.ravel())).encode()


@pytest.mark.parametrize(
    "content",
    [
        amira(LITTLE),
        amira(BIG, "BINARY"),
        amira(TEXT, "ASCII"),
        amira(zlib.compress(LITTLE), packing=f"(HxZip,{len(zlib.compress(LITTLE))})"),
        amira(LITTLE, before=bytes(8 * 60)),
        amira(TEXT, "3D ASCII", before=b"0 1\n" * 60),
    ],
    ids=["little", "big", "text", "zip", "second", "second of text"],
)
def test_amira(tmp_path, content):
    """Samples and places as the format's description has them, in every packing and behind another array."""
    (tmp_path / "a.am").write_bytes(content)
    check(read(tmp_path / "a.am", "Data"))
    if b"Flow" in content:
        with pytest.raises(ValueError, match=r"a\.am: .* pick one with scalars=, of Flow, Data"):
            read(tmp_path / "a.am")
        with pytest.raises(ValueError, match="2 components"):
            read(tmp_path / "a.am", "Flow")


def test_amira_labels_in_runs(tmp_path):
    labels = np.repeat(np.arange(60, dtype=np.uint8) % 7, np.arange(60) % 5)[:60].reshape(FIELD.shape)
    packed = runs(labels.tobytes())
    content = amira(packed, kind="byte", packing=f"(HxByteRLE,{len(packed)})")
    (tmp_path / "a.am").write_bytes(content)
    check(read(tmp_path / "a.am"), labels)
    (tmp_path / "b.am").write_bytes(content[:-5])
    with pytest.raises(OSError, match=r"b\.am is truncated or corrupt: .* packed bytes, 4 are missing"):
        read(tmp_path / "b.am")
    (tmp_path / "c.am").write_bytes(content.replace(b"Lattice 5 3 4", b"Lattice 5 3 3"))
    with pytest.raises(OSError, match=r"c\.am holds more than it declares"):
        read(tmp_path / "c.am")


@pytest.mark.parametrize(
    "old, new, said",
    [
        (b'CoordType "uniform"', b'CoordType "curvilinear"', "uniform coordinates"),
        (b"AmiraMesh", b"HyperSurface", "no header of an AmiraMesh"),
        (b"{ short", b"{ complex", "'complex' of its array 'Data' is none of byte"),
        (b" } @1", b" } @1(HxLZ4,120)", "packed by 'HxLZ4'"),
        (b" } @1", b" } @1(HxByteRLE,120)", "packed by runs of bytes"),
        (b" } @1", b" } @3", "data begin with @1, which its header does not declare"),
        (b"0 6 0 4 0 9", b"0 6 0 4", "BoundingBox must be 6 numbers"),
        (b"10 20 30 1", b"10 20 30 2", "no affine"),
        (b"Lattice 5 3 4", b"Lattice 5 3 5", "150 bytes, and holds 121"),
        (b"Lattice 5 3 4", b"Lattice 5 3 3", "31 or more bytes after"),
        (b"Lattice 5 3 4", b"Lattice 5 3", "three dimensions"),
    ],
)
def test_amira_files_that_are_not_read(tmp_path, old, new, said):
    content = amira(LITTLE)
    assert old in content
    (tmp_path / "a.am").write_bytes(content.replace(old, new))
    with pytest.raises((OSError, ValueError), match=rf"a\.am.*{said}"):
        read(tmp_path / "a.am")


@pytest.mark.parametrize("by", [read, wvr.open])
def test_hdf5_in_frail_filters(tmp_path, by):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("v", data=FIELD, chunks=(2, 2, 2), scaleoffset=0)
    with pytest.raises(ValueError, match=r"a\.h5.*'v' is packed by scaleoffset.*h5repack"):
        by(tmp_path / "a.h5")
