"""The study of model error in words: table, answers, report.md."""

from rich import box
from rich.table import Table

from testbench.studies.model_error.summary import CLAIM
from testbench.studies.model_error.trial import ALL, NONE
from testbench.views.report import Report, show
from testbench.views.tables import grid

FEATURED = "MGCO56 + prior"


def title(report: Report) -> str:
    """What was done, in one line."""
    return (
        f"{report['arm']}, poses and weight of section 6, {report['trials']} trials: errors of predicted "
        f"deflection in {report['workspace_poses']} poses never measured, um, without noise and with "
        f"{report['sigma_um']:g} um; disturbances that have a size {report['scale']:g} times their "
        f"typical one; "
        "medians"
    )


def table(report: Report) -> Table:
    """Median RMS error by disturbance and model, for a terminal of 80 columns: noise-free / noisy."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("disturbance", no_wrap=True)
    models = list(dict.fromkeys(c["model"] for c in report["cells"]))
    for name in models:
        shown.add_column(name.replace(" + ", "\n+ "), justify="right", no_wrap=True)
    for case in report["sizes"]:
        shown.add_row(case, *(_pair(report, case, name) for name in models))
    return shown


def _pair(report: Report, case: str, model: str) -> str:
    calm, noisy = (
        cell(report, case, model, noise)["rms_um"]["median"] for noise in (0.0, report["sigma_um"])
    )
    return f"{calm:.0f} / {noisy:.0f}"


def cell(report: Report, case: str, model: str, noise: float) -> Report:
    """One case, model and noise."""
    found: Report = next(
        c
        for c in report["cells"]
        if c["case"] == case and c["model"] == model and abs(c["noise_um"] - noise) < 1e-9
    )
    return found


def statements(report: Report) -> list[str]:
    """The answers, each with its numbers; the first one is the headline."""
    claim = [_claim(report)] if report["claim"] else []
    return [_headline(report), _noise(report), *claim, _together(report)]


def _headline(report: Report) -> str:
    alone = [case for case in report["sizes"] if case not in (NONE, ALL)]
    added = {case: cell(report, case, FEATURED, 0.0)["added_um"]["median"] for case in alone}
    order = sorted(alone, key=lambda case: -added[case])
    words = ", ".join(f"{case} {added[case]:+.0f}" for case in order)
    return f"Added to the error of {FEATURED} without noise, um: {words}."


def _noise(report: Report) -> str:
    base = [cell(report, NONE, FEATURED, noise)["rms_um"] for noise in (0.0, report["sigma_um"])]
    share = base[1]["median"] - base[0]["median"]
    above = [
        case
        for case in report["sizes"]
        if case not in (NONE, ALL) and cell(report, case, FEATURED, 0.0)["added_um"]["median"] > share
    ]
    return (
        f"Noise of {report['sigma_um']:g} um takes the undisturbed arm from {show(base[0], '.0f')} to "
        f"{show(base[1], '.0f')} um, adding {share:.0f}: more than that alone adds "
        f"{', '.join(above) or 'none'}."
    )


def _claim(report: Report) -> str:
    words = []
    for row in report["claim"]:
        low, middle, high = (100 * row["against_readings"][key] for key in ("p05", "median", "p95"))
        words.append(
            f"{row['case']}, {row['model']} {middle:+.1f} % ({low:+.0f} to {high:+.0f}; within the claim in "
            f"{100 * row['within_claim']:.0f} % of trials; against the truth "
            f"{100 * row['against_truth']['median']:+.0f} %)"
        )
    return (
        f"The paper quotes errors with and without the compensator at most {100 * CLAIM:.1f} % apart. Here, "
        f"RMS over the workspace with the readings' noise added in quadrature: {'; '.join(words)}."
    )


def _together(report: Report) -> str:
    words = []
    for model in dict.fromkeys(c["model"] for c in report["cells"]):
        none, every = (
            cell(report, case, model, report["sigma_um"])["rms_um"]["median"] for case in (NONE, ALL)
        )
        words.append(f"{model} {none:.0f} to {every:.0f}")
    return f"All together, with noise, um: {', '.join(words)}."


def markdown(report: Report) -> str:
    """report.md."""
    first, *others = statements(report)
    lines = [f"# {report['scenario']}", "", f"{title(report)}.", "", f"**{first}**", ""]
    lines += [f"- {text}" for text in others]
    models = list(dict.fromkeys(c["model"] for c in report["cells"]))
    for noise, words in ((0.0, "without noise"), (report["sigma_um"], f"{report['sigma_um']:g} um")):
        rows = [
            [
                case,
                show(cell(report, case, models[0], noise)["moved_um"], ".0f"),
                *(show(cell(report, case, m, noise)["rms_um"], ".0f") for m in models),
            ]
            for case in report["sizes"]
        ]
        lines += ["", f"## RMS error, um, {words}", "", *grid(["disturbance", "moves", *models], rows)]
    sizes = [[case, str(values or "-")] for case, values in report["sizes"].items()]
    lines += ["", "Moves: how far the disturbance alone moves the deflections to be predicted.", ""]
    lines += ["## Sizes, SI", "", *grid(["case", "switched on"], sizes), ""]
    return "\n".join(lines)
