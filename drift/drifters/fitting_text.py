"""What a fit of errors says: in words for a terminal, and as the `[uncertainty]` of a case to paste."""

import math

from drift.drifters.error_law import NAMES
from drift.drifters.fitting import Fit, Parameter

Facts = dict[str, str]

MISFIT = 0.25  # of a correlation, beyond which it is told that it is not that of the law
WORDS = {
    "std": ("current error, standard deviation", "m/s", 1.0),
    "time": ("current error, decorrelation time", "h", 3600.0),
    "bias": ("bias that a drifter keeps, standard deviation", "m/s", 1.0),
    "diffusivity": ("diffusivity", "m2/s", 1.0),
    "noise": ("errors of the fixes, standard deviation", "m", 1.0),
}


def facts(fit: Fit) -> Facts:
    """Return what was fitted, how well it is known, and how it was checked, by name."""
    many = len(fit.names) > 1
    told = {
        "drifters": f"{len(fit.names)}, {fit.increments:,} ways between fixes; log likelihood {fit.log:.1f}",
        "standard errors": "the larger of the likelihood's curvature and of that clustered by drifter"
        if fit.clustered
        else "from the curvature of the likelihood: drifters are too few to cluster by",
    }
    for name in NAMES:
        words, unit, scale = WORDS[name]
        if name == "bias" and not many:
            told[words] = "not told by one drifter: its bias and the mean error are one"
        else:
            told[words] = _parameter(fit.parameters[name], unit, scale)
    for words, value, error in zip(("east", "north"), fit.mean, fit.mean_error, strict=True):
        told[f"mean error of the model, {words}"] = f"{value:+.3f} ± {error:.3f} m/s"
    if math.isfinite(fit.windage):
        told["windage (down-wind slope)"] = f"{100 * fit.windage:.2f} ± {100 * fit.windage_error:.2f} % of the wind"
    for lag, data, error, law in fit.correlation:
        within = f" ± {error:.2f}" if math.isfinite(error) else ""
        told[f"correlation of errors after {lag:g} h"] = f"{data:.2f}{within}, of the fitted law {law:.2f}"
    if strange := [f"{lag:g}" for lag, data, _, law in fit.correlation if abs(data - law) > MISFIT]:
        told["the law does not fit"] = (
            f"errors {', '.join(strange)} h apart are correlated otherwise than by any decay: tides or inertial motion, which a "
            "model is to bring; areas are then too small or too large at such times"
        )
    if fit.held is not None:
        held = fit.held
        told["held out"] = (
            f"{held.how}, {held.increments:,} ways: log likelihood {held.other:.2f} each, {held.own:.2f} of those fitted"
        )
        for one in held.coverage:
            if one.held.count:
                few = ", few days: rough" if one.held.few else ""
                told[f"held out, {100 * one.share:.0f} % ellipse after {one.hours:g} h"] = (
                    f"held {100 * one.held.mean:.0f} % ± {100 * one.held.error:.0f} of {one.held.count}{few} (independent ones: "
                    f"± {100 * math.sqrt(one.share * (1 - one.share) / one.held.count):.0f})"
                )
    return told | {f"note {k}": note for k, note in enumerate(fit.notes, 1)}


def _parameter(one: Parameter, unit: str, scale: float) -> str:
    if one.told:
        low, high = (one.value * math.exp(sign * 2 * one.error) / scale for sign in (-1, 1))
        return f"{one.value / scale:.3g} {unit} (95 %: {low:.3g} to {high:.3g})"
    if math.isfinite(one.limit):
        return f"not told by these data: below {one.limit / scale:.2g} {unit} (95 %)"
    return f"not told by these data; likeliest {one.value / scale:.2g} {unit}"


def toml(fit: Fit) -> str:
    """Return the errors as tables of a case.

    The mean error is part of the bias, as long as no source takes it out: that one is given as a comment, with the bias
    that is left then.
    """
    bias = fit.standing_bias
    parts = [f'std = "{fit.law.std:.3f} m/s"', f'time = "{fit.law.time / 3600:.1f} h"']
    if bias >= 5e-4:
        parts.append(f'bias = "{bias:.3f} m/s"')
    lines = [
        f"[uncertainty]  # fitted to {len(fit.names)} drifter{'s' if len(fit.names) > 1 else ''}, {fit.increments:,} ways between fixes",
        f"current = {{ {', '.join(parts)} }}",
    ]
    walk = fit.parameters["diffusivity"]
    if walk.told or fit.law.diffusivity > 0.05:
        lines.append(f'diffusivity = "{fit.law.diffusivity:.2g} m2/s"')
    else:
        lines.append(
            "diffusivity = 0  # not told by these data"
            + (f": below {walk.limit:.2g} m2/s" if math.isfinite(walk.limit) else "")
        )
    if any(abs(mean) > 2 * error for mean, error in zip(fit.mean, fit.mean_error, strict=True)):
        told = fit.parameters["bias"].told
        left = (
            f'state bias = "{fit.law.bias:.3f} m/s"'
            if told
            else "state what is left of the bias, which these data do not tell"
        )
        lines += [
            "",
            f"# The model's mean error is in the bias. To take it out, {left}, and add this source:",
            f'# [[current]]\n# name = "mean error of the model"\n# constant = {{ east = {fit.mean[0]:.3f}, north = {fit.mean[1]:.3f} }}\n# add = true',
        ]
    if math.isfinite(fit.windage) and fit.windage > 0:
        lines += ["", f'# Windage, of a scenario: object = {{ windage = "{100 * fit.windage:.2f} %" }}']
    if math.isfinite(fit.windage) and fit.windage <= 2 * fit.windage_error:
        lines.append("# (the data do not tell it from none)")
    return "\n".join(lines)
