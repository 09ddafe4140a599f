"""Texts of strangers: refused at the door, or shown as text wherever they stand."""

import csv
import json
import os
import pty
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
from markdown_it import MarkdownIt
from spoil import swap

from testbench.errors import BenchError, InputError, printable, shell_word
from testbench.files.program import read_program
from testbench.files.read_pairs import read_csv
from testbench.files.table import as_cell, from_cell
from testbench.files.write import write_program
from testbench.report.figure import page, save
from testbench.report.markdown import as_markdown, as_plain, lines
from testbench.workflows.cell import build_cell

NAMES = {
    "markup": "[/nope]",
    "link of a terminal": "[link=file:///etc/passwd]x",
    "tag": "<img src=x onerror=alert(1)>|a",
    "script": "</script><script>alert(1)</script>",
    "comment": "a <!-- b",
    "letter by name": "&lt;b&gt; &#60;i&#62;",
    "code": "`code` ``` ~~~",
    "cell": "a|b\\|c\\",
    "link": "[a](javascript:alert(1))",
    "end of a link": "](javascript:alert(1))",
    "picture": "![a](http://far.example/b.png)",
    "stress": "**b** _i_ __u__ ~~s~~",
    "heading": "# head",
    "quote": "> said",
    "item": "1. first",
    "template": "{{ 7*7 }}{% raw %}",
    "formula of a figure": "$\\frac",
    "path": "../../etc/passwd",
    "root": "/world/arm",
    "honest": "robot/link 1 (A1) [deg]",
    "Chinese": "关节 2",
}
"""Names that an arm may have."""
UNFIT = {
    "title of a terminal": "a\x1b]0;owned\x07",
    "cleared screen": "\x1b[2Ja",
    "C1": "a\x9bb",
    "backspace": "a\b\bb",
    "lines": "a\nerror: b",
    "end of a paragraph": "a\u2029b",
    "turned": "a\u202egpj",
    "without width": "a\u200bb",
    "formula": "=cmd|'/c calc'!A1",
    "sum": "@SUM(1)",
    "plus": "+1",
    "flag": "--save=x",
    "blank": " a",
    "long": "A" * 65,
    "none": "",
}
"""Names that none may have."""
CELLS = ["=1+1", "@SUM(1)", "+cmd|' /C calc'!A0", "-2+3", "\uff1d1", " =1", "--x"]
NO_FORMULA = ["-5", "+3.2", "-1,5", "-1.5e-3", "- 5", "a=1", "'quoted'", "it's", ""]


JOINT, MARKER = "joint_1", "probe"


def rename(lab, name, title="arm"):
    """An arm whose second joint and marker are called so."""
    for file, say in (("rigid.xml", quoteattr), ("elastic.toml", json.dumps)):
        path = lab / "arm" / file
        text = path.read_text()
        for own in (JOINT, MARKER):
            text = text.replace(f'"{own}"', say(name if own == JOINT else f"{name}_m"))
        if file == "elastic.toml":
            text = re.sub(r"^title = .*$", lambda _: f"title = {json.dumps(title)}", text, flags=re.M)
        path.write_text(text)


SHOWN = "markup|link of a terminal|tag|code|cell|template|formula of a figure|honest|Chinese".split("|")
"""One of each way to mean something to who prints it; Markdown shows all of them below."""


@pytest.mark.parametrize("kind", SHOWN)
def test_a_strange_name_is_text_on_the_terminal(kind, attack, lab):
    name = NAMES[kind]
    rename(lab, name, "\x1b]0;owned\x07\x1b[2J\u202etitle\n# [/x]")
    done = attack(lab, "check", "arm")
    done.done()
    assert name in done.out


@pytest.mark.parametrize("name", UNFIT.values(), ids=UNFIT)
def test_a_name_that_steers_is_refused_at_the_door(name, attack, lab):
    swap(f'"{JOINT}"', json.dumps(name))(lab / "arm" / "elastic.toml")
    attack(lab, "check", "arm").refused("elastic.toml: line ", "joint.0.name")


@pytest.mark.parametrize("text", [text for text in (*NAMES.values(), *UNFIT.values()) if text])
def test_markdown_of_a_text_shows_it_and_nothing_else(text):
    """Alone, in the middle of a line, stressed, and in a cell of a table."""
    md = MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"])
    own = as_markdown(text)
    assert as_plain(own) == printable(text)
    for place in ("{}", "Of {}: 5 mm", "**{}**", "- {}", "- Of {}(see below)"):
        made = md.render(place.format(own))
        assert not set(re.findall(r"<(\w+)", made)) - {"p", "strong", "ul", "li"}, made
    table = md.render(lines([own, "b"], [[own, "c"], [f"**{own}**", "[1]"]]))
    assert set(re.findall(r"<(\w+)", table)) <= {"table", "thead", "tbody", "tr", "th", "td", "strong"}
    assert [row.count("</t") - 1 for row in re.findall(r"<tr>.*?</tr>", table, re.S)] == [2, 2, 2]


@pytest.mark.parametrize("text", [*CELLS, *NO_FORMULA])
def test_a_cell_that_a_spreadsheet_would_compute_is_none_and_every_cell_is_read_as_it_was(text):
    own = as_cell(text)
    assert own[0] == "'" if text in CELLS else own == text
    assert from_cell(own) == text


