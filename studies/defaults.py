"""What ``wvr.render(data)`` shows when nothing else is said, beside what PyVista's ``add_volume`` does.

    python -m studies.defaults FOLDER_OR_FILE ... -o docs/defaults

writes contact sheets, ``sheet-1.jpg`` and on, ten volumes a sheet: in each pair wvr is on the left, PyVista on the
right. Without a file it shows the generated volumes. With ``--hero`` the files are one picture, hero.jpg, in shadow.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import wvr

TILE = 320
ROWS = 5
MARGIN = 4


def ours(volume: wvr.Volume) -> Image.Image:
    """Of one line."""
    return Image.fromarray(wvr.render(volume, size=(TILE, TILE)).to_uint8("black"))


def theirs(volume: wvr.Volume) -> Image.Image:
    """Of the three lines that PyVista takes."""
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=(TILE, TILE))
    plotter.add_volume(volume.to_pyvista(), show_scalar_bar=False)
    pixels: NDArray[np.uint8] = plotter.screenshot(return_img=True)
    plotter.close()
    return Image.fromarray(pixels)


def hero(paths: list[Path], output: Path) -> None:
    """Two by two pictures with shadows; prints the largest bound on the error of their opacities."""
    error = 0.0
    picture = Image.new("RGB", (4 * TILE, 4 * TILE * -(-len(paths) // 2) // 2))
    for number, path in enumerate(paths):
        image = wvr.render(path, size=(2 * TILE, 2 * TILE), shadows=True)
        error = max(error, image.max_error)
        picture.paste(Image.fromarray(image.to_uint8()), (number % 2 * 2 * TILE, number // 2 * 2 * TILE))
    picture.save(output / "hero.jpg", quality=88)
    print(f"{output / 'hero.jpg'}: opacities are within {error:.2g}")


def volumes(paths: list[Path]) -> list[tuple[str, wvr.Volume]]:
    """Those in the files and folders; what is no regular grid of scalars is left out, and said."""
    files = [file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    found = []
    for file in files:
        try:
            found.append((file.name.partition(".")[0], wvr.read(file)))
        except (ValueError, OSError) as error:
            print(f"left out: {error}")
    if not paths:
        found = [(name, wvr.datasets.load(name, 64)) for name in wvr.datasets.GENERATED]
    return found


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/defaults"))
    parser.add_argument("--hero", action="store_true")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    if options.hero:
        return hero(options.paths, options.output)
    warnings.simplefilter("ignore")
    tiles = []
    for name, volume in volumes(options.paths):
        print(name, flush=True)
        pair = Image.new("RGB", (2 * TILE, TILE))
        pair.paste(ours(volume), (0, 0))
        pair.paste(theirs(volume), (TILE, 0))
        ImageDraw.Draw(pair).text((6, 6), name, fill="white")
        tiles.append(pair)
    for first in range(0, len(tiles), 2 * ROWS):
        some = tiles[first : first + 2 * ROWS]
        rows = -(-len(some) // 2)
        sheet = Image.new("RGB", (4 * TILE + MARGIN, rows * (TILE + MARGIN)), "grey")
        for number, pair in enumerate(some):
            sheet.paste(pair, (number % 2 * (2 * TILE + MARGIN), number // 2 * (TILE + MARGIN)))
        path = options.output / f"sheet-{first // (2 * ROWS) + 1}.jpg"
        sheet.save(path, quality=88, optimize=True)
        print(path)


if __name__ == "__main__":
    main()
