"""The dataset that command lines of tests are about."""

import wvr

SIZE = 12


def spheres():
    return wvr.datasets.load("spheres", SIZE)
