"""Shared parts of figures: one width, a title that answers, dots with their spread, lines, quiet axes."""

import copy
import functools
import io
import itertools
import math
import re
import textwrap
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Literal

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure as Figure
from matplotlib.figure import SubFigure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox, ScaledTranslation
from PIL import Image

from testbench.errors import Array
from testbench.model.structure import JOINTS_ONLY
from testbench.report.colours import GREY, SCALE, Look, hexadecimal
from testbench.report.markdown import capital, ended
from testbench.report.schema import Table, TableColumn, best_rows, looks
from testbench.runs.interrupt import SESSION
from testbench.runs.rows import Row
from testbench.runs.spread import Number, Spread, dotted, ends, inner, middle
from testbench.workflows.model_names import row_words

SOFT = hexadecimal(GREY)
SIZES = LinearSegmentedColormap.from_list("sizes", [hexadecimal(colour) for colour in SCALE])
"""Colours of sizes, as recordings have them."""
INCH = 25.4  #: [mm]
WIDTH, DPI = 183 / INCH, 200
"""Width of a figure, as journals print two columns [in]; points per inch."""
MIN_LETTER_SIZE, LETTER_SIZE, TITLE_SIZE = 7.0, 7.4, 8.8
"""Sizes of letters [pt]: the least, that of most, that of a title. On a page 800 pixels wide, 7 points are
11 pixels high."""
STEPS = {
    2: (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8),
    3: (1, 1.5, 2, 3, 5, 7),
    100: (1, 2, 5),
    1000: (1, 3),
    math.inf: (1,),
}
"""Ticks of a decade by how many times the least the greatest value is at most."""
DECADES = 6  #: Most decades of an axis that have a tick each.
LOG_AXIS_RATIO = 5.0  #: Times the least number from which an axis is logarithmic [1].
TITLE, CAPTION = 88, 136  #: Letters of a line of the title, and of the words below.
TITLE_LINES, NARROW_TITLE_LINES = 2, 4  #: Lines of a title at most, in two columns of a journal and in one.
TITLE_BAND, TITLE_LINE, WORDS_LINE = 0.3, 0.15, 0.125
"""Heights of a title of one line, of each further line, and of a line of the words below [in]."""
HEAD_LETTERS = 32  #: Letters of a line of the name of a row.
ROW, TALL_ROW = 0.2, 0.26  #: Height of a row of a forest, and where a name has two lines [in].
KEY_LETTERS = 6  #: Letters that the line of an entry of a key is as wide as.
BREAKS, LATE_BREAKS = (". ", " ("), ("; ", ": ", ", ")
"""Where a title that is too long ends, the best first; and where one ends that has no room in all lines."""


Ticks = tuple[tuple[float, ...], ...]  #: Of the axis to the right and of the upright one.

MICRO = re.compile(r"\bu(?=(?:m|rad)\b)")  #: The u of um and urad.
TIMES_TEN = re.compile(r" x 10\^(-?\d+)")  #: Ends a number that has too many zeros.
RATIO = "ratio"  #: Key of a column of errors over one model's, with 95 % intervals.
ASIDE, GOLDEN = 0.5, 0.618
"""How far dots of a row are apart, over its height, and the step from one to the next [1]."""
TICKS = {"size": 2.5, "width": 0.6, "pad": 2.5}  #: Length, width and distance of ticks [pt].
SIDE = 0.07  #: Room beside what is drawn [in]: letters of an SVG are up to 2 % wider than those of a PNG.
LEVEL, COLOURS = 4, 256
"""Of a PNG: its compression, of which the next ones save no more than a fiftieth, and colours, which make it
three times smaller than all colours do."""
BAND = 0.15  #: Opacity of bands [1]: fainter ones fall together with white where a PNG has few colours.


# No dollar of a name begins a formula. Titles stay where they are: a search for room above every axes, at
# each of three passes, takes a tenth of a picture's time, and no ticks of ours are above. Letters without
# hints are drawn faster by a sixth, and are spaced as in an SVG.
rcParams.update(
    {
        "text.parse_math": False,
        "text.hinting": "none",
        "svg.hashsalt": "testbench",
        "axes.titley": 1.0,
        "font.size": LETTER_SIZE,
        "axes.titlesize": LETTER_SIZE,
        "axes.linewidth": 0.6,
        "axes.titlepad": 4.0,
        "axes.labelpad": 2.5,
        "lines.linewidth": 1.1,
        "figure.constrained_layout.w_pad": SIDE,
        "legend.frameon": False,
        "legend.fontsize": MIN_LETTER_SIZE,
        "legend.title_fontsize": MIN_LETTER_SIZE,
        "lines.markersize": 4.3,
        "lines.markeredgewidth": 0.8,
        **{f"{side}tick.major.{key}": size for side in "xy" for key, size in TICKS.items()},  # type: ignore[misc]
    }
)


def save(figure: Figure, path: Path | IO[bytes]) -> None:
    """Write a figure as PNG, laid out and drawn once: `savefig` draws it twice.

    Letters of scripts without a font here are drawn as boxes. Beside a file go SVGs of both widths where the
    command was asked for them by `--print`.

    Args:
        figure: The figure; it keeps its layout.
        path: Where to.
    """
    _write_png(figure, path)
    if isinstance(path, Path) and SESSION.get().prints:
        _print(figure, path)


