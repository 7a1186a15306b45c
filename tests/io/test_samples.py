"""Types of samples, absent ones, and PyVista's grids, that share memory."""

from __future__ import annotations

import gc

import numpy as np
import pytest
import pyvista as pv

from wvr.io import from_pyvista, read, read_raw, to_pyvista
from wvr.volume import Volume

from .files import (
    FIELD,
    ORIGIN,
    SPACING,
    TURNED,
    check,
    image,
    meta,
    nifti,
    nrrd,
    vti,
)

VTK_DTYPES = ("uint8", "int8", "uint16", "int16", "float32", "float64")

# --- Dtypes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "values, expected",
    [
        (np.array([False, True]), "uint8"),
        (np.array([0, 255], np.int64), "uint8"),
        (np.array([-128, 127], np.int32), "int8"),
        (np.array([-1, 128], np.int32), "int16"),
        (np.array([0, 65535], np.uint32), "uint16"),
        (np.array([-32768, 32767], np.int64), "int16"),
        (np.array([-1, 32768], np.int64), "float64"),
        (np.array([0, 2**53], np.uint64), "float64"),
    ],
)
def test_narrowing_is_exact(tmp_path, values, expected):
    np.save(tmp_path / "a.npy", np.resize(values, (2, 2, 2)))
    volume = read(tmp_path / "a.npy")
    assert volume.dtype == expected
    np.testing.assert_array_equal(volume.numpy().ravel()[:2], values)
    if values.dtype != bool:
        assert from_pyvista(image(np.resize(values, (2, 2, 2)))).dtype == expected


def test_narrowing_refuses_what_no_dtype_holds(tmp_path):
    np.save(tmp_path / "a.npy", np.full((2, 2, 2), 2**53 + 1))
    with pytest.raises(ValueError, match="9007199254740993 fit no accepted dtype exactly"):
        read(tmp_path / "a.npy")


@pytest.mark.parametrize(
    "kind, dtype", [("uchar", "u1"), ("int8_t", "i1"), ("unsigned short", "u2"), ("float", "f4"), ("double", "f8")]
)
def test_nrrd_types(tmp_path, kind, dtype):
    array = (FIELD % 100).astype(dtype)
    (tmp_path / "a.nrrd").write_bytes(nrrd(array.tobytes(), kind=kind))
    check(read(tmp_path / "a.nrrd"), array)


@pytest.mark.parametrize(
    "kind, dtype",
    [("MET_UCHAR", "u1"), ("MET_CHAR", "i1"), ("MET_USHORT", "u2"), ("MET_FLOAT", "f4"), ("MET_DOUBLE", "f8")],
)
def test_meta_types(tmp_path, kind, dtype):
    array = (FIELD % 100).astype(dtype)
    (tmp_path / "a.mha").write_bytes(meta(array.tobytes(), kind=kind))
    check(read(tmp_path / "a.mha"), array)


@pytest.mark.parametrize("code, dtype", [(2, "u1"), (256, "i1"), (512, "u2"), (16, "f4"), (64, "f8")])
def test_nifti_types(tmp_path, code, dtype):
    array = (FIELD % 100).astype(dtype)
    (tmp_path / "a.nii").write_bytes(nifti(array.tobytes(), code=code, bits=8 * array.itemsize))
    check(read(tmp_path / "a.nii"), array)


def test_nan(tmp_path):
    array = np.full((2, 2, 2), np.nan, np.float32)
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(ValueError, match="8 NaN"):
        read(tmp_path / "a.npy")
    assert read(tmp_path / "a.npy", nan="transparent").has_nonfinite
    array.tofile(tmp_path / "a.raw")
    assert read_raw(tmp_path / "a.raw", (2, 2, 2), "float32", nan="transparent").has_nonfinite
    assert from_pyvista(image(array), nan="transparent").has_nonfinite


