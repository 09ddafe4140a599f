"""The page of a run: its words, what is drawn, and the pictures that lie in its folder, in one file."""

from pathlib import Path

from testbench import files
from testbench.views.markdown import Told, as_plain
from testbench.views.page import html
from testbench.views.page.data import seen_plain
from testbench.views.scene import Seen

NAME = "report.html"
MARKED, FACTS = ("answer", "worst", "statements"), ("question", "title")
"""Blocks of Markdown, and those that are text."""


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
        words={name: words.block(name) for name in MARKED}
        | {name: as_plain(words.block(name)) for name in FACTS},
        rest=words.block("body"),
        drawn=seen_plain(seen),
        pictures=pictures,
        others=[name for name in (*files.inside(folder), "manifest.json") if name != NAME],
        versions=files.versions(),
    )
    (folder / NAME).write_text(text, encoding="utf-8")
