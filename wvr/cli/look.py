"""How a volume looks: the options that images and movies share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from cyclopts import Parameter
from cyclopts.validators import Number

from ..defaults import Call
from .options import (
    Vector,
    Vectors,
    clips_of,
    function_of,
    labels_of,
    lighting_of,
    method_of,
    numbers,
    renamed,
    shadows_of,
    size_of,
    strengths_of,
)

if TYPE_CHECKING:
    from ..bricks.stored import StoredVolume
    from ..volume import Volume


class Wanted(NamedTuple):
    """What a command line says of a volume: keywords of :func:`wvr.render`, the files of labels, and what says where
    in the volume things are.
    """

    keywords: dict[str, Any]
    files: tuple[Path, ...]
    placed: Any


@Parameter(name="*")
@dataclass(frozen=True)
class Look:
    """How it looks.

    Attributes
    ----------
    tf
        Transfer function: a suggestion of "wvr info" (bands, warm, surfaces), a preset (ct-bone, mri, ...), a
        Matplotlib colour map, a .json file, or control points SCALAR:COLOUR:OPACITY,SCALAR:COLOUR:OPACITY,... By
        default the first suggestion.
    cmap
        A Matplotlib colour map, or colours in a list, black,red,white; opacities are suggested, or those of --opacity.
    opacity
        Of a colour map: linear, geom, sigmoid, sigmoid_5, linear_r, ..., foreground, or numbers 0,0.2,0.9 that are
        equally spaced over --clim; of PyVista's unit distance.
    clim
        Scalars LO,HI that a preset or colour map spans: by default the volume's range, or Hounsfield units for ct-*.
    labels
        File of labels for the same grid: each has a colour of its own, 0 is nothing.
    tolerance
        Largest absolute error of any channel of any pixel, above 0 and below 1; by default 1/512.
    integrator
        Instead of a tolerance: NAME:VALUE:... with the values in the order of the API: riemann:0.5, riemann:0.5:left,
        preintegrated:1:4.
    projection
        The largest, smallest or mean value along each ray, or the line integral, in the colours of --tf or --cmap (by
        default grey) over --clim.
    isosurface
        Surfaces where the field is SCALAR,SCALAR,..., lit; colours and opacities are those of --tf or --cmap there.
    lighting
        "on" or "off"; by default on where opacities are suggested and the data have surfaces. Or light from the camera:
        interpolated, or another mode of the API, MODE:AMBIENT:DIFFUSE:SPECULAR:SHININESS with what is left out as in
        the API.
    shadows
        X,Y,Z towards a light that casts them, "headlight", or "on": the light that is on.
    size
        WIDTHxHEIGHT in pixels.
    background
        Colour name or #rrggbb behind the volume, or transparent, where 8 bits are written; by default black where
        opacities are suggested, else none.
    precision
        Of everything along a ray.
    device
        cpu, cuda:0, ...; by default CUDA where there is one.
    termination
        A ray ends when less than this transparency is left; 0: never.
    clip_plane
        PX,PY,PZ,NX,NY,NZ: keep the side of the plane through P that N points to [world coordinates]. This and the
        other clips may be given several times; what all keep is left.
    clip_box
        X0,Y0,Z0,X1,Y1,Z1: keep the box between two corners.
    clip_sphere
        X,Y,Z,RADIUS: keep the ball.
    threads
        CPU threads; by default all cores.
    nan
        NaN and infinite samples are an error, or transparent.
    """

    tf: Vector | None = None
    cmap: str | None = None
    opacity: Vector | None = None
    clim: Annotated[str | None, Parameter(name=["--clim", "--domain"], allow_leading_hyphen=True)] = None
    labels: Path | None = None
    tolerance: float | None = None
    integrator: str | None = None
    projection: Literal["max", "min", "mean", "sum"] | None = None
    isosurface: Vector | None = None
    lighting: str | None = None
    shadows: Vector | None = None
    size: str = "512x512"
    background: str | None = None
    precision: Literal["auto", "float32", "float64"] = "auto"
    device: str | None = None
    termination: float | None = None
    clip_plane: Vectors | None = None
    clip_box: Vectors | None = None
    clip_sphere: Vectors | None = None
    threads: Annotated[int | None, Parameter(validator=Number(gte=1))] = None
    nan: Literal["error", "transparent"] = "error"

    def keywords(self) -> dict[str, Any]:
        """Those of :func:`wvr.render` that depend on no volume, and the number of threads, which is set."""
        import wvr

        found = {
            "integrator": method_of(self.integrator, self.projection, self.isosurface),
            "tolerance": self.tolerance,
            "lighting": None if self.lighting is None else lighting_of(self.lighting),
            "shadows": None if self.shadows is None else shadows_of(self.shadows),
            "size": size_of(self.size),
            "background": self.background,
            "precision": self.precision,
            "device": self.device,
            "termination": self.termination,
            "clip": clips_of(self.clip_plane, self.clip_box, self.clip_sphere),
        }
        if self.threads is not None:
            wvr.set_num_threads(self.threads)
        return found

    def of(self, volume: Volume | StoredVolume, keywords: dict[str, Any]) -> Wanted:
        """The same with what depends on the volume."""
        call = Call(
            function_of(self.tf, self.cmap),
            opacity=strengths_of(self.opacity),
            clim=None if self.clim is None else numbers(self.clim, "--clim", "0,255"),
            background=self.background,
            integrator=keywords["integrator"],
        )
        with renamed():
            seen, placed = call.looks_at(volume)
            function, chosen = call.function(volume, seen)
        segmentation, files = (None, ()) if self.labels is None else labels_of(self.labels, function)
        found = keywords | {"transfer_function": function, "segmentation": segmentation}
        found["background"] = call.behind(seen, chosen)
        if keywords["lighting"] is None:
            found["lighting"] = call.lit(volume, chosen) or None
        return Wanted(found, files, placed)
