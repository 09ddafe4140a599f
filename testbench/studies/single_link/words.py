"""Section 5.1 in words: table, verdict, matrices, report.md."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from testbench.studies.single_link.trial import GCO, LEAST_SQUARES, SYMMETRIC, eigenvalues
from testbench.views.report import UM, Report, middle, show
from testbench.views.tables import grid


def which_m(report: Report) -> str:
    """The answer to "which m" in one sentence, with its numbers."""
    low, high = report["order_range"]
    *smaller, full = [row for row in report["order"] if low <= row["m"]]
    parts = [
        f"m = {row['m']} in {100 * row['reaches_optimum']:.0f} % (F_M {_excess(row['f_m_over_optimum'])} "
        f"above it, {_position_error(row)} um)"
        for row in smaller
    ]
    return (
        f"Which m? Eq. (20) allows {low:g} to {high:g}. m = 6 reaches the certified optimum of F_M in "
        f"{100 * full['reaches_optimum']:.0f} % of {report['order_draws']} draws (position error "
        f"{_position_error(full)} um), {', '.join(parts)}. Take {_least_sure(report)}."
    )


def _least_sure(report: Report) -> str:
    """The least order that reaches the optimum in every draw."""
    sure = [row["m"] for row in report["order"] if row["reaches_optimum"] == 1]
    return f"m = {min(sure)}, the least that always does" if sure else "none: no order always does"


def _excess(ratio: Any) -> str:
    """How far F_M lies above the optimum, 5 % to 95 % of the draws."""
    ends = (ratio["p05"], ratio["p95"]) if isinstance(ratio, dict) else (ratio, ratio)
    low, high = (100 * max(0.0, x - 1) for x in ends)
    return f"{low:.0f} to {high:.0f} %"


def _position_error(row: Report) -> str:
    return f"{middle(row['prediction']['position_rms_um']):.1f}"


ROWS: tuple[tuple[str, tuple[str, ...], str, float], ...] = (
    ("conservative, %", ("conservative",), ".1f", 100),
    ("symmetric, %", ("symmetric",), ".1f", 100),
    ("an eigenvalue < 0, %", ("negative_eigenvalue_matrix",), ".1f", 100),
    ("  of symmetric part, %", ("negative_eigenvalue",), ".1f", 100),
    ("smallest eigenvalue, 1e-6", ("min_eigenvalue_matrix",), ".3f", 1e6),
    ("  of symmetric part, 1e-6", ("min_eigenvalue",), ".3f", 1e6),
    ("F_M", ("f_m",), ".2f", 1),
    ("F_M floor", ("f_m_floor",), ".2f", 1),
    ("position error, um", ("prediction", "position_rms_um"), ".1f", 1),
    ("  of the deflection, %", ("prediction", "position_relative_percent"), ".2f", 1),
    ("rotation error, urad", ("prediction", "rotation_rms_urad"), ".0f", 1),
    ("  of the rotation, %", ("prediction", "rotation_relative_percent"), ".2f", 1),
    ("C force-position, um/N", ("entries", "translation_rms_um_per_N"), ".2f", 1),
    ("C moment-pos., um/(N m)", ("entries", "coupling_translation_rms_um_per_Nm"), ".2f", 1),
    ("C force-rot., urad/N", ("entries", "coupling_rotation_rms_urad_per_N"), ".2f", 1),
    ("C mom.-rot., urad/(N m)", ("entries", "rotation_rms_urad_per_Nm"), ".2f", 1),
)
"""Rows of the table: words, place in a model's report, format, unit."""


def _cell(model: Report | None, path: tuple[str, ...], form: str, factor: float, *, spread: bool) -> str:
    value: Any = model
    for key in path:
        value = None if value is None else value.get(key)
    if value is None:
        return "-"
    if isinstance(value, dict):
        value = {key: float(_plain(factor * x, form)) for key, x in value.items()}
        return show(value, form) if spread else _plain(value["median"], form)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return _plain(factor * value, form)


def _plain(value: float, form: str) -> str:
    """A number without the sign of a zero."""
    words = format(value, form)
    return words.lstrip("-") if float(words) == 0 else words


def title(report: Report) -> str:
    """What was measured, in one line."""
    data = report["dataset"]
    loads = "10 N or 10 N m along one axis" if report["loads"] == "axes" else "random within 10 N and 10 N m"
    return (
        f"{report['scenario']}: Eq. (21), {data['runs']} loads ({loads}), noise of a deflection "
        f"{data['sigma_of_a_deflection_um']:g} um and {data['sigma_of_a_deflection_urad']:g} urad, "
        f"{report['draws']} draws from seed {report['seed']}; medians"
    )


