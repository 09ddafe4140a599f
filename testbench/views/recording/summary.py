"""The summary of a calibration: question, answer, table, legend. All numbers are the report's."""

from collections.abc import Sequence

import numpy as np

from testbench.views.recording.run_text import RunLine
from testbench.views.recording.study import Study, best, by_method
from testbench.views.recording.style import is_gco
from testbench.views.report import Report, middle, show, show_truth
from testbench.views.tables import grid

Row = tuple[str, str, str, str, str]

GRAVITY: tuple[Row, ...] = (
    ("RMS, identification, mm", "identification", "rms_mm", ".3f", "identification_rms_mm"),
    ("RMS, check, mm", "check", "rms_mm", ".3f", "check_rms_mm"),
    ("max, check, mm", "check", "max_mm", ".3f", "check_max_mm"),
    ("max relative, check, %", "check", "max_relative_percent", ".2f", "check_max_relative_percent"),
    ("RMS, workspace, mm", "workspace", "rms_mm", ".3f", ""),
)
"""Error rows of the summary: heading, set, number, format, the paper's cell."""

FULL_POSE: tuple[Row, ...] = (
    ("95 %, readings, mm", "readings", "p95_mm", ".3f", "readings_p95_mm"),
    ("max, readings, %", "readings", "max_relative_percent", ".2f", "readings_max_relative_percent"),
    ("95 %, truth, mm", "check", "p95_mm", ".3f", ""),
    ("RMS, truth, mm", "check", "rms_mm", ".3f", ""),
)
"""The same of full poses under wrenches: check runs against their readings, and against the truth."""


def error_rows(report: Report) -> tuple[Row, ...]:
    """The error rows that this kind of report has."""
    return GRAVITY if "workspace" in report["models"][0] else FULL_POSE


def summary(study: Study, worst: RunLine) -> str:
    """Question, answer, table, legend, how to scrub.

    Args:
        study: Its report gives all numbers.
        worst: The run with the largest residual of the best model.
    """
    report = study.report
    gravity = "workspace" in report["models"][0]
    question = (
        f"under {report['payload_kg']:g} kg: which stiffness model predicts its sag best?"
        if gravity
        else "under any load: which stiffness model predicts its deflection best?"
    )
    M, scale = study.magnification, study.residual_scale
    return "\n\n".join(
        [
            f"### {study.cell.arm.title} {question}",
            f"#### **{_gravity_answer(report, worst) if gravity else _full_pose_answer(report)}**",
            "\n".join(model_table(report)),
            _remarks(study),
            *([] if gravity else [_statements(report)]),
            f"**Colours** Grey: arm without load. Vermillion: measured, and the ghost; deflection x {M:g}. "
            "Sky blue: markers without load. Orange: least squares. Green: GCO. Purple: load. "
            f"Arrows measured to predicted: x {scale:g}; label: worst marker, best model.",
            "**Scrub** the time bar below: `worst_first` 0 is the worst run, `pose` the dataset's order, "
            f"`load` loads {worst.where} from 0 to 100 % (tab Loading).",
        ]
    )


def model_table(report: Report) -> list[str]:
    """A column a model, the paper's number in brackets; medians where there are several seeds."""
    rows = report["models"]
    first = best(rows, "check")
    head = ["", *(f"**{m['name']}**" if m is first else m["name"] for m in rows)]
    lines = [
        ["unknowns / seen", *(f"{m['parameters']} / {_median(m['rank'], '.0f')}" for m in rows)],
        ["conservative", *(show_truth(m["conservative"]) for m in rows)],
        ["F_M / floor", *(f"{_median(m['f_m'], '.2f')} / {_median(m['f_m_floor'], '.2f')}" for m in rows)],
    ]
    for heading, group, number, form, cell in error_rows(report):
        cells = [_median(m[group][number], form) for m in rows]
        known = [(m["paper"] or {}).get(cell) for m in rows]
        both = zip(cells, known, strict=True)
        lines.append([heading, *(a if b is None else f"{a} ({b:{form}})" for a, b in both)])
    return grid(head, lines)


def _median(value: object, form: str) -> str:
    """Without the spread: it would make the table too wide; the tab of errors shows it."""
    return show(None if value is None else middle(value), form)


