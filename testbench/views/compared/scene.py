"""A comparison as a scene for the Rerun viewer; importing this module imports rerun."""

from collections.abc import Sequence

from testbench.bench.compare_models import ModelPair
from testbench.bench.compare_report import ComparedReport
from testbench.trials.spread import Number, middle
from testbench.views.colours import GREY, Colour, look
from testbench.views.compared.words import told, words
from testbench.views.recording.beside import BesideScene
from testbench.views.recording.chart import Chart, Dot
from testbench.views.schema import show

LINES = 24  #: Of a chart, as many as have room.
LONGEST = 30  #: Name of a number [characters]; before it stands its place in `worst_first`.


def scene(report: ComparedReport) -> BesideScene:
    """Models by the error that matters most, or numbers as ratios, and what is said of each."""
    text = words(report)
    first = report.beside[0]
    rows = [text.block("row", p=first, own=model) for model in _farthest(first.led)]
    rows += [text.block("number", p=first, own=number) for number in first.numbers if not first.lead]
    summary = text.summary(then=("statements", "how_to_read"))
    return BesideScene(summary, chart(report), rows or [text.block("answer")], text.block("body"))


def chart(report: ComparedReport) -> Chart | None:
    """A line a model and run; of numbers a line each."""
    first = report.beside[0]
    if first.lead is not None:
        kept = {m.name for m in _farthest(first.led)[: LINES // len(report.runs)]}
        dots = [dot for model in first.led if model.name in kept for dot in _of_model(report, model)]
        return Chart("rms_error_mm", f"RMS error {first.where} (mm), logarithmic", dots)
    known = [(k, own) for k, own in enumerate(first.numbers) if middle(own.found.ratio) > 0][:LINES]
    if not known:
        return None
    ratios = [
        Dot(f"{k}  {own.what[:LONGEST]}", own.found.ratio, GREY, f"{own.a} and {own.b}") for k, own in known
    ]
    return Chart("ratio", f"{first.b} over {first.a} (times), logarithmic", ratios)


def _farthest(models: Sequence[ModelPair]) -> list[ModelPair]:
    return sorted(models, key=lambda pair: (not pair.rms_mm.apart, -pair.rms_mm.size))


def _of_model(report: ComparedReport, model: ModelPair) -> list[Dot]:
    """The model in every run that has it, in the model's colour."""
    shade = look(model.structure, model.constraint, model.prior).colour if model.constraint else GREY
    found = [_dot(model.name, report.runs[0].letter, model.rms_mm.a, shade)]
    for pair in report.beside:
        for own in pair.models:
            if (own.name, own.kind) == (model.name, model.kind):
                found.append(_dot(model.name, pair.b, own.rms_mm.b, shade, told(own.rms_mm)))
    return found


def _dot(name: str, letter: str, value: Number, shade: Colour, *said: str) -> Dot:
    text = ", ".join([f"{show(middle(value))} mm", *said])
    return Dot(f"{name}, {letter}", value, shade, text)
