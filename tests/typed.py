"""What type checkers say of calls; read by mypy, run by nobody. An ignore that nothing needs is an error."""

import numpy as np

import wvr

samples = np.zeros((3, 3, 3), np.uint8)

# A certified call has a bound, without a question.
wvr.render(samples, "viridis", lighting=True).error_bound.max()
wvr.render(samples, integrator=wvr.Certified(1e-3)).error_bound.max()
wvr.render(samples, integrator=wvr.Riemann(1)).error_bound.max()  # type: ignore[union-attr]

# What comes back of a movie, and of none.
name: str = wvr.orbit(samples, output="a.gif", size=(3, 3), tolerance=1e-3).name
image: wvr.Image = next(wvr.orbit(samples, frames=2, lighting="center"))
moments: list[wvr.Image] = list(wvr.time_series([samples], shadows=True))

# Slips.
wvr.render(samples, cmap="viridis")  # type: ignore[call-overload]
wvr.render(samples, precision="float16")  # type: ignore[call-overload]
wvr.render(samples, lighting="centre")  # type: ignore[call-overload]
wvr.orbit(samples, lightning=True)  # type: ignore[call-overload]
wvr.as_volume(samples, axes="zxy")  # type: ignore[arg-type]
wvr.TransferFunction.preset("ct_bone")  # type: ignore[arg-type]
wvr.Riemann(0.5, rule="centre")  # type: ignore[arg-type]
wvr.Lighting(mode="phong")  # type: ignore[arg-type]
wvr.preintegrate(wvr.TransferFunction.preset("ct-bone"), generator="fast")  # type: ignore[call-overload]
wvr.ConvolutionShadows(mode="soft")  # type: ignore[arg-type]