def _lay_out(figure: Figure) -> None:
    """Lay a figure out once, and keep it so.

    Constrained layout measures what is around every axes twice, and color bars once more for each of their
    axes, which takes most of its time. What is around axes is as wide as before if their ticks are the same.
    """
    figure.set_layout_engine("constrained")
    engine = figure.get_layout_engine()
    assert engine is not None  # just set
    visible = [axes for axes in figure.axes if axes.get_visible()]
    for axes in visible:
        axes.get_tightbbox = functools.partial(_around, axes, {})  # type: ignore[method-assign]
    engine.execute(figure)
    for axes in visible:
        del axes.get_tightbbox
    figure.set_layout_engine("none")


def _around(
    axes: Axes, measured: dict[Ticks, Array], renderer: RendererBase, *, for_layout_only: bool
) -> Bbox:
    """Return the box of an axes with its words and its key; words are measured once for the same ticks.

    Args:
        axes: The axes.
        measured: How far words are around the axes, (4,) [pixel], by its ticks; words are added to it.
        renderer: As matplotlib gives it.
        for_layout_only: The same: names along an axis count only across it.

    Returns:
        The box [pixel].
    """
    key, locator = axes.get_legend(), axes.get_axes_locator()
    axes.apply_aspect(None if locator is None else locator(axes, renderer))  # to where it stands now
    ticks = _ticks(axes)
    if ticks not in measured:
        if key is not None:  # it may stand beside the axes, at a share of their size
            key.set_in_layout(False)
        whole = type(axes).get_tightbbox(axes, renderer, for_layout_only=for_layout_only)
        assert whole is not None  # it is visible
        measured[ticks] = np.subtract(whole.extents, axes.bbox.extents)
    box = Bbox.from_extents(*(axes.bbox.extents + measured[ticks]))
    beside = None if key is None else key.get_tightbbox(renderer)
    return box if beside is None else Bbox.union([box, beside])


def _ticks(axes: Axes) -> Ticks:
    """Tell where both axes have ticks, in data."""
    found = []
    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        found.append(tuple(at for at in axis.get_majorticklocs().tolist() if low <= at <= high))
    return tuple(found)


def _write_png(figure: Figure, path: Path | IO[bytes]) -> None:
    """Draw a figure in few colours, but where it holds an image."""
    canvas = FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        if figure.axes and figure.get_layout_engine() is not None:
            _lay_out(figure)
        canvas.draw()  # type: ignore[no-untyped-call]
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])  # type: ignore[no-untyped-call]
    if any(axes.images for axes in figure.axes):  # a ramp has more colours than are kept of others
        picture.save(path, "PNG", compress_level=LEVEL, dpi=(figure.dpi, figure.dpi))
        return
    few = picture.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette, ground = few.getpalette() or [], int(few.getpixel((0, 0)))  # type: ignore[arg-type]
    palette[3 * ground : 3 * ground + 3] = picture.getpixel((0, 0))  # type: ignore[assignment]
    few.putpalette(palette)
    few.save(path, "PNG", compress_level=LEVEL, dpi=(figure.dpi, figure.dpi))


ONE_COLUMN = "_89"  #: Ends the name of an SVG that is 89 mm wide.
NEUTRAL = re.compile(r"#([0-9a-f]{2})\1\1\b")  #: White, black and greys of an SVG.
DARK_GROUND, DARK_INK = 18, 235  #: Greys in place of white and of black on a dark ground.


def _print(figure: Figure, png: Path) -> None:
    """Write a figure that was saved as SVG beside its PNG, two columns and one wide, on light and on dark."""
    for wide, own in (("", figure), (ONE_COLUMN, one_column(figure))):
        light = as_svg(own)
        png.with_name(f"{png.stem}{wide}.svg").write_text(light, encoding="utf-8")
        ink = light.replace("<svg ", '<svg fill="#000000" ', 1)  # of letters, which name no black
        dark = NEUTRAL.sub(_inverted, ink)
        png.with_name(f"{png.stem}{wide}_dark.svg").write_text(dark, encoding="utf-8")


