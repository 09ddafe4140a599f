"""What stands on the page of a run, and the writing of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench import files
from testbench.views.colours import SCALE
from testbench.views.markdown import Told, as_plain
from testbench.views.page import html
from testbench.views.page.charts import PlaceMap, RunChart
from testbench.views.page.scene import Json, Scene
from testbench.views.schema import Table

NAME = "report.html"
MARKED, FACTS = ("answer", "worst", "statements"), ("question", "title")
"""Blocks of Markdown, and those that are text."""


@dataclass(frozen=True)
class Seen:
    """What of a run is drawn, beside its words."""

    scene: Scene | None = None
    map: PlaceMap | None = None  #: Only beside a scene.
    runs: Sequence[RunChart] = ()  #: Only beside a scene.
    tables: Sequence[Table] = ()  #: Those that can be sorted and drawn, the first one first.


def write_page(folder: Path, scenario: str, words: Told, seen: Seen) -> None:
    """report.html of a run, from its words, what is drawn, and the pictures that lie in its folder.

    Args:
        folder: Of the run; all its other files are there but the manifest.
        scenario: What was run, such as "Gravity calibration".
        words: Of its report.
        seen: What is drawn.
    """
    pictures = [{"name": png.name, "data": html.embedded(png)} for png in sorted(folder.glob("*.png"))]
    text = html.fill(
        scenario=scenario,
        words={name: _block(words, name) for name in MARKED}
        | {name: as_plain(_block(words, name)) for name in FACTS},
        rest=words.rest(),
        drawn=_plain(seen),
        pictures=pictures,
        others=[name for name in (*files.inside(folder), "manifest.json") if name != NAME],
        versions=files.versions(),
    )
    (folder / NAME).write_text(text, encoding="utf-8")


def _block(words: Told, name: str) -> str:
    return words.block(name) if words.has(name) else ""


def _plain(seen: Seen) -> Json:
    """All that is drawn as JSON data."""
    return {
        "scene": seen.scene.plain() if seen.scene else None,
        "map": seen.map.plain() if seen.map else None,
        "runs": [chart.plain() for chart in seen.runs],
        "tables": [html.grid(table) for table in seen.tables],
        "ramp": SCALE,
    }
