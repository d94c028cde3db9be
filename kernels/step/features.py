"""Optional terms of a step, as bits of a compile-time number.

Terms that are not requested are not compiled.
"""

(
    CURRENT,
    WIND,
    STOKES,
    ERRORS,
    DIFFUSION,
    JIBE,
    COAST,
    RK4,
    BIAS,
    SINK,
    REFLOAT,
    SLIDE,
    DIVERGENCE,
    DEBRIS,
    LAYERS,
    MEMBERS,
    POLAR,
    GUIDED,
    PARAMETERS,
    SHARED,
    TAIL,
    CHANGES,
) = (1 << k for k in range(22))
# LAYERS: a quantity of the forcing has several tiles; POLAR: the domain holds a pole; PARAMETERS:
# the velocity is the user's own, with its parameters in the columns of the leeway lines; SHARED:
# part of the errors is shared with buoys (kernels.step.buoys); TAIL: the errors of the current have a
# scale of each particle's own; CHANGES: objects change their state on the way (kernels.step.change).
LINES = WIND | PARAMETERS  # features that read these columns
# feature of each quantity of the forcing that moves particles
FORCING = {"current": CURRENT, "wind": WIND, "stokes": STOKES}
