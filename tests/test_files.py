"""Files that are written: whole or not at all, under the name that was asked for, with nothing left beside them."""

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import wvr
from studies.base.harness import save_figure
from wvr.files import known_suffix, whole_file, write_text

IMAGE = wvr.Image(np.full((4, 5, 4), 0.25, np.float32), np.zeros((4, 5), np.int32))
COMPARISON = wvr.compare(IMAGE, np.full((4, 5, 4), 0.3))
TF = wvr.TransferFunction([(0, "black", 0.0), (1, "white", 0.5)])

MAGIC = {
    ".eps": b"%!PS",
    ".exr": b"\x76\x2f\x31\x01",
    ".jpg": b"\xff\xd8",
    ".npy": b"\x93NUMPY",
    ".pdf": b"%PDF",
    ".png": b"\x89PNG",
    ".svg": b"<?xml",
    ".svgz": b"\x1f\x8b",
    ".tif": b"II*\0",
    ".tiff": b"II*\0",
}


def upper(suffix: str) -> str:
    return suffix.upper()


def mixed(suffix: str) -> str:
    return suffix[:2].upper() + suffix[2:]


@pytest.mark.parametrize("case", [str, upper, mixed])
@pytest.mark.parametrize("suffix", [".png", ".exr", ".tif", ".tiff", ".npy"])
def test_images_in_any_case(tmp_path, suffix, case):
    path = tmp_path / f"a{case(suffix)}"
    IMAGE.save(path)
    assert path.read_bytes().startswith(MAGIC[suffix])
    assert os.listdir(tmp_path) == [path.name]
    if suffix == ".npy":
        np.testing.assert_array_equal(np.load(path), IMAGE.rgba)


@pytest.mark.parametrize("case", [str, upper, mixed])
@pytest.mark.parametrize("suffix", [".png", ".svg", ".svgz", ".pdf", ".jpg", ".tif", ".eps"])
def test_comparisons_in_any_case(tmp_path, suffix, case):
    path = tmp_path / f"map{case(suffix)}"
    COMPARISON.save(path)
    assert path.read_bytes().startswith(MAGIC[suffix])
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("name", ["map", "map.", "map.npy", "map.png.bak", ".png"])
def test_comparisons_name_what_matplotlib_writes(tmp_path, name):
    with pytest.raises(ValueError, match=r"path must end in .*\.pdf.*\.png.*\.svg.*, got"):
        COMPARISON.save(tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_comparisons_list_only_what_can_be_written(tmp_path):
    with pytest.raises(ValueError) as caught:
        COMPARISON.save(tmp_path / "map")
    listed = str(caught.value).partition(" in ")[2].partition(", got")[0].split(", ")
    # Pillow can be built without these two.
    listed = [suffix for suffix in listed if suffix not in (".avif", ".webp")]
    for suffix in listed:
        COMPARISON.save(tmp_path / f"map{suffix}")
    assert sorted(os.listdir(tmp_path)) == sorted(f"map{suffix}" for suffix in listed)
    assert all((tmp_path / f"map{suffix}").stat().st_size > 0 for suffix in listed)


@pytest.mark.parametrize("name", ["tf.json", "tf.JSON", "tf.Json"])
def test_transfer_functions_in_any_case(tmp_path, name):
    TF.save(tmp_path / name)
    assert wvr.TransferFunction.load(tmp_path / name) == TF
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("name", ["tf", "tf.npy", "tf.json.bak"])
def test_transfer_functions_are_json(tmp_path, name):
    with pytest.raises(ValueError, match=r"path must end in \.json, got"):
        TF.save(tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_charts_keep_the_points_of_their_names(tmp_path):
    from matplotlib.figure import Figure

    save_figure(Figure(), tmp_path / "step-0.5")
    assert sorted(os.listdir(tmp_path)) == ["step-0.5.png", "step-0.5.svg"]
    assert all(path.read_bytes().startswith(MAGIC[path.suffix]) for path in tmp_path.iterdir())


def test_a_block_that_fails_leaves_what_was_there(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as file:
        file.write(b"half")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == ["a"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_what_cannot_be_flushed_is_not_written(tmp_path, monkeypatch):
    # The error comes when the file is closed: only then does its buffer reach the disk.
    real = Path.open

    def full(path, mode):
        path.touch()
        return real(Path("/dev/full"), "wb")

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(OSError, match="No space left"):
        write_text(tmp_path / "a", "text")
    monkeypatch.undo()
    assert os.listdir(tmp_path) == []


def test_text_is_the_same_everywhere(tmp_path):
    write_text(tmp_path / "a", json.dumps({"ä": 1}, ensure_ascii=False) + "\n")
    assert (tmp_path / "a").read_bytes() == '{"ä": 1}\n'.encode()


def test_known_suffix():
    assert known_suffix(Path("a.b.PNG"), (".png", ".exr")) == ".png"
    with pytest.raises(ValueError, match=r"^--output must end in \.png, \.exr, got 'a'$"):
        known_suffix(Path("a"), (".png", ".exr"), "--output")


@pytest.mark.skipif(os.name == "nt", reason="modes and links are those of POSIX")
def test_modes_and_links_are_kept(tmp_path):
    (tmp_path / "real").mkdir()
    target, link = tmp_path / "real" / "a.png", tmp_path / "b.png"
    target.write_bytes(b"old")
    target.chmod(0o600)
    link.symlink_to(target)
    IMAGE.save(link)
    assert link.is_symlink() and target.read_bytes().startswith(MAGIC[".png"])
    assert target.stat().st_mode & 0o777 == 0o600
    dangling = tmp_path / "c.png"
    dangling.symlink_to(tmp_path / "real" / "new.png")
    IMAGE.save(dangling)
    assert dangling.is_symlink() and (tmp_path / "real" / "new.png").exists()
    assert sorted(os.listdir(tmp_path / "real")) == ["a.png", "new.png"]


def test_only_files_are_replaced(tmp_path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(OSError, match="which is no regular file"):
        IMAGE.save(tmp_path / "a.png")
    with pytest.raises(OSError, match="which is no regular file"):
        write_text(Path(os.devnull), "text")


@pytest.mark.skipif(os.name == "nt", reason="needs fork and locks")
def test_what_a_killed_process_left_is_taken_away(tmp_path):
    """But not what another is writing, or what is of another name."""
    path, other = tmp_path / ("a" * 200), tmp_path / "other"
    child = os.fork()
    if not child:
        with whole_file(path) as file:
            file.write(b"half")
            file.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert len(os.listdir(tmp_path)) == 1
    with whole_file(other) as file:
        file.write(b"other")
        assert len(os.listdir(tmp_path)) == 2
        with whole_file(path) as first:
            assert len(os.listdir(tmp_path)) == 2
            write_text(path, "second")
            first.write(b"first")
    assert sorted(os.listdir(tmp_path)) == [path.name, "other"]
    assert path.read_bytes() == b"first"


@pytest.mark.parametrize("background", [None, "white", (0.2, 0.3, 2.0)])
def test_strips_are_those_of_the_whole(monkeypatch, background):
    rng = np.random.default_rng(0)
    image = wvr.Image(rng.random((37, 23, 4)), np.zeros((37, 23), np.int32))
    whole = image.to_uint8(background)
    monkeypatch.setattr("wvr.image.STRIP", 50)
    np.testing.assert_array_equal(image.to_uint8(background), whole)
