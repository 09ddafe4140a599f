"""Residuals run by run, their histogram, and the sag while the load grows."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.rows import MM, UM
from testbench.errors import Array
from testbench.identify.evaluate import noise_limit, normal_density
from testbench.views.recording.drawing import Drawing
from testbench.views.recording.pen import Line, Pen
from testbench.views.recording.style import MEASURED, NOISE, Colour

SETS = ("identification", "check")
BINS = 17
LEAST_TOP_MM = 0.01  #: Where the axis of residuals ends at least: below is rounding of exact data.
LEAST_EDGE_UM = 0.1  #: The same of histograms without noise.
MANY = 60  #: Runs beyond which dots are small.
ALIKE = 0.02  #: Models whose residuals differ by less than this share lie on each other in the plot.


def write_residuals(pen: Pen, drawing: Drawing) -> None:
    """Worst marker residual of every run and model, and what noise alone stays below in 95 % of runs."""
    size = 5.0 if drawing.data.runs <= MANY else 2.5
    sizes = np.where(drawing.checked, size, 0.0)
    for k, look in enumerate(drawing.looks):
        path, name = f"residual_mm/{drawing.paths[k]}", f"{drawing.names[k]} (mm)"
        line = Line(path, name, look.colour, look.width, look.shape, None)
        pen.line(line, MM * drawing.residual[k], sizes)
    if drawing.noise:
        line = Line("residual_mm/noise_p95", "95 % of pure noise (mm)", NOISE, 1.5)
        pen.line(line, np.full(drawing.data.runs, MM * noise_limit(drawing.data)))


def residual_view(drawing: Drawing) -> rrb.TimeSeriesView:
    """Zoomed on the best model of each method; the title says how far the others go."""
    top = max(LEAST_TOP_MM, MM * 2 * drawing.residual[list(drawing.about.shown)].max())
    if drawing.noise:
        top = max(top, 1.2 * MM * noise_limit(drawing.data))
    largest = MM * drawing.residual.max(axis=1)
    best, first = drawing.names[drawing.about.best], drawing.residual[drawing.about.best]
    off = np.abs(drawing.residual - first).max(axis=1)
    same = [n for n, x in zip(drawing.names, off, strict=True) if x < ALIKE * first.max() and n != best]
    twins = f"; {', '.join(same)} as {best}" if same else ""
    names = [name for name, mm in zip(drawing.names, largest, strict=True) if mm > top]
    beyond = f"; {', '.join(names)} beyond, up to {largest.max():.3g} mm" if names else ""
    return rrb.TimeSeriesView(
        origin="residual_mm",
        contents=[*(f"$origin/{drawing.paths[k]}" for k in drawing.about.shown), "$origin/noise_p95"],
        name=f"Worst marker residual of each run (mm), dots: check runs{beyond}{twins}",
        axis_y=rrb.ScalarAxis(range=(0.0, float(top))),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def write_sag(pen: Pen, drawing: Drawing) -> None:
    """Deflection of the marker that moves most while the load grows, and what the shown models miss of it."""
    loading, (true, *models) = drawing.loading, drawing.sag
    pen.line(Line("sag_mm/true", "true (mm)", MEASURED, 4.0), MM * true)
    missed = np.linalg.norm(loading.predicted - loading.deflection, axis=-1)[:, :, drawing.lowest]
    for k in drawing.about.shown:
        for root, unit, values in (("sag_mm", "mm", MM * models[k]), ("sag_error_um", "um", UM * missed[k])):
            path, look = f"{root}/{drawing.paths[k]}", drawing.looks[k]
            pen.line(Line(path, f"{drawing.names[k]} ({unit})", look.colour, look.width), values)


def sag_views(drawing: Drawing) -> list[rrb.TimeSeriesView]:
    """Blank on the other timelines: a title says which one they need."""
    run = drawing.data.run[drawing.loading.run]
    titles = {
        "sag_mm": f"Deflection of run {run} (mm) over its load (%): choose timeline load below",
        "sag_error_um": "Model against truth (um), noise-free, over the load (%)",
    }
    legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
    return [rrb.TimeSeriesView(origin=k, name=name, plot_legend=legend) for k, name in titles.items()]


def write_histograms(pen: Pen, drawing: Drawing) -> None:
    """Residual components of the shown models before the normal curve of noise, by set of runs."""
    pooled = UM * drawing.errors[list(drawing.about.shown)]
    largest = float(np.abs(pooled).max())
    unit = 50.0 if drawing.noise else max(largest, LEAST_EDGE_UM)
    edge = unit * max(1.0, float(np.ceil(largest / unit)))
    edges, fine = np.linspace(-edge, edge, BINS + 1), np.linspace(-edge, edge, 8 * BINS + 1)
    wide, count = 2 * edge / BINS, len(pooled)
    slot, middle = 0.8 * wide / count, (edges[:-1] + edges[1:]) / 2
    for group, runs in zip(SETS, (~drawing.checked, drawing.checked), strict=True):
        path, components = f"histogram_um/{group}", pooled[:, runs].reshape(count, -1)
        for i, k in enumerate(drawing.about.shown):
            counts = np.histogram(components[i], edges)[0].astype(float)
            at = middle + slot * (i - (count - 1) / 2)
            bars = _bars(at, counts, slot, drawing.looks[k].colour)
            pen.still(f"{path}/{drawing.paths[k]}", bars)
        if drawing.noise:
            density = normal_density(fine, 0.0, UM * drawing.data.sigma * np.sqrt(2))
            curve = wide * components.shape[1] * density
            pen.still(f"{path}/expected_noise", _bars(fine, curve, fine[1] - fine[0], (*NOISE, 90)))


def _bars(at: Array, counts: Array, width: float, colour: Colour) -> rr.BarChart:
    return rr.BarChart(counts, color=colour, abscissa=at, widths=np.full(len(at), width))


def histogram_views(drawing: Drawing) -> list[rrb.BarChartView]:
    """One view a set of runs."""
    what = "residual components (um)" + ("; grey: noise alone" if drawing.noise else "")
    return [
        rrb.BarChartView(origin=f"histogram_um/{group}", name=f"{group.capitalize()} runs, {what}")
        for group in SETS
    ]
