"""A sweep in words: its summary, every number, what stands at a step."""

from testbench.views.markdown import lines as grid
from testbench.views.recording.swept import TIMELINE, Sweep

LARGE = 1000.0
"""Numbers from here on are shown without decimals."""


def summary(sweep: Sweep) -> str:
    """Question, answer, table, legend, how to scrub."""
    drawn_as = (
        "**Dots** Median, with a bar from 5 to 95 %. One colour a model."
        if sweep.labels
        else "**Lines** Bold with dots: median. Thin: 5 and 95 %. One colour and one shape a model. "
        f"Above: {sweep.unit}; below: log10 of the same."
    )
    scrub = f"**Scrub** `{TIMELINE}` is the {sweep.heading}{'' if sweep.labels else ', rounded'}."
    return "\n\n".join(filter(None, [sweep.words or _medians(sweep), drawn_as, scrub]))


def _medians(sweep: Sweep) -> str:
    """Question, answer, medians, remarks."""
    lines = {model: sweep.line(model) for model in sweep.models}
    places = [sweep.place(p.x) for p in sweep.line(sweep.models[0])]
    rows = [[place, *(_number(own[k].median) for own in lines.values())] for k, place in enumerate(places)]
    parts = [
        f"### {sweep.question}",
        f"#### **{sweep.answer}**",
        f"Median {sweep.measured}, {sweep.unit}:",
        grid([sweep.heading, *lines], rows),
        sweep.remarks,
    ]
    return "\n\n".join(filter(None, parts))


def table(sweep: Sweep) -> str:
    """Every number with its spread."""
    rows = [
        [model, sweep.place(p.x), *(_number(v) for v in (p.median, p.p05, p.p95))]
        for model in sweep.models
        for p in sweep.line(model)
    ]
    head = [
        "model",
        sweep.heading,
        *(f"{k}, {sweep.unit}" for k in ("median", "5 %", "95 %")),
    ]
    return "\n\n".join([f"### {sweep.title}", grid(head, rows)])


def caption(sweep: Sweep, k: int) -> str:
    """The models at one step."""
    points = [sweep.line(model)[k] for model in sweep.models]
    unit = f" {sweep.swept_unit}" if sweep.swept_unit and not sweep.labels else ""
    rows = [[p.model, *(_number(v) for v in (p.median, p.p05, p.p95))] for p in points]
    place = f"**{sweep.swept.capitalize()} {sweep.place(points[0].x)}{unit}**"
    head = [f"{sweep.measured}, {sweep.unit}", "median", "5 %", "95 %"]
    return "\n\n".join([place, grid(head, rows)])


def _number(value: float) -> str:
    """Four digits, never 1.2e+03."""
    return f"{value:.0f}" if value >= LARGE else f"{value:.4g}"
