"""Reports that are sweeps: their rows as points, their words as questions and answers."""

from testbench.recording.sweep import Point, Sweep
from testbench.report import Report
from testbench.studies import loaded_text

ROUNDING_MM = 1e-6
"""A method that is nowhere further off is exact: rounding is no line worth looking at."""


def loaded_stiffness(report: Report, parameters: object) -> Sweep:
    """Error of Eq. (6) and (7) against the hung weight.

    Args:
        report: report.json of the study.
        parameters: The scenario as plain data.
    """
    rows = report["rows"]
    cases = dict.fromkeys((row["truth"], row["method"]) for row in rows)
    worst = {c: max(r["median_mm"] for r in rows if (r["truth"], r["method"]) == c) for c in cases}
    exact = [f"{method} ({truth})" for (truth, method), mm in worst.items() if mm < ROUNDING_MM]
    points = [
        Point(
            x=row["load_N"],
            model=f"{row['method']}, {row['truth']}",
            median=row["median_mm"],
            p05=row["p05_mm"],
            p95=row["p95_mm"],
        )
        for row in rows
        if worst[row["truth"], row["method"]] >= ROUNDING_MM
    ]
    methods = "; ".join(f"*{name}*: {words}" for name, words in report["methods"].items())
    return Sweep(
        scenario=report["scenario"],
        parameters=parameters,
        seed=report["seed"],
        question=f"{report['arm']}: how far off are Eq. (6) and Eq. (7) as the hung weight grows?",
        answer=loaded_text.verdict(report),
        swept="load",
        swept_unit="N",
        measured="error of the tool's deflection",
        unit="mm",
        points=points,
        colours={},
        remarks=f"Over {report['poses']} poses, true compliances, no noise. {methods}."
        + (f" Not drawn, exact to rounding: {', '.join(exact)}." if exact else ""),
    )
