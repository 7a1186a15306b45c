"""The control points of the presets; :mod:`wvr.presets` says what they are made for."""

from __future__ import annotations

from typing import Literal, NamedTuple

from .validation import check_domain, choice

HOUNSFIELD = (-1000.0, 2000.0)  # air, dense cortical bone
RELATIVE = (0.0, 1.0)


PresetName = Literal["ct-bone", "ct-soft-tissue", "ct-angiography", "ct-lung", "mri", "isosurfaces", "simulation"]


class Preset(NamedTuple):
    """Control points (scalar, colour, opacity of the smallest voxel spacing) and the scalars a domain stands for."""

    range: tuple[float, float]
    points: list[tuple[float, str, float]]


PRESETS: dict[str, Preset] = {
    # Bone from its marrow up; everything softer is transparent.
    "ct-bone": Preset(
        HOUNSFIELD,
        [
            (150, "#7a3b22", 0.0),
            (300, "#b0683a", 0.03),
            (500, "#dcae7a", 0.15),
            (1000, "#f4e3c3", 0.4),
            (2000, "#ffffff", 0.7),
        ],
    ),
    # Skin and fat as a thin veil, organs red, bone ivory.
    "ct-soft-tissue": Preset(
        HOUNSFIELD,
        [
            (-300, "#8a4b2f", 0.0),
            (-150, "#b5764a", 0.02),
            (-80, "#dca766", 0.01),
            (0, "#b5533c", 0.015),
            (50, "#a8322a", 0.04),
            (150, "#c4573a", 0.06),
            (400, "#ecd2a0", 0.15),
            (1500, "#ffffff", 0.5),
        ],
    ),
    # Vessels with contrast medium red; bone, which shares their range from below, pale and less opaque.
    "ct-angiography": Preset(
        HOUNSFIELD,
        [
            (120, "#7a1420", 0.0),
            (200, "#b01e26", 0.08),
            (350, "#e0402e", 0.3),
            (500, "#f0a070", 0.3),
            (700, "#efe2c8", 0.12),
            (2000, "#ffffff", 0.3),
        ],
    ),
    # Lung tissue as a veil, its vessels and airway walls more opaque, the wall of the chest transparent.
    "ct-lung": Preset(
        HOUNSFIELD,
        [
            (-950, "#4a6fa5", 0.0),
            (-850, "#6f93c4", 0.006),
            (-700, "#d99a94", 0.015),
            (-500, "#d9705f", 0.08),
            (-300, "#b8402f", 0.1),
            (-200, "#b8402f", 0.0),
            (300, "#efe2c8", 0.0),
            (1500, "#ffffff", 0.15),
        ],
    ),
    "mri": Preset(
        RELATIVE,
        [
            (0.06, "#3b0f2b", 0.0),
            (0.15, "#7a3b2b", 0.015),
            (0.35, "#c2754a", 0.02),
            (0.6, "#eebd83", 0.06),
            (1.0, "#fff3e0", 0.4),
        ],
    ),
    # Four thin shells, the inner ones more opaque.
    "isosurfaces": Preset(
        RELATIVE,
        [
            (level + side * 0.03, color, opacity * (side == 0))
            for level, color, opacity in (
                (0.2, "#3b6fb6", 0.1),
                (0.4, "#4fb286", 0.25),
                (0.6, "#f2b134", 0.5),
                (0.8, "#d7402b", 0.8),
            )
            for side in (-1, 0, 1)
        ],
    ),
    # A quantity that is nothing at 0: the opacity grows with it, as does the brightness (colours of inferno).
    "simulation": Preset(
        RELATIVE,
        [
            (0.02, "#1b0c41", 0.0),
            (0.25, "#781c6d", 0.01),
            (0.5, "#cf4446", 0.05),
            (0.75, "#fb9b06", 0.15),
            (1.0, "#f7d13d", 0.4),
        ],
    ),
}


def preset_points(name: PresetName, domain: tuple[float, float] | None = None) -> list[tuple[float, str, float]]:
    """Control points of a preset, mapped affinely from its own scale to ``domain``; see :func:`wvr.presets.preset`."""
    (start, end), points = PRESETS[choice(name, "name of a preset", list(PRESETS))]
    lo, hi = (start, end) if domain is None else check_domain(domain)
    scale = (hi - lo) / (end - start)
    return [(lo + (scalar - start) * scale, color, opacity) for scalar, color, opacity in points]
