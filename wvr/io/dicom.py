"""DICOM, by pydicom: a file with one or many frames, or a folder with one series, known by content and not by name."""

from __future__ import annotations

import errno
import warnings
from collections.abc import Iterable
from contextlib import suppress
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, Unsupported, components_error, rescaled
from .bytes import CHUNK, Flaw, Inflating, corrupt, empty, guess, opened

# Directions that differ by less are one: scanners write them rounded, each file on its own.
NOISE = 1e-4
# How far a slice may be from where it is expected, in parts of their distance.
UNEVEN = 0.02
# How many files below a folder are looked at.
MOST_FILES = 20_000
# Transfer syntaxes without compression of pixels.
RAW = ("1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.1.99", "1.2.840.10008.1.2.2")
# The one in which the whole file is deflated, and how much of that may be about the pixels [bytes], which begin here.
DEFLATED, DESCRIBED, PIXELS = b"1.2.840.10008.1.2.1.99", 1 << 24, 0x7FE00008
# Who may unpack compressed pixels, first choice first. GDCM is not among them: damaged files end the process.
DECODERS = ("pydicom", "pillow", "pylibjpeg")
# The frame's time is what goes from frame to frame.
FRAME_TIMES = (0x00181063, 0x00181065)


def read_dicom(path: Path) -> Grid:
    return _grid(path, _slices(path))


def read_dicom_folder(path: Path) -> Grid:
    files = dicom_files(path)
    return _grid(path, [one for file in files for one in _slices(file)])


def dicom_files(folder: Path, below: bool = True) -> list[Path]:
    """Those in a folder or, where it has none, in the folders ``below`` it; a directory of them is none."""
    for files in (folder.iterdir(), islice(folder.rglob("*"), MOST_FILES) if below else ()):
        if found := [file for file in sorted(files) if file.name != "DICOMDIR" and is_dicom(file)]:
            return found
    return []


