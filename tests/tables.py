"""Tables as files for tests."""

from collections.abc import Iterable, Sequence
from pathlib import Path


def write_table(path: Path, header: str | Sequence[str], rows: Iterable[Iterable[object]]) -> Path:
    """A CSV file of a header and rows of words or numbers; its path."""
    first = header if isinstance(header, str) else ",".join(header)
    lines = [",".join(x if isinstance(x, str) else repr(float(x)) for x in row) for row in rows]
    path.write_text("\n".join([first, *lines]) + "\n", encoding="utf-8")
    return path
