"""Parts of hand-written pages that are numbers: each stands between a mark and `<!-- end -->`.

`<!-- from STUDY: PART; PART -->`: of the report of a full run, tables by name or blocks of its template, such
as title and answer. `<!-- bench -->`: where bench.json was measured; its rows are in tables/speed.csv.
`<!-- expected -->`, `<!-- covered -->`: of the tables beside the pages of studies. A part whose run is not
there stays as it was.
"""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from read_reports import read_report
from scipy.stats import binomtest

from testbench.errors import InputError
from testbench.report.markdown import grid, lines
from testbench.report.report import LISTS, PARTS, Report
from testbench.studies import find_study
from testbench.studies.study import DEFAULT_WITHOUT_CONE
from testbench.workflows.models import DEFAULT

FROM = re.compile(r"(<!-- from (\w+): ([^>]*?) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
PLAIN = re.compile(r"(<!-- (bench|expected|covered) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
COVERAGE = ("true arms", "trials", "covered, %", "in the worst tenth, %")
COVERAGE_HEADS = ["true arms", "n", "covered, %", "worst tenth, %"]
COVERED = (
    "the family", "undisturbed family", "links of tubes", "unequal joints", "cast links",
    "links 40 % off tubes", "coupled links", "disturbances times 2",
)  # fmt: skip
"""Kinds of arms that the page of intervals has, of `docs/studies/model_error/kinds.csv`."""
STUDIES = Path(__file__).resolve().parents[1] / "docs" / "studies"


def fill(page: Path, runs: Path, bench: Path) -> bool:
    """Write the parts of a page whose runs are there; whether it has any.

    Args:
        page: Markdown.
        runs: Folder with one folder a study.
        bench: bench.json.

    Raises:
        InputError: When a mark names a study or part that there is not, or a report is of another version.
    """
    text = page.read_text(encoding="utf-8")
    found = FROM.sub(lambda mark: _from(page, runs, mark), text)
    tables: dict[str, Callable[[], str]] = {
        "bench": lambda: bars(bench, page.parent / "tables"),
        "expected": expected,
        "covered": covered,
    }
    found = PLAIN.sub(lambda mark: _put(mark[1], tables[mark[2]](), mark[3], mark[4]), found)
    if found != text:
        page.write_text(found, encoding="utf-8")
    return bool(FROM.search(text) or PLAIN.search(text))


def _put(mark: str, new: str, old: str, end: str) -> str:
    return f"{mark}{new}\n\n{end}" if new else f"{mark}{old}{end}"


def _from(page: Path, runs: Path, mark: re.Match[str]) -> str:
    name = mark[2]
    try:
        find_study(name)
    except ImportError as err:
        raise InputError(page, mark[1].strip(), f"no study {name!r}") from err
    if not (runs / name / "report.json").is_file():
        return mark[0]
    report = read_report(runs / name / "report.json")
    parts = [_part(page, report, part.strip()) for part in mark[3].split(";")]
    return _put(mark[1], "\n\n".join(parts), mark[4], mark[5])


def _part(page: Path, report: Report, name: str) -> str:
    if name in report.tables:
        return grid(report.tables[name])
    if name in (*PARTS, *LISTS, "badge") and report.block(name):
        return report.block(name)
    raise InputError(page, name, f"no such block, and no such table; tables are {', '.join(report.tables)}")


def bars(file: Path, folder: Path) -> str:
    """Write the first of each benchmark's bars, and say how they were measured.

    Args:
        file: bench.json.
        folder: Folder of speed.csv, which holds them.

    Returns:
        The sentence; empty where `make bench` did not run.
    """
    if not file.is_file():
        return ""
    record = json.loads(file.read_text(encoding="utf-8"))
    held = {row["benchmark"][:3]: row for row in reversed(record["results"]) if row["bar"] is not None}
    rows = [
        [row["benchmark"], f"{row['value']:.3g} {row['unit']}", _bar(row)]
        for letter, row in sorted(held.items())
        if letter.strip()
    ]
    folder.mkdir(exist_ok=True)
    with (folder / "speed.csv").open("w", encoding="utf-8", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows([["what", "measured", "bar"], *rows])
    return f"Medians of one run on one thread of {record['machine']['processor']}."


def _bar(row: dict[str, Any]) -> str:
    return f"{'at least' if row['at_least'] else 'at most'} {row['bar']:g}"


def expected() -> str:
    """What README promises: the default beside its rivals, of the tables beside the pages of studies."""
    models = {row["model"]: row for row in _table("gravity_calibration/models.csv")}
    every = next(r for r in _table("model_error/noisy.csv") if r["disturbance"] == "all together")
    real = {row["model"]: row for row in _table("real_ur10/models.csv")}
    methods = (DEFAULT, DEFAULT_WITHOUT_CONE, "Joints", "MLS56 + prior", "MLS56")
    rows = [
        ["with every disturbance", *(_spread(every, name, 1e-3) for name in methods)],
        ["undisturbed", *(_spread(models[name], "RMS workspace, true, mm", 1.0) for name in methods)],
    ]
    names = ("common pattern", "joint springs", "links, LS")
    for what, key in (("held-out poses", "blocks, mm"), ("series A, fitted to C", "C to A, mm")):
        ours, springs, least = (real[f"+ {name}"][key] for name in names)
        rows.append([f"real UR10, {what}", ours, "", springs, "", least])
    pulled, weighed = (_corrected(f"planned, {loads}") for loads in ("weight and pull", "weight"))
    *others, least = (
        _spread(pulled[name], "after, mm", 1.0) for name in ("default", "LS153 + prior", "Joints", "MLS56")
    )
    before = pulled["default"]["before, mm"]
    rows.append([f"corrected program ({before} before)", *others, "", least])
    alone = "Joints-only"
    heads = ["", "default", "default without cone", alone, "LS of links, prior", "LS of links"]
    won = int(models[DEFAULT_WITHOUT_CONE]["conservative"].rstrip(" %"))
    ends = binomtest(won, 100).proportion_ci(method="wilson")
    names = ("Joints", DEFAULT_WITHOUT_CONE, DEFAULT, "MGCO56", "MGCO56 (paper)", "Ridge", "MLS56")
    joints, same, cone, gco, papers, ridge, least = (
        models[name]["RMS workspace, true, mm"] for name in names
    )
    said = (
        "**The prior and the link compliances bring the gain; the cone keeps the model conservative.** On "
        "undisturbed arms, with the same prior and unknowns, the median error of LS is "
        f"{same} mm, that of GCO {cone} mm. GCO is conservative on all arms, LS on "
        f"{won} % ({100 * ends.low:.0f} to {100 * ends.high:.0f} %). "
        f"Without a prior the median errors are: GCO of beams with a learnt trace weight {gco} mm, {alone} "
        f"{joints} mm, GCO of beams as in the paper {papers} mm, ridge regression {ridge} mm, LS {least} mm. "
        "The last row is the error that remains after a program of drilling and milling (1000 to 3000 N) was "
        "corrected. The models were identified from 12 poses under a weight and a sideways pull. If they are "
        f"identified under a weight alone, {weighed['default']['after, mm']} mm remain with the default and "
        f"{weighed['Joints']['after, mm']} mm with {alone}."
    )
    return f"{lines(heads, rows)}\n\n{said}"


def covered() -> str:
    """How often the default's intervals hold on kinds of arms, best covered first, of the table beside it."""
    some = [row for row in _table("model_error/kinds.csv") if row["true arms"] in COVERED]
    rows = [[row[key] for key in COVERAGE] for row in some]
    return lines(COVERAGE_HEADS, sorted(rows, key=lambda row: -float(row[2])))


def _corrected(campaign: str) -> dict[str, dict[str, str]]:
    """Rows of the study of corrected programs by model: disturbed arms, a campaign of 12 poses."""
    asked = {"arm": "disturbed", "campaign": campaign, "poses": "12"}
    rows = _table("compensation/both.csv")
    return {row["model"]: row for row in rows if asked.items() <= row.items()}


def _table(name: str) -> list[dict[str, str]]:
    with (STUDIES / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _spread(row: dict[str, str], key: str, scale: float) -> str:
    middle, low, high = (scale * float(row[own]) for own in (key, f"{key} (low)", f"{key} (high)"))
    return f"{middle:.3f} ({low:.3f} to {high:.3f})"