def table(report: Report) -> Table:
    """All models, and the paper's printed matrices, for a terminal of 80 columns."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("", no_wrap=True)
    rows = report["models"]
    for m in rows:
        shown.add_column(m["name"], justify="right", no_wrap=True)
    for words in ("Eq. (22)\nLS", "Eq. (23)\nGCO"):
        shown.add_column(words, justify="right", no_wrap=True, style="italic")
    printed = [m["paper"] for m in rows if m["paper"]]
    for name, path, form, factor in ROWS:
        shown.add_row(name, *(_cell(m, path, form, factor, spread=False) for m in (*rows, *printed)))
    return shown


def verdict(report: Report) -> str:
    """What a person should take home."""
    ls, symmetric, ours = report["models"]
    pairs = {other: report["paired"][other]["gco_better"] for other in (LEAST_SQUARES, SYMMETRIC)}
    draws = report["draws"]
    lines = [
        f"GCO is conservative in {100 * ours['conservative']:.4g} % of {draws} draws, LS in "
        f"{100 * ls['conservative']:.4g} %: it is symmetric in {100 * ls['symmetric']:.4g} %, and has a "
        "negative eigenvalue in "
        f"{100 * ls['negative_eigenvalue_matrix']:.0f} % (its symmetric part in "
        f"{100 * ls['negative_eigenvalue']:.0f} %).",
        "LS has F_M = 0: 36 equations for 36 unknowns fit the noise exactly.",
        f"GCO predicts positions better than LS in {pairs[LEAST_SQUARES]['position_rms_um']} of {draws} "
        "draws "
        f"({_position_error(ours)} against {_position_error(ls)} um), rotations in "
        f"{pairs[LEAST_SQUARES]['rotation_rms_urad']}. Symmetry alone, LS with 21 entries, gives "
        f"{_position_error(symmetric)} um and is conservative in {100 * symmetric['conservative']:.0f} %; "
        "GCO beats "
        f"that in {pairs[SYMMETRIC]['position_rms_um']}.",
        report["which_m"],
        _words_on_eq_23(report["eq_22_23"]["eq_23_from_the_data_of_eq_22"]),
    ]
    if report["loads"] == "random":
        share = report["condition_of_the_loads"]
        lines.append(
            f"The random loads have a condition number of {show(share, '.1f')}, axis loads of 1: the rarely "
            "loaded directions are read with that much more noise. LS takes it as it comes, symmetry and the "
            "constraint hold part of it off."
        )
    return "\n".join(lines)


def _words_on_eq_23(found: Report) -> str:
    four = found["order"][3]
    return (
        "The paper's own data (Eq. 22 read column by column) have their optimum at F_M "
        f"{found['optimum_f_m']:.3f}, "
        f"rank {found['optimum_rank']}; the printed Eq. (23) has {found['printed_f_m']:.3f} and, within its "
        f"rounding, rank {found['rank_within_rounding']}; the best of m = 4 has {four['f_m']:.3f}."
    )


def first_draw(report: Report) -> str:
    """LS and GCO of the first draw side by side in 80 columns, with their eigenvalues."""
    ls, ours = (report["first_draw"][name] for name in (LEAST_SQUARES, GCO))
    pairs = zip(ls["matrix"], ours["matrix"], strict=True)
    lines = [f"{'first draw, 1e-6 SI: LS':<37}    {'GCO'}"]
    lines += [f"{_short_row(a)}    {_short_row(b)}" for a, b in pairs]
    lines += ["eigenvalues"]
    lines += [f"{_short_row(ls['eigenvalues_matrix'])}    {_short_row(ours['eigenvalues_symmetric_part'])}"]
    return "\n".join(lines)


def _short_row(values: Sequence[float]) -> str:
    return " ".join(f"{_short(UM * value):>5}" for value in values)


def _short(value: float) -> str:
    digits = 2 if abs(value) < 10 else 1 if abs(value) < 100 else 0
    return _plain(value, f".{digits}f")


def where(out: Path) -> str:
    """Where the results are."""
    return (
        f"numbers    {out / 'report.json'}, {out / 'report.md'}\n"
        f"readings   {out / 'dataset.csv'} (first draw)\n"
        f"figure     {out / 'single_link.png'}\n"
        f"to repeat  {out / 'manifest.json'}"
    )


NOTES = (
    "MLS21 is not in the paper: least squares with symmetry and nothing else. Prediction errors are RMS "
    "distances from the true deflection over fresh loads spread evenly over |F| <= 10 N, |M| <= 10 N m; "
    "entry "
    "errors are RMS over the nine entries of a block of C. The paper's columns are its printed matrices "
    "under "
    "the check loads of our first draw, their F_M that on the paper's own data; the sign of the smallest "
    "eigenvalue of Eq. (23) is below its printed digits. Eigenvalues are in mixed SI units, as the paper's.",
    "36 equations determine the 36 unknowns of LS: its F_M is 0 whatever the noise, and says nothing. The "
    "floor "
    "of the others spreads their 15 spare equations evenly, 2 sqrt(3 (1 - 21/36)) = 2.24. Under axis loads 3 "
    "of them are in positions and 12 in rotations, since positions are the more precise reading of the "
    "coupling: sqrt(3) (sqrt(3/18) + sqrt(12/18)) = 2.12, and the mean of an RMS of so few lies a little "
    "below.",
)
"""How to read the table, and why F_M stays below its floor."""


def markdown(report: Report) -> str:
    """report.md: verdict, tables, what the printed matrices tell, matrices of the first draw."""
    rows = report["models"]
    printed = [m["paper"] for m in rows if m["paper"]]
    head = ["", *(m["name"] for m in rows), "paper, Eq. (22), LS", "paper, Eq. (23), GCO"]
    body = [
        [
            name.strip(),
            *(_cell(m, path, form, factor, spread=True) for m in (*rows, *printed)),
        ]
        for name, path, form, factor in ROWS
    ]
    ranks = [", ".join(f"{rank}: {count}" for rank, count in m["rank_of_C"].items()) for m in rows]
    body.append(["rank: draws", *ranks, "-", "-"])
    first, *others = verdict(report).split("\n")
    blocks = [
        f"# {report['scenario']}",
        f"{title(report)} (5 % to 95 % of the draws).",
        f"**{first}**",
        *others,
        "\n".join(grid(head, body)),
        *NOTES,
        *_paired_words(report),
        "## The order m",
        "\n".join(_order_table(report)),
        "## What the printed Eq. (22) and (23) tell",
        *_printed_words(report["eq_22_23"]),
        "## One draw in the manner of Eq. (22) and (23)",
        f"Seed {report['seed']}; dataset.csv holds its readings.",
        *_matrices(report),
    ]
    return "\n\n".join(blocks) + "\n"


def _paired_words(report: Report) -> list[str]:
    head = ["draws in which GCO is closer to the truth", "than MLS36", "than MLS21"]
    wins = [report["paired"][other]["gco_better"] for other in (LEAST_SQUARES, SYMMETRIC)]
    table = "\n".join(grid(head, [[key, *(str(w[key]) for w in wins)] for key in wins[0]]))
    ls, _, ours = report["models"]
    true = UM * report["truth_matrix"][0][0]
    means = [f"{true + UM * m['entry_bias'][0][0]:.2f}" for m in (ours, ls)]
    return [
        table,
        f"What GCO pays is a bias where the truth is near zero: it cannot find c11 = {true:.3f} um/N "
        f"below zero, and finds {means[0]} um/N in the mean (LS {means[1]}); the RMS error of this entry is "
        f"{UM * ours['entry_rms'][0][0]:.2f} against {UM * ls['entry_rms'][0][0]:.2f} um/N all the same.",
    ]


def _order_table(report: Report) -> list[str]:
    head = ["m", "F_M", "F_M / optimum", "reaches it, %", "rank: draws", "eigenvalues, 1e-6 (medians)"]
    head += ["position error, um", "rotation error, urad"]
    body = [
        [
            str(row["m"]),
            show(row["f_m"], ".3f"),
            show(row["f_m_over_optimum"], ".4f"),
            f"{100 * row['reaches_optimum']:.0f}",
            ", ".join(f"{rank}: {count}" for rank, count in row["rank_of_C"].items()),
            " ".join(_short(UM * middle(value)) for value in row["eigenvalues"]),
            show(row["prediction"]["position_rms_um"], ".1f"),
            show(row["prediction"]["rotation_rms_urad"], ".0f"),
        ]
        for row in report["order"]
    ]
    return grid(head, body)


def _printed_words(found: Report) -> list[str]:
    pin, own = found["pinning"], found["eq_23_from_the_data_of_eq_22"]
    columns = " ".join(f"{value:.2f}" for value in pin["position_rms_by_column_over_sigma"])
    expected = pin["negative_eigenvalue_expected"]
    deflection, reading = (
        f"{100 * expected[key]['of_the_matrix']:.0f} % (symmetric part "
        f"{100 * expected[key]['of_its_symmetric_part']:.0f} %)"
        for key in ("if_sigma_is_of_a_deflection", "if_sigma_is_of_a_reading")
    )
    low, high = own["printed_f_m_within_rounding"]
    small = own["eigenvalues_within_rounding"][1]
    best = own["optimum_prediction"]
    p_deflection = pin["p_as_large_if_sigma_is_of_a_deflection"]
    p_reading = pin["p_as_small_if_sigma_is_of_a_reading"]
    ratio = pin["likelihood_ratio_deflection_to_reading"]
    return [
        f"Eq. (22) differs from Eq. (21) by an RMS of {pin['position_rms_over_sigma']:.2f} times 25 um / "
        "10 N "
        f"in its translation rows (by column {columns}) and {pin['rotation_rms_over_sigma']:.2f} times "
        f"0.25 mrad / 10 N m in its rotation rows, each +-{pin['standard_error_percent']:.0f} %. Axis "
        "loads of "
        "10 N and 10 N m read the columns of C directly: this gives 1.00 if sigma is the noise of a "
        "deflection, 1.41 if it is that of each of its two readings. Over all 36 entries the RMS is "
        f"{pin['rms_over_sigma']:.2f}: as large or larger with p = {p_deflection:.2f} in the first case, as "
        f"small or smaller with p = {p_reading:.2f} in the second, a likelihood ratio of {ratio:.1f} for the "
        "deflection. Six random loads would give "
        f"{show(pin['random_loads_rms_over_sigma'], '.1f')}, and so little in "
        f"{100 * pin['random_loads_share_as_small']:.1f} % of cases.",
        f"A negative eigenvalue is to be expected in {deflection} of draws if sigma is that of a deflection, "
        f"in {reading} if it is that of a reading.",
        f"Eigenvalues of Eq. (22): {_exact(found['eq_22']['eigenvalues_matrix'])}; of its symmetric part: "
        f"{_exact(found['eq_22']['eigenvalues_symmetric_part'])}. Of Eq. (23): "
        f"{_exact(found['eq_23']['eigenvalues'])}. Matrices that round to Eq. (23) have a second eigenvalue "
        f"of {small[0]:.1e} to {small[1]:.1e}: two are zero within rounding, rank "
        f"{own['rank_within_rounding']}.",
        "Eq. (22) times 10 N, 10 N m is the paper's dataset. Its certified optimum over all conservative "
        f"matrices has F_M {own['optimum_f_m']:.3f} and rank {own['optimum_rank']}; Eq. (23) has "
        f"{own['printed_f_m']:.3f} ({low:.2f} to {high:.2f} within rounding). Against the truth the optimum "
        f"errs by {best['position_rms_um']:.1f} um and {best['rotation_rms_urad']:.0f} urad under the check "
        "loads of our first draw: compare the paper's columns above.",
        "\n".join(
            grid(
                [
                    "m",
                    "F_M on the paper's data",
                    "eigenvalues, 1e-6",
                    "RMS distance to Eq. (23), sigma / 10 N",
                ],
                [
                    [
                        str(row["m"]),
                        f"{row['f_m']:.3f}",
                        " ".join(_short(UM * value) for value in row["eigenvalues"]),
                        f"{row['rms_to_eq_23_over_sigma']:.2f}",
                    ]
                    for row in own["order"]
                ],
            )
        ),
    ]


def _exact(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.2e}" for value in values)


def _matrices(report: Report) -> list[str]:
    printed = report["eq_22_23"]
    named = (
        ("Eq. (21), truth", report["truth_matrix"]),
        ("LS, first draw", report["first_draw"][LEAST_SQUARES]["matrix"]),
        ("Eq. (22), the paper's LS", printed["eq_22"]["matrix"]),
        ("GCO, first draw", report["first_draw"][GCO]["matrix"]),
        ("Eq. (23), the paper's GCO", printed["eq_23"]["matrix"]),
        ("GCO, certified optimum on the data of Eq. (22)",
         printed["eq_23_from_the_data_of_eq_22"]["optimum_matrix"]),
    )  # fmt: skip
    blocks = []
    for name, matrix in named:
        rows = "\n".join(" ".join(f"{value:10.2e}" for value in row) for row in matrix)
        matrix_values, symmetric_values = eigenvalues(np.array(matrix))
        values = f"eigenvalues                {_exact(matrix_values.tolist())}"
        if matrix != np.transpose(matrix).tolist():
            values += f"\nof the symmetric part      {_exact(symmetric_values.tolist())}"
        blocks.append(f"{name}:\n\n```\n{rows}\n\n{values}\n```")
    return blocks
