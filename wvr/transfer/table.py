"""A pre-integration table as users see it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..validation import choice, float_array, unmasked


class Table:
    """A pre-integration table: segments whose scalar runs linearly between two of n equally spaced values.

    Attributes
    ----------
    rgba
        (n, n, 4), or (m, n, n, 4) for m lengths: [..., i, j, :] is the segment from table value i (front) to j (back):
        premultiplied colour and opacity. NumPy, in the table's precision.
    front, back
        With weights, of the shape of ``rgba``: the integrals of diffuse colour and of white specular light (last
        channel), weighted by a ramp that falls from 1 at the front to 0 at the back, and by the opposite one
        (Lum, Wilson and Ma 2004, section 3). Without coefficients in the transfer function front + back = rgba, so
        that two tables are all that a lit segment reads. None without weights.
    ambient
        ``rgba`` with colours times the transfer function's ambient coefficient; None where it has none.
    domain
        Scalars of the first and last value.
    length
        Length of the segments [world length], or (m,) ascending lengths.
    """

    def __init__(
        self,
        rgba: NDArray[np.floating],
        domain: tuple[float, float],
        length: float | NDArray[np.float64],
        front: NDArray[np.floating] | None = None,
        back: NDArray[np.floating] | None = None,
        ambient: NDArray[np.floating] | None = None,
    ):
        for name, entries in (("rgba", rgba), ("front", front), ("back", back), ("ambient", ambient)):
            unmasked(entries, name)
        self.rgba, self.front, self.back, self.ambient = rgba, front, back, ambient
        self.domain = domain
        self.length = length

    def lookup(
        self,
        front: ArrayLike,
        back: ArrayLike,
        length: ArrayLike | None = None,
        table: Literal["rgba", "front", "back", "ambient"] = "rgba",
    ) -> NDArray[np.float64]:
        """Segments that run from scalar ``front`` to ``back``, interpolated linearly between entries.

        Parameters
        ----------
        front, back
            Scalars, broadcast together; those outside the domain are clamped to it.
        length
            Lengths [world length]. A 2D table has one and needs none; a 3D table interpolates between its lengths (and
            length 0, which is nothing), up to the last.
        table
            Which: ``"rgba"``, ``"front"``, ``"back"`` or ``"ambient"``.

        Returns
        -------
        float64, shape (..., 4)
        """
        entries = getattr(self, choice(table, "table", ("rgba", "front", "back", "ambient")))
        if entries is None:
            raise ValueError(f"table must be one that was generated, got {table!r}")
        u, v = float_array(front, "front"), float_array(back, "back")
        if np.isnan(u).any() or np.isnan(v).any():
            raise ValueError("front and back must be scalars, got NaN")
        if np.ndim(self.length) == 0:
            if length is not None and np.any(float_array(length, "length") != self.length):
                raise ValueError(f"length must be that of the table, {self.length}, got {length!r}")
            return self._bilinear(entries, u, v)
        lengths = np.concatenate([[0.0], self.length])
        given = float_array(np.nan if length is None else length, "length")
        if not np.all((given >= 0) & (given <= lengths[-1])):
            raise ValueError(f"length must be in [0, {lengths[-1]}], got {length!r}")
        layer = np.clip(np.searchsorted(lengths, given, "right") - 1, 0, len(lengths) - 2)
        share = ((given - lengths[layer]) / np.diff(lengths)[layer])[..., None]
        below = np.where((layer > 0)[..., None], self._bilinear(entries, u, v, np.maximum(layer - 1, 0)), 0.0)
        return (1 - share) * below + share * self._bilinear(entries, u, v, layer)

    def _bilinear(
        self, entries: NDArray, front: NDArray[np.float64], back: NDArray[np.float64], *layer: NDArray
    ) -> NDArray[np.float64]:
        n = entries.shape[-2]
        (lo, hi), last = self.domain, n - 1
        u, v = (np.clip((s - lo) / (hi - lo) * last, 0, last) for s in (front, back))
        i, j = (np.minimum(w.astype(int), n - 2) for w in (u, v))
        x, y = (u - i)[..., None], (v - j)[..., None]
        e00, e01, e10, e11 = (entries[tuple([*layer, i + a, j + b])] for a in (0, 1) for b in (0, 1))
        e0, e1 = e00 * (1 - y) + e01 * y, e10 * (1 - y) + e11 * y
        return e0 * (1 - x) + e1 * x
