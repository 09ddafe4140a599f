"""Run the cells of a tutorial as the documentation does: python run_cells.py PAGE, in an empty folder.

Prints each cell's output. Ends with the first cell that fails.
"""

import re
import sys
from pathlib import Path

HEAD = r"(?:---\n.*?^---\n|(?::[^\n]*\n)*)"  #: Of a cell: its metadata, as a block or as lines.
CELL = re.compile(rf"^```\{{code-cell\}} ipython3\n{HEAD}\n?(.*?)^```$", re.MULTILINE | re.DOTALL)


def cells(page: Path) -> list[str]:
    """Give the code of every cell of a page."""
    return CELL.findall(page.read_text(encoding="utf-8"))


if __name__ == "__main__":
    from IPython.core.interactiveshell import InteractiveShell

    sys.path.insert(0, "")  # the folder where it runs, as in a notebook
    shell = InteractiveShell.instance(colors="nocolor")
    for code in cells(Path(sys.argv[1])):
        shell.run_cell(code).raise_error()
