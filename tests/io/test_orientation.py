"""Where voxels are in the world, by every axis order and named space, as the formats' own packages say; pictures."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
import tifffile

import wvr
from wvr.io import read

from .files import FIELD, SPACING, dicom, vti

sitk = pytest.importorskip("SimpleITK")
nrrd = pytest.importorskip("nrrd")
nibabel = pytest.importorskip("nibabel")

# Index along the file's x, y, z of the voxel that is looked for, and where the first one is.
MARKED, ORIGIN = (3, 1, 2), np.array([-70.0, 30.0, 11.0])
ARRAY = np.zeros_like(FIELD)
ARRAY[MARKED[::-1]] = 1000
LETTERS = ("RL", "AP", "SI")


def orders() -> list[np.ndarray]:
    """All ways that three axes may go along those of the world, of either handedness, and two that are oblique."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            found.append(np.eye(3)[:, order] * signs)
    turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    return [*found, turned, -turned]


def marked(volume: wvr.Volume) -> np.ndarray:
    """World position of the voxel with the largest value."""
    index = np.unravel_index(np.argmax(volume.numpy()), volume.shape)[::-1]
    return volume.index_to_world[:3, :3] @ index + volume.index_to_world[:3, 3]


def lps(volume: wvr.Volume) -> np.ndarray:
    """That in a patient's coordinates, to the left, the back and the head."""
    assert volume.anatomical in ("LPS", "RAS")
    return marked(volume) * ((1, 1, 1) if volume.anatomical == "LPS" else (-1, -1, 1))


def of_itk(path: Path | list[str]) -> np.ndarray:
    """The same by SimpleITK, whose coordinates are those."""
    image = sitk.ReadImage(path if isinstance(path, list) else str(path))
    index = np.unravel_index(np.argmax(sitk.GetArrayFromImage(image)), image.GetSize()[::-1])[::-1]
    return np.array(image.TransformIndexToPhysicalPoint([int(i) for i in index]))


@pytest.mark.parametrize("abbreviated", [False, True])
@pytest.mark.parametrize("space", ["".join(letters) for letters in itertools.product(*LETTERS)])
def test_nrrd(tmp_path, space, abbreviated):
    words = dict(zip("RLAPSI", ["right", "left", "anterior", "posterior", "superior", "inferior"], strict=True))
    name = space if abbreviated else "-".join(words[letter] for letter in space)
    path = tmp_path / "a.nrrd"
    to_lps = np.where([letter in "LPS" for letter in space], 1.0, -1.0)
    for direction in orders():
        header = {"space": name, "space directions": (direction * SPACING).T, "space origin": ORIGIN}
        nrrd.write(str(path), np.asfortranarray(ARRAY.T), header)
        head = nrrd.read_header(str(path))
        expected = to_lps * (head["space origin"] + MARKED @ head["space directions"])
        volume = read(path)
        np.testing.assert_allclose(lps(volume), expected, atol=1e-9)
        if space in ("LPS", "RAS", "LAS"):  # ITK takes other spaces for LPS
            np.testing.assert_allclose(lps(volume), of_itk(path), atol=1e-5)


@pytest.mark.parametrize("space", ["scanner-xyz", "3D-right-handed", "3D-left-handed"])
def test_nrrd_without_a_patient(tmp_path, space):
    for direction in orders():
        header = {"space": space, "space directions": (direction * SPACING).T, "space origin": ORIGIN}
        nrrd.write(str(tmp_path / "a.nrrd"), np.asfortranarray(ARRAY.T), header)
        volume = read(tmp_path / "a.nrrd")
        expected = ORIGIN + direction @ (np.array(SPACING) * MARKED)
        np.testing.assert_allclose(marked(volume), expected * (1, 1, -1 if "left" in space else 1), atol=1e-9)
        assert volume.anatomical == ""


