"""Reports in words: one Markdown template a study serves terminal, report.md and recording.

A template extends `report.md.j2` and fills its blocks: `question`, `title`, `answer` and `worst` are one
line each, `statements` a list, `body` the rest of report.md. It sees what its study gives it.
What a sentence claims is computed before, so that a test can hold it against the numbers.
"""

import functools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PrefixLoader, StrictUndefined, Template

from testbench.errors import shown
from testbench.views.gains import less, more
from testbench.views.schema import Table, brackets, show, show_truth, written_out

TEMPLATES = Path(__file__).parent / "templates"
NAME = "report.md.j2"
MOST = 5  #: Statements that are told at once; the others stand under "More".
LINES = ("question", "title", "answer", "worst")  #: Blocks of one line.
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
    """Text that is Markdown: no template escapes it once more."""

    def __html__(self) -> str:
        """Itself, for jinja."""
        return self


def as_markdown(text: object) -> Markdown:
    """A stranger's text, or anything that is no Markdown, as Markdown that shows it and nothing else."""
    escaped = LIVE.sub(r"\\\g<0>", shown(str(text)))
    return Markdown(NUMBERED.sub(r"\1\\\2", escaped))


def as_plain(markdown: str) -> str:
    """A line of Markdown without stress or links as a text."""
    return ESCAPED.sub(r"\1", markdown)


def _kept(value: object) -> str:
    """What a template's expression becomes."""
    return value if isinstance(value, str) and hasattr(value, "__html__") else as_markdown(value)


def grid(table: Table) -> Markdown:
    """A table in Markdown: medians with their spread, the paper's numbers in square brackets."""
    rows = []
    for row in table.rows:
        texts = [as_markdown(column.cell(row)) for column in table.columns]
        known = [column.known(row) for column in table.columns]
        cells = [f"{a} [{b}]" if b else str(a) for a, b in zip(texts, known, strict=True)]
        marked = table.bold == table.columns[0].cell(row)
        rows.append([f"**{cells[0]}**" if marked else cells[0], *cells[1:]])
    words = [all(isinstance(column.value(row), str) for row in table.rows) for column in table.columns]
    return lines([as_markdown(column.title) for column in table.columns], rows, words)


def lines(head: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[bool] = ()) -> Markdown:
    """Cells of Markdown under headings; numbers stand on the right, the first column and `words` left."""
    left = words or [False] * len(head)
    rule = ["---" if k == 0 or left[k] else "---:" for k in range(len(head))]
    return Markdown("\n".join("| " + " | ".join(line) + " |" for line in [head, rule, *rows]))


class Told(Protocol):
    """The words of a report, whatever makes them."""

    def block(self, name: str) -> Markdown:
        """One part, such as question, title, answer, worst, statements, more, body."""
        ...

    def has(self, name: str) -> bool:
        """Whether there is such a part."""
        ...

    def worst_lines(self) -> list[str]:
        """Where it is worst, if that is said."""
        ...

    def rest(self) -> str:
        """What stands below the first sentences."""
        ...


class Words:
    """The words of one report; macros of the template serve all of its blocks.

    Args:
        folder: Where the study's template is.
        values: What the template sees by name: the report, its tables.
        name: Of the template.
    """

    def __init__(self, folder: Path, values: Mapping[str, object], name: str = NAME) -> None:
        self._template: Template = _environment(folder).get_template(f"own/{name}")
        module = vars(self._template.make_module(dict(values)))
        self._values = {**values, **{k: v for k, v in module.items() if not k.startswith("_")}}

    def block(self, name: str, **more: object) -> Markdown:
        """One block; of those in `LINES` a single line.

        Args:
            name: Of the block.
            more: What it sees beside the values of the report, such as one row.
        """
        context = self._template.new_context(self._values | more)
        text = written_out("".join(self._template.blocks[name](context)).strip())
        return Markdown(line(text) if name in LINES else text)

    def summary(self, *parts: Table | str, then: Sequence[str] = ("statements",)) -> str:
        """What a recording says first: question, answer in bold, the worst place, tables, what else there is.

        Args:
            parts: Tables, and words as they are.
            then: Names of the blocks at the end.
        """
        texts = [part if isinstance(part, str) else _titled(part) for part in parts]
        head = [f"### {self.block('question')}", f"#### **{self.block('answer')}**", *self.worst_lines()]
        return "\n\n".join([*head, *texts, *map(self.block, then)])

    def worst_lines(self) -> list[str]:
        """Where it is worst and by how much; nothing where that is not said."""
        return [*filter(None, [self.block("worst")])] if self.has("worst") else []

    def has(self, name: str) -> bool:
        """Whether the template fills a block."""
        return name in self._template.blocks

    def rest(self) -> str:
        """What of report.md stands below the statements."""
        if self.has("body"):
            more = self.block("more") if self.has("more") else ""
            return f"{self.block('body')}\n\n{'## More' if more else ''}\n\n{more}".strip()
        _, mark, below = self.whole().partition("\n## ")
        return mark.lstrip() + below

    def whole(self) -> str:
        """report.md."""
        lines = written_out(self._template.render(self._values)).strip().split("\n")
        kept = [b for a, b in zip(["", *lines], lines, strict=False) if a.strip() or b.strip()]
        return "\n".join(line.rstrip() for line in kept) + "\n"


def _titled(table: Table) -> str:
    """A table below its title, with what its brackets hold."""
    title = f"{table.title[:1].upper()}{table.title[1:]}:" if table.title else ""
    note = f"In brackets: {brackets(table)}." if brackets(table) else ""
    return "\n\n".join(filter(None, [as_markdown(title), grid(table), note]))


@functools.cache  # compiling a template takes longer than filling it
def _environment(folder: Path) -> Environment:
    own, shared = FileSystemLoader(folder), FileSystemLoader(TEMPLATES)
    found = Environment(
        loader=ChoiceLoader([PrefixLoader({"own": own}), shared]),
        undefined=StrictUndefined,
        autoescape=True,  # what macros and blocks make is told apart from what they are given
        finalize=_kept,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters |= {"show": show, "yes": show_truth, "grid": grid, "listed": listed, "place": place}
    found.filters |= {"less": less, "more": more, "counted": counted, "ended": ended, "line": line}
    found.filters |= {"told": told, "untold": untold}
    return found


def told(text: str) -> Markdown:
    """The first statements of a list."""
    return Markdown("\n".join(_bullets(text)[:MOST]))


def untold(text: str) -> Markdown:
    """The others."""
    return Markdown("\n".join(_bullets(text)[MOST:]))


def _bullets(text: str) -> list[str]:
    return [row for row in text.splitlines() if row.startswith("- ")]


def line(text: str) -> str:
    """Words on one line."""
    return " ".join(text.split())


def ended(sentence: str) -> str:
    """A sentence with one mark at its end, a full stop where it has none."""
    return sentence if sentence.endswith((".", "?", "!")) else f"{sentence}."


def capital(sentence: str) -> str:
    """A sentence that begins with a capital."""
    return sentence[:1].upper() + sentence[1:]


def listed(names: list[str], word: str = "and") -> str:
    """Names as in a sentence: a, b and c, or with another word before the last."""
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def place(metres: Sequence[float]) -> str:
    """Where in the world: x 1.20, y -0.35, z 2.10 m."""
    x, y, z = (show(float(value), ".2f") for value in metres)
    return f"x {x}, y {y}, z {z} m"


def counted(number: int, noun: str) -> str:
    """Such as 1 pose, 5,132 poses."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
