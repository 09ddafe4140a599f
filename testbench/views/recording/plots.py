"""Residuals run by run, their histogram, and the sag while the load grows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy import stats

from testbench.bench.rows import MM, UM
from testbench.data.dataset import Mask
from testbench.errors import Array
from testbench.views.recording.drawing import Drawing, noise_limit
from testbench.views.recording.style import MEASURED, NOISE, Colour, Drawn

SETS = ("identification", "check")
BINS = 17
LEAST_TOP_MM = 0.01
"""Where the axis of residuals ends at least: below is rounding of exact data."""
LEAST_EDGE_UM = 0.1
"""The same of histograms without noise."""
MANY = 60
"""Runs beyond which dots are small."""
ALIKE = 0.02
"""Models whose residuals differ by less than this share lie on each other in the plot."""


def write_residuals(stream: rr.RecordingStream, drawing: Drawing, times: Sequence[rr.TimeColumn]) -> None:
    """Worst marker residual of every run and model, and what noise alone stays below in 95 % of runs."""
    size = 5.0 if drawing.data.runs <= MANY else 2.5
    for k, (model, look) in enumerate(zip(drawing.names, drawing.looks, strict=True)):
        path, name = f"residual_mm/{drawing.paths[k]}", f"{model} (mm)"
        _line(stream, path, name, look)
        shape = rr.SeriesPoints(colors=look.colour, markers=look.shape, names=name)
        stream.log(path, shape, static=True)
        sizes = rr.SeriesPoints.columns(marker_sizes=np.where(drawing.checked, size, 0.0))
        values = rr.Scalars.columns(scalars=MM * drawing.residual[k])
        # In one chunk: of two the viewer pairs the rows wrongly on a timeline that is not sorted.
        stream.send_columns(path, times, [*values, *sizes])
    if drawing.noise:
        path, name = "residual_mm/noise_p95", "95 % of pure noise (mm)"
        stream.log(path, rr.SeriesLines(colors=NOISE, widths=1.5, names=name), static=True)
        limit = np.full(drawing.data.runs, MM * noise_limit(drawing))
        stream.send_columns(path, times, rr.Scalars.columns(scalars=limit))


def _line(stream: rr.RecordingStream, path: str, name: str, look: Drawn) -> None:
    stream.log(path, rr.SeriesLines(colors=look.colour, widths=look.width, names=name), static=True)


def residual_view(drawing: Drawing) -> rrb.TimeSeriesView:
    """Zoomed on the best model of each method; the title says how far the others go."""
    top = max(LEAST_TOP_MM, MM * 2 * drawing.residual[list(drawing.shown)].max())
    if drawing.noise:
        top = max(top, 1.2 * MM * noise_limit(drawing))
    largest = MM * drawing.residual.max(axis=1)
    first = drawing.residual[drawing.best]
    off = np.abs(drawing.residual - first).max(axis=1)
    same = [
        n
        for n, x in zip(drawing.names, off, strict=True)
        if x < ALIKE * first.max() and n != drawing.names[drawing.best]
    ]
    twins = f"; {', '.join(same)} as {drawing.names[drawing.best]}" if same else ""
    names = [name for name, mm in zip(drawing.names, largest, strict=True) if mm > top]
    beyond = f"; {', '.join(names)} beyond, up to {largest.max():.3g} mm" if names else ""
    return rrb.TimeSeriesView(
        origin="residual_mm",
        contents=[f"$origin/{path}" for path in (*(drawing.paths[k] for k in drawing.shown), "noise_p95")],
        name=f"Worst marker residual of each run (mm), dots: check runs{beyond}{twins}",
        axis_y=rrb.ScalarAxis(range=(0.0, float(top))),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def write_sag(stream: rr.RecordingStream, drawing: Drawing, time: rr.TimeColumn) -> None:
    """Deflection of the marker that moves most while the load grows, and what the shown models miss of it."""
    loading = drawing.loading
    marker = int(np.linalg.norm(loading.deflection[-1], axis=-1).argmax())
    true = np.linalg.norm(loading.deflection[:, marker], axis=-1)
    stream.log("sag_mm/true", rr.SeriesLines(colors=MEASURED, widths=4.0, names="true (mm)"), static=True)
    stream.send_columns("sag_mm/true", [time], rr.Scalars.columns(scalars=MM * true))
    for k in drawing.shown:
        path = f"sag_mm/{drawing.paths[k]}"
        sag = np.linalg.norm(loading.predicted[k, :, marker], axis=-1)
        _line(stream, path, f"{drawing.names[k]} (mm)", drawing.looks[k])
        stream.send_columns(path, [time], rr.Scalars.columns(scalars=MM * sag))
        missed = UM * np.linalg.norm(loading.predicted[k] - loading.deflection, axis=-1)[:, marker]
        path = f"sag_error_um/{drawing.paths[k]}"
        _line(stream, path, f"{drawing.names[k]} (um)", drawing.looks[k])
        stream.send_columns(path, [time], rr.Scalars.columns(scalars=missed))


def sag_views(drawing: Drawing) -> list[rrb.TimeSeriesView]:
    """Blank on the other timelines: a title says which one they need."""
    run = drawing.data.run[drawing.loading.run]
    titles = {
        "sag_mm": f"Deflection of run {run} (mm) over its load (%): choose timeline load below",
        "sag_error_um": "Model against truth (um), noise-free, over the load (%)",
    }
    legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
    return [rrb.TimeSeriesView(origin=k, name=name, plot_legend=legend) for k, name in titles.items()]


@dataclass(frozen=True)
class Bars:
    """A bar chart."""

    at: Array  #: Centres, (bars,) [um].
    counts: Array  #: Heights, (bars,) [1].
    width: float  #: Of every bar [um].


def histograms(drawing: Drawing, runs: Mask) -> tuple[Bars | None, list[Bars]]:
    """Residual components of the shown models over some runs.

    Args:
        drawing: Gives residuals and noise.
        runs: Which runs, (runs,).

    Returns:
        The normal curve of the noise, as fine bars, where there is noise; and the bars of each shown model,
        side by side.
    """
    pooled = UM * drawing.errors[list(drawing.shown)]
    edge = float(np.abs(pooled).max())
    unit = 50.0 if drawing.noise else max(edge, LEAST_EDGE_UM)
    edge = unit * max(1.0, float(np.ceil(edge / unit)))
    edges = np.linspace(-edge, edge, BINS + 1)
    wide, count = 2 * edge / BINS, len(pooled)
    slot, middle = 0.8 * wide / count, (edges[:-1] + edges[1:]) / 2
    components = pooled[:, runs].reshape(count, -1)
    bars = [
        Bars(middle + slot * (i - (count - 1) / 2), np.histogram(x, edges)[0].astype(float), slot)
        for i, x in enumerate(components)
    ]
    if not drawing.noise:
        return None, bars
    fine = np.linspace(-edge, edge, 8 * BINS + 1)
    density = stats.norm.pdf(fine, scale=UM * drawing.data.sigma * np.sqrt(2))
    return Bars(fine, wide * components.shape[1] * density, fine[1] - fine[0]), bars


def write_histograms(stream: rr.RecordingStream, drawing: Drawing) -> None:
    """Residual components of the best models before the normal curve of noise, for each set of runs."""
    for group, runs in zip(SETS, (~drawing.checked, drawing.checked), strict=True):
        curve, bars = histograms(drawing, runs)
        path = f"histogram_um/{group}"
        if curve is not None:
            stream.log(f"{path}/expected_noise", _chart(curve, (*NOISE, 90)), static=True)
        for k, model in zip(drawing.shown, bars, strict=True):
            stream.log(f"{path}/{drawing.paths[k]}", _chart(model, drawing.looks[k].colour), static=True)


def _chart(bars: Bars, colour: Colour) -> rr.BarChart:
    widths = np.full(len(bars.at), bars.width)
    return rr.BarChart(bars.counts, color=colour, abscissa=bars.at, widths=widths)


def histogram_views(drawing: Drawing) -> list[rrb.BarChartView]:
    """One view a set of runs."""
    what = "residual components (um)" + ("; grey: noise alone" if drawing.noise else "")
    return [
        rrb.BarChartView(origin=f"histogram_um/{group}", name=f"{group.capitalize()} runs, {what}")
        for group in SETS
    ]
