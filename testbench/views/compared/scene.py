"""A comparison as a scene for the Rerun viewer; importing this module imports rerun."""

from collections.abc import Sequence

from testbench.bench.compare_map import RunMap
from testbench.bench.compare_models import ModelPair
from testbench.bench.compare_report import Beside, ComparedReport, NumberPair
from testbench.trials.spread import Number, middle
from testbench.views.colours import GREY, look
from testbench.views.compared.words import model_row, told, words
from testbench.views.recording.beside import BesideScene, RunMaps
from testbench.views.recording.chart import Chart, Dot
from testbench.views.recording.plane import HALF, WHOLE
from testbench.views.schema import show

LINES = 24  #: Of a chart, as many as have room.
LONGEST = 30  #: Name of a number [characters]; before it stands its place in `worst_first`.
PANE = HALF[0], WHOLE[1]  #: Of the chart.
RATIOS = 1e-9, 1e9  #: That a chart shows.
PANES = 4  #: Maps side by side.
CORNERS = (0, 24, 4, 3, 5, 6, 7, 8)  #: Shape of every run: a disc, a ring, polygons.


def scene(report: ComparedReport, maps: Sequence[RunMap]) -> BesideScene:
    """Models by the error that matters most, or numbers as ratios, and what is said of each.

    Args:
        report: What was found.
        maps: Errors of the leading model over the workspace.
    """
    text, first = words(report), report.beside[0]
    summary, tables = text.summary(then=("statements", "how_to_read")), text.block("body")
    if first.lead is not None:
        models = _in_all(report)[: LINES // len(report.runs)]
        rows = [text.block("row", own=model, table=model_row(report, model.name)) for model in models]
        dots = [dot for model in models for dot in _of_model(report, model)]
        title = f"RMS error {first.where} (mm), logarithmic"
        chart, said = Chart("rms_error_mm", title, dots, PANE), text.block("map", maps=maps)
        return BesideScene(summary, chart, rows, len(report.runs), tables, RunMaps(maps[:PANES], said))
    known = [own for own in first.numbers if RATIOS[0] < middle(own.found.ratio) < RATIOS[1]][:LINES]
    if not known:
        return BesideScene(summary, None, [text.block("answer")], 1, tables)
    rows = [text.block("number", p=first, own=own) for own in known]
    return BesideScene(summary, _ratios(first, known), rows, 1, tables)


def _in_all(report: ComparedReport) -> list[ModelPair]:
    """Models of the second run that all others have, those that differ most first."""
    named = [{(m.name, m.kind) for m in pair.models} for pair in report.beside]
    models = [m for m in report.beside[0].led if all((m.name, m.kind) in own for own in named)]
    return sorted(models, key=lambda model: (not model.rms_mm.apart, -model.rms_mm.size))


def _of_model(report: ComparedReport, model: ModelPair) -> list[Dot]:
    """The model in every run, in its own colour; the run is told by shape and name."""
    shade = look(model.structure, model.constraint, model.prior).colour if model.constraint else GREY
    found = [Dot(f"{model.name}, {report.runs[0].letter}", model.rms_mm.a, shade, _mm(model.rms_mm.a))]
    for pair, corners in zip(report.beside, CORNERS[1:], strict=False):
        [own] = [m.rms_mm for m in pair.models if (m.name, m.kind) == (model.name, model.kind)]
        found.append(Dot(f"{model.name}, {pair.b}", own.b, shade, f"{_mm(own.b)}, {told(own)}", corners))
    return found


def _mm(value: Number) -> str:
    return f"{show(middle(value))} mm"


def _ratios(pair: Beside, numbers: list[NumberPair]) -> Chart:
    """A line a number."""
    dots = [
        Dot(f"{k}  {own.what[:LONGEST]}", own.found.ratio, GREY, f"{own.a} and {own.b}")
        for k, own in enumerate(numbers)
    ]
    return Chart("ratio", f"{pair.b} over {pair.a} (times), logarithmic", dots, PANE)