@pytest.mark.parametrize("name", ["a.mha", "a.mhd"])
def test_meta_image(tmp_path, name):
    for direction in orders():
        image = sitk.GetImageFromArray(ARRAY)
        image.SetSpacing(SPACING), image.SetOrigin(ORIGIN), image.SetDirection(direction.ravel())
        sitk.WriteImage(image, str(tmp_path / name))
        np.testing.assert_allclose(lps(read(tmp_path / name)), of_itk(tmp_path / name), atol=1e-5)


@pytest.mark.parametrize("forms", ["sform", "qform", "both", "differ"])
@pytest.mark.parametrize("kind", ["Nifti1Image", "Nifti2Image", "MGHImage"])
def test_nifti(tmp_path, kind, forms):
    path = tmp_path / ("a.mgz" if kind == "MGHImage" else "a.nii")
    for direction in orders():
        affine = np.eye(4)
        affine[:3, :3], affine[:3, 3] = direction * SPACING, ORIGIN
        image = getattr(nibabel, kind)(ARRAY.T, affine)
        if kind != "MGHImage":
            other = np.diag([7.0, 8.0, 9.0, 1.0]) if forms == "differ" else affine
            image.set_sform(None if forms == "qform" else affine, 0 if forms == "qform" else 2)
            image.set_qform(other, 0 if forms == "sform" else 1)
        nibabel.save(image, path)
        volume = read(path)
        assert volume.anatomical == "RAS"
        np.testing.assert_allclose(marked(volume), (nibabel.load(path).affine @ (*MARKED, 1))[:3], atol=1e-4)
        if kind == "Nifti1Image" and forms != "differ":
            np.testing.assert_allclose(lps(volume), of_itk(path), atol=1e-3)


def test_dicom(tmp_path):
    """Slices that are stacked either way along their normal, by pydicom's fields and by SimpleITK's series."""
    pydicom = pytest.importorskip("pydicom")
    for number, direction in enumerate(orders()):
        folder = tmp_path / str(number)
        folder.mkdir()
        row, column, normal = direction.T
        for k, page in enumerate(ARRAY):
            place = ORIGIN + normal * SPACING[2] * k
            dicom(folder / f"{k}.dcm", page, place, number=k, orientation=(*row, *column))
        head = pydicom.dcmread(folder / f"{MARKED[2]}.dcm")
        across, down = np.reshape(head.ImageOrientationPatient, (2, 3)).astype(float)
        spacing = head.PixelSpacing  # between rows, between columns
        place = np.array(head.ImagePositionPatient, float)
        expected = place + MARKED[0] * float(spacing[1]) * across + MARKED[1] * float(spacing[0]) * down
        volume = read(folder)
        np.testing.assert_allclose(lps(volume), expected, atol=1e-6)
        names = sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder))
        np.testing.assert_allclose(lps(volume), of_itk(list(names)), atol=1e-4)


def test_vti(tmp_path):
    """Also where the extent does not begin at 0, which is where VTK's origin is."""
    for number, direction in enumerate(orders()):
        grid = pv.ImageData(dimensions=ARRAY.shape[::-1], spacing=SPACING, origin=tuple(ORIGIN))
        grid.SetDirectionMatrix(*direction.ravel())
        if number % 2:
            grid.SetExtent(3, 7, -1, 1, 5, 8)
        grid.point_data["a"] = ARRAY.ravel()
        vti(tmp_path / "a.vti", grid)
        again = pv.read(tmp_path / "a.vti")
        np.testing.assert_allclose(marked(read(tmp_path / "a.vti")), again.points[np.argmax(again["a"])], atol=1e-5)


def test_tiff(tmp_path):
    """A TIFF file has no axes but its own: rows go along y, pages along z."""
    metadata = {"axes": "ZYX", "spacing": SPACING[2], "unit": "mm"}
    resolution = (1 / SPACING[0], 1 / SPACING[1])
    tifffile.imwrite(tmp_path / "a.tif", ARRAY, imagej=True, resolution=resolution, metadata=metadata)
    np.testing.assert_allclose(marked(read(tmp_path / "a.tif")), np.array(SPACING) * MARKED, rtol=1e-6)
    image = sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / "a.tif")))
    np.testing.assert_array_equal(read(tmp_path / "a.tif").numpy(), image)


