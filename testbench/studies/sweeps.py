"""Reports that are sweeps: their rows as points, their words as questions and answers."""

from testbench.studies.model_error import words as model_error_text
from testbench.studies.noise_sensitivity import words as noise_text
from testbench.views.recording.style import GREENS, ORANGES, Colour
from testbench.views.recording.sweep import Point, Sweep
from testbench.views.report import Report


def noise(report: Report, parameters: object) -> Sweep:
    """Error over the workspace against noise, the KR 500 under its payload.

    Args:
        report: report.json of the study of noise.
        parameters: What was tried, as plain data.
    """
    rows = report["sweeps"]["gravity"]
    points = [
        Point(
            row["sigma_um"], row["model"], row["rms_um"]["median"], row["rms_um"]["p05"], row["rms_um"]["p95"]
        )
        for row in rows
    ]
    first, *others = noise_text.statements(report)
    return Sweep(
        scenario=report["scenario"],
        parameters=parameters,
        seed=_root_seed(report),
        question="What does tracker noise cost, by method and structure?",
        answer=first,
        swept="noise of one reading",
        swept_unit="um",
        measured="RMS error over the workspace",
        unit="um",
        points=points,
        colours=_roles(list(dict.fromkeys(row["model"] for row in rows))),
        remarks="\n\n".join(others),
    )


def model_error(report: Report, parameters: object) -> Sweep:
    """Error over the workspace by disturbance, numbered, with noise.

    Args:
        report: report.json of the study of model error.
        parameters: What was tried, as plain data.
    """
    cases = list(report["sizes"])
    points = [
        Point(
            cases.index(c["case"]), c["model"], c["rms_um"]["median"], c["rms_um"]["p05"], c["rms_um"]["p95"]
        )
        for c in report["cells"]
        if c["noise_um"] > 0
    ]
    first, *others = model_error_text.statements(report)
    return Sweep(
        scenario=report["scenario"],
        parameters=parameters,
        seed=_root_seed(report),
        question=f"{report['arm']}: what do disturbances cost that the model does not know?",
        answer=first,
        swept="disturbance",
        swept_unit="number",
        measured="RMS error over the workspace",
        unit="um",
        points=points,
        colours=_roles(list(dict.fromkeys(c["model"] for c in report["cells"]))),
        remarks="\n\n".join(others),
        labels=dict(enumerate(cases)),
    )


def _root_seed(report: Report) -> int:
    """First root of randomness."""
    seeds = report["seed"]
    return int(seeds if isinstance(seeds, int) else seeds[0])


def _roles(models: list[str]) -> dict[str, Colour]:
    """Orange for least squares, shades of green for GCO, those with a prior first."""
    by_prior = sorted(models, key=lambda name: "prior" not in name)
    greens = [name for name in by_prior if not name.startswith("MLS")]
    oranges = [name for name in by_prior if name.startswith("MLS")]
    return {
        name: shades[k % len(shades)]
        for names, shades in ((greens, GREENS), (oranges, ORANGES))
        for k, name in enumerate(names)
    }
