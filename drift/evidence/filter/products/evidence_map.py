"""The picture of a search's evidence: probability and POS of each scenario after each update.

The left chart lists the updates, downward in time, with the probability of each scenario after each
and the Bayes factor of the scenario that changed most. The right chart is the cumulative POS by
scenario, the basis of a decision to suspend.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import blended_transform_factory

from drift.evidence.filter import shapes as search_shapes
from drift.evidence.filter.products import particles_left
from drift.evidence.filter.products import tables as search_tables
from drift.evidence.filter.updates import Update, Updates, merge_unlikely_scenarios
from drift.forecast import effective
from drift.forecast.products import layers
from drift.products.maps import labels, page, sheet
from drift.products.maps.chart import GREY, INK
from drift.products.maps.imprint import Setting
from drift.products.maps.sheet import Badge, Row, Sheet
from geo import notation
from geo.array import Array

A_LINE = 4  # scenarios on a line of the legend
HUGE = 1e6  # largest Bayes factor that is written exactly
MOST = 22  # most rows; if there are more updates, the last ones
THIN = 0.006  # share of a scenario below which its bar has no edge
DIGIT = 0.072  # [in] width of a small digit
OVERHANG = 0.12  # [in] how far numbers over a chart may reach beyond its right edge
# Any two differ by hatch, or by lightness that is visible in greyscale.
FILLS: tuple[dict[str, Any], ...] = (
    {"facecolor": "#cfe0ee", "hatch": ""},
    {"facecolor": "#0b4f8a", "hatch": ""},
    {"facecolor": "#f3d9a4", "hatch": "////"},
    {"facecolor": "#7d8894", "hatch": ""},
    {"facecolor": "#ffffff", "hatch": "...."},
    {"facecolor": "#e6b8ab", "hatch": "||||"},
    {"facecolor": "#dfe7d3", "hatch": "\\\\\\\\"},
    {"facecolor": "#b6cfb2", "hatch": "----"},
    {"facecolor": "#e7c3d4", "hatch": "xxxx"},
    {"facecolor": "#d6bfe4", "hatch": "++++"},
    {"facecolor": "#eeeeee", "hatch": "oo"},
)
STROKES: tuple[tuple[str, Any, str], ...] = (  # colour, dashes, marker
    ("#5b8db8", (0, (6, 2)), "s"),
    ("#0b4f8a", (0, (2, 1.5)), "^"),
    ("#b9802a", (0, (6, 2, 1, 2)), "D"),
    ("#55606b", (0, (10, 2)), "v"),
    ("#7a1fa2", (0, (1, 1.2)), "P"),
    ("#a33b20", (0, (4, 1, 1, 1, 1, 1)), "X"),
    ("#7f9464", (0, (8, 1, 2, 1)), "<"),
    ("#3f6b3a", (0, (3, 3)), ">"),
    ("#c2557f", (0, (5, 1, 1, 1)), "p"),
    ("#40507a", (0, (2, 1, 2, 4)), "h"),
    ("#999999", (0, (1, 3)), "d"),
)
# Kass and Raftery (1995), Bayes factors, J. Am. Stat. Assoc. 90, 773-795,
# doi:10.1080/01621459.1995.10476572, section 3.2
STRENGTH = (
    (1.2, ""),
    (3.0, "weak"),
    (20.0, "positive"),
    (150.0, "strong"),
    (math.inf, "very strong"),
)


def plot_evidence(updates: Updates, path: Path, setting: Setting) -> None:
    """Draw the evidence of a search; scenarios beyond the likeliest are merged into one."""
    every, updates = updates, merge_unlikely_scenarios(updates)
    steps = search_tables.steps(updates)
    shown = list(enumerate(steps, 1))[-MOST:]
    stories = len(updates.scenarios) > 1
    lines = -(-len(updates.scenarios) // A_LINE) if stories else 0  # lines of the legend
    least = particles_left.lowest(updates, setting.particles)
    below = 0.32 * least.few  # [in] height of a warning
    over = 1.45 + 0.24 * lines + below
    height = max(4.6, over + 1.0 + 0.47 * (len(shown) + 1))
    on = sheet.begin_page(
        Sheet(
            14.0,
            height,
            120,
            left=0.02,
            title=sheet.heading(1 - 0.4 / height, 14),
            lines=(Row(1 - 0.68 / height, 9.5),),
            caution=Badge(0.985, 1 - 0.4 / height, side="right"),
            rough=Badge(0.0225, 1 - 1.0 / height),
            footer=sheet.small(0.07 / height, 7),
        )
    )
    figure = on.figure
    room = (0.85 / height, 1 - over / height)  # bottom and top of both charts
    (_posterior if stories else _sortie_bars)(figure, updates, shown, room)
    if _flown(updates):
        _cumulative(figure, updates, room)
    sheet.write_head(on, setting.imprint, _subtitle(every, len(steps) - len(shown)))
    if stories:
        _legend(figure, updates, 1 - (0.86 + below) / height)
    if least.few:
        sheet.draw_rough_banner(on, effective.banner(least, "shares, evidence and POS are rough"))
    figure.text(
        0.02,
        0.33 / height,
        _explained(updates),
        fontsize=8,
        color=GREY,
        linespacing=1.35,
        va="center",
    )
    sheet.finish_page(on, path, setting.imprint)


def _flown(updates: Updates) -> bool:
    """Whether there is a cumulative POS.

    Without it, the chart on the left takes the full width.
    """
    return any(update.cumulative is not None for update in updates.all)


def evidence_in_words(update: Update, before: Array, scenarios: tuple[str, ...]) -> tuple[str, str]:
    """Return the effect of an update on the scenarios in words, and its Bayes factor and strength.

    It names the scenario whose odds against the others changed most. Both are empty if there is
    only one scenario.

    Args:
        update: the update.
        before: probability of each scenario before it, shape (scenarios,).
        scenarios: their names.
    """
    factors = search_tables.bayes_factors(update, before)
    defined = [j for j in range(len(factors)) if not np.isnan(factors[j])]
    if not defined:
        return "", ""
    gone = [scenarios[j] for j in defined if factors[j] == 0]
    if gone:
        return f"rules out {_quoted(gone)}", "impossible in that scenario"
    most = max(defined, key=lambda j: abs(math.log(factors[j])))
    factor = float(factors[most])
    if factor == math.inf:
        return f"leaves only {_quoted([scenarios[most]])}", "impossible in the others"
    size = max(factor, 1 / factor)
    strength = next(word for limit, word in STRENGTH if size < limit or limit == math.inf)
    if not strength:
        return "hardly distinguishes the scenarios", f"no Bayes factor beyond {size:.2f}"
    figure = f"{size:.3g}" if size < 999.5 else labels.number(min(size, HUGE))
    if factor > 1:
        side, figure = "for", figure if size < HUGE else f"over {figure}"
    else:
        side, figure = "against", f"1/{figure}" if size < HUGE else f"under 1/{figure}"
    return (
        f"speaks {side} {_quoted([scenarios[most]])}",
        f"Bayes factor {figure}: {strength} evidence",
    )


def _quoted(names: list[str]) -> str:
    quoted = [f'"{page.fit(name, 30)}"' for name in names[:2]]
    return " and ".join(quoted) + (f" and {len(names) - 2} more" if len(names) > 2 else "")


def _subtitle(updates: Updates, hidden: int) -> str:
    """Return the line of text under the title: what was done, and the status of the search."""
    sorties = [u for u in updates.all if u.kind == "sortie"]
    contacts = sum(u.kind == "contact" for u in updates.all)
    overdue = sum(u.kind == "overdue" for u in updates.all)
    sensors = len(updates.all) - len(sorties) - contacts - overdue
    parts = (
        [f"{len(sorties)} sortie{'s' * (len(sorties) != 1)} that found nothing"]
        if sorties or not updates.all
        else []
    )
    if contacts:
        parts.append(f"{contacts} contact{'s' * (contacts != 1)}")
    if sensors:
        parts.append(f"{sensors} report{'s' * (sensors != 1)} of sensors")
    if overdue:
        parts.append(f"{overdue} overdue arrival{'s' * (overdue != 1)}")
    done = [u.cumulative[-1] for u in sorties if u.cumulative is not None]
    if done:
        parts.append(f"cumulative POS {notation.percent(done[-1])}")
    if len(updates.scenarios) > 1 and updates.all:
        best = int(np.argmax(updates.all[-1].posterior))
        share = notation.percent(float(updates.all[-1].posterior[best]))
        parts.append(f'most likely now "{page.fit(updates.scenarios[best], 40)}", {share}')
    if hidden:
        parts.append(f"the first {hidden} updates are in sorties.csv")
    return "   ·   ".join(parts)


def _explained(updates: Updates) -> str:
    if len(updates.scenarios) == 1:
        if not _flown(updates):
            return "After several unlikely reports in a row, one of them may be false, or the scenario wrong."
        return "Cumulative POS: probability that the sorties so far would have found the object."
    factor = (
        "Bayes factor: probability of the observation under the scenario, divided by that under all others; "
        "up to 3 weak, up to 20 positive, up to 150 strong."
    )
    if not _flown(updates):
        return factor
    return (
        f"{factor}\nCumulative POS: probability that the sorties so far would have "
        "found the object if the scenario is true; if it is low, the scenario has hardly been searched."
    )


def _legend(figure: Figure, updates: Updates, top: float) -> None:
    """Draw the legend of scenarios: bar and line of each, row by row."""
    rows: list[tuple[Any, str]] = []
    for j, name in enumerate(page.shorten_names(updates.scenarios, 34)):
        colour, dashes, marker = STROKES[j % len(STROKES)]
        bar = Patch(edgecolor=INK, linewidth=0.6, **FILLS[j % len(FILLS)])
        line = Line2D(
            [],
            [],
            color=colour,
            linestyle=dashes,
            marker=marker,
            markersize=5,
            markeredgecolor="white",
        )
        rows.append(([bar, line], name))
    columns = min(A_LINE, len(rows))
    # legends fill column by column
    order = [i for c in range(columns) for i in range(c, len(rows), columns)]
    sheet.legend(
        figure,
        [rows[i] for i in order],
        loc="upper left",
        bbox_to_anchor=(0.02, top),
        ncols=columns,
        fontsize=9,
        borderaxespad=0,
        borderpad=0,
        handlelength=5.0,
        columnspacing=2.0,
    )


# numbers of the updates, each update, and the probability of the scenarios before it
Shown = list[tuple[int, tuple[Update, Array]]]
Said = list[tuple[str, str]]  # two lines


def _posterior(figure: Figure, updates: Updates, shown: Shown, room: tuple[float, float]) -> None:
    """Draw the probabilities of scenarios as bars, one row an update, with its effect in words."""
    first = shown[0][1][1] if shown else np.asarray(updates.prior, float)
    rows = [first, *(np.asarray(update.posterior, float) for _, (update, _) in shown)]
    begin = (
        "before the first update"
        if not shown or shown[0][0] == 1
        else f"after update {shown[0][0] - 1}"
    )
    short = tuple(page.shorten_names(updates.scenarios, 34))
    effects = [
        ("", ""),
        *(evidence_in_words(update, before, short) for _, (update, before) in shown),
    ]
    heads = ("Probability of each scenario [%]", "Effect of the update")
    ax = _rows(figure, room, shown, begin, effects, heads, wide=not _flown(updates))
    left, y = np.zeros(len(rows)), np.arange(len(rows))
    for j in range(len(updates.scenarios)):
        share = np.array([row[j] for row in rows])
        fill = FILLS[j % len(FILLS)]
        # edges would hide the thin bars of many unlikely scenarios
        edges = np.where(share >= THIN, 0.6, 0.0)
        ax.barh(y, share, 0.62, left, edgecolor=INK, linewidth=edges.tolist(), zorder=3, **fill)
        for k in y[share >= 0.09]:
            _figure(
                ax, left[k] + share[k] / 2, int(k), notation.percent(float(share[k]), 0, ""), fill
            )
        left += share


def _sortie_bars(figure: Figure, updates: Updates, shown: Shown, room: tuple[float, float]) -> None:
    """Draw POC and POS of each sortie for a single scenario.

    Without sorties, draw the probability of each sensor report.
    """
    texts = [("", "")]
    for _, (update, _) in shown:
        pod, figures = update.pod, ""
        if pod is not None and update.poc is not None and update.poc[-1] > 0:
            figures = f"POC {notation.percent(float(update.poc[-1]))} × POD {notation.percent(float(pod[-1]))}"
        texts.append((figures, f"effective particles {update.ess_after:,.0f}"))
    if flown := _flown(updates):
        heads = ("POC (light), POS (dark) [%]", "Factors of the POS")
    else:
        heads = ("Probability of the report beforehand [%]", "Particles left")
    ax = _rows(figure, room, shown, "", texts, heads, wide=not flown)
    for k, (_, (update, _)) in enumerate(shown, 1):
        likely = (
            np.exp(update.log_evidence)
            if not flown and update.kind in ("look", "presence")
            else None
        )
        for values, fill in ((likely, FILLS[0]), (update.poc, FILLS[0]), (update.pos, FILLS[1])):
            if values is not None:
                ax.barh(k, values[-1], 0.62, edgecolor=INK, linewidth=0.6, zorder=3, **fill)


def _rows(
    figure: Figure,
    room: tuple[float, float],
    shown: Shown,
    begin: str,
    said: Said,
    heads: tuple[str, str],
    wide: bool,
) -> Axes:
    """Return axes for one bar a row, from 0 to 1.

    A row has the name of its update on the left and two lines on the right. wide: no other chart
    stands beside it.
    """
    width = 0.5 if wide else 0.21
    ax = figure.add_axes((0.185, room[0], width, room[1] - room[0]))
    ax.set_xlim(0, 1)
    ax.set_ylim(len(shown) + 0.5, -0.5 if begin else 0.5)
    ax.set_yticks([])
    ax.set_xticks(np.linspace(0, 1, 5), labels=[f"{100 * v:.0f}" for v in np.linspace(0, 1, 5)])
    ax.tick_params(labelsize=8, colors=INK, length=3)
    for name, spine in ax.spines.items():
        spine.set(visible=name == "bottom", color=INK, linewidth=0.8)
    place = blended_transform_factory(ax.transAxes, ax.transData)

    def write(x: float, y: float, text: str, size: float, colour: str = INK, **style: Any) -> None:
        ax.text(x, y, text, transform=place, va="center", fontsize=size, color=colour, **style)

    beside = -0.0065 / width
    write(beside, 0, begin, 8.5, GREY, ha="right")
    for k, (number, (update, _)) in enumerate(shown, 1):
        what = (
            update.name
            if update.kind in ("sortie", "overdue")
            else f"{page.fit(update.name, 18)} ({update.kind})"
        )
        write(beside, k - 0.15, f"{number}  {page.fit(what, 28)}", 9, weight="bold", ha="right")
        pos = "" if update.pos is None else f", POS {notation.percent(float(update.pos[-1]))}"
        left = effective.Count(update.left)
        if left.few:
            write(
                beside,
                k + 0.21,
                f"{notation.format_dtg(update.time)}, {left.words}",
                7.5,
                layers.LAST_KNOWN,
                ha="right",
            )
        else:
            write(beside, k + 0.21, notation.format_dtg(update.time) + pos, 7.5, GREY, ha="right")
    for k, (above, below) in enumerate(said):
        write(1 + 0.0065 / width, k - 0.15, above, 9)
        write(1 + 0.0065 / width, k + 0.21, below, 7.5, GREY)
    for x, head in zip((0.185, 0.1915 + width), heads, strict=True):
        figure.text(
            x, room[1] + 0.25 / figure.get_figheight(), head, fontsize=10, weight="bold", color=INK
        )
    return ax


def _figure(ax: Axes, x: float, y: int, text: str, fill: dict[str, Any]) -> None:
    red, green, blue = (int(fill["facecolor"][i : i + 2], 16) for i in (1, 3, 5))
    dark = 0.3 * red + 0.59 * green + 0.11 * blue < 140
    box = (
        {"boxstyle": "square,pad=0.1", "facecolor": fill["facecolor"], "edgecolor": "none"}
        if fill["hatch"]
        else None
    )
    colour = "white" if dark else INK
    ax.text(x, y, text, ha="center", va="center", fontsize=8, color=colour, zorder=5, bbox=box)


def _cumulative(figure: Figure, updates: Updates, room: tuple[float, float]) -> None:
    """Draw the cumulative POS by scenario over time, with value and name at each line's end."""
    ax = figure.add_axes((0.665, room[0], 0.185, room[1] - room[0]))
    high = figure.get_figheight()
    figure.text(
        0.665, room[1] + 0.25 / high, "Cumulative POS [%]", fontsize=10, weight="bold", color=INK
    )
    done = [(number, u) for number, u in enumerate(updates.all, 1) if u.cumulative is not None]
    ax.set_ylim(0, 1)
    ax.set_yticks(np.linspace(0, 1, 6), labels=[f"{100 * v:.0f}" for v in np.linspace(0, 1, 6)])
    ax.tick_params(labelsize=8, colors=INK, length=3)
    ax.grid(color=INK, alpha=0.2, linewidth=0.5, zorder=0)
    for spine in ax.spines.values():
        spine.set(color=INK, linewidth=0.8)
    times = np.array([search_shapes.epoch(update.time) for _, update in done])
    values = np.array([update.cumulative for _, update in done])
    before = times[0] - max(0.08 * (times[-1] - times[0]), 3600)
    ax.set_xlim(before, times[-1] + 0.04 * (times[-1] - before))
    order = [*range(len(updates.scenarios)), -1] if len(updates.scenarios) > 1 else [-1]
    texts, short = [], page.shorten_names(updates.scenarios, 24)
    for j in order:
        colour, dashes, marker = STROKES[j % len(STROKES)] if j >= 0 else ("#111111", "-", "o")
        style: dict[str, Any] = {
            "color": colour,
            "linestyle": dashes,
            "linewidth": 1.4 if j >= 0 else 2.4,
        }
        x, y = np.append(before, times), np.append(0.0, values[:, j])
        ax.plot(x, y, drawstyle="steps-post", zorder=4 if j >= 0 else 5, **style)
        ax.plot(
            times,
            values[:, j],
            marker,
            color=colour,
            markersize=5,
            markeredgecolor="white",
            zorder=6,
            clip_on=False,
        )
        name = short[j] if j >= 0 else "all together"
        texts.append((float(values[-1, j]), f"{_percent(values[-1, j])}  {name}", colour, j < 0))
    _ends(ax, texts)
    ticks = labels.round_times(*ax.get_xlim(), 4)
    ax.set_xticks(ticks, labels=[notation.day_time(np.datetime64(round(t), "s")) for t in ticks])
    _numbers(ax, [number for number, _ in done], times)