# --- PyVista --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", VTK_DTYPES)
def test_pyvista_round_trip_shares_memory(dtype):
    array = (FIELD % 100).astype(dtype)
    volume = Volume(array, SPACING, ORIGIN, TURNED)
    grid = to_pyvista(volume)
    assert np.shares_memory(grid.point_data["values"], array)
    assert grid.active_scalars_name == "values" and grid.point_data["values"].dtype == dtype
    again = from_pyvista(grid)
    check(again, array)
    assert np.shares_memory(again.numpy(), array)
    corner = [grid.bounds[i] for i in (0, 2, 4)]
    np.testing.assert_allclose(corner, volume.corners.min(axis=0))
    del grid, volume
    gc.collect(1)
    np.testing.assert_array_equal(again.numpy(), (FIELD % 100).astype(dtype))


def test_pyvista_round_trip_of_others():
    half = to_pyvista(Volume(FIELD.astype(np.float16)))
    assert half.point_data["values"].dtype == np.float32
    np.testing.assert_array_equal(from_pyvista(half).numpy(), FIELD.astype(np.float32))
    frozen = FIELD.copy()
    frozen.flags.writeable = False
    check(from_pyvista(to_pyvista(Volume(frozen, SPACING, ORIGIN, TURNED))))
    sheared = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    check(from_pyvista(to_pyvista(Volume(FIELD, SPACING, ORIGIN, sheared))), direction=sheared)


def test_pyvista_array_outlives_its_grid():
    volume = from_pyvista(image())
    gc.collect(1)
    check(volume)


def test_pyvista_extent_and_negative_spacing():
    grid = image()
    grid.SetExtent(2, 6, -1, 1, 3, 6)  # VTK's origin is where index (0, 0, 0) would be
    check(from_pyvista(grid), origin=np.array(grid.points[0], np.float64))
    assert not np.allclose(grid.points[0], ORIGIN)
    grid = image()
    grid.SetSpacing(-1.5, 2, 3)
    check(from_pyvista(grid), direction=TURNED * [-1, 1, 1])


def test_vti_with_extent(tmp_path):
    grid = image()
    grid.SetExtent(2, 6, -1, 1, 3, 6)
    vti(tmp_path / "a.vti", grid)
    check(read(tmp_path / "a.vti"), origin=np.array(grid.points[0], np.float64))


def test_cell_data_sits_at_centres(tmp_path):
    grid = pv.ImageData(dimensions=(6, 4, 5), spacing=SPACING, origin=ORIGIN)
    grid.SetDirectionMatrix(*TURNED.ravel())
    grid.cell_data["c"] = FIELD.ravel()
    centre = grid.cell_centers().points[0].astype(np.float64)
    check(from_pyvista(grid), origin=centre)
    vti(tmp_path / "a.vti", grid)
    check(read(tmp_path / "a.vti"), origin=centre)
    flat = pv.ImageData(dimensions=(6, 4, 1))
    flat.cell_data["c"] = FIELD[0].ravel()
    check(from_pyvista(flat), FIELD[:1], (1, 1, 1), (0.5, 0.5, 0), np.eye(3))


def test_scalars_by_name(tmp_path):
    grid = image(name="first")
    grid.point_data["second"] = (FIELD + 1).ravel()
    grid.set_active_scalars("first")
    vti(tmp_path / "a.vti", grid)
    check(read(tmp_path / "a.vti"))
    check(read(tmp_path / "a.vti", scalars="second"), FIELD + 1)
    with pytest.raises(ValueError, match="'third' is unknown; there are 'first', 'second'"):
        read(tmp_path / "a.vti", scalars="third")
    grid.point_data.active_scalars_name = None
    with pytest.raises(ValueError, match="none is active; there are 'first', 'second'"):
        from_pyvista(grid)
    with pytest.raises(ValueError, match="no point or cell array"):
        from_pyvista(pv.ImageData(dimensions=(2, 2, 2)))
    np.save(tmp_path / "a.npy", FIELD)
    with pytest.raises(ValueError, match="without a name"):
        read(tmp_path / "a.npy", scalars="first")


def test_volume_methods():
    check(Volume.from_pyvista(Volume(FIELD, SPACING, ORIGIN, TURNED).to_pyvista()))
