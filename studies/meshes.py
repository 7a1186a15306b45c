"""PyVista's meshes before, in and behind a volume: where they are in depth, rays end.

python -m studies.meshes -o docs/meshes.jpg
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import wvr

from .demo import TREE

SIZE = (640, 480)


def picture(size: tuple[int, int] = SIZE, samples: int = 192) -> tuple[wvr.Image, np.ndarray]:
    """A tree between meshes, and the pixels of those alone."""
    import pyvista as pv

    volume = wvr.datasets.load("tree", samples)
    low, high = volume.corners.min(axis=0), volume.corners.max(axis=0)
    center, width = (low + high) / 2, float(high[0] - low[0])

    def at(x: float, y: float, z: float) -> np.ndarray:
        """In parts of the volume's width, from the middle of its bottom."""
        return np.array([*center[:2], low[2]]) + width * np.array([x, y, z])

    plotter = pv.Plotter(off_screen=True, window_size=size, lighting="light kit")
    plotter.set_background("#dfe8f2")
    meadow = pv.Disc(center=at(0, 0, 0.02), inner=0, outer=0.75 * width, c_res=80)
    plotter.add_mesh(meadow, color="#7d9a5b")
    ball = pv.Sphere(radius=0.13 * width, center=at(0.12, 0.14, 0.62), theta_resolution=80, phi_resolution=80)
    plotter.add_mesh(ball, color="tomato")
    for x, y in ((0.42, 0.05), (0.05, 0.46), (-0.46, -0.1), (-0.1, -0.46)):
        post = pv.Cylinder(center=at(x, y, 0.3), direction=(0, 0, 1), radius=0.03 * width, height=0.6 * width)
        plotter.add_mesh(post, color="#8a6d4b")
    plotter.camera_position = [tuple(at(1.7, 1.1, 1.0)), tuple(at(0, 0, 0.42)), (0, 0, 1)]
    plotter.show(auto_close=False)
    meshes, depth = plotter.screenshot(return_img=True), -plotter.get_image_depth()
    camera = wvr.Camera.from_pyvista(plotter)
    plotter.close()
    return wvr.render(volume, TREE, camera, size, depth=depth, lighting=True), np.asarray(meshes)[..., :3]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/meshes.jpg"))
    output = parser.parse_args().output
    image, meshes = picture()
    image.save(output, background=meshes)
    print(
        f"{output}: errors up to {image.max_error:.2g} but for light, {np.mean(image.rgba[..., 3] > 0.01):.0%} volume"
    )


if __name__ == "__main__":
    main()
