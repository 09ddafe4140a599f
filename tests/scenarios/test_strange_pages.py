"""Names of strangers stand on pages as text: nothing of them runs."""

import re
import shutil
from pathlib import Path

import pytest
from page_checks import check_page, said
from run_here import fine as run

MODEL = Path(__file__).resolve().parents[2] / "models" / "kr500_l480"
JOINT, FILE = "<img src=x onerror=alert(1)>|a", "<script>alert(2)<!--.csv"
IN_XML = JOINT.replace("<", "&lt;").replace(">", "&gt;")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Checks of an arm with a joint of a strange name, and of readings in a file of a strange name."""
    own = tmp_path_factory.mktemp("strange")
    arm, data = Path(shutil.copytree(MODEL, own / "arm")), own / FILE
    for name, strange in (("rigid.xml", IN_XML), ("elastic.toml", JOINT)):
        path = arm / name
        path.write_text(path.read_text().replace("joint_5", strange))
    run("simulate", arm, "--poses", 4, "--payload-kg", 460, "--seed", 1, "--out", data)
    run("check", arm, "--out", own / "checked")
    run("data", "check", arm, data, "--out", own / "data")
    return own


def test_a_joint_and_a_file_that_are_called_as_scripts_are_text(folder, open_page):
    shown = check_page(open_page, folder / "checked" / "report.html", [JOINT])
    assert shown.page.locator("td", has_text=JOINT).count() == 4  # to confirm, its share; the same in words
    shown = check_page(open_page, folder / "data" / "report.html", [FILE, JOINT])
    assert re.match(r"Run (\d), pose \1\. 4512\.6 N: P1 moves ", said(shown))
    run_or_load = shown.page.evaluate("document.querySelectorAll('script, img').length")
    assert run_or_load == 3  # the data, our own, the figure