def test_labels_of_a_program_come_back_from_the_corrected_one_as_no_formulas(lab):
    labels = ["=cmd|'/c calc'!A1", "@x", "a\x1b]0;b\x07", "\u202egpj", "-5", "[/x]"]
    arm = build_cell(lab / "arm").arm
    joints = [joint.display_column for joint in arm.joints]
    with (lab / "program.csv").open("w", newline="") as file:
        rows = [[label, *[k] * len(joints), "=HYPERLINK(1)"] for k, label in enumerate(labels)]
        csv.writer(file).writerows([["label", *joints, "=1+1"], *rows])
    program = read_program(lab / "program.csv", arm)
    assert program.labels == tuple(map(printable, labels))
    write_program(lab / "new.csv", program, program.q, {"said": ["=2"] * len(labels)})
    with (lab / "new.csv").open(newline="") as file:
        assert not [cell for row in csv.reader(file) for cell in row if cell[:1] in ("=", "@")]
    again = read_program(lab / "new.csv", arm)
    assert again.labels == program.labels
    assert again.content.table.texts(len(again.content.table.names) - 1) == ["=2"] * len(labels)


def test_a_figure_has_dollars_and_letters_without_a_font_as_text(tmp_path, recwarn):
    figure = page(3.0)
    axes = figure.subplots()
    axes.plot([0, 1], label="$\\frac{")
    axes.set_title("$\\nope$ 关节")
    axes.set_xticks([0, 1], labels=["$", "$$\\x"])
    axes.legend()
    save(figure, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert not recwarn.list


@pytest.mark.parametrize("name", ["x[/b]", "--save=x", "=1+1", "\u202egpj", "a b|c", "`a`", "{{x}}"])
def test_a_file_of_a_strange_name_is_written_and_named_as_text(name, attack, lab):
    attack(lab, "check", "arm", f"--elastic={name}.xml").done(f"{name}.xml".split("/")[0], f"{name}.xml")


@pytest.mark.parametrize("name", ["a\x1bb", "a\nb", "a\x9bb", "a\u2028b"])
def test_control_characters_on_the_command_line_are_refused(name, attack, lab):
    attack(lab, "check", "arm", "--elastic", name).refused("expected no control characters")
    attack(lab, "check", name).refused("expected no control characters")


@pytest.mark.parametrize("name", ["[/nope]", "$\\frac", "A" * 100_000, "\u202ea", "..", "/"])
def test_what_is_no_arm_is_said_in_a_line(name, attack, lab):
    refused = attack(lab, "check", name)
    refused.refused("elastic.toml" if name in ("..", "/") else "expected the folder of an arm")
    assert len(refused.err) <= 2100


def test_keys_and_values_of_toml_in_an_error_steer_nothing(attack, lab):
    swap(r"\A", '"\\u001b]0;a\\u0007[/x]\\n" = "\\u001b[2J"\n')(lab / "arm" / "elastic.toml")
    attack(lab, "check", "arm").refused("elastic.toml", "[/x]")


def test_a_folder_whose_name_is_no_text_is_an_arm_like_others(attack, lab):
    folder = lab / os.fsdecode(b"\xff\xfe\x1barm")
    shutil.copytree(lab / "arm", folder)
    done = attack(folder, "check", ".", "--out", "../checked")
    done.done()
    assert "\N{REPLACEMENT CHARACTER}" in (lab / "checked" / "report.html").read_text()


def test_colours_alone_steer_a_terminal(lab):
    """Rich behaves otherwise where it writes to one."""
    rename(lab, NAMES["link of a terminal"], "\x1b]0;owned\x07\x9b2J")
    own, other = pty.openpty()
    code = "from testbench.cli import main; main()"
    args = [sys.executable, "-c", code, "check", "arm"]
    with subprocess.Popen(args, cwd=lab, stdout=other, stderr=other, stdin=other) as process:
        os.close(other)
        said = b"".join(iter(lambda: _read(own), b""))
    os.close(own)
    assert process.returncode == 0
    text = re.sub(r"\x1b\[[\d;]*m", "", said.decode()).replace("\r\n", "\n")
    assert NAMES["link of a terminal"] in text
    assert all(c.isprintable() or c == "\n" for c in text)


def _read(stream):
    try:
        return os.read(stream, 65536)
    except OSError:  # nobody writes any more
        return b""


def test_an_error_of_python_is_one_clean_line_too(tmp_path):
    with pytest.raises(BenchError) as info:
        raise InputError(tmp_path / "a\x1b]0;b\x07\n\udcff", "line 1", "\u202e" + "x" * 5000)
    assert str(info.value).isprintable()
    assert len(str(info.value)) <= 2000


def test_a_marker_reads_back_as_it_was_written(attack, lab):
    rename(lab, NAMES["tag"])
    asked = ("--poses", 3, "--payload-kg", 1, "--seed", 1)
    attack(lab, "simulate", "arm", *asked, "--out", "new.csv").done("new.csv")
    arm = build_cell(lab / "arm").arm
    assert set(read_csv(lab / "new.csv", arm).markers) <= set(arm.markers)


@pytest.mark.parametrize("name", ["a b", "x; rm -rf ~", "$(id)", "`id`", "it's", "--force", "-", "a\\b", "*"])
def test_a_path_in_a_command_line_that_is_proposed_is_one_word_and_no_flag(name):
    [found] = shlex.split(shell_word(Path(name)))
    assert Path(found) == Path(name)
    assert not found.startswith("-")
