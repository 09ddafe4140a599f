"""Count the words of README and docs, and the sentences that are too long to read once.

    python tools/words.py [--show]

Tables, code and lists of links do not count as sentences; their words count.
"""

import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from testbench.runs import command

ROOT = Path(__file__).resolve().parents[1]
LONGEST = 25  #: Words of a sentence that is read once.
MOST, SHARE = 30_000, 0.1  #: Words of all pages; share of sentences that may be longer.

app = typer.Typer(add_completion=False)


def sentences(text: str) -> list[str]:
    """The sentences of a page of Markdown."""
    text = re.sub(r"```.*?```|<!--.*?-->|^( {4}|\||#|:::|:\w).*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    blocks = re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.)\s", text)
    return [own for block in blocks for own in re.split(r"(?<=[.!?:])\s+", " ".join(block.split())) if own]


@app.command()
def main(show: Annotated[bool, typer.Option(help="Print the long sentences.")] = False) -> None:
    """Words and long sentences by page; exit code 1 beyond the bars."""
    pages = [
        ROOT / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "docs/studies").glob("*.md")),
    ]
    words = long = every = 0
    for page in pages:
        text = page.read_text(encoding="utf-8")
        own = sentences(text)
        beyond = [one for one in own if len(one.split()) > LONGEST]
        size = len(text.split())
        print(f"{size:6} words {len(beyond):4} of {len(own):4} sentences long  {page.relative_to(ROOT)}")
        if show:
            print(*(f"       {one}" for one in beyond), sep="\n")
        words, long, every = words + size, long + len(beyond), every + len(own)
    print(
        f"{words:6} words {long:4} of {every:4} sentences long  all; at most {MOST} and {100 * SHARE:.0f} %"
    )
    if words > MOST or long > SHARE * every:
        raise typer.Exit(1)


if __name__ == "__main__":
    sys.exit(command.run(app))
