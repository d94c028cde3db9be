"""A fit of errors as text: lines for a terminal, and the `[uncertainty]` of a case to paste."""

import math

from drift.assess.verify.error_law import NAMES
from drift.assess.verify.fitting import Fit, Parameter
from drift.tracking.tracks.clusters import Estimate

Facts = dict[str, str]

MISFIT = 0.25  # difference of correlations from which the model is reported not to fit
WORDS = {
    "std": ("current error, standard deviation", "m/s", 1.0),
    "time": ("current error, decorrelation time", "h", 3600.0),
    "bias": ("constant bias per drifter, standard deviation", "m/s", 1.0),
    "diffusivity": ("diffusivity", "m2/s", 1.0),
    "noise": ("errors of the fixes, standard deviation", "m", 1.0),
}


def fitting_facts(fit: Fit) -> Facts:
    """Return lines, by name, on the fitted parameters, their errors, and the hold-out check."""
    several = len(fit.names) > 1
    lines = {
        "drifters": (
            f"{len(fit.names)}, {fit.increments:,} displacements between fixes; log likelihood "
            f"{fit.log:.1f}"
        ),
        "standard errors": "the larger of two: from the likelihood's curvature, and clustered by drifter"
        if fit.clustered
        else "from the curvature of the likelihood; there are too few drifters for clustered errors",
    }
    for name in NAMES:
        label, unit, scale = WORDS[name]
        if name == "bias" and not several:
            lines[label] = (
                "not determined by one drifter: its bias cannot be separated from the mean error"
            )
        else:
            lines[label] = _parameter(fit.parameters[name], unit, scale)
    for label, value, error in zip(("east", "north"), fit.mean, fit.mean_error, strict=True):
        lines[f"mean error of the model, {label}"] = f"{value:+.3f} ± {error:.3f} m/s"
    if math.isfinite(fit.windage):
        lines["windage (down-wind slope)"] = (
            f"{100 * fit.windage:.2f} ± {100 * fit.windage_error:.2f} % of the wind"
        )
    for lag, data, error, law in fit.correlation:
        within = f" ± {error:.2f}" if math.isfinite(error) else ""
        lines[f"correlation of errors after {lag:g} h"] = (
            f"{data:.2f}{within}, of the fitted model {law:.2f}"
        )
    if misfits := [f"{lag:g}" for lag, data, _, law in fit.correlation if abs(data - law) > MISFIT]:
        lines["the model does not fit"] = (
            f"errors {', '.join(misfits)} h apart are not correlated like an exponential decay, "
            "perhaps by tides or inertial motion that the forcing lacks; areas are too small or "
            "too large at such times"
        )
    if fit.held is not None:
        held = fit.held
        lines["held out"] = (
            f"{held.how}, {held.increments:,} displacements: log likelihood {held.other:.2f} each, "
            f"{held.own:.2f} for the fitted half"
        )
        for coverage in held.coverage:
            if coverage.held.count:
                name = f"held out, {100 * coverage.share:.0f} % ellipse after {coverage.hours:g} h"
                lines[name] = _coverage(coverage.share, coverage.held)
    return lines | {f"note {k}": note for k, note in enumerate(fit.notes, 1)}


def _coverage(share: float, held: Estimate) -> str:
    """Return as text how often an ellipse of a stated share held a displacement."""
    few = ", few days: rough" if held.few else ""
    independent = math.sqrt(share * (1 - share) / held.count)
    return (
        f"held {100 * held.mean:.0f} % ± {100 * held.error:.0f} of {held.count}{few} (independent "
        f"ones: ± {100 * independent:.0f})"
    )


def _parameter(parameter: Parameter, unit: str, scale: float) -> str:
    """Return a parameter in its unit as text; scale: size of the unit in SI."""
    if parameter.identified:
        low, high = (
            parameter.value * math.exp(sign * 2 * parameter.error) / scale for sign in (-1, 1)
        )
        return f"{parameter.value / scale:.3g} {unit} (95 %: {low:.3g} to {high:.3g})"
    if math.isfinite(parameter.limit):
        return f"not determined by these data: below {parameter.limit / scale:.2g} {unit} (95 %)"
    return f"not determined by these data; likeliest {parameter.value / scale:.2g} {unit}"


def toml(fit: Fit) -> str:
    """Return the fitted errors as tables of a case.

    The bias includes the model's mean error. A comment holds a source that removes the mean error,
    and the bias that is then left.
    """
    bias, count = fit.standing_bias, len(fit.names)
    parts = [f'std = "{fit.law.std:.3f} m/s"', f'time = "{fit.law.time / 3600:.1f} h"']
    if bias >= 5e-4:
        parts.append(f'bias = "{bias:.3f} m/s"')
    lines = [
        f"[uncertainty]  # fitted to {count} drifter{'s' if count > 1 else ''}, "
        f"{fit.increments:,} displacements between fixes",
        f"current = {{ {', '.join(parts)} }}",
    ]
    walk = fit.parameters["diffusivity"]
    if walk.identified or fit.law.diffusivity > 0.05:
        lines.append(f'diffusivity = "{fit.law.diffusivity:.2g} m2/s"')
    else:
        lines.append(
            "diffusivity = 0  # not determined by these data"
            + (f": below {walk.limit:.2g} m2/s" if math.isfinite(walk.limit) else "")
        )
    if any(abs(mean) > 2 * error for mean, error in zip(fit.mean, fit.mean_error, strict=True)):
        bias_identified = fit.parameters["bias"].identified
        remedy = (
            f'state bias = "{fit.law.bias:.3f} m/s"'
            if bias_identified
            else "state the rest of the bias, which these data do not determine"
        )
        lines += [
            "",
            f"# The model's mean error is in the bias. To take it out, {remedy}, and add this "
            "source:",
            "# [[current]]",
            '# name = "mean error of the model"',
            f"# constant = {{ east = {fit.mean[0]:.3f}, north = {fit.mean[1]:.3f} }}",
            "# add = true",
        ]
    if math.isfinite(fit.windage) and fit.windage > 0:
        lines += [
            "",
            f'# Windage, of a scenario: object = {{ windage = "{100 * fit.windage:.2f} %" }}',
        ]
    if math.isfinite(fit.windage) and fit.windage <= 2 * fit.windage_error:
        lines.append("# (the data do not distinguish it from none)")
    return "\n".join(lines)