def _numbers(ax: Axes, numbers: list[int], times: Array) -> None:
    """Write the numbers of sorties over the chart at their times.

    Numbers that would overlap become one text, such as 4-6, 8.
    """
    begin, end = ax.get_xlim()
    per = (end - begin) / (ax.get_window_extent().width / ax.get_figure(root=True).dpi)  # type: ignore[union-attr]
    # numbers, and begin and end [s] of their text on the time axis
    groups: list[tuple[list[int], float, float]] = []

    def spread(some: list[int]) -> tuple[list[int], float, float]:
        at = float(np.mean([times[numbers.index(number)] for number in some]))
        half = DIGIT * per * len(_runs(some)) / 2
        at = max(min(at, end + OVERHANG * per - half), begin + half)
        return some, at - half, at + half

    for number in numbers:
        groups.append(spread([number]))
        while len(groups) > 1 and groups[-1][1] < groups[-2][2] + DIGIT * per:
            last = groups.pop()[0]
            groups[-1] = spread([*groups[-1][0], *last])
    for some, left, right in groups:
        ax.annotate(
            _runs(some),
            ((left + right) / 2, 1.0),
            (0, 3),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=GREY,
        )


def _runs(numbers: list[int]) -> str:
    """Return ascending numbers as ranges, such as 1, 3-5."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def _ends(ax: Axes, texts: list[tuple[float, str, str, bool]]) -> None:
    """Write the last value and name of each line right of the chart, without overlaps."""
    texts = sorted(texts)
    inches = ax.get_window_extent().height / ax.get_figure(root=True).dpi  # type: ignore[union-attr]
    least = 0.19 / inches
    y = [text[0] for text in texts]
    for i in range(1, len(y)):  # push up, then back from the top
        y[i] = max(y[i], y[i - 1] + least)
    y[-1] = min(y[-1], 1.0)
    for i in range(len(y) - 2, -1, -1):
        y[i] = min(y[i], y[i + 1] - least)
    for at, (value, text, colour, bold) in zip(y, texts, strict=True):
        weight = "bold" if bold else "normal"
        leader = {
            "arrowstyle": "-",
            "color": GREY,
            "linewidth": 0.5,
            "shrinkA": 0,
            "shrinkB": 0,
            "relpos": (0, 0.5),
        }
        ax.annotate(
            text,
            (1.0, value),
            (1.07, at),
            xycoords="axes fraction",
            textcoords="axes fraction",
            fontsize=8.5,
            va="center",
            color=colour,
            weight=weight,
            annotation_clip=False,
            arrowprops=leader,
        )


def _percent(share: float) -> str:
    return notation.percent(share, 0 if 0.005 <= share < 0.995 else 1, "")