def _gravity_answer(report: Report, worst: RunLine) -> str:
    """Which model is best, by how much, and where it is worst; one line."""
    rows = report["models"]
    first, area = best(rows, "check"), best(rows, "workspace")
    check, workspace = (f"{show(first[group]['rms_mm'])} mm" for group in ("check", "workspace"))
    rival, method = _rival(rows, first)
    if rival:
        check += f" (best {method} {rival['name']} {middle(rival['check']['rms_mm']):.3f})"
        workspace += f" ({rival['name']} {middle(rival['workspace']['rms_mm']):.3f})"
    largest = max(middle(first[group]["max_mm"]) for group in ("identification", "check"))
    text = f"{_kind(first)}: {first['name']}, RMS {check} at check poses, {workspace} over the workspace"
    if area is not first:
        text += f", where {area['name']} has {show(area['workspace']['rms_mm'])} mm"
    where = "" if isinstance(report["seed"], list) else f" in {worst.where}"
    return (
        f"{text}. Its worst marker: {largest:.2f} mm{where}; "
        f"{show(first['workspace']['max_mm'], '.2f')} mm in the workspace."
    )


def _full_pose_answer(report: Report) -> str:
    rows = report["models"]
    first = best(rows, "check")
    error = f"{show(first['check']['rms_mm'])} mm RMS"
    rival, method = _rival(rows, first)
    if rival:
        error += f" (best {method} {rival['name']} {middle(rival['check']['rms_mm']):.3f})"
    broken = [m["name"] for m in rows if m["conservative"] is not True]
    runs = f"{report['dataset']['check_runs']} check runs"
    text = f"{_kind(first)}: {first['name']}, {error} off the truth in {runs}"
    if broken:
        text += f"; not conservative: {', '.join(broken)}"
    return f"{text}. At most {show(first['check']['max_mm'])} mm."


def _kind(first: Report) -> str:
    return "Best conservative model" if first["conservative"] is True else "No model is conservative; best"


def _rival(rows: Sequence[Report], first: Report) -> tuple[Report | None, str]:
    """The best model of the other method, and that method."""
    rivals, method = by_method(rows)[0 if is_gco(first) else 1], "LS" if is_gco(first) else "GCO"
    return min(rivals, key=lambda m: middle(m["check"]["rms_mm"]), default=None), method


def _remarks(study: Study) -> str:
    """What the columns mean, and what was measured."""
    report = study.report
    data = report["dataset"]
    low, high = (middle(data[f"deflection_{end}_mm"]) for end in ("min", "max"))
    sag = f"{low:.2f} to {high:.2f} mm"
    parts = ["In brackets: the paper. Seen: directions of the unknowns that the data determine."]
    if "workspace" in report["models"][0]:
        noise = np.sqrt(6) * data["sigma_um"] / 1e3
        parts += [
            f"Markers move {sag} in {data['runs']} runs.",
            f"Noise alone makes {noise:.3f} mm RMS at check poses."
            if study.noise
            else "Readings are noise-free.",
            "Over the workspace errors are against the truth.",
        ]
    else:
        parts.append(f"{data['runs']} runs identify, {data['check_runs']} others check; they move {sag}.")
    if isinstance(report["seed"], list):
        parts.append(f"Medians of {len(report['seed'])} seeds (above: 5 to 95 %); drawn: seed {study.seed}.")
    return " ".join(parts)


def _statements(report: Report) -> str:
    """How many of the paper's statements hold, which do not, and the answer to which m."""
    rows = report["claims"]
    others = [row["claim"] for row in rows if not row["verdict"].startswith("confirmed")]
    holds = f"**The paper** {len(rows) - len(others)} of {len(rows)} statements confirmed"
    return f"{holds}; not: {'; '.join(others)}." if others else f"{holds}."


def statements(report: Report) -> str:
    """Every statement of the paper against our numbers, and which m; empty where there are none."""
    if "claims" not in report:
        return ""
    rows = [[row["claim"], row["verdict"], row["why"]] for row in report["claims"]]
    table = "\n".join(grid(["statement", "verdict", "why"], rows))
    return "\n\n".join(["### The paper's statements", table, "### The order m", report["which_m"]])
