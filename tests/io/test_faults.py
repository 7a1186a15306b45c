"""Files that lie about what they hold: what is read is theirs and right, or refused before memory is taken for it."""

from __future__ import annotations

import base64
import bz2
import gzip
import io
import lzma
import os
import socket
import tracemalloc
import zlib
from contextlib import contextmanager

import numpy as np
import pytest
import tifffile
from PIL import Image

from wvr.io import read, read_raw

from .files import BIG, FIELD, LITTLE, check, dicom, image, legacy, meta, nifti, npy, nrrd, vti

MIB = 1 << 20


@contextmanager
def memory(most: int):
    """What is done within takes no more than so many bytes."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < most


@pytest.fixture
def little_memory():
    with memory(16 * MIB):
        yield


# --- VTK ------------------------------------------------------------------------------------------------------------


def replaced(path, old: bytes, new: bytes):
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))


@pytest.mark.parametrize("compress", [True, False])
@pytest.mark.parametrize("mode, encode", [("appended", False), ("appended", True), ("binary", False), ("ascii", False)])
@pytest.mark.parametrize(
    "old, new",
    [
        (b'Piece Extent="0 4 0 2 0 3"', b'Piece Extent="0 4 0 2 0 2"'),
        (b'Piece Extent="0 4 0 2 0 3"', b'Piece Extent="0 4 0 2 0 4"'),
        (b'Piece Extent="0 4 0 2 0 3"', b'Piece Extent="0 99999 0 99999 0 99999"'),
        (b'WholeExtent="0 4 0 2 0 3"', b'WholeExtent="0 4 0 2 0 7"'),
        (b'WholeExtent="0 4 0 2 0 3"', b'WholeExtent="0 99999 0 99999 0 99999"'),
        (b'0 4 0 2 0 3"', b'0 4 0 2 0 x"'),
        (b"Int16", b"Int32"),
        (b"Int16", b"Float64"),
    ],
)
def test_vti_whose_parts_do_not_fit(tmp_path, little_memory, compress, mode, encode, old, new):
    path = tmp_path / "a.vti"
    vti(path, mode=mode, encode=encode, compress=compress)
    replaced(path, old, new)
    if mode == "ascii" and old == b"Int16":  # numbers are of any type
        assert read(path).range == (FIELD.min(), FIELD.max())
        return
    with pytest.raises(OSError, match=r"a\.vti is truncated or corrupt"):
        read(path)


def test_vti_whose_whole_is_as_large_as_its_pieces(tmp_path, little_memory):
    """Extents that agree with each other and not with the samples."""
    path = tmp_path / "a.vti"
    vti(path)
    for word in (b"WholeExtent", b"Piece Extent"):
        replaced(path, word + b'="0 4 0 2 0 3"', word + b'="0 99999 0 99999 0 99999"')
    with pytest.raises(OSError, match=r"a\.vti is truncated or corrupt"):
        read(path)


@pytest.mark.parametrize("compress", [True, False])
def test_vti_with_other_offsets(tmp_path, compress):
    vti(tmp_path / "good.vti", compress=compress)
    path = tmp_path / "a.vti"
    for offset in (-1, 1, 4, 10**6, 2**63, 2**64):
        path.write_bytes((tmp_path / "good.vti").read_bytes().replace(b'offset="0"', b'offset="%d"' % offset))
        with pytest.raises(OSError, match=r"a\.vti is truncated or corrupt"):
            read(path)


@pytest.mark.parametrize("junk", [b"!", b"\0", b"=", "é".encode(), b"AAAA"])
def test_vti_with_junk_in_its_base64(tmp_path, junk):
    path = tmp_path / "a.vti"
    vti(path, mode="binary", compress=False)
    content = path.read_bytes()
    start = content.index(b"eAAAA")  # 120 bytes follow
    for place in (start, start + 2, start + 40):
        path.write_bytes(content[:place] + junk + content[place + len(junk) :])
        try:
            array = read(path).numpy()
        except OSError as error:
            assert "a.vti" in str(error)
        else:  # base64 of something else, as the file says
            assert junk == b"AAAA" and np.count_nonzero(array != FIELD) <= 3


def test_vti_of_pieces(tmp_path):
    """The same as in one."""
    lower, upper = FIELD[:3], FIELD[2:]

    def piece(extent, part):
        data = np.array([part.nbytes], "<u4").tobytes() + part.astype("<i2").tobytes()
        return (
            f'<Piece Extent="{extent}"><PointData Scalars="s"><DataArray type="Int16" Name="s" format="binary">'
            f"{base64.b64encode(data).decode()}</DataArray></PointData></Piece>"
        )

    head = '<VTKFile type="ImageData" byte_order="LittleEndian"><ImageData WholeExtent="0 4 0 2 0 3" '
    head += 'Origin="10 20 30" Spacing="1.5 2 3" Direction="0 -1 0 1 0 0 0 0 1">'
    whole = head + piece("0 4 0 2 0 2", lower) + piece("0 4 0 2 2 3", upper) + "</ImageData></VTKFile>"
    (tmp_path / "a.vti").write_text(whole)
    check(read(tmp_path / "a.vti"))
    (tmp_path / "a.vti").write_text(whole.replace('"0 4 0 2 2 3"', '"0 4 0 2 1 2"'))
    with pytest.raises(OSError, match=r"leave 15 of 60 samples open"):
        read(tmp_path / "a.vti")
    # Streams of header and samples may also be apart.
    apart = base64.b64encode(np.array([lower.nbytes], "<u4").tobytes()) + base64.b64encode(
        lower.astype("<i2").tobytes()
    )
    joined = base64.b64encode(np.array([lower.nbytes], "<u4").tobytes() + lower.astype("<i2").tobytes())
    (tmp_path / "a.vti").write_text(whole.replace(joined.decode(), apart.decode()))
    check(read(tmp_path / "a.vti"))


@pytest.mark.parametrize("kind", ["LZ4", "LZMA", "ZLib"])
def test_vti_by_every_compressor(tmp_path, kind):
    import vtk

    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputData(image())
    writer.SetFileName(str(tmp_path / "a.vti"))
    getattr(writer, f"SetCompressorTypeTo{kind}")()
    writer.SetBlockSize(48)
    writer.Write()
    check(read(tmp_path / "a.vti"))


@pytest.mark.parametrize("entity", [b"<!DOCTYPE a [<!ENTITY x 'y'>]>", b"<!DOCTYPE a SYSTEM '/etc/passwd'>"])
def test_xml_with_a_document_type(tmp_path, entity):
    vti(tmp_path / "a.vti")
    replaced(tmp_path / "a.vti", b"<VTKFile", entity + b"<VTKFile")
    with pytest.raises(OSError, match="document type"):
        read(tmp_path / "a.vti")


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize(
    "dimensions", [b"5 3 5", b"99999 99999 99999", b"2147483647 2147483647 2", b"0 3 4", b"-5 -3 4"]
)
def test_legacy_vtk_whose_dimensions_do_not_fit(tmp_path, little_memory, binary, dimensions):
    path = tmp_path / "a.vtk"
    legacy(path, image(), binary)
    replaced(path, b"DIMENSIONS 5 3 4", b"DIMENSIONS " + dimensions)
    with pytest.raises(OSError, match=r"a\.vtk is truncated or corrupt"):
        read(path)
    count = int(np.prod([int(n) for n in dimensions.split()], dtype=object))
    replaced(path, b"POINT_DATA 60", b"POINT_DATA %d" % count)
    with pytest.raises(OSError, match=r"a\.vtk is truncated or corrupt"):
        read(path)


def test_legacy_vtk_with_other_attributes(tmp_path):
    grid = image()
    for name, components in (("v", 3), ("t", 9), ("one", 1)):
        grid.point_data[name] = np.zeros((60, components), np.float32).squeeze()
    grid.cell_data["cells"] = np.arange(24.0)
    grid.field_data["f"] = [1.0, 2.0]
    grid.set_active_scalars("values")
    for binary in (True, False):
        legacy(tmp_path / "a.vtk", grid, binary)
        check(read(tmp_path / "a.vtk"), direction=np.eye(3))
        np.testing.assert_array_equal(read(tmp_path / "a.vtk", "cells").numpy().ravel(), np.arange(24.0))
        with pytest.raises(ValueError, match="3 components"):
            read(tmp_path / "a.vtk", "v")


# --- Sides, units and values ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "space, signs, world",
    [
        ("left-posterior-superior", (1, 1, 1), "LPS"),
        ("LPS", (1, 1, 1), "LPS"),
        ("left-anterior-superior", (1, -1, 1), "LPS"),
        ("LAS", (1, -1, 1), "LPS"),
        ("right-anterior-superior", (1, 1, 1), "RAS"),
        ("right-posterior-superior", (1, -1, 1), "RAS"),
        ("left-posterior-inferior", (1, 1, -1), "LPS"),
        ("3D-left-handed", (1, 1, -1), ""),
        ("3D-right-handed", (1, 1, 1), ""),
        ("scanner-xyz", (1, 1, 1), ""),
    ],
)
def test_nrrd_in_left_handed_spaces(tmp_path, space, signs, world):
    """The same patient, wherever the axes of the file go: not the mirror image."""
    vectors = (np.array([(0, 1.5, 0), (-2, 0, 0), (0, 0, 3)]) * signs).tolist()
    origin = (np.array([10, 20, 30]) * signs).tolist()
    text = [f"({','.join(map(str, vector))})" for vector in (*vectors, origin)]
    content = nrrd(LITTLE).replace(b"left-posterior-superior", space.encode())
    content = content.replace(b"(0,1.5,0) (-2,0,0) (0,0,3)", " ".join(text[:3]).encode())
    (tmp_path / "a.nrrd").write_bytes(content.replace(b"(10,20,30)", text[3].encode()))
    check(read(tmp_path / "a.nrrd"))
    assert read(tmp_path / "a.nrrd").anatomical == world


def test_nrrd_in_unknown_spaces(tmp_path):
    (tmp_path / "a.nrrd").write_bytes(nrrd(LITTLE).replace(b"left-posterior-superior", b"upside-down"))
    with pytest.raises(ValueError, match=r"a\.nrrd: its space 'upside-down' is unknown"):
        read(tmp_path / "a.nrrd")


def test_nrrd_byte_orders(tmp_path):
    path = tmp_path / "a.nrrd"
    path.write_bytes(nrrd(BIG, more="endian: BIG\n"))
    check(read(path))
    path.write_bytes(nrrd(LITTLE).replace(b"endian: little\n", b""))
    with pytest.raises(OSError, match="samples of int16 need the field 'endian: little' or 'endian: big'"):
        read(path)
    path.write_bytes(nrrd(LITTLE, more="endian: middle\n"))
    with pytest.raises(OSError, match="endian must be little or big, got 'middle'"):
        read(path)


def test_nrrd_with_unknown_spacing(tmp_path):
    (tmp_path / "a.nrrd").write_bytes(nrrd(LITTLE, place=False, more="spacings: 2 NaN 2.4\n"))
    check(read(tmp_path / "a.nrrd"), spacing=(2, 1, 2.4), origin=(0, 0, 0), direction=np.eye(3))


def test_units_that_differ_between_axes(tmp_path):
    plain = {"origin": (0, 0, 0), "direction": np.eye(3)}
    (tmp_path / "a.nrrd").write_bytes(nrrd(LITTLE, place=False, more='spacings: 250 250 1.5\nunits: "nm" "nm" "um"\n'))
    check(read(tmp_path / "a.nrrd"), spacing=(250, 250, 1500), **plain)
    array = FIELD.astype(np.uint16)
    metadata = {"axes": "ZYX", "spacing": 1.5, "unit": "nm", "zunit": "um"}
    tifffile.imwrite(tmp_path / "a.tif", array, imagej=True, resolution=(1 / 250, 1 / 250), metadata=metadata)
    check(read(tmp_path / "a.tif"), array, spacing=(250, 250, 1500), **plain)
    metadata = {"axes": "ZYX", "PhysicalSizeX": 250, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 250}
    metadata |= {"PhysicalSizeYUnit": "nm", "PhysicalSizeZ": 1.5, "PhysicalSizeZUnit": "µm"}
    tifffile.imwrite(tmp_path / "a.ome.tif", array, metadata=metadata)
    check(read(tmp_path / "a.ome.tif"), array, spacing=(250, 250, 1500), **plain)
    metadata = {"axes": "ZYX", "spacing": 1.5, "unit": "nm", "zunit": "sec"}
    tifffile.imwrite(tmp_path / "b.tif", array, imagej=True, metadata=metadata)
    with pytest.raises(ValueError, match=r"b\.tif: its axes are in 'nm', 'nm', 'sec', and 'sec' is no unit of length"):
        read(tmp_path / "b.tif")


def test_rescaling_does_not_wrap(tmp_path):
    array = np.full((4, 3, 5), 2**64 - 3, np.uint64)
    (tmp_path / "a.nii").write_bytes(nifti(array.tobytes(), code=1280, bits=64, slope=1, intercept=-1))
    with pytest.raises(ValueError, match=r"a\.nii: samples from 18446744073709551612 .* are beyond 2\*\*53"):
        read(tmp_path / "a.nii")
    array = np.full((4, 3, 5), 2**63, np.uint64)
    (tmp_path / "a.nii").write_bytes(nifti(array.tobytes(), code=1280, bits=64, slope=1, intercept=-(2.0**62)))
    with pytest.raises(ValueError, match=rf"from {2**62} .* are beyond 2\*\*53"):
        read(tmp_path / "a.nii")


def test_meta_image_with_an_intensity_function(tmp_path):
    more = "ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = -1\n"
    (tmp_path / "a.mha").write_bytes(meta(LITTLE, more=more))
    check(read(tmp_path / "a.mha"), FIELD * 2 - 1)


# --- Names ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["größe.raw", "a 5 %.raw", "100%d", "体积.raw"])
def test_names_of_data_files(tmp_path, name):
    (tmp_path / name).write_bytes(LITTLE)
    (tmp_path / "a.nhdr").write_bytes(nrrd(b"", more=f"data file: {name}\n"))
    (tmp_path / "a.mhd").write_bytes(meta(b"", file="NAME").replace(b"NAME", name.encode()))
    for header in ("a.nhdr", "a.mhd"):
        check(read(tmp_path / header))
        assert {file.name for file in read(tmp_path / header).files} == {header, name}


def test_patterns_of_data_files(tmp_path):
    (tmp_path / "a.nhdr").write_bytes(nrrd(b"", more="data file: s%03d.raw 1 9 1\n"))
    (tmp_path / "b.nhdr").write_bytes(nrrd(b"", more="data file: LIST\ns1.raw\n"))
    (tmp_path / "a.mhd").write_bytes(meta(b"", file="s%03d.raw 1 9 1"))
    (tmp_path / "b.mhd").write_bytes(meta(b"", file="LIST"))
    for name in ("a.nhdr", "b.nhdr", "a.mhd", "b.mhd"):
        with pytest.raises((ValueError, OSError), match=rf"{name}.*"):
            read(tmp_path / name)


# --- Sizes ----------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
@pytest.mark.parametrize(
    "ending", ["nrrd", "mha", "nii", "vti", "vtk", "tif", "npy", "npz", "h5", "mrc", "mgz", "dcm", "am", "xyz"]
)
def test_only_regular_files_are_opened(tmp_path, ending):
    pipe, device = tmp_path / f"pipe.{ending}", tmp_path / f"zero.{ending}"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for path, kind in ((pipe, "pipe"), (device, "device")):
        with pytest.raises(OSError, match=rf"{path.name} is a {kind}, a regular file is expected"):
            read(path)
        with pytest.raises(OSError, match=rf"{path.name} is a {kind}, a regular file is expected"):
            read_raw(path, (4, 3, 5), "int16")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
def test_only_regular_data_files_are_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as one:
        os.chdir(tmp_path)  # names of sockets are short
        one.bind("socket")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name, kind in (("pipe", "pipe"), ("zero", "device"), ("socket", "socket"), (".", "folder")):
        (tmp_path / "a.nhdr").write_bytes(nrrd(b"", more=f"data file: {name}\n"))
        (tmp_path / "a.mhd").write_bytes(meta(b"", file=name))
        for header in ("a.nhdr", "a.mhd"):
            with pytest.raises(OSError, match=f"is a {kind}, a regular file is expected"):
                read(tmp_path / header)


@pytest.mark.parametrize("count", [-1, 0, 1, 100])
def test_more_and_less_than_declared(tmp_path, count):
    """However it is packed; what is there too much is counted, where that costs nothing."""
    samples = LITTLE[:count] if count < 0 else LITTLE + bytes(count)
    text = " ".join(map(str, np.frombuffer(samples[: len(samples) // 2 * 2], "<i2"))).encode()
    files = {
        "raw.nrrd": nrrd(samples),
        "gzip.nrrd": nrrd(gzip.compress(samples), "gzip"),
        "bzip2.nrrd": nrrd(bz2.compress(samples), "bzip2"),
        "raw.mha": meta(samples),
        "zlib.mha": meta(zlib.compress(samples), True),
        "raw.nii": nifti(samples),
        "gzip.nii.gz": gzip.compress(nifti(samples)),
        "a.npy": npy(FIELD)[:128] + samples,
        "text.nrrd": nrrd(text, "ascii"),
    }
    for name, content in files.items():
        if name == "text.nrrd" and abs(count) == 1:
            continue
        (tmp_path / name).write_bytes(content)
        if count == 0:
            np.testing.assert_array_equal(read(tmp_path / name).numpy(), FIELD)
            continue
        what = "is truncated or corrupt: it declares" if count < 0 else "holds more than it declares: "
        with pytest.raises(OSError, match=rf"{name} {what}"):
            read(tmp_path / name)


@pytest.mark.parametrize(
    "sizes", ["2 2 -1", "0 3 4", "5 3", "5 3 4 4", "1e3 3 4", "999 999 999", "99999 99999 99999", f"{2**63} 2 2"]
)
@pytest.mark.parametrize("encoding", ["raw", "ascii", "gzip", "bzip2"])
def test_sizes_that_cannot_be(tmp_path, little_memory, sizes, encoding):
    packed = {"raw": LITTLE, "ascii": b"1 2 3 4", "gzip": gzip.compress(LITTLE), "bzip2": bz2.compress(LITTLE)}[
        encoding
    ]
    (tmp_path / "a.nrrd").write_bytes(nrrd(packed, encoding).replace(b"sizes: 5 3 4", f"sizes: {sizes}".encode()))
    with pytest.raises((OSError, MemoryError), match=r"a\.nrrd"):
        read(tmp_path / "a.nrrd")


def test_shapes_of_arrays_that_cannot_be(tmp_path, little_memory):
    content = npy(FIELD)
    for shape in ("(4, 3, 6)", "(9, 9, 99)", "(4, -3, -5)", "(4, 0, 5)"):
        (tmp_path / "a.npy").write_bytes(content.replace(b"(4, 3, 5), }  ", f"({shape[1:]}, }}".encode().ljust(14)))
        with pytest.raises((OSError, ValueError), match=r"a\.npy"):
            read(tmp_path / "a.npy")


def test_bombs_are_not_inflated(tmp_path):
    """No more is unpacked than was declared."""
    bomb = bz2.compress(bytes(100 * MIB))
    (tmp_path / "a.nrrd").write_bytes(nrrd(bomb, "bzip2"))
    (tmp_path / "b.nrrd").write_bytes(nrrd(gzip.compress(bytes(100 * MIB)), "gzip"))
    (tmp_path / "a.mha").write_bytes(meta(zlib.compress(bytes(100 * MIB)), True))
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(nifti(LITTLE) + bytes(100 * MIB)))
    for name in ("a.nrrd", "b.nrrd", "a.mha", "a.nii.gz"):
        with memory(16 * MIB), pytest.raises(OSError, match=rf"{name} holds more than it declares"):
            read(tmp_path / name)


def test_readers_are_linear(tmp_path):
    """These take hours where every line or member copies the rest."""
    (tmp_path / "a.nrrd").write_bytes(nrrd(b"\n" * 1_000_000 + LITTLE, more="line skip: 1000000\n"))
    check(read(tmp_path / "a.nrrd"))
    (tmp_path / "b.nrrd").write_bytes(nrrd(gzip.compress(b"") * 100_000 + gzip.compress(LITTLE), "gzip"))
    check(read(tmp_path / "b.nrrd"))
    (tmp_path / "c.nrrd").write_bytes(nrrd(b"\n", more="line skip: 1000000000000\n"))
    with pytest.raises(OSError, match=r"c\.nrrd .*lines are to be skipped"):
        read(tmp_path / "c.nrrd")


def test_every_error_names_the_file(tmp_path):
    """Also those of the volume that comes of it."""
    files = {
        "spacing.mha": meta(LITTLE).replace(b"1.5 2 3", b"1.5 0 3"),
        "far.mha": meta(LITTLE).replace(b"1.5 2 3", b"1.5 1e200 3"),
        "flat.mha": meta(LITTLE).replace(b"0 1 0 -1 0 0 0 0 1", b"1 0 0 1 0 0 0 0 1"),
        "nan.npy": npy(np.full((2, 2, 2), np.nan)),
        "flat.npy": npy(np.zeros((2, 2))),
        "complex.npy": npy(np.zeros((2, 2, 2), complex)),
        "text.npy": npy(np.full((2, 2, 2), "a")),
        "hex.nrrd": nrrd(b"00", "hex"),
        "field.nrrd": nrrd(LITTLE).replace(b"type: short\n", b""),
        "type.nrrd": nrrd(LITTLE, kind="block"),
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises((OSError, ValueError, TypeError), match=name):
            read(tmp_path / name)
    with pytest.raises(ValueError, match=r"hex\.nrrd has the encoding 'hex'; raw, gzip"):
        read(tmp_path / "hex.nrrd")
    with pytest.raises(OSError, match=r"field\.nrrd .* its header lacks the field 'type'"):
        read(tmp_path / "field.nrrd")


@pytest.mark.parametrize(
    "arguments, kind",
    [
        ({"shape": 5}, ValueError),
        ({"shape": ("a", 1, 1)}, ValueError),
        ({"shape": (float("inf"), 1, 1)}, ValueError),
        ({"dtype": "no"}, TypeError),
        ({"dtype": object}, TypeError),
        ({"dtype": "complex64"}, TypeError),
        ({"offset": 1.5}, ValueError),
        ({"shape": (2**40, 2**40, 2**40)}, OSError),
    ],
)
def test_raw_arguments(tmp_path, arguments, kind):
    (tmp_path / "a.raw").write_bytes(LITTLE)
    with pytest.raises(kind, match=f"{next(iter(arguments))}|a\\.raw"):
        read_raw(tmp_path / "a.raw", **{"shape": (4, 3, 5), "dtype": "int16"} | arguments)


def test_samples_in_odd_places(tmp_path):
    """What a header names is said together with the header."""
    for name, content in (("a.nhdr", nrrd(b"", more="data file: NAME\n")), ("a.mhd", meta(b"", file="NAME"))):
        for place in (b".", b"x" * 5000, b"a\0b", b"none.raw"):
            (tmp_path / name).write_bytes(content.replace(b"NAME", place))
            with pytest.raises(OSError, match=name):
                read(tmp_path / name)


# --- More than is declared, in what others unpack -------------------------------------------------------------------


def test_tiff_strips_are_no_bombs(tmp_path):
    """A strip that inflates to far more than its page, which would be taken as a whole."""
    path = tmp_path / "a.tif"
    for compression, packed in (("zlib", zlib.compress(bytes(70 * MIB), 9)), ("lzma", lzma.compress(bytes(70 * MIB)))):
        tifffile.imwrite(path, np.zeros((64, 64), np.uint8), compression=compression)
        check(read(path), np.zeros((1, 64, 64), np.uint8), (1, 1, 1), (0, 0, 0), np.eye(3))
        content = bytearray(path.read_bytes())
        with tifffile.TiffFile(path) as file:
            for name, value in (("StripOffsets", len(content)), ("StripByteCounts", len(packed))):
                tag = file.pages[0].tags[name]
                content[tag.offset + 2 : tag.offset + 4] = b"\4\0"
                content[tag.valueoffset : tag.valueoffset + 4] = value.to_bytes(4, "little")
        path.write_bytes(content + packed)
        with memory(16 * MIB), pytest.raises(OSError, match=r"a\.tif .*a strip of its samples holds more than"):
            read(path)


def test_deflated_dicom_is_no_bomb(tmp_path):
    pydicom = pytest.importorskip("pydicom")
    path = tmp_path / "a.dcm"
    dicom(path, FIELD[0], (10, 20, 30))
    data = pydicom.dcmread(path)
    data.file_meta.TransferSyntaxUID = pydicom.uid.DeflatedExplicitVRLittleEndian
    data.save_as(path)
    check(read(path), FIELD[:1], spacing=(1.5, 2, 99))
    data.add_new(0x7FE10010, "OB", bytes(60 * MIB))
    data.save_as(path)
    del data
    with memory(40 * MIB), pytest.raises(OSError, match=r"a\.dcm .*more in it than the image that it declares"):
        read(path)


def test_frames_of_dicom_are_as_large_as_declared(tmp_path):
    """1.2 kB of JPEG 2000 that would unpack into 700 MB."""
    pydicom = pytest.importorskip("pydicom")
    path, encoded = tmp_path / "a.dcm", io.BytesIO()
    Image.fromarray(np.zeros((3000, 3000), np.uint8)).save(encoded, "JPEG2000")
    dicom(path, FIELD[0].astype(np.uint8), (10, 20, 30))
    data = pydicom.dcmread(path)
    data.file_meta.TransferSyntaxUID = pydicom.uid.JPEG2000Lossless
    data.PixelData = pydicom.encaps.encapsulate([encoded.getvalue()])
    data["PixelData"].is_undefined_length = True
    data.save_as(path)
    with memory(4 * MIB), pytest.raises(OSError, match=r"header says 5 x 3 pixels, a frame has 3000 x 3000"):
        read(path)


def test_dicom_images_without_rows(tmp_path):
    """A damaged slice is not left out; what is no image is."""
    pydicom = pytest.importorskip("pydicom")
    for k in range(4):
        dicom(tmp_path / str(k), FIELD[k], (10, 20, 30 + 3 * k), number=k)
    data = pydicom.dcmread(tmp_path / "3")
    del data.Rows
    data.save_as(tmp_path / "3")
    with pytest.raises(OSError, match=r"3 is truncated or corrupt: it is of CT Image Storage and has no image"):
        read(tmp_path)
    data.SOPClassUID = pydicom.uid.BasicTextSRStorage
    data.save_as(tmp_path / "3")
    check(read(tmp_path), FIELD[:3])


def test_fields_that_are_there_twice(tmp_path):
    """Which of them is meant, nobody knows."""
    (tmp_path / "a.nrrd").write_bytes(nrrd(LITTLE, more="sizes: 3 5 4\n"))
    with pytest.raises(OSError, match="its header has the field 'sizes' twice"):
        read(tmp_path / "a.nrrd")
    (tmp_path / "a.nrrd").write_bytes(nrrd(LITTLE, more="spacings: 1 1 1\nkey:=value\nkey:=other\n"))
    check(read(tmp_path / "a.nrrd"))
