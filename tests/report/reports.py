"""What every report must hold, whatever it is of."""

import io
import json
import math
import tempfile
from pathlib import Path

import matplotlib.colors
import numpy as np
import pytest
from checks import check_words, unit_in
from made_up import of_one_trial
from page_checks import check_tables
from read_reports import read
from rich.console import Console

from testbench.report import page as html
from testbench.report import terminal
from testbench.report.figure import SOFT
from testbench.report.table import Trials
from testbench.runs.spread import Spread, ends, middle
from testbench.runs.store import arrow_table, write_trials
from testbench.studies.campaigns import Measured
from testbench.workflows.error_places import WorkspacePoses

WIDTH = 80  #: Of a terminal.


def table_of(seeds, rows):
    """Trials as a study's report gets them, from the file of its run: `rows` makes those of a seed."""
    own = {seed: rows(seed) for seed in seeds}
    kind = type(next(row for found in own.values() for row in found))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trials.parquet"
        write_trials(path, arrow_table(kind, own.items()))
        return Trials.read(path)


JOINTS = ("[1.0, 2.0] deg", "[3.0, 4.0] deg")
AT = WorkspacePoses((1, 2), (0.1, 0.2), JOINTS, (1.2, 0.5), (-0.35, 0.0), (2.0, 1.0), (4.0, 5.0))
"""Two poses of a workspace."""


def campaign_row(kind, rng, name, **own):
    """A made-up row of a model in a campaign, the same in all trials; nothing is drawn unless it is given."""
    fixed = dict.fromkeys(("places", "place_mm", "drawn", "trace_bounds_rad_per_Nm"))
    fixed |= {"name": name, "structure": name, "constraint": "psd", "prior": False, "advice": ()}
    fixed |= {"measured": of_one_trial(Measured, np.random.default_rng(1))}
    return of_one_trial(kind, rng, **fixed | own)


def read_back(report):
    """The report as it is read from its report.json."""
    return read(json.loads(json.dumps(report.json(), allow_nan=False)))


def check_drawn_alike(figures, report):
    """Figures of a report and of the same one read back from report.json have the same lines and dots."""
    both = [figures(found) for found in (report, read_back(report))]
    assert both[0].keys() == both[1].keys()
    for ours, theirs in zip(*(own.values() for own in both), strict=True):
        for a, b in zip(ours.axes, theirs.axes, strict=True):
            lines = [[line.get_xydata() for line in axes.get_lines()] for axes in (a, b)]
            assert lines[0]
            for x, y in zip(*lines, strict=True):
                np.testing.assert_allclose(x, y, rtol=1e-3)  # dots of tables have four digits


def check(report, printed):
    """Words are short, tables fit a terminal, and report.json says all of it again.

    Args:
        report: Of a study or command.
        printed: Names of the tables that the terminal shows.

    Returns:
        report.md.
    """
    check_words(report)
    again = read_back(report)
    assert again.whole() == report.whole()
    grids = {name: html.grid(table) for name, table in report.tables.items()}
    for name, grid in grids.items():
        assert json.dumps(html.grid(again.tables[name])) == json.dumps(grid), name
    filled = [grids[name] for name, table in report.tables.items() if table.rows]
    check_tables(filled, report.badge and report.badge.json())
    console = Console(width=WIDTH, record=True, file=io.StringIO())
    terminal.print_words(console, report, [report.tables[name] for name in printed])
    shown = console.export_text()
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= WIDTH
    for name in printed:
        free = console.options.update(width=10 * WIDTH)  # else the console's width is the most it measures
        assert console.measure(terminal.grid(report.tables[name]), options=free).maximum <= WIDTH, name
        assert len(report.tables[name].title) <= WIDTH, name
    unused = set(report.tables) - set(report.body) - set(printed)
    assert not unused, f"tables that nothing shows: {unused}"
    page = report.whole()
    if report.badge and report.answer:
        assert page.index(report.badge.words) < page.index(report.answer)
    return page


