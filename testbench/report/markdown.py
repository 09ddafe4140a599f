"""Text as Markdown: what is a stranger's is escaped; tables, lists and places in words."""

import re
from collections.abc import Sequence
from typing import Protocol

from testbench.errors import printable
from testbench.report.schema import Table, show

MAX_STATEMENTS = 5  #: Statements that are told at once; the others stand under "More".
LIVE = re.compile(
    r"""[`<|$~] | \] (?=[(\[:]|$)        # code, tags, cells, formulas; links and pictures
    | \\ (?=[!-/:-@\[-`{-~]|$)        # what takes the meaning of the next letter
    | & (?=[#\w]+;)                    # a letter by its name
    | (?<!\s) \* | \* (?!\s|$)         # stress
    | (?<![^\W_]) _ | _ (?![^\W_])
    | ^ (?: > | \#{1,6} (?=\s|$) | [-+] (?=\s) )""",
    re.VERBOSE,
)
"""What means something in the Markdown of a person's viewer, and nothing in a text."""
NUMBERED = re.compile(r"^(\d{1,9})([.)])(?=\s)")
ESCAPED = re.compile(r"\\([!-/:-@\[-`{-~])")


class Markdown(str):
    """Mark a text as Markdown: no template escapes it once more."""

    def __html__(self) -> str:
        """Itself, for jinja."""
        return self


def as_markdown(text: object) -> Markdown:
    """Escape a stranger's text, or anything that is no Markdown, so that it shows and does nothing else."""
    escaped = LIVE.sub(r"\\\g<0>", printable(str(text)))
    return Markdown(NUMBERED.sub(r"\1\\\2", escaped))


def as_plain(markdown: str) -> str:
    """Strip a line of Markdown of stress and links."""
    return ESCAPED.sub(r"\1", markdown)


def grid(table: Table) -> Markdown:
    """Write a table in Markdown: medians with their spread, the paper's numbers in square brackets."""
    rows = []
    for row in table.rows:
        texts = [as_markdown(column.cell(row)) for column in table.columns]
        known = [column.known(row) for column in table.columns]
        cells = [f"{a} [{b}]" if b else str(a) for a, b in zip(texts, known, strict=True)]
        rows.append([f"**{cells[0]}**" if table.marks(row) else cells[0], *cells[1:]])
    words = [all(isinstance(column.value(row), str) for row in table.rows) for column in table.columns]
    return lines([as_markdown(column.title) for column in table.columns], rows, words)


def lines(head: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[bool] = ()) -> Markdown:
    """Write cells of Markdown under headings; numbers stand on the right, the first column and `words` left.

    Args:
        head: Headings.
        rows: Cells.
        words: Whether a column has words; empty for none.

    Returns:
        The table.
    """
    left = words or [False] * len(head)
    rule = ["---" if k == 0 or left[k] else "---:" for k in range(len(head))]
    return Markdown("\n".join("| " + " | ".join(line) + " |" for line in [head, rule, *rows]))


class ReportWords(Protocol):
    """Define the words of a report, whatever makes them."""

    def block(self, name: str) -> Markdown:
        """Return a part, empty if none: badge, question, title, answer, worst, statements, more, body."""
        ...


def ended(sentence: str) -> str:
    """End a sentence with one mark, a full stop where it has none."""
    return sentence if sentence.endswith((".", "?", "!")) else f"{sentence}."


def capital(sentence: str) -> str:
    """Begin a sentence with a capital."""
    return sentence[:1].upper() + sentence[1:]


def titled(name: str) -> str:
    """Write a name of a study or picture, such as real_ur10, for people."""
    words = capital(name.removesuffix(".png").replace("_", " "))
    return words.replace("ur10", "UR10").replace("dof", "DOF")


def listed(names: list[str], word: str = "and") -> str:
    """List names as in a sentence: a, b and c, or with another word before the last.

    Args:
        names: The names.
        word: The word before the last.

    Returns:
        The words.
    """
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def place(metres: Sequence[float]) -> str:
    """Write a place in the world: x 1.20, y -0.35, z 2.10 m."""
    x, y, z = (show(float(value), ".2f") for value in metres)
    return f"x {x}, y {y}, z {z} m"


def counted(number: int, noun: str) -> str:
    """Write a number with its noun, such as 1 pose, 5,132 poses.

    Args:
        number: The number.
        noun: The noun in the singular.

    Returns:
        The words.
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
