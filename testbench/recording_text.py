"""The words of a recording, in markdown: summary and notes from the report alone, tables from the runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.bench import Scenario
from testbench.dataset import Dataset, Ids, Mask
from testbench.errors import Array
from testbench.report import MM, Report, middle, show, show_truth

Row = dict[str, Any]

ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("RMS, identification, mm", "identification", "rms_mm", ".3f", "identification_rms_mm"),
    ("RMS, check, mm", "check", "rms_mm", ".3f", "check_rms_mm"),
    ("max, check, mm", "check", "max_mm", ".3f", "check_max_mm"),
    ("max relative, check, %", "check", "max_relative_percent", ".2f", "check_max_relative_percent"),
    ("RMS, workspace, mm", "workspace", "rms_mm", ".3f", ""),
)
"""Error rows of the summary: heading, set, number, format, the paper's cell."""


def is_gco(row: Row) -> bool:
    """Whether a model of the report was identified by GCO."""
    return bool(row["method"].startswith("GCO"))


def by_method(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """The models of least squares, and those of GCO."""
    return [m for m in rows if not is_gco(m)], [m for m in rows if is_gco(m)]


def best(rows: Sequence[Row], group: str) -> Row:
    """The conservative model of least RMS error on a set; of all models where none is conservative."""
    conservative = [m for m in rows if m["conservative"] is True]
    return min(conservative or rows, key=lambda m: middle(m[group]["rms_mm"]))


@dataclass(frozen=True)
class RunLine:
    """What is said of one run.

    Attributes:
        run: Its identifier.
        pose: Identifier of its pose.
        group: "identification" or "check".
        place: Its place in worst_first.
        sag_mm: Deflection of the marker that moves most.
    """

    run: int
    pose: int
    group: str
    place: int
    sag_mm: float

    @property
    def where(self) -> str:
        """The run in words."""
        return f"run {self.run}, {self.group} pose {self.pose}"


def run_lines(data: Dataset, checked: Mask, rank: Ids) -> list[RunLine]:
    """One line a run, in dataset order.

    Args:
        data: The runs.
        checked: Which of them check, (runs,).
        rank: Their places in worst_first, (runs,).
    """
    sag = MM * np.linalg.norm(data.deflection, axis=-1).max(axis=1)
    groups = np.where(checked, "check", "identification")
    columns = (data.run, data.pose, groups, rank, sag)
    return [RunLine(*row) for row in zip(*(c.tolist() for c in columns), strict=True)]


def summary(report: Report, arm: str, scenario: Scenario, worst: str, scales: tuple[float, float]) -> str:
    """Question, answer, table, legend.

    Args:
        report: All numbers.
        arm: Its title.
        scenario: Payload and noise.
        worst: The run with the largest residual of the best model, in words.
        scales: Magnification of deflections and of residuals [1].
    """
    data, noise = report["dataset"], np.sqrt(6) * MM * scenario.sigma * scenario.noise
    floor = f"Noise alone makes {noise:.3f} mm RMS at check poses." if noise else "Readings are noise-free."
    sag = f"{show(data['deflection_min_mm'], '.2f')} to {show(data['deflection_max_mm'], '.2f')} mm"
    paragraphs = [
        f"### {arm} under {scenario.payload:g} kg: which stiffness model predicts its sag best?",
        f"#### **{answer(report, worst)}**",
        "\n".join(model_table(report["models"])),
        "In brackets: the paper. Seen: directions of the unknowns that the data determine. "
        f"Markers move {sag} in {data['runs']} runs. {floor} "
        "Over the workspace errors are against the truth.",
        f"**Colours** Grey: arm without its load. Vermillion: measured, and the ghost; sag x {scales[0]:g}. "
        "Sky blue: markers without load. Orange: least squares. Green: GCO. Purple: load. "
        f"Arrows from measured to predicted: x {scales[1]:g}.",
        "**Scrub** the time bar below: `worst_first` 0 is the worst run, `pose` the dataset's order.",
    ]
    return "\n\n".join(paragraphs)


def answer(report: Report, worst: str) -> str:
    """Which model is best, by how much, and where it is worst; one line."""
    rows = report["models"]
    first, area = best(rows, "check"), best(rows, "workspace")
    rivals, method = by_method(rows)[0 if is_gco(first) else 1], "LS" if is_gco(first) else "GCO"
    check, workspace = (f"{show(first[group]['rms_mm'])} mm" for group in ("check", "workspace"))
    if rivals:
        rival = min(rivals, key=lambda m: middle(m["check"]["rms_mm"]))
        check += f" (best {method} {rival['name']} {show(rival['check']['rms_mm'])})"
        workspace += f" ({rival['name']} {show(rival['workspace']['rms_mm'])})"
    kind = "Best conservative model" if first["conservative"] is True else "No model is conservative; best"
    largest = max(middle(first[group]["max_mm"]) for group in ("identification", "check"))
    text = f"{kind}: {first['name']}, RMS {check} at check poses, {workspace} over the workspace"
    if area is not first:
        text += f", where {area['name']} has {show(area['workspace']['rms_mm'])} mm"
    return (
        f"{text}. Its worst marker: {largest:.2f} mm in {worst}; "
        f"{show(first['workspace']['max_mm'], '.2f')} mm in the workspace."
    )


def model_table(rows: Sequence[Row]) -> list[str]:
    """The table of section 6 with a column a model, the paper's number in brackets."""
    first = best(rows, "check")
    names = [f"**{m['name']}**" if m is first else m["name"] for m in rows]
    lines = [
        ["", *names],
        ["---", *["---:"] * len(rows)],
        ["unknowns / seen", *(f"{m['parameters']} / {show(m['rank'], '.0f')}" for m in rows)],
        ["conservative", *(show_truth(m["conservative"]) for m in rows)],
        ["F_M / floor", *(f"{show(m['f_m'], '.2f')} / {show(m['f_m_floor'], '.2f')}" for m in rows)],
    ]
    for heading, group, number, form, cell in ROWS:
        cells = [show(m[group][number], form) for m in rows]
        known = [(m["paper"] or {}).get(cell) for m in rows]
        both = zip(cells, known, strict=True)
        lines.append([heading, *(a if b is None else f"{a} ({b:{form}})" for a, b in both)])
    return [_line(cells) for cells in lines]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def table(runs: Sequence[RunLine], names: Sequence[str], residual: Array) -> str:
    """All runs, in dataset order.

    Args:
        runs: Their lines.
        names: Of the models.
        residual: Residual of the worst marker, (models, runs) [m].
    """
    head = ["run", "pose", "set", "worst_first", "deflection, mm", *(f"{n}, mm" for n in names)]
    lines = [head, ["---:"] * len(head)]
    for run, column in zip(runs, MM * residual.T, strict=True):
        known = [str(run.run), str(run.pose), run.group, str(run.place), f"{run.sag_mm:.3f}"]
        lines.append([*known, *(f"{mm:.3f}" for mm in column)])
    head_line = "Deflection of the marker that moves most; residual of the worst marker, for each model."
    return "\n".join(["### Every run", "", head_line, "", *map(_line, lines)])


def captions(runs: Sequence[RunLine], names: Sequence[str], residual: Array) -> list[str]:
    """What is on screen, for every run; arguments as for `table`."""
    head = [_line(["worst marker", *names]), _line(["---", *["---:"] * len(names)])]
    texts = []
    for run, column in zip(runs, MM * residual.T, strict=True):
        title = f"**{run.where.capitalize()}** sags {run.sag_mm:.2f} mm; "
        title += f"number {run.place + 1} of {len(runs)} from the worst."
        numbers = _line(["residual, mm", *(f"{mm:.3f}" for mm in column)])
        texts.append("\n".join([title, "", *head, numbers]))
    return texts


def notes(report: Report) -> str:
    """Status and advice of every model."""
    lines = ["### What the models say of themselves", ""]
    for m in report["models"]:
        gap = "" if m["duality_gap"] is None else f", duality gap {show(m['duality_gap'], '.1e')}"
        lines += [
            f"**{m['name']}**: {m['method']}, {m['status']}{gap}, smallest eigenvalue "
            f"{show(m['min_eigenvalue'], '.1e')}",
            "",
            *(f"- {advice}" for advice in m["advice"]),
            *(f"- residuals, {group}: {_words(m['residuals'][group])}" for group in m["residuals"]),
            "",
        ]
    return "\n".join(lines)


def _words(residuals: Row) -> str:
    mean, std = show(residuals["mean_um"], ".1f"), show(residuals["std_um"], ".1f")
    p = show(residuals["lilliefors_p"], ".3f")
    return f"mean {mean} um, standard deviation {std} um, Lilliefors p = {p}"
