"""What every page of a run has to be, whatever it shows."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from chromium import DESKTOP, PHONE, Opened

from testbench.report.markdown import as_plain
from testbench.workflows.model_names import in_words, row_words


def check_page(open_page: Callable[..., Opened], page: Path, told: Sequence[str]) -> Opened:
    """Open a page: no complaint, no network, no text beyond a desk's or a phone's edge, these words on it."""
    assert page.stat().st_size < 3e6
    shown = open_page(page)
    text = shown.page.evaluate("document.body.textContent.replace(/\\s+/g, ' ')")
    assert [words for words in told if words not in text] == []
    assert shown.page.evaluate("document.documentElement.dataset.ready")  # the last line of its script
    for width in (DESKTOP, PHONE):
        shown.page.set_viewport_size({"width": width, "height": 844})
        assert shown.faults() == []
    return shown


def said(shown: Opened) -> str:
    """What the page says of the pose that it shows."""
    return shown.page.locator("#scene .says").first.inner_text()


def drawn_in(page: Path) -> Any:
    """What the scripts of a page draw."""
    [data] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page.read_text(), re.S)
    return json.loads(data)


def layer_of(group: Mapping[str, Any], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Where dots, lines or arrows of a group begin and end, (poses, k, 3) both [m], within 0.05 mm."""
    [layer] = [one for one in group["layers"] if one["name"] == name]
    ends = (np.array(layer[key] or layer["at"], dtype=float) for key in ("at", "to"))
    start, end = (points.reshape(len(points), -1, 3) / 1e4 for points in ends)
    return start, end


def times_of(title: str) -> list[float]:
    """The magnifications that a title says, in its order."""
    return [float(number) for number in re.findall(r"x (\d[\de.+]*?)(?=[,;. ]|$)", title)]


def names_drawn(page: Path) -> dict[str, str]:
    """What a page names in each of its views: every group of arms, map, charts, the first table."""
    drawn = drawn_in(page)
    groups = drawn["scene"]["groups"] if drawn["scene"] else []
    errors = [group for group in groups if any("error" in own["name"] for own in group["layers"])]
    found = {
        group["name"]: [group["name"], *(own["name"] for own in group["layers"])]
        for group in errors or groups[:1]
    }
    if drawn["map"]:
        found["map"] = [line["name"] for line in drawn["map"]["lines"]]
    found |= {chart["title"]: [line["name"] for line in chart["lines"]] for chart in drawn["runs"]}
    for table in drawn["tables"][:1]:
        rows = [row["cells"][0]["text"] for row in table["rows"]]
        found["table"] = [table["title"], *(head["title"] for head in table["head"]), *rows]
    return {view: " | ".join(names) for view, names in found.items()}


def check_tables(tables: Sequence[Mapping[str, Any]], badge: Mapping[str, Any] | None) -> None:
    """No cell of a table is empty; what the badge is about is first, and marked if it wins."""
    winner = badge["winner"] if badge else ""
    wins = badge is not None and badge["verdict"] in ("holds", "likely", "do not use") and not badge["why"]
    for table in tables:
        names = [row["cells"][0]["text"] for row in table["rows"]]
        marked = [row["marked"] for row in table["rows"]]
        assert [
            cell["text"] for row in table["rows"] for cell in row["cells"][1:] if blank(cell["text"])
        ] == []
        if winner in names:
            assert marked == [wins and name == winner for name in names], table["title"]
            assert names.count(winner) > 1 or names[0] == winner


def blank(text: str) -> bool:
    """Whether a cell says nothing, not even why."""
    return text.strip() in ("", "-", "nan")


def check_winner(out: Path) -> None:
    """The badge of a run says the same everywhere, and its winner is drawn in every view of it."""
    badge = json.loads((out / "report.json").read_text())["badge"]
    if badge is None:  # nothing to compare: no incumbent was fitted
        return
    assert list(badge)[:6] == ["winner", "rival", "factor", "interval", "n", "verdict"]
    views = names_drawn(out / "report.html")
    called = (badge["winner"], in_words(badge["winner"]), row_words(badge["winner"]))
    missing = [view for view, names in views.items() if not any(name in names for name in called)]
    assert views, out
    assert missing == [], (badge, views)
    check_tables(drawn_in(out / "report.html")["tables"], badge)
    words = as_plain(badge["words"])
    assert f"> {badge['words']}" in (out / "report.md").read_text()
    assert escape(words, quote=False) in (out / "report.html").read_text().replace("&#39;", "'")
