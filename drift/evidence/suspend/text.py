"""The basis of a decision to suspend as ASCII text without a recommendation."""

import numpy as np

from drift.evidence.suspend.decision import Suspension
from drift.forecast import effective
from drift.products.files.text_sheet import SYNTHETIC, paragraph, text_sheet
from geo import notation
from geo.notation import NMI

FIRST = (0.5, 0.1, 0.01)  # probabilities of being alive whose times are stated


def suspension_text(
    suspension: Suspension, case_title: str, run: str, *, synthetic: bool = False, lost: float = 0.0
) -> str:
    """Return the basis of a decision to suspend as text.

    Args:
        suspension: the basis.
        case_title: title of the case.
        run: the run_id.
        synthetic: whether winds or currents are synthetic.
        lost: probability of particles on no map.
    """
    what = (
        "the last sortie or contact"
        if suspension.now > suspension.times[0] and suspension.sorties
        else "what is known"
    )
    intro = paragraph(
        f"As of {notation.format_dtg(suspension.now)}, {what}. All figures assume that nothing has been found."
    )
    intro += paragraph("The decision is the coordinator's: this is not a recommendation.")
    sections = (
        ("ALIVE", _alive(suspension)),
        ("WHAT HAS BEEN SEARCHED", _searched(suspension)),
        ("WHAT IS LEFT", _left(suspension, lost)),
        ("SEARCHING ON", _further(suspension)),
    )
    return text_sheet(
        "BASIS OF A DECISION TO SUSPEND",
        case_title,
        run,
        sections,
        warnings=warnings(suspension, synthetic),
        intro=intro,
    )


def warnings(suspension: Suspension, synthetic: bool) -> list[str]:
    """Return warnings about figures that are not reliable."""
    lines = [SYNTHETIC] if synthetic else []
    if suspension.count.few:
        lines.append(
            effective.sentence(
                suspension.count, "of all that were drawn", "every figure here is rough"
            )
        )
    return lines + missing_survival_warning(suspension)


def missing_survival_warning(suspension: Suspension) -> list[str]:
    """Return a warning if some scenarios have no survival times while others have them."""
    names = ", ".join(
        f'"{name}"'
        for name, basis in zip(suspension.scenarios, suspension.bases, strict=True)
        if basis is None
    )
    if not (suspension.mortal and names):
        return []
    return [f"no survival times for {names}: persons adrift there are assumed alive forever."]


def _give_or_take(value: float, error: float) -> str:
    """Return a probability with its standard error, in percent."""
    return f"{notation.percent(value)} +- {100 * error:.{1 if error >= 9.5e-4 else 2}f}"


def reached(suspension: Suspension) -> list[tuple[float, np.datetime64]]:
    """Return the times when the probability of being alive falls to each of FIRST.

    Times outside the curve are left out.
    """
    alive, times = suspension.alive[:, -1], notation.epochs(suspension.times)
    crossings = []
    for level in FIRST:
        below = np.flatnonzero(alive <= level)
        if len(below) and below[0] > 0:
            i = int(below[0])
            part = (alive[i - 1] - level) / (alive[i - 1] - alive[i])
            crossings.append(
                (level, np.datetime64(round(times[i - 1] + part * (times[i] - times[i - 1])), "s"))
            )
    return crossings


def _alive(suspension: Suspension) -> list[str]:
    if not suspension.mortal:
        return paragraph(
            "No scenario has survival times (survival = ...), so survival is unknown.", 3
        )
    several = len(suspension.scenarios) > 1
    lines = [f"   {'':18}{'From now':10}Probability of being alive"]
    for time, mean, error in suspension.ahead:
        hours = float((time - suspension.now) / np.timedelta64(1, "h"))
        ahead = "now" if hours == 0 else f"+{hours:.0f} h" if hours < 72 else f"+{hours / 24:.0f} d"
        lines.append(
            f"   {notation.format_dtg(time):18}{ahead:10}{_give_or_take(float(mean[-1]), float(error[-1]))}"
        )
    for level, time in reached(suspension):
        tense = "was" if time < suspension.now else "is"
        lines.append(f"   It {tense} {100 * level:.0f} % at {notation.format_dtg(time)}.")
    lines += ["   By scenario, now:"] if several else []
    for s, basis in enumerate(suspension.bases):
        now = (
            f"{notation.percent(float(suspension.ahead[0][1][s]))} alive; "
            if several
            else "Survival times: "
        )
        name = f'"{suspension.scenarios[s]}": ' if several else ""
        lines += paragraph(f"{name}{now}{basis or 'no survival times'}", 3, 6)
    caveat = "The error is that of the particles. Survival times are far less certain: try half and twice the median."
    return [*lines, *paragraph(caveat, 3)]


