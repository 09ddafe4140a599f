"""The languages by name and by suffix, and a program of any of them as a file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.arm.folder import Joint
from testbench.data.motion import krl, rapid, urscript
from testbench.errors import Array, BenchError
from testbench.output.whole import write_whole

CSV = "csv"
"""Not a language: the table that `testbench.data.program` reads and writes."""


@dataclass(frozen=True)
class Language:
    """A robots' language."""

    title: str  #: For people.
    suffix: str  #: Of its files.
    newline: str  #: Between its lines.
    begins: bytes  #: Regular expression of the beginning of a file of ours.
    lines: Callable[[str, Array, Sequence[Joint], Sequence[str]], Iterator[str]]


WRITERS: Mapping[str, Language] = {
    "krl": Language("KUKA KRL", ".src", "\r\n", rb"DEF \w+\(\)\r\n; A1 is ", krl.lines),
    "rapid": Language("ABB RAPID", ".mod", "\r\n", rb"MODULE \w+\r\n  ! rax_1 is ", rapid.lines),
    "urscript": Language("URScript", ".script", "\n", rb"def \w+\(\):\n  # joints \[rad\]: ", urscript.lines),
}


def format_of(path: Path, asked: str | None = None) -> str:
    """What a file is to be written as, "csv" or a key of `WRITERS`.

    Args:
        path: The file.
        asked: The same, in any case; None for what the suffix says.

    Raises:
        BenchError: When neither says it.
    """
    known = {CSV: ".csv", **{name: language.suffix for name, language in WRITERS.items()}}
    if asked is not None:
        if asked.lower() not in known:
            raise BenchError(f"format: expected {', '.join(known)}, got {asked!r}")
        return asked.lower()
    found = [name for name, suffix in known.items() if suffix == path.suffix.lower()]
    if not found:
        pairs = ", ".join(f"{suffix} ({name})" for name, suffix in known.items())
        raise BenchError(f"{path}: expected a file called {pairs}, or a format")
    return found[0]


def write_moves(
    path: Path, language: Language, q: Array, joints: Sequence[Joint], labels: Sequence[str] = ()
) -> None:
    """Write a program named after its file, whole or not at all.

    Args:
        path: The file.
        language: One of `WRITERS`.
        q: Joints of every point, (points, n) [rad, m], as the model counts them.
        joints: Whose they are.
        labels: A comment a point, or none.

    Raises:
        BenchError: When the language has no place for such joints, or the file cannot be written.
    """
    every = language.lines(path.stem, q, joints, labels)
    write_whole("".join(f"{line}{language.newline}" for line in every), path)
