"""Errors and deflections by place, by run and over the load, and histograms of residuals."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.rows import MM, UM
from testbench.errors import Array
from testbench.identify.evaluate import noise_limit, normal_density
from testbench.views.recording.bars import bars_view, write_bars
from testbench.views.recording.drawing import Drawing, States, over_markers
from testbench.views.recording.pen import Line, Pen
from testbench.views.recording.style import MEASURED, NOISE, Colour

ERROR, BARS, DEFLECTION = "error_mm", "error_bars_mm", "deflection_mm"
METHODS = {
    "none": "LS",
    "free": "LS",
    "psd": "GCO",
    "own": "own",
}  #: What a bar is named after, by constraint.
SETS = {"identification": "fit", "check": "check"}  #: Sets of runs, and what they are called.
THICK, THIN = 4.5, 1.5  #: Widths of lines that may lie on each other [ui points].
MOST = 4  #: Models of which there is a histogram.
BINS = 17
LEAST_EDGE_UM = 0.1  #: Where histograms without noise end at least: below is rounding of exact data.
MANY = 60  #: Runs beyond which dots are small.


def write_plots(runs: Pen, places: Pen, load: Pen, drawing: Drawing) -> None:
    """What is plotted over runs, places and load: every plot has something on each timeline."""
    widths = _widths(drawing)
    for k in drawing.about.shown:
        path, name, look = f"{ERROR}/{drawing.paths[k]}", drawing.names[k], drawing.looks[k]
        line = Line(path, name, look.colour, widths[k], look.shape, None)
        small = 5.0 if drawing.data.runs <= MANY else 2.5
        runs.looks(line)
        runs.values(line, MM * drawing.residual[k], np.where(drawing.checked, small, 0.0))
        for pen, states in ((places, drawing.places), (load, drawing.loading)):
            rms = MM * states.rms[k]
            pen.values(line, rms, np.zeros_like(rms))
    if drawing.noise:
        line = Line(f"{ERROR}/noise_p95", "95 % of pure noise", NOISE, 1.5)
        runs.line(line, np.full(drawing.data.runs, MM * noise_limit(drawing.data)))
    _write_bars(runs, places, load, drawing)
    _write_deflection(drawing, ((runs, drawing.runs), (places, drawing.places), (load, drawing.loading)))


def _widths(drawing: Drawing) -> dict[int, float]:
    """Widths of the shown models' lines [ui points]: what is drawn later is thinner, so that all are seen."""
    order = sorted(drawing.about.shown, key=lambda k: drawing.paths[k])  # as the viewer draws them
    widths = np.linspace(THICK, THIN, len(order)) if len(order) > 1 else np.array([THICK])
    return dict(zip(order, widths.tolist(), strict=True))


def _write_deflection(drawing: Drawing, on: Sequence[tuple[Pen, States]]) -> None:
    """True or measured, and by the shown models."""
    lines = {
        k: Line(f"{DEFLECTION}/{drawing.paths[k]}", drawing.names[k], drawing.looks[k].colour, width)
        for k, width in _widths(drawing).items()
    }
    truth = Line(f"{DEFLECTION}/truth", "truth", MEASURED, THIN)
    for line in (truth, *lines.values()):
        on[0][0].looks(line)
    for pen, states in on:
        pen.values(truth, MM * over_markers(states.deflection))
        for k, line in lines.items():
            pen.values(line, MM * over_markers(states.predicted[k]))


def _compared(drawing: Drawing) -> list[int]:
    """Indices of the models that are compared."""
    return [drawing.names.index(name) for name in drawing.about.map.compared]


def _write_bars(runs: Pen, places: Pen, load: Pen, drawing: Drawing) -> None:
    """The errors of the compared models, the one beside the other."""
    every, own = _compared(drawing), [drawing.about.models[k] for k in _compared(drawing)]
    names = [m.name if m.structure == "Joints" else f"{METHODS[m.constraint]} ({m.name})" for m in own]
    on = (load, drawing.loading), (places, drawing.places), (runs, drawing.runs)
    colours = [drawing.looks[k].colour for k in every]
    write_bars(BARS, names, colours, [(pen, MM * states.rms[every]) for pen, states in on])


def error_bars_view(drawing: Drawing) -> rrb.Spatial2DView:
    """Bars of the compared models."""
    return bars_view(BARS, "Error (mm), RMS over markers", len(_compared(drawing)))


def error_view() -> rrb.TimeSeriesView:
    """Errors of the shown models by place, by run or over the load, whichever timeline is chosen."""
    return rrb.TimeSeriesView(
        origin=ERROR,
        name="Error (mm): RMS over markers by place; worst marker by run, dots: check",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def deflection_view() -> rrb.TimeSeriesView:
    """The same of the deflection, true (of runs measured) and predicted."""
    return rrb.TimeSeriesView(
        origin=DEFLECTION,
        name="Deflection (mm), RMS over markers",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )


def write_histograms(pen: Pen, drawing: Drawing) -> None:
    """Residual components of some shown models before the normal curve of noise, by set of runs."""
    pooled, edge = UM * drawing.runs.errors[_pooled(drawing)], _edge(drawing)
    edges, fine = np.linspace(-edge, edge, BINS + 1), np.linspace(-edge, edge, 8 * BINS + 1)
    wide, middle = 2 * edge / BINS, (edges[:-1] + edges[1:]) / 2
    for group, runs in zip(SETS, (~drawing.checked, drawing.checked), strict=True):
        for own, k in zip(pooled[:, runs], _pooled(drawing), strict=True):
            path = f"histogram_um/{drawing.paths[k]}/{group}"
            counts = np.histogram(own, edges)[0].astype(float)
            pen.still(f"{path}/residuals", _bars(middle, counts, 0.9 * wide, drawing.looks[k].colour))
            if drawing.noise:
                density = normal_density(fine, 0.0, UM * drawing.data.sigma * np.sqrt(2))
                curve = wide * own.size * density
                pen.still(f"{path}/noise", _bars(fine, curve, fine[1] - fine[0], (*NOISE, 90)))


def _pooled(drawing: Drawing) -> list[int]:
    """The models of the histograms."""
    return list(drawing.about.shown[:MOST])


def _edge(drawing: Drawing) -> float:
    """Where their axis ends [um]."""
    largest = UM * float(np.abs(drawing.runs.errors[_pooled(drawing)]).max())
    unit = 50.0 if drawing.noise else max(largest, LEAST_EDGE_UM)
    return unit * max(1.0, float(np.ceil(largest / unit)))


def _bars(at: Array, counts: Array, width: float, colour: Colour) -> rr.BarChart:
    return rr.BarChart(counts, color=colour, abscissa=at, widths=np.full(len(at), width))


def histogram_grid(drawing: Drawing) -> rrb.Grid:
    """A pane a model and set of runs: a legend would show paths."""
    views = [
        rrb.BarChartView(
            origin=f"histogram_um/{drawing.paths[k]}/{group}",
            name=f"{drawing.names[k]}, {called} (+-{_edge(drawing):.3g} um)",
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for group, called in SETS.items()
        for k in _pooled(drawing)
    ]
    return rrb.Grid(*views, grid_columns=len(_pooled(drawing)), name="Histogram")