def fit_row(kind, rng, models, name, **own):
    """A made-up row of a factorial campaign's model.

    Args:
        kind: Type of the row.
        rng: Source of what is not given.
        models: Structure, constraint and whether it has a prior, by name.
        name: Of the model.
        own: Fields that are given; factors that are not are None.
    """
    known = dict(zip(("structure", "constraint", "prior"), models[name], strict=True))
    factors = dict.fromkeys(("part", "case", "instrument", "distance_m", "sigma_um", "data_file"))
    return of_one_trial(kind, rng, **{**factors, "name": name, **known, **own})


def place_of(found, names):
    """Where the one that a report's badge is about stands among names, and whether it is marked."""
    return [*names].index(found.badge.winner), bool(found.winner)


def check_forest(axes, numbers, looks, unit="mm", first=(0, True)):
    """Dots, spreads, colours, weights, bands and unit of a pane of `figure.forest`, the winner on top.

    Args:
        axes: The pane.
        numbers: What is drawn, one a row.
        looks: Of the rows.
        unit: Of its axis; None without.
        first: Which of them is on top, None for the first; and whether it is marked.
    """
    assert unit is None or unit_in(axes.get_xlabel()) == unit
    low, high = axes.get_ylim()
    assert low > high  # the first row on top
    order = sorted(range(len(numbers)), key=lambda k: k != first[0])
    texts = [text.get_text().split()[-1] for text in axes.get_yticklabels()]
    sizes = []
    for y, k in enumerate(order):
        number, look = numbers[k], looks[k]
        own = [line for line in axes.get_lines() if near(line, y) and line.get_linestyle() != ":"]
        values = number.values if isinstance(number, Spread) else ()
        if values and number.too_few:
            [dots, *_] = own
            assert dots.get_xdata() == pytest.approx(values)
        else:
            *trials, line, dots = [one for one in own if (one.get_marker(), one.get_color()) != ("D", SOFT)]
            assert [one.get_xdata() for one in trials] == ([pytest.approx(values)] if values else [])
            assert all(one.get_color() == look.hex for one in trials)
            assert tuple(line.get_xdata()) == (number.interval if values else ends(number))
            assert (np.ravel(dots.get_xdata()).tolist(), line.get_color()) == ([middle(number)], look.hex)
        shade = look.dots(1)
        assert (dots.get_color(), dots.get_markerfacecolor()) == (look.hex, look.face)
        assert dots.get_marker() == shade["marker"]
        sizes.append(dots.get_markersize() / shade["markersize"])
        assert float(texts[y]) == pytest.approx(middle(number), rel=0.06, abs=0.06)
    best = best_of_trials([numbers[k] for k in order])
    assert [(band.get_y(), band.get_height()) for band in axes.patches] == [(y - 0.5, 1.0) for y in best]
    assert all(matplotlib.colors.same_color(band.get_facecolor()[:3], SOFT) for band in axes.patches)
    assert not first[1] or sizes[0] == max(sizes) > min(sizes[1:])


def best_of_trials(numbers):
    """Places of the least median and of what a sign test does not tell from it, by counting; none if all."""
    n = max((own.trials for own in numbers if isinstance(own, Spread)), default=0)
    own = {y: np.array(x.values) for y, x in enumerate(numbers) if isinstance(x, Spread) and x.trials == n}
    if n < 6 or len(own) < 2:
        return []
    least = min(own, key=lambda y: numbers[y].median)
    tied = []
    for y, values in own.items():
        won = min((values > own[least]).sum(), (values < own[least]).sum())
        p_value = sum(math.comb(len(values), k) for k in range(won + 1)) / 2 ** len(values)
        near = abs(np.median(values / own[least]) - 1) <= 0.02
        tied += [y] if p_value > 0.025 or near else []
    return tied if len(tied) < len(own) else []


def near(line, y):
    """Whether all of a line is in a row."""
    at = np.ravel(line.get_ydata())
    return bool(len(at)) and bool((np.abs(at - y) <= 0.3).all())