def as_svg(figure: Figure) -> str:
    """Draw a figure that was saved, as it was laid out, as SVG; its letters are outlines.

    Args:
        figure: The figure.

    Returns:
        The same text for the same figure.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG  # here: only for print

    written = io.StringIO()
    FigureCanvasSVG(figure).print_svg(written, metadata={"Date": None})  # type: ignore[no-untyped-call]
    return written.getvalue()


def _inverted(found: re.Match[str]) -> str:
    """Turn a grey of a light ground into that of a dark one."""
    level = round(DARK_INK + (DARK_GROUND - DARK_INK) * int(found[1], 16) / 255)
    return f"#{level:02x}{level:02x}{level:02x}"


def page(height: float, width: float = WIDTH) -> Figure:
    """Make an empty figure of this height and width [in]."""
    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")


def _body(figure: Figure) -> SubFigure:
    """The whole of a figure between its title and its caption, for a legend of all axes."""
    found = figure.subfigures()
    assert isinstance(found, SubFigure)  # one row, one column
    return found


def bands(figure: Figure, heights: Sequence[float]) -> list[SubFigure]:
    """Split a figure into bands from top to bottom, each laid out by itself.

    Args:
        figure: The figure.
        heights: Of the bands, in any unit.
    """
    parts = figure.subfigures(len(heights), 1, height_ratios=[*heights], squeeze=False)
    return [part for row in parts for part in row]


def _key(part: SubFigure, columns: int) -> None:
    """Add a legend below all axes, of what the first ones have, of at most so many columns."""
    handles, labels = part.axes[0].get_legend_handles_labels()
    longest = KEY_LETTERS + max(map(len, labels), default=0)
    part.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=max(1, min(columns, CAPTION // longest)),
        handlelength=3.0,
    )


def say(figure: Figure, answer: str, reading: str) -> None:
    """Write what is seen above a figure, and below it what its marks and numbers are; the last step of it.

    Words inside of panes have no room of their own beside them: that would be searched twice for each.

    Args:
        figure: The figure; its width sets the length of lines.
        answer: Its title: what is too long for its lines begins the words below.
        reading: The words below.
    """
    answer, reading = map(printed, (answer.rstrip("."), reading))
    wide = figure.get_figwidth() / WIDTH
    letters, lines = int(TITLE * wide), TITLE_LINES if wide == 1 else NARROW_TITLE_LINES
    title, rest = split_title(" ".join(answer.split()), letters * lines // 2, letters * lines)
    title = _balanced(title, letters)
    figure.suptitle(title, x=0.01, ha="left", fontsize=TITLE_SIZE, fontweight="bold")
    words = textwrap.fill(" ".join(filter(None, [rest and ended(rest), reading])), int(CAPTION * wide))
    figure.supxlabel(words, x=0.01, ha="left", fontsize=MIN_LETTER_SIZE, color="0.3")
    for text in itertools.chain.from_iterable(axes.texts for axes in figure.axes):
        text.set_in_layout(False)


def printed(text: str) -> str:
    """Write micrometres as figures do."""
    return MICRO.sub("µ", text)


def words_height(figure: Figure) -> float:
    """Return the height of the title of a figure and of the words below it [in]."""
    title, words = figure.get_suptitle().count("\n"), figure.get_supxlabel().count("\n") + 1
    return TITLE_BAND + TITLE_LINE * title + WORDS_LINE * words


def _balanced(text: str, letters: int) -> str:
    """Break a text into as few lines as have room, of about the same length."""
    count = len(textwrap.wrap(text, letters))
    widths = range(-(-len(text) // max(count, 1)), letters)
    return textwrap.fill(text, next((w for w in widths if len(textwrap.wrap(text, w)) == count), letters))


def add_words(figure: Figure, words: str) -> Figure:
    """Add a sentence to the words below a figure, and return the figure."""
    say(figure, figure.get_suptitle(), " ".join([*figure.get_supxlabel().split(), words]))
    return figure


def split_title(text: str, letters: int, most: int) -> tuple[str, str]:
    """Split words into a title and the rest, where a sentence or a part of one ends.

    Args:
        text: The words.
        letters: Letters of a title.
        most: Those of a longer one, for a part that would be cut otherwise.

    Returns:
        The title and the rest.
    """
    text = text.replace("Eq. (", "Eq.\u00a0(")  # no sentence ends there
    if len(text) <= letters:
        return text, ""
    late = LATE_BREAKS if len(text) > most else ()
    for end, limit in itertools.product((*BREAKS, *late), (letters, most)):
        at = text.rfind(end, 0, limit + len(end))
        if at > letters * (0.6 if end == ", " else 0.25):  # a comma may end half a thought
            rest = text[at + len(end) :]
            if end == " (":
                rest = rest.replace(")", "", 1)
            return text[:at], capital(rest)
    if len(text) <= most:
        return text, ""
    at = text.rfind(" ", 0, most)
    return (text[:at], text[at:].strip()) if at > 0 else (short(text, letters), text)


def headed(figure: Figure, words: str, winner: str = "") -> Figure:
    """Entitle a figure by the badge of its run, and draw its lines in their weights.

    Args:
        figure: The figure; its own title goes into the words below.
        words: The title, empty to keep its own.
        winner: The model whose line stands out, empty for none.

    Returns:
        The figure.
    """
    if words:
        own = figure.get_suptitle()
        say(figure, words, " ".join([ended(own), *figure.get_supxlabel().split()]))
    names = {row_words(name): name for name in (winner, JOINTS_ONLY)}  # of lines that have words
    for line in figure.findobj(Line2D):
        label = str(line.get_label()) if isinstance(line, Line2D) else ""
        if isinstance(line, Line2D) and (heavy := weight(names.get(label, label), winner)):
            line.set(
                linewidth=1.0 + 0.4 * heavy,
                markersize=line.get_markersize() + 0.7 * heavy,
                zorder=2 + heavy / 10,
            )
    return figure


LONG = 1000  #: Numbers beyond have no room side by side: of an axis to the right only powers of ten.


def log_ticks(axes: Axes, side: Literal["x", "y"], low: float, high: float) -> None:
    """A logarithmic axis with plain numbers: more of a decade where there are few."""
    decades = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1)
    steps = next(ticks for most, ticks in STEPS.items() if high < most * low)
    every = max(1, -(-(len(decades) - 2) // DECADES))  # one beyond each end
    low, high = low / 1.3, high * 1.3
    ticks = [step * 10.0**k for k in decades[::every] for step in steps if low <= step * 10.0**k <= high]
    if side == "x" and ticks[-1] > LONG and len(whole := [x for x in ticks if math.log10(x) % 1 == 0]) > 1:
        ticks = whole
    elif side == "x" and ticks[-1] == LONG:
        ticks = [x for x in ticks if not LONG / 3 < x < LONG]  # its neighbour would touch it
    axes.set(**{f"{side}scale": "log", f"{side}lim": (low, high)})
    axis = axes.xaxis if side == "x" else axes.yaxis
    axis.set_ticks(ticks, [tick_words(tick) for tick in ticks])
    axis.set_ticks([], minor=True)


def short(name: str, letters: int = 20) -> str:
    """A name that has room beside an axis."""
    return name if len(name) <= letters else f"{name[: letters - 1]}…"


def tick_words(number: float) -> str:
    """A round number on an axis: 0.05, 2000, and 2·10⁻⁹ or 10⁵ for what has too many zeros."""
    mantissa, _, power = f"{number:.5g}".partition("e")
    if not power:
        return mantissa
    return f"{'' if mantissa == '1' else f'{mantissa}·'}10{_power(power)}"


def _power(digits: str) -> str:
    """A power as it stands behind a ten."""
    return str(int(digits)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _raised(text: str) -> str:
    """Write 2·10⁻⁹ for 2 x 10^-9."""
    return TIMES_TEN.sub(lambda found: f"·10{_power(found[1])}", text)


def quiet(axes: Axes) -> None:
    """Without the frame above and on the right; labels of ticks reach farther than what stays of it."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_in_layout(False)


