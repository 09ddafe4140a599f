"""The study of Eq. (7) in words: table, verdict, report.md."""

from collections.abc import Iterator

from rich import box
from rich.table import Table

from testbench.studies.loaded_stiffness.trial import METHODS, TRUTHS
from testbench.views.report import Report
from testbench.views.tables import grid

COLUMNS = (
    "deflection_rms_mm", "rms_mm", "vertical_rms_mm", "median_mm", "p05_mm", "p95_mm", "max_mm",
    "rms_percent", "median_percent", "p05_percent", "p95_percent", "max_percent",
)  # fmt: skip
"""Columns of report.md."""


def cells(report: Report) -> Iterator[tuple[Report, dict[str, Report]]]:
    """By load and truth: the linear row, and the rows of all methods by name."""
    rows = report["rows"]
    for k in range(0, len(rows), len(METHODS)):
        yield rows[k], {row["method"]: row for row in rows[k : k + len(METHODS)]}


def table(report: Report) -> Table:
    """RMS errors for a terminal of 80 columns."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("truth", no_wrap=True)
    headings = ["load\nkN", "moves\nmm", "Eq. 6\nmm", "%", "Eq. 7\nsecant mm", "%", "integrated\nmm", "%"]
    for heading in headings:
        shown.add_column(heading, justify="right", no_wrap=True)
    for truth in TRUTHS:
        for first, rows in cells(report):
            if first["truth"] == truth:
                numbers = [words for row in rows.values() for words in (number(row["rms_mm"]), share(row))]
                moves = f"{first['deflection_rms_mm']:.2f}"
                shown.add_row(truth, f"{first['load_N'] / 1e3:.3g}", moves, *numbers)
        shown.add_section()
    return shown


def number(value: float) -> str:
    """Three digits; what is only rounding as a power of ten."""
    return f"{value:.3g}" if value >= 1e-4 else f"{value:.0e}"


def share(row: Report) -> str:
    """RMS error over RMS deflection."""
    percent = float(row["rms_percent"])
    return f"{percent:.2f}" if percent >= 0.005 else f"{percent:.0e}"


def verdict(report: Report) -> str:
    """What a person should take home, in one sentence."""
    last = {first["truth"]: rows for first, rows in cells(report)}
    free, heavy = (last[truth] for truth in TRUTHS)
    worst = max(row["max_relative_difference"] for row in report["tangent"])

    def error(row: Report) -> str:
        return f"{number(row['rms_mm'])} mm RMS ({share(row)} % of the deflection)"

    return (
        f"Under {report['loads_N'][-1] / 1e3:.3g} kN Eq. (6) is off by {error(free['linear'])}, Eq. (7) with "
        f"K_w at theta = 0 by {error(free['secant'])} and integrated by {error(free['integrated'])}, its "
        f"tangent within {worst:.0e} of the true one; where the arm also sags under its own weight, which "
        f"no method knows, they are off by {number(heavy['linear']['rms_mm'])}, "
        f"{number(heavy['secant']['rms_mm'])} and {number(heavy['integrated']['rms_mm'])} mm."
    )


def markdown(report: Report) -> str:
    """report.md: verdict, errors, tangents."""
    head = ["truth", "load, N", "method", *(column.replace("_", " ") for column in COLUMNS)]
    body = [
        [row["truth"], f"{row['load_N']:.0f}", row["method"], *(number(row[key]) for key in COLUMNS)]
        for truth in TRUTHS
        for row in report["rows"]
        if row["truth"] == truth
    ]
    tangents = [
        [f"{row['load_N']:.0f}", f"{row['max_relative_difference']:.1e}"] for row in report["tangent"]
    ]
    lines = [
        f"# {report['scenario']}: {report['arm']}, {report['poses']} poses, seed {report['seed']}",
        f"**{verdict(report)}**",
        "\n".join(f"- {name}: {words}" for name, words in METHODS.items()),
        "Errors are distances at the tool's origin between predicted and true deflection, over all poses; "
        "true compliances, no noise. A percentage is of the pose's own deflection; the RMS percentage is RMS "
        "error over RMS deflection. Weightless truth differs from the methods by their own mathematics "
        "alone. With its own weight the true arm has sagged before the load comes, and every method starts "
        "from the arm that has not.",
        "Along the force, at its own point, the true deflection exceeds the linear one by 1.5 a in second "
        "order, a = theta^T K_w theta; Eq. (7) with K_w at theta = 0 adds 1.0 a and so leaves a third of the "
        "linear error there. Across the force its correction is not that of the true arm, and the distance "
        "error falls by less: compare the vertical RMS with the RMS.",
        "\n".join(grid(head, body)),
        "Tangent compliance at the load's point under load, 3 x 3 against forces: Eq. (7) at the equilibrium "
        "against central differences of the true weightless arm; largest difference over all poses, relative "
        "in the Frobenius norm. What is left is the tolerance of the true equilibria.",
        "\n".join(grid(["load, N", "largest relative difference"], tangents)),
    ]
    return "\n\n".join(lines) + "\n"