def _searched(suspension: Suspension) -> list[str]:
    if not suspension.sorties:
        return paragraph("No sortie has been flown.", 3)
    lines = [f"   {'Sortie':25}{'Ended':9}{'nmi2':>8}{'POC':>8}{'POD':>8}{'POS':>8}{'So far':>9}"]
    for update, area in suspension.sorties:
        name = update.name if len(update.name) <= 24 else f"{update.name[:21]}..."
        size = f"{area / NMI**2:,.0f}" if np.isfinite(area) else ""
        figures = [
            float(v[-1]) if v is not None else np.nan
            for v in (update.poc, update.pod, update.pos, update.cumulative)
        ]
        poc, pod, pos, so_far = (f"{100 * v:.1f} %" if np.isfinite(v) else "" for v in figures)
        lines.append(
            f"   {name:25}{notation.format_dtg(update.time)[:6] + 'Z':9}{size:>8}{poc:>8}{pod:>8}{pos:>8}{so_far:>9}"
        )
    total = float(suspension.cumulative[-1])
    lines += ["", f"   Cumulative POS  {_give_or_take(total, float(suspension.error(total)))}"]
    if len(suspension.scenarios) > 1:
        for s, name in enumerate(suspension.scenarios):
            by_now, prior, posterior = (
                notation.percent(float(v[s]))
                for v in (suspension.cumulative, suspension.prior, suspension.share)
            )
            words = f'{by_now} if "{name}" is true: its probability was {prior} at first, and is {posterior} now'
            lines += paragraph(words, 3, 6)
    return lines


def _left(suspension: Suspension, lost: float) -> list[str]:
    lines = []
    if suspension.sorties:
        never = float(suspension.never[-1])
        lines += paragraph(
            f"{_give_or_take(never, float(suspension.error(never)))} of the remaining probability lies outside all searched "
            f"areas; the other {notation.percent(1 - never)} was searched and missed.",
            3,
        )
        for s, name in enumerate(suspension.scenarios if len(suspension.scenarios) > 1 else ()):
            lines += paragraph(
                f'"{name}": {notation.percent(float(suspension.never[s]))} of its probability never searched',
                3,
                6,
            )
        lines += paragraph("Probability left in the searched area right after each sortie:", 3)
        for update, _ in suspension.sorties:
            if update.poc is not None and update.pos is not None:
                poc, pos = float(update.poc[-1]), float(update.pos[-1])
                lines += paragraph(
                    f"{notation.percent((poc - pos) / max(1 - pos, 1e-12))}  {update.name}", 3, 6
                )
    else:
        lines += paragraph("Nothing has been searched: all of the probability is left.", 3)
    if lost > 0:
        lines += paragraph(
            f"At the end of the run {notation.percent(lost)} is on no map: see the account in summary.json.",
            3,
        )
    return lines


def _further(suspension: Suspension) -> list[str]:
    lines = paragraph(f"{suspension.how[:1].upper()}{suspension.how[1:]}.", 3)
    if not suspension.further:
        return lines

    def figure(value: float, error: float) -> str:
        return _give_or_take(value, error) if suspension.planned else notation.percent(value)

    head = f"   {'Until':16}{'Found':>18}"
    if suspension.mortal:
        head += f"{'Found alive':>18}{'Alive, not found':>19}"
    lines += ["", head]
    for end in suspension.further:
        row = f"   {notation.format_dtg(end.until):16}{figure(end.pos, end.pos_error):>18}"
        if suspension.mortal:
            row += f"{figure(end.alive, end.alive_error):>18}{notation.percent(end.waiting):>19}"
        lines.append(row)
    lines += ["", *paragraph("Probabilities from now on; each row includes the rows above it.", 3)]
    if not suspension.planned:
        lines += paragraph(
            "It is a rough figure, neither a plan nor a bound: the map does not change while the object drifts on and spreads, "
            "which makes later days look better than they are. The size of this effect is unknown, so no errors are given. "
            "Regular tracks find more than random search does, and effort cannot be divided without limit. drift plan "
            "makes a plan.",
            3,
        )
    return lines