def few_ticks(*every: Axis) -> None:
    """Give axes round numbers, whatever their length: words around them are measured once, see `_lay_out`.

    Args:
        every: The axes, to the right or upright.
    """
    for axis in every:
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))


def forest(
    table: Table, panes: Mapping[str, str], answer: str, reading: str, mark: str | float = ""
) -> Figure:
    """Dots of a table's rows side by side, a pane a column, on logarithmic axes.

    Args:
        table: Rows that are of models, see `schema.looks`; in each pane the best have a band.
        panes: Titles by the keys of the columns that are drawn.
        answer: See `say`.
        reading: The same.
        mark: Name of the row to beat, or a number to beat: a dotted line.
    """
    columns = {column.key: column for column in table.columns}
    figure = page(1.3 + forest_height(table))
    name, known = table.columns[0], table.looks or looks(table.rows, table.columns[0])
    sides = figure.subplots(1, len(panes), squeeze=False)[0]
    for k, (axes, key) in enumerate(zip(sides, panes, strict=True)):
        forest_pane(axes, replace(table, looks=known), columns[key], named=not k)
    _share_scales(sides, "x")
    for axes, (key, title) in zip(sides, panes.items(), strict=True):
        beaten = [row for row in table.rows if name.cell(row) == mark]
        for row in beaten:
            at, shade = middle(columns[key].value(row)), known[name.cell(row)].hex
            axes.axvline(at, color=shade, linewidth=0.8, linestyle=":")
        if isinstance(mark, float):
            axes.axvline(mark, color=SOFT, linewidth=0.8, linestyle=":")
        axes.set_title(printed(title))
    dots = dotted(columns[key].value(row) for key in panes if key != RATIO for row in table.rows)
    banded = any(best_rows(replace(table, looks=known), columns[key]) for key in panes)
    bands = "Band: the best, and all that tie with it." if banded else ""
    say(figure, answer, " ".join(filter(None, [reading, dots and f"{capital(dots)}.", bands])))
    return figure


def _share_scales(panes: Sequence[Axes], side: Literal["x", "y"]) -> None:
    """Give panes logarithmic axes along a side; those of one quantity have the same."""
    label, k = {"x": (Axes.get_xlabel, 0), "y": (Axes.get_ylabel, 1)}[side]
    drawn = [(label(axes), axes.dataLim.get_points()[:, k].copy()) for axes in panes]
    for axes in panes:
        ends = np.array([own for quantity, own in drawn if quantity == label(axes)])
        log_ticks(axes, side, float(ends.min()), float(ends.max()))


