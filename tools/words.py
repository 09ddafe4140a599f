"""Count the words of README and docs, and the sentences of more than 25 words.

    python tools/words.py [--show]

Tables, code, equations and lists of links do not count as sentences; their words count.
"""

import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from testbench.runs import command

ROOT = Path(__file__).resolve().parents[1]
LONGEST = 25  #: Words of a sentence that is read once.
SHARE = 0.05  #: Of sentences, in all pages together, that may be longer.

app = typer.Typer(add_completion=False)


def sentences(text: str) -> list[str]:
    """The sentences of a page of Markdown."""
    text = re.sub(
        r"```.*?```|\$\$.*?\$\$|<!--.*?-->|^( {4}|\||#|:::|:\w).*?$", "", text, flags=re.DOTALL | re.MULTILINE
    )
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    blocks = re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.)\s", text)
    return [own for block in blocks for own in re.split(r"(?<=[.!?:])\s+", " ".join(block.split())) if own]


def pages() -> list[Path]:
    """README, the contributing guide and every page of the site."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def long_sentences(page: Path) -> tuple[list[str], int]:
    """Find the sentences of a page that have too many words.

    Args:
        page: Markdown.

    Returns:
        These sentences, and the number of all.
    """
    own = sentences(page.read_text(encoding="utf-8"))
    return [one for one in own if len(one.split()) > LONGEST], len(own)


@app.command()
def main(show: Annotated[bool, typer.Option(help="Print the long sentences.")] = False) -> None:
    """Words and long sentences by page; exit code 1 beyond the bar."""
    words = long = every = 0
    for page in pages():
        beyond, count = long_sentences(page)
        size = len(page.read_text(encoding="utf-8").split())
        print(f"{size:6} words {len(beyond):4} of {count:4} sentences long  {page.relative_to(ROOT)}")
        if show:
            print(*(f"       {one}" for one in beyond), sep="\n")
        words = words + size
        long = long + len(beyond)
        every = every + count
    print(f"{words:6} words {long:4} of {every:4} sentences long  all; at most {100 * SHARE:.0f} %")
    if long > SHARE * every:
        raise typer.Exit(1)


if __name__ == "__main__":
    sys.exit(command.run(app))
