"""What a step may include, as bits of a number that is known when a kernel is compiled.

What is not asked for is not compiled.
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
) = (1 << k for k in range(19))
# LAYERS: a quantity of the forcing has several tiles; POLAR: the domain holds a pole; PARAMETERS: a
# velocity of the user's own, whose parameters stand in the columns of the leeway lines.
LINES = WIND | PARAMETERS  # what has these columns read
# terms of kernels.step.velocity, by quantity
FORCING = {"current": CURRENT, "wind": WIND, "stokes": STOKES}