def is_dicom(path: Path) -> bool:
    """Whether a file says so, in its content or its name."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM" or path.suffix.lower() == ".dcm"


class Slice(NamedTuple):
    """One image: of which file and series, its samples, where it is [mm], and what orders those without a place."""

    path: Path
    series: str
    array: NDArray
    row: NDArray[np.float64]
    column: NDArray[np.float64]
    spacing: tuple[float, float]  # between rows, between columns
    place: Any  # x, y, z, or None
    thickness: float
    order: tuple[float, float]  # time, number


def _slices(path: Path) -> list[Slice]:
    """The images of a file, in units that it states; none of a file without any, such as a directory."""
    try:
        import pydicom
    except ImportError as error:
        raise ImportError("reading DICOM needs the package pydicom: pip install pydicom") from error

    with opened(path) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of values that are not as the standard wants them
        _check_deflated(file)
        try:
            head = pydicom.dcmread(file)
        except pydicom.errors.InvalidDicomError:
            file.seek(0)
            head = pydicom.dcmread(file, force=True)  # older files begin without a preamble
            if "SOPClassUID" not in head:
                raise Flaw("no DICOM header at its start") from None
        if "Rows" not in head:
            kind = getattr(head.get("SOPClassUID"), "name", "")
            if "Image Storage" in kind:
                raise Flaw(f"it is of {kind} and has no image")
            return []
        components = int(head.get("SamplesPerPixel") or 1)
        if components > 1:
            raise components_error(str(path), components)
        pixels = _pixels(path, head)
        return [_frame(path, head, pixels[k], k) for k in range(len(pixels))]


def _pixels(path: Path, head: Any) -> NDArray:
    """The stored samples (frame, y, x)."""
    name = next((n for n in ("PixelData", "FloatPixelData", "DoubleFloatPixelData") if n in head), None)
    if name is None:
        raise Flaw("it has no pixel data")
    shape = int(head.get("NumberOfFrames") or 1), int(head.Rows), int(head.Columns)
    bits = int(head.BitsAllocated)
    syntax = getattr(getattr(head, "file_meta", None), "TransferSyntaxUID", None)
    packing = "raw" if syntax is None or str(syntax) in RAW else "image"
    # Samples of one bit are eight to a byte.
    if bits != 1 or packing != "raw":
        empty(shape, f"u{max(bits // 8, 1)}", len(head[name].value), packing)
    if packing != "raw":
        head.pixel_array_options(decoding_plugin=_decoder(path, syntax))
        _check_frames(head.PixelData, shape)
    return head.pixel_array.reshape(shape)


def _check_deflated(file: BinaryIO) -> None:
    """Where all of a file is deflated, there is no more in it than its image and what describes that: pydicom inflates
    whatever there is.
    """
    import pydicom

    start = file.read(1024)
    file.seek(0)
    if DEFLATED not in start or start[132:136] != b"\x02\0\0\0":
        return
    file.seek(144 + int.from_bytes(start[140:144], "little"))
    stream = Inflating(file, wbits=-15)
    content = b""
    while len(content) < DESCRIBED and (part := stream.read(DESCRIBED - len(content))):
        content += part
    head = pydicom.filereader.read_dataset(BytesIO(content), False, True, stop_when=lambda tag, *_: tag >= PIXELS)
    rest = int(head.get("Rows") or 0) * int(head.get("Columns") or 0) * int(head.get("NumberOfFrames") or 1)
    rest = DESCRIBED + rest * max(int(head.get("BitsAllocated") or 0) // 8, 1) - len(content)
    while part := stream.read(CHUNK):
        rest -= len(part)
        if rest < 0:
            raise Flaw("it is deflated, and there is more in it than the image that it declares")
    file.seek(0)


def _check_frames(packed: bytes, shape: tuple[int, int, int]) -> None:
    """Frames are of the size that the header says, so that no more memory is taken. Where they are JP2 files, their
    boxes have lengths: pydicom looks for one after the other, without an end.
    """
    from PIL import Image, UnidentifiedImageError
    from pydicom.encaps import generate_frames

    for frame in generate_frames(packed, number_of_frames=shape[0]):
        with suppress(UnidentifiedImageError), Image.open(BytesIO(frame), formats=("JPEG", "JPEG2000")) as image:
            if image.size != shape[:0:-1]:
                raise Flaw(
                    f"its header says {shape[2]} x {shape[1]} pixels, a frame has {image.width} x {image.height}"
                )
        at = 12 if frame.startswith(b"\0\0\0\x0cjP  ") else len(frame)
        while at < len(frame) and frame[at + 4 : at + 8] != b"jp2c":
            length = int.from_bytes(frame[at : at + 4], "big")
            if length < 8:
                raise Flaw(f"a box of its JPEG 2000 is {length} bytes long")
            at += length


def _decoder(path: Path, syntax: Any) -> str:
    """Who unpacks a transfer syntax."""
    from pydicom.pixels import get_decoder

    there = get_decoder(syntax).available_plugins
    if found := next((name for name in DECODERS if name in there), None):
        return found
    raise ImportError(
        f"{path} is compressed ({syntax.name}), which needs a package that is not there: pip install 'wvr[dicom]'"
    )


def _number(value: Any, default: float) -> float:
    """A number of a header, where it is given; some write an empty one."""
    return default if value in (None, "") else float(value)


def _first(groups: Iterable[Any], sequence: str) -> Any:
    """The first item of a sequence in the first group that has it; empty without one."""
    for group in groups:
        if group is not None and group.get(sequence):
            return group[sequence].value[0]
    return {}


def _frame(path: Path, head: Any, stored: NDArray, k: int) -> Slice:
    own = head.get("PerFrameFunctionalGroupsSequence")
    shared = head.get("SharedFunctionalGroupsSequence")
    groups = [own[k] if own and k < len(own) else None, shared[0] if shared else None]
    measures = _first(groups, "PixelMeasuresSequence") or head
    turned = _first(groups, "PlaneOrientationSequence") or head
    placed = _first(groups, "PlanePositionSequence") or head
    content = _first(groups[:1], "FrameContentSequence")
    orientation = np.array(turned.get("ImageOrientationPatient") or (1, 0, 0, 0, 1, 0), np.float64)
    if orientation.shape != (6,) or not np.all(np.isfinite(orientation)):
        raise Flaw(f"its orientation must be six numbers, got {orientation.tolist()}")
    row, column = orientation.reshape(2, 3)
    place = placed.get("ImagePositionPatient")
    place = np.array(place, np.float64) if place else None
    if place is not None and (place.shape != (3,) or not np.all(np.isfinite(place))):
        raise Flaw(f"its position must be three numbers, got {place.tolist()}")
    thickness = _number(measures.get("SpacingBetweenSlices"), _number(measures.get("SliceThickness"), 1.0)) or 1.0
    frames = int(head.get("NumberOfFrames") or 1)
    timely = frames > 1 and head.get("FrameIncrementPointer") in FRAME_TIMES
    if frames > 1 and placed is head and place is not None and not timely:
        offsets = head.get("GridFrameOffsetVector") or [thickness * n for n in range(frames)]
        # The vector begins at 0, or holds places along z.
        place = place + np.cross(row, column) * (float(offsets[k]) - float(offsets[0]))
    widths = measures.get("PixelSpacing") or head.get("ImagerPixelSpacing") or []
    spacing = tuple(float(width) for width in widths) or (guess(path, "how wide pixels are"),) * 2
    time = _number(content.get("TemporalPositionIndex"), _number(head.get("TemporalPositionIdentifier"), 0.0))
    order = time if not timely else float(k), _number(head.get("InstanceNumber"), 0.0) + k * (not timely)
    series = str(head.get("SeriesInstanceUID", ""))
    return Slice(path, series, _rescaled(head, groups, stored), row, column, spacing, place, thickness, order)  # type: ignore[arg-type]


def _rescaled(head: Any, groups: list[Any], stored: NDArray) -> NDArray:
    """In the units that the file states."""
    if "DoseGridScaling" in head:
        return rescaled(stored, _number(head.DoseGridScaling, 1.0), 0.0)
    if head.get("ModalityLUTSequence"):
        from pydicom.pixels.processing import apply_modality_lut

        return apply_modality_lut(stored, head)
    values = _first(groups, "PixelValueTransformationSequence") or head
    return rescaled(stored, _number(values.get("RescaleSlope"), 1.0), _number(values.get("RescaleIntercept"), 0.0))


def _grid(path: Path, slices: list[Slice]) -> Grid:
    if not slices:
        raise FileNotFoundError(errno.ENOENT, "no DICOM images", str(path))
    series = sorted({s.series for s in slices})
    if len(series) > 1:
        raise Unsupported(f"{path} holds {len(series)} DICOM series; put the one to read into a folder of its own")
    first = slices[0]
    for other in slices:
        if other.array.shape != first.array.shape:
            raise Unsupported(
                f"{path} holds DICOM slices of different size: {other.path.name} has {other.array.shape} samples, "
                f"{first.path.name} {first.array.shape}; move odd ones out of the folder"
            )
        if max(np.abs(other.row - first.row).max(), np.abs(other.column - first.column).max()) > NOISE:
            raise Unsupported(
                f"{path} holds DICOM slices of different orientation: {other.path.name} has "
                f"{[*other.row, *other.column]}, {first.path.name} {[*first.row, *first.column]}; move odd ones out"
            )
        if not np.allclose(other.spacing, first.spacing, rtol=NOISE, atol=0):
            raise Unsupported(
                f"{path} holds DICOM slices of different spacing: {other.path.name} has {[*other.spacing]} mm, "
                f"{first.path.name} {[*first.spacing]}; move odd ones out of the folder"
            )
    normal = np.cross(first.row, first.column)
    slices = sorted(slices, key=lambda s: s.order)
    if any(s.place is None for s in slices):
        # Slices without a position (no patient) are ordered by number and stacked along the normal.
        slices = [s._replace(place=normal * s.thickness * k) for k, s in enumerate(slices)]
    slices.sort(key=_along)
    times = _volumes(path, slices, first.thickness)
    ordered = times[0]
    place = np.array([s.place for s in ordered])
    step = normal * first.thickness
    if len(ordered) > 1:
        between = np.diff(place, axis=0)
        # The commonest step: a gap is where it is another.
        step = np.median(between, axis=0)
        off = np.linalg.norm(between - step, axis=1) > UNEVEN * np.linalg.norm(step)
        if np.any(off) or not np.any(step):
            k = int(np.argmax(off))
            raise Unsupported(
                f"{path} holds DICOM slices that are not evenly spaced: from {ordered[k].path.name} to "
                f"{ordered[k + 1].path.name} it is {np.linalg.norm(between[k]):.6g} mm, elsewhere "
                f"{np.linalg.norm(step):.6g} mm; some are missing or doubled"
            )
        step = (place[-1] - place[0]) / (len(ordered) - 1)
    down, across = first.spacing
    steps = np.stack([first.row * across, first.column * down, step], axis=1)
    with corrupt(path):
        dtype = np.result_type(*{s.array.dtype for s in slices})
        array = empty((len(times), len(ordered), *first.array.shape), dtype, sum(s.array.size for s in slices) * 8)
    for time, volume in enumerate(times):
        for k, one in enumerate(volume):
            array[time, k] = one.array
    files = tuple(dict.fromkeys(s.path for s in slices))
    return Grid(array if len(times) > 1 else array[0], steps, place[0], "LPS", files)


def _along(one: Slice) -> float:
    """Its place along its own normal [mm]."""
    return float(np.cross(one.row, one.column) @ one.place)


def _volumes(path: Path, slices: list[Slice], thickness: float) -> list[list[Slice]]:
    """Slices that are sorted along the normal, by volume: as many as there are slices at each place."""
    groups: list[list[Slice]] = []
    for one in slices:
        if groups and _along(one) - _along(groups[-1][0]) < 1e-3 * thickness:
            groups[-1].append(one)
        else:
            groups.append([one])
    counts = {len(group) for group in groups}
    if len(counts) > 1:
        many = next(group for group in groups if len(group) != len(groups[0]))
        raise Unsupported(
            f"{path} holds {len(many)} DICOM slices at the place of {many[0].path.name}, {len(groups[0])} at that of "
            f"{groups[0][0].path.name}: some are missing or doubled, so they are not evenly spaced"
        )
    groups = [sorted(group, key=lambda s: s.order) for group in groups]
    return [[group[time] for group in groups] for time in range(counts.pop())]
