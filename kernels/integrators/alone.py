"""A piece of ray that double precision has, lit as ``lit`` does cells: its points in the lanes."""

from functools import cache

import warp as wp

from ..field.gradients import ROWS
from .crossings import make_crossings
from .lit import JOBS, PIECE, PLACES, Task

# Depth of a piece, at most, as far as its light is concerned.
DEEPEST = wp.float64(1e9)


@cache
def make_lit_piece(halves):
    """``lit_piece(scene, middle, d, length, m, k, segment)`` -> ``segment`` lit, of a piece about its ``middle`` along
    d in interval k, whose scalar is ``m[0] + m[1] v + m[2] v^2 + m[3] v^3``, in the cell whose gradients are known.
    """
    real = wp.float64
    Scene = halves.Scene
    light = make_crossings(True, halves.cuts.clipped)

    @wp.func
    def lit_piece(scene: Scene, middle: wp.vec3d, d: wp.vec3d, length: real, m: wp.vec4d, k: int, segment: wp.vec4d):
        A = segment[3]
        if A <= real(0.0):
            return segment
        scratch = scene.march.scratch
        cell = wp.array(ptr=scratch + wp.uint64(wp.static(PLACES[0])), shape=(4,), dtype=real)
        numbers = wp.array(ptr=scratch + wp.uint64(wp.static(PLACES[1])), shape=(24,), dtype=wp.float32)
        task = Task()
        task.gradient = wp.array(ptr=scratch + wp.uint64(wp.static(PLACES[2])), shape=(ROWS, JOBS), dtype=wp.float32)
        task.numbers = numbers
        task.clear = wp.float32(1.0)
        task.tolerance = wp.float32(scene.march.tolerance)
        task.what = wp.static(PIECE)
        slope = scene.transfer.slope[k]
        away = wp.dot(middle - wp.vec3d(cell[0], cell[1], cell[2]), d)
        # Its depth, which its opacity does not say where that is 1.
        mean = m[0] + real(wp.static(1.0 / 3.0)) * m[2]
        extinction = scene.transfer.value[k][3] + (mean - scene.transfer.knot[k]) * slope[3]
        depth = length * wp.max(extinction, real(0.0))
        # Of what is deeper only the front is seen; but of squares of depths single precision has no more.
        less = wp.min(wp.static(DEEPEST) / wp.max(depth, real(1.0)), real(1.0))
        numbers[0] = wp.float32(less * depth)
        numbers[1] = wp.float32(A)
        numbers[2] = wp.float32(less * real(0.5) * length * slope[3])
        for n in range(3):
            numbers[3 + n] = wp.float32(m[1 + n])
            numbers[8 + n] = wp.float32(segment[n] / A)
            numbers[12 + n] = wp.float32(slope[n])
        numbers[6] = wp.float32(away / (wp.dot(d, d) * cell[3]))
        numbers[7] = wp.float32(real(0.5) * length / cell[3])
        light(scene.march.rows, scene.transfer, wp.vec3(), scene.light, task)
        return wp.vec4d(real(numbers[16]), real(numbers[17]), real(numbers[18]), A)

    return lit_piece
