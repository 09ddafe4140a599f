"""What every page of a run has to be, whatever it shows."""

from collections.abc import Callable, Sequence
from pathlib import Path

from chromium import DESKTOP, PHONE, Opened


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