def ranked(table: Table, key: str, over: Sequence[Row]) -> Table:
    """Sort a table of models by an error, the least first, and give it a column of ratios.

    Args:
        table: Rows of models.
        key: Of the column of the error.
        over: `ratio` of each model's error to that of ours, by `name`: see `badge.ratios`.

    Returns:
        The table with the column `ratio`; rows without one keep their place and have none.
    """
    name, ratios = table.columns[0], {row.name: row.ratio for row in over}
    error = next(column for column in table.columns if column.key == key)
    rows = sorted(table.rows, key=lambda row: _known(middle(error.value(row))))
    ratio = TableColumn(RATIO, "ratio of errors", form=".2f", none="")
    return replace(
        table,
        columns=(*table.columns, ratio),
        rows=[Row(row, ratio=ratios.get(name.cell(row))) for row in rows],  # type: ignore[call-overload]
        bold="",
        looks=table.looks or looks(table.rows, name),
    )


def _known(number: float) -> float:
    """Put what is no number last."""
    return number if number == number else math.inf


def forest_pane(axes: Axes, table: Table, value: TableColumn, *, named: bool = True) -> None:
    """Rows from top to bottom in their looks: see `_distribution`; the paper's number is a grey diamond.

    The best has a band, and all that tie with it: see `best_rows`; the marked row has larger dots.
    """
    name, best = table.columns[0], best_rows(table, value)
    for y, row in enumerate(table.rows):
        number, look = value.value(row), table.looks[name.cell(row)]
        _distribution(axes, y, number, look, 4.7 + 0.7 * weight(name.cell(row), table.bold))
        if known := value.known(row):
            axes.plot(float(known), y, "D", color=SOFT, markersize=3.6)
        if y in best:
            axes.axhspan(y - 0.5, y + 0.5, color=SOFT, alpha=0.16, linewidth=0, zorder=0)
    heads = [f"{row_head(name.cell(row))}  " if named else "" for row in table.rows]
    numbers = [_raised(value.text(middle(value.value(row)))) for row in table.rows]
    axes.set_yticks(range(len(heads)), [f"{a}{b}" for a, b in zip(heads, numbers, strict=True)])
    axes.set_ylim(len(heads) - 0.5, -0.5)
    axes.set_xlabel(labelled(value))
    quiet(axes)


def row_head(name: str) -> str:
    """Write the name of a row beside its axis, in words, in lines that leave room for what is drawn."""
    return _balanced(printed(row_words(name)), HEAD_LETTERS)


def forest_height(table: Table) -> float:
    """Return the height of the rows of a forest [in]."""
    heads = [row_head(table.columns[0].cell(row)) for row in table.rows]
    return len(heads) * (TALL_ROW if any("\n" in head for head in heads) else ROW)


def _distribution(axes: Axes, y: float, number: Number, look: Look, size: float) -> None:
    """A dot a trial, the median and as a line its 95 % interval; of few trials dots alone."""
    if isinstance(number, Spread) and number.values:
        k = np.arange(len(number.values))
        if number.too_few:
            axes.plot(number.values, np.full(len(k), y), linestyle="", **look.dots(size))
            return
        apart = y + ASIDE * ((GOLDEN * k) % 1 - 0.5)  # trials of one number do not hide each other
        axes.plot(number.values, apart, ".", color=look.hex, markersize=2.5, alpha=0.35, markeredgewidth=0)
    if line := inner(number):
        axes.plot(line, (y, y), color=look.hex, linewidth=1.8)
    axes.plot(middle(number), y, linestyle="", **look.dots(size))


def weight(name: str, winner: str) -> int:
    """How much a model stands out: 2 of the winner, 1 of joint stiffness alone, 0 of all others."""
    return 2 if name and name == winner else int(name == JOINTS_ONLY)


