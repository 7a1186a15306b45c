"""The floating-point types that device code is written over: samples in float32 or float64, sums always in float64."""

import warp as wp

REALS = {"float32": wp.float32, "float64": wp.float64}


def name_of(real):
    """The name of ``real``, which is also NumPy's."""
    return real.__name__


def vec2_of(real):
    """Vector of two ``real``."""
    return wp.vec2d if real is wp.float64 else wp.vec2


def vec3_of(real):
    """Vector of three ``real``."""
    return wp.vec3d if real is wp.float64 else wp.vec3


def vec4_of(real):
    """Vector of four ``real``."""
    return wp.vec4d if real is wp.float64 else wp.vec4