# --- Pictures -------------------------------------------------------------------------------------------------------


def head() -> np.ndarray:
    """Samples [right to left, front to back, feet to head] with a nose in front and one ear, on the left."""
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, n) for n in (26, 30, 28)), indexing="ij")
    inside = (x / 0.6) ** 2 + (y / 0.7) ** 2 + (z / 0.8) ** 2
    nose = ((x / 0.12) ** 2 + ((y + 0.75) / 0.2) ** 2 + ((z + 0.1) / 0.2) ** 2) < 1
    ear = (((x - 0.65) / 0.2) ** 2 + (y / 0.1) ** 2 + (z / 0.2) ** 2) < 1
    return np.where(nose | ear, 220, np.where(inside < 1, 150 - 60 * (inside < 0.5), 0)).astype(np.int16)


def test_one_head_looks_the_same_in_all_formats(tmp_path):
    """However the axes of the file go: its front, its left on the right of the picture, whichever space it is in."""
    samples = head()
    turned = np.eye(3)[:, [2, 0, 1]] * (1, -1, -1)
    directions = {"plain": np.eye(3), "turned": turned, "left-handed": np.diag([1.0, -1.0, 1.0])}
    pictures = {}
    for name, direction in directions.items():
        order = np.argmax(np.abs(direction), axis=0)
        signs = direction[order, range(3)].astype(int)
        stored = samples.transpose(order)[tuple(slice(None, None, sign) for sign in signs)]  # x, y, z of the file
        corner = np.where(direction.sum(axis=1) > 0, 0.0, np.array(samples.shape) - 1.0)
        image = sitk.GetImageFromArray(np.ascontiguousarray(stored.T))
        image.SetOrigin(corner), image.SetDirection(direction.ravel())
        folder = tmp_path / name
        folder.mkdir()
        for ending in ("mha", "nrrd", "nii"):
            sitk.WriteImage(image, str(folder / f"a.{ending}"))
        for space, flips in (("RAS", (-1, -1, 1)), ("left-anterior-superior", (1, -1, 1))):
            header = {"space": space, "space directions": (direction.T * flips), "space origin": corner * flips}
            nrrd.write(str(folder / f"{space}.nrrd"), np.asfortranarray(stored), header)
        affine = np.diag([-1.0, -1, 1, 1])
        affine[:3, :3] = affine[:3, :3] @ direction
        affine[:3, 3] = (-1, -1, 1) * corner
        nibabel.save(nibabel.MGHImage(stored, affine), folder / "a.mgz")
        series = folder / "dicom"
        series.mkdir()
        for k in range(stored.shape[2]):
            page = np.ascontiguousarray(stored[:, :, k].T)
            dicom(series / f"{k}", page, corner + direction[:, 2] * k, number=k, orientation=direction.T[:2].ravel())
        for path in folder.iterdir():
            volume = read(path)
            if path == series:  # of spacings of its own
                volume = wvr.Volume(volume.numpy(), origin=volume.origin, direction=volume.direction)
                volume.anatomical = "LPS"
            pictures[name, path.name] = wvr.render(volume, size=(24, 24), lighting=False, device="cpu").rgba
    first = pictures["plain", "a.mha"]
    assert np.abs(first - first[:, ::-1]).max() > 0.1  # the ear
    for name, picture in pictures.items():
        assert np.abs(picture - first).max() < 0.02, name
    # The patient's left is on the right: that is where the ear is, and none on the other side.
    camera = wvr.render(read(tmp_path / "plain" / "a.mha"), size=(24, 24), lighting=False, device="cpu").shown.camera
    ear, none = np.rint(camera.project([(22.0, 15, 14), (0.0, 15, 14)], (24, 24))).astype(int)
    assert ear[0] > none[0] and first[ear[1], ear[0], 3] > 0.5 > 0.1 > first[none[1], none[0], 3]