def sweeps(
    panes: Mapping[str, Table],
    answer: str,
    reading: str,
    bands: Sequence[str] | None = None,
    *,
    proportional: str = "",
) -> Figure:
    """Draw lines over swept quantities; lines that are alike in all panes share one legend.

    Args:
        panes: By title, a table whose columns name the line, sweep and are drawn.
        answer: See `say`.
        reading: The same.
        bands: Lines whose spread is drawn, all of them if None.
        proportional: Words for a guide of slope 1, along which what is drawn grows as what sweeps; empty for
            none.

    Returns:
        The figure.
    """
    across = min(2, len(panes))
    down = -(-len(panes) // across)
    known = [table.looks or looks(table.rows, table.columns[0]) for table in panes.values()]
    shared = all(own == known[0] for own in known)
    figure = page(1.1 + (2.7 if shared else 3.1) * down)
    part = _body(figure)
    grid = part.add_gridspec(down, across)
    for k, ((title, table), lines) in enumerate(zip(panes.items(), known, strict=True)):
        alone = k % across == 0 and k == len(panes) - 1
        axes = part.add_subplot(grid[k // across, slice(None) if alone else k % across])
        _sweep(axes, table, lines, lines if bands is None else bands)
        axes.set_title(printed(title))
    _share_scales(part.axes, "y")
    for axes in part.axes:
        if proportional:
            _guide(axes, proportional)
        if not shared:
            axes.legend(ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    if shared:
        _key(part, columns=7 if across == 2 else 4)
    say(figure, answer, reading)
    return figure


def _sweep(axes: Axes, table: Table, lines: Mapping[str, Look], bands: Collection[str]) -> None:
    """Lines of a table in one pane."""
    name, x, y = table.columns
    for line, look in lines.items():
        rows = [row for row in table.rows if name.cell(row) == line]
        if rows:
            rows.sort(key=lambda row: middle(x.value(row)))
            at, numbers = [middle(x.value(row)) for row in rows], [y.value(row) for row in rows]
            style = "--" if look.prior else "-"
            words = row_words(line)
            axes.plot(at, [*map(middle, numbers)], linestyle=style, label=words, **look.dots(3.6))
            if line in bands and any(isinstance(number, Spread) for number in numbers):
                low, high = np.transpose([*map(ends, numbers)])
                axes.fill_between(at, low, high, color=look.hex, alpha=BAND, linewidth=0)
    swept = {middle(x.value(row)): x.cell(row) for row in table.rows}
    if max(swept) > LOG_AXIS_RATIO * min(swept) > 0:
        log_ticks(axes, "x", *axes.dataLim.intervalx)
    axes.set_xticks(list(swept), list(swept.values()))
    axes.set(xlabel=labelled(x), ylabel=labelled(y))
    quiet(axes)


def _guide(axes: Axes, words: str) -> None:
    """Draw a grey line of slope 1 through the lower right corner of what is drawn, on logarithmic axes."""
    (x0, y0), (x1, _) = axes.dataLim.min, axes.dataLim.max
    x = np.array([max(x0, x1 * y0 / axes.dataLim.max[1]), x1])
    low = min(float(np.asarray(line.get_ydata(), dtype=float)[-1]) for line in axes.get_lines())
    ends = axes.get_xlim(), axes.get_ylim()
    axes.plot(x, low * x / x1, color=SOFT, linewidth=1.0, linestyle=(0, (1, 1)), label=words, zorder=1)
    axes.set(xlim=ends[0], ylim=ends[1])


def labelled(column: TableColumn) -> str:
    """A quantity with its unit beside an axis."""
    return f"{column.heading} [{printed(column.unit)}]" if column.unit else column.heading


def ranges(
    panes: Mapping[str, Table],
    answer: str,
    reading: str,
    mark: float | None = None,
    places: Sequence[str] = (),
) -> Figure:
    """Medians and spreads without lines, a pane a table: its columns name row and model, and are drawn.

    A dotted line is at the number `mark`. Rows have their order from the panes, if not from `places`.
    """
    table, rows = next(iter(panes.values())), [row for own in panes.values() for row in own.rows]
    down, name, value = table.columns
    places, known = places or list(dict.fromkeys(map(down.cell, rows))), table.looks or looks(rows, name)
    figure = page(1.7 + 0.42 * len(places))
    part = _body(figure)
    sides = part.subplots(1, len(panes), sharey=True, squeeze=False)[0]
    for axes, (title, own) in zip(sides, panes.items(), strict=True):
        for k, (model, look) in enumerate(known.items()):
            shown = [row for row in own.rows if name.cell(row) == model]
            y = [places.index(down.cell(row)) + 0.8 * ((k + 0.5) / len(known) - 0.5) for row in shown]
            for row, at in zip(shown, y, strict=True):
                axes.plot(ends(value.value(row)), (at, at), color=look.hex, alpha=0.5)
            middles = [middle(value.value(row)) for row in shown]
            axes.plot(middles, y, linestyle="", label=row_words(model), **look.dots(3.6))
        axes.set(xlabel=labelled(value))
        axes.set_title(printed(title))
        axes.grid(axis="y", alpha=0.2)
        quiet(axes)
    _share_scales(sides, "x")
    for axes in sides:
        if mark is not None:
            axes.axvline(mark, color=SOFT, linewidth=0.8, linestyle=":")
    sides[0].set_ylabel(down.heading)
    sides[0].set_yticks(range(len(places)), places)
    sides[0].set_ylim(len(places) - 0.5, -0.5)
    _key(part, columns=5)
    say(figure, answer, reading)
    return figure


# --- One column of a journal: the first panes of a figure one below the other -------------------------------

COLUMN, TALLEST = 89 / INCH, 120 / INCH
"""Width of a figure, as journals print one column, and its height at most if its first pane allows [in]."""
IN_COLUMN = "in one column"  #: Label of the panes that a figure of one column has, where not all may stay.
PANE_HEIGHT, EQUAL_SCALES, MATRIX = 1.5, 1.8, 2.4
"""Height of a pane, of one with equal scales, of a matrix with numbers [in]."""
PANE_HEAD, NAME_LINE = 0.56, 0.1  #: What a pane needs beside its rows, and a line of a row's name [in].
KEY_LINE, LETTER = 0.16, 0.058
"""Height of a line of a key below a pane, and of a letter of the name of its upright axis [in]."""
PANE_LETTERS = 46  #: Letters of a line above or below a pane, and of the entries of its key side by side.
KEY_BELOW = 3.0  #: Distance of a key from what is above it [pt].
KEY_INSIDE = 0.99  #: Where a key begins at most that is inside of a pane, over its width [1].
LABELS_APART = 2.0  #: Least distance of two labels along an axis [pt].
NOTHING = 1e-3  #: Height of a band without panes; bands of no height have no layout [in].


def for_column(*panes: Axes) -> None:
    """Mark the panes that a figure of one column has; without marks it has all of them, the first ones first.

    Args:
        panes: Of one figure.
    """
    for axes in panes:
        axes.set_label(IN_COLUMN)


def one_column(figure: Figure) -> Figure:
    """Stack the panes of a figure, row by row, 89 mm wide, as far as they fit into 120 mm.

    Panes that are marked by `for_column` stay alone; of these and of unmarked ones the first stays, and each
    further one that fits. Rows that only the first pane of a row names get their names in every pane; labels
    along an axis are left out where they would touch; keys beside a pane go below it.

    Args:
        figure: A figure that was laid out; it stays as it is.

    Returns:
        Its copy, laid out.
    """
    narrow = copy.deepcopy(figure)
    narrow.set_size_inches(COLUMN, figure.get_figheight())
    say(narrow, " ".join(narrow.get_suptitle().split()), " ".join(narrow.get_supxlabel().split()))
    around = words_height(narrow)
    parts = [part for part in _leaves(narrow) if _panes(part)]
    for part in parts:
        _share_names(part)
    room = TALLEST - around
    stacks = [_stack(part, chosen) for part, chosen in zip(parts, _choose(parts, room), strict=True)]
    for part, heights in zip(parts, stacks, strict=True):
        if isinstance(part, SubFigure):
            place = part._subplotspec  # type: ignore[attr-defined] # it has no public name
            bands = place.get_gridspec()
            ratios = list(bands.get_height_ratios())
            ratios[place.rowspan.start] = sum(heights) or NOTHING
            bands.set_height_ratios(ratios)
    narrow.set_size_inches(COLUMN, sum(map(sum, stacks)) + around)
    _lay_out(narrow)
    for axes in narrow.axes:
        _thin(axes)
        if legend := axes.get_legend():
            _place_below(axes, legend)
    _lay_out(narrow)
    return narrow


def _leaves(part: Figure | SubFigure) -> Iterator[Figure | SubFigure]:
    """Parts of a figure that have no parts."""
    for own in part.subfigs:
        yield from _leaves(own)
    if not part.subfigs:
        yield part


def _panes(part: Figure | SubFigure) -> list[Axes]:
    """Panes of a part, row by row."""
    placed = [axes for axes in part.axes if axes.get_subplotspec() is not None and axes.figure is part]
    return sorted(placed, key=_place)


def _place(axes: Axes) -> tuple[int, int]:
    """Row and column of a pane."""
    spec = axes.get_subplotspec()
    assert spec is not None  # see `_panes`
    return spec.rowspan.start, spec.colspan.start


def _share_names(part: Figure | SubFigure) -> None:
    """Give every pane of a part its own names of rows and axes, and break its long words."""
    panes = [axes for axes in _panes(part) if axes.get_visible()]
    firsts = {_place(axes)[0]: axes for axes in reversed(panes)}
    lasts = {_place(axes)[1]: axes for axes in panes}
    for axes in panes:
        row, column = _place(axes)
        _name(axes, firsts[row], lasts[column])
        _wrap(axes)


def _choose(parts: Sequence[Figure | SubFigure], room: float) -> list[list[Axes]]:
    """Choose the panes of every part that fit into a height [in]; one pane stays, whatever its height."""
    every = [axes for part in parts for axes in _panes(part) if axes.get_visible()]
    marked = [axes for axes in every if axes.get_label() == IN_COLUMN]
    room -= KEY_LINE * sum(
        -(-len(key.get_texts()) // _columns(key)) for part in parts for key in part.legends
    )
    chosen: list[Axes] = []
    for axes in marked or every:
        height = _pane_height(axes)
        if not chosen or height <= room:
            chosen.append(axes)
            room -= height
    return [[axes for axes in _panes(part) if axes in chosen] for part in parts]


def _pane_height(axes: Axes) -> float:
    """Height that a pane needs in one column, with its title, its axis and its key [in]."""
    legend = axes.get_legend()
    key = (
        KEY_LINE * -(-len(legend.get_texts()) // _columns(legend)) if legend and _beside(axes, legend) else 0
    )
    counts = [label.get_text().count("\n") + 1 for label in axes.get_yticklabels()]
    lines = len(counts) * max(counts, default=0)  # rows are as far apart as the longest name needs
    least = PANE_HEIGHT if axes.get_aspect() == "auto" else EQUAL_SCALES
    least = MATRIX if axes.images and axes.texts else least
    least = max(least, PANE_HEAD + LETTER * max(map(len, axes.get_ylabel().split("\n"))))
    return max(least, PANE_HEAD + NAME_LINE * lines) + key


def _stack(part: Figure | SubFigure, chosen: Sequence[Axes]) -> list[float]:
    """Stack the chosen panes of a part and remove all others; their heights with what is around them [in]."""
    for axes in [*part.axes]:
        bar = getattr(axes, "_colorbar_info", None)  # it has no public name
        if bar is not None:
            bar["parents"] = [pane for pane in bar["parents"] if pane in chosen]
            gone = not bar["parents"]
        else:
            gone = axes.figure is part and axes.get_subplotspec() is not None and axes not in chosen
        if gone:
            axes.remove()
    if not chosen:
        return []
    heights = [_pane_height(axes) for axes in chosen]
    stacked = part.add_gridspec(len(chosen), 1, height_ratios=heights)
    for k, axes in enumerate(chosen):
        axes.set_subplotspec(stacked[k, 0])
        for label in axes.get_yticklabels():
            label.set(fontsize=MIN_LETTER_SIZE, linespacing=1.0)
    for legend in [*part.legends]:
        part.legends.remove(legend)
        _narrow_key(part, legend)
    for axes in chosen:
        if (key := axes.get_legend()) and _beside(axes, key):
            _narrow_key(axes, key)
    own = sum(-(-len(key.get_texts()) // _columns(key)) for key in part.legends)
    return [*heights, KEY_LINE * own]


def _narrow_key(part: Axes | Figure | SubFigure, legend: Legend) -> None:
    """Make a key again below a part, in as few columns as have room; a key that is made keeps its columns."""
    handles = [own for own in legend.legend_handles if own is not None]
    labels, columns = [text.get_text() for text in legend.get_texts()], _columns(legend)
    wide = float(legend.handlelength)
    if isinstance(part, Axes):
        part.legend(
            handles,
            labels,
            ncols=columns,
            handlelength=wide,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.2),
        )
    else:
        part.legend(handles, labels, ncols=columns, handlelength=wide, loc="outside lower center")


def _columns(legend: Legend) -> int:
    """How many entries of a key fit side by side."""
    longest = max((len(text.get_text()) for text in legend.get_texts()), default=1)
    return max(1, PANE_LETTERS // (longest + 8))


def _name(axes: Axes, first: Axes, last: Axes) -> None:
    """Give a pane what it shares with the first one of its row and the last one of its column."""
    if not axes.axison:
        return
    if axes in axes.get_shared_y_axes().get_siblings(first) and axes is not first:
        axes.tick_params(labelleft=True)
        axes.set_ylabel(axes.get_ylabel() or first.get_ylabel())
    if axes in axes.get_shared_x_axes().get_siblings(last) and axes is not last:
        axes.tick_params(labelbottom=True)
    axes.set_xlabel(axes.get_xlabel() or last.get_xlabel())
    if axes is first or axes.get_ylim() != first.get_ylim():
        return
    names, own = ([text.get_text() for text in pane.get_yticklabels()] for pane in (first, axes))
    if not own:
        axes.set_yticks(first.get_yticks(), names)
    elif len(own) == len(names) and all("  " in name for name in names):  # a name and a number
        heads = [name.rpartition("  ")[0] for name in names]
        axes.set_yticks(axes.get_yticks(), [f"{a}  {b}" for a, b in zip(heads, own, strict=True)])


def _wrap(axes: Axes) -> None:
    """Break long words above and below a pane."""
    for place in ("left", "center", "right"):
        if title := axes.get_title(loc=place):
            axes.set_title(textwrap.fill(" ".join(title.split()), PANE_LETTERS), loc=place)
    axes.set_xlabel(textwrap.fill(axes.get_xlabel(), PANE_LETTERS))


def _thin(axes: Axes) -> None:
    """Leave out labels along a pane that touch: show every second one, or as many as are apart."""
    low, high = sorted(axes.get_xlim())
    every_label = [label for label in axes.get_xticklabels() if label.get_text()]
    labels = [label for label in every_label if low <= label.get_position()[0] <= high]
    if not labels:
        return
    ticks, words = [label.get_position()[0] for label in labels], [label.get_text() for label in labels]
    room = LABELS_APART * axes.get_figure(root=True).dpi / 72  # type: ignore[union-attr]
    ends = [(box.x0, box.x1) for box in map(Text.get_window_extent, labels)]
    every = 1
    while any(b < a + room for (_, a), (b, _) in itertools.pairwise(sorted(ends[::every]))):
        every += 1
    if every > 1:
        shown = ["" if k % every else word for k, word in enumerate(words)]
        axes.set_xticks(ticks, shown, rotation=labels[0].get_rotation())


def _beside(axes: Axes, legend: Legend) -> bool:
    """Whether a key stands outside of a pane, so that it has to go below its axis."""
    anchor = legend.get_bbox_to_anchor().transformed(axes.transAxes.inverted())
    return not KEY_INSIDE > anchor.x0 >= 0 <= anchor.y0


def _place_below(axes: Axes, legend: Legend) -> None:
    """Put a key that stands outside of a pane below its axis."""
    if not _beside(axes, legend):
        return
    figure = axes.get_figure(root=True)
    assert figure is not None  # it has one
    low = min(box.y0 for box in (axes.bbox, axes.xaxis.get_tightbbox()) if box is not None)
    down = ScaledTranslation(0, (low - axes.bbox.y0) / figure.dpi - KEY_BELOW / 72, figure.dpi_scale_trans)
    legend.set_loc("upper center")
    legend.set_bbox_to_anchor((0.5, 0.0), axes.transAxes + down)
