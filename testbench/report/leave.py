"""The folder of a run, all of it or nothing: numbers, words, picture, recording, page, manifest."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.progress import stepwise
from testbench.report.report import Report
from testbench.report.scene import PageContent, typical_first
from testbench.runs import manifest as files
from testbench.runs.manifest import digests
from testbench.runs.whole import whole_folder

if TYPE_CHECKING:  # importing matplotlib takes long, and not every command leaves a folder
    from testbench.report.figure import Figure

More = Callable[[Path], Mapping[str, object] | None]
"""Writes what else a command leaves into the folder; what it returns goes into manifest.json."""

Draw = Callable[[Report, PageContent], "Mapping[str, Figure]"]
"""Draws the figures of a command, by name."""

MAP = "error_map.png"  #: The maps of a command that has some.


@dataclass(frozen=True)
class RunRequest:
    """Describe what was asked of a command, of what, and what it leaves."""

    command: str  #: As manifest.json names it, such as "testbench check".
    name: str  #: Of what the run is about: arm, file or program.
    flags: Mapping[str, object]  #: Plain data, without places of results.
    arms: Sequence[Path]  #: Folders of the arms.
    picture: str  #: Name of the PNG.
    seeds: range = range(0)
    more: More | None = None  #: What else the command leaves.
    stem: str = "report"  #: Name of its numbers and words without suffix.
    map: str = ""  #: Title of error_map.png, empty for none.
    #: Draws the figures, by name, in place of the overview, which is `picture`; None for the overview.
    draw: Draw | None = None


def write_run(out: Path, run_request: RunRequest, report: Report, page: PageContent) -> None:
    """Write a run; InputError when its folder cannot be written.

    Args:
        out: Folder of the results.
        run_request: What was asked.
        report: The report.
        page: What the page draws.
    """
    with whole_folder(out) as folder:
        found = (run_request.more(folder) if run_request.more else None) or {}
        files.write_json(report.json(), folder / f"{run_request.stem}.json")
        (folder / f"{run_request.stem}.md").write_text(report.whole(), encoding="utf-8")
        for view in stepwise(_views(folder, run_request, report, page), "writing"):
            view()
        files.write_log(folder)
        models = digests(run_request.arms)
        plain = dict(run_request.flags)
        files.write_manifest(
            folder,
            command=run_request.command,
            scenario=plain,
            seeds=run_request.seeds,
            models=models,
            tables=(),
            **found,
        )


def _views(
    folder: Path, run_request: RunRequest, report: Report, page: PageContent
) -> list[Callable[[], object]]:
    """List what draws a run into its folder: figures, map, recording and page."""
    _shorten_matplotlib_docstrings()
    from testbench.report.figure import save  # here: matplotlib and rerun take half a second, and not
    from testbench.report.page import write_page  # every command leaves a folder
    from testbench.report.recording.run import write_run
    from testbench.report.recording.stream import RecordingHeader
    from testbench.report.run_figure import error_map, overview, silhouette

    tables = page.tables or [table for table in report.tables.values() if table.rows]
    drawn = typical_first(replace(page, tables=tables))
    header = RecordingHeader(
        run_request.command,
        json.dumps(run_request.flags, sort_keys=True),
        next(iter(run_request.seeds), 0),
    )

    def write_figures() -> None:
        asked = run_request.draw
        figures = asked(report, drawn) if asked else {run_request.picture: overview(report, drawn)}
        for name, figure in figures.items():
            save(figure, folder / name)

    views: list[Callable[[], object]] = [
        write_figures,
        lambda: write_run(folder / "recording.rrd", header, report, drawn, {}),
        lambda: write_page(folder, f"{run_request.command}: {run_request.name}", report, drawn),
    ]
    if run_request.map and page.map and any(np.isfinite(line.values).any() for line in page.map.lines):
        places = page.map
        arm = silhouette(drawn, places)
        views.insert(1, lambda: save(error_map(places, run_request.map, arm), folder / MAP))
    return views


def _shorten_matplotlib_docstrings() -> None:
    """Keep tables of properties out of matplotlib's docstrings; to be called before figures are imported.

    Every class of artists lists all of its setters in the signature and docstring of `set` and in several
    other docstrings: a fifth of the time of the import.
    """
    import matplotlib.artist

    def none(artist: object) -> str:
        """Stand in for `matplotlib.artist.kwdoc`, the table of an artist's properties."""
        del artist
        return ""

    matplotlib.artist.kwdoc = none
    matplotlib.artist.Artist._update_set_signature_and_docstring = classmethod(none)  # type: ignore[attr-defined]
