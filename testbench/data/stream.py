"""Files of any number of rows, read block by block: each as a file of its own under the same header.

What a header means, and what a block of lines says, `read_table` and the readers of pairs and of absolute
readings find, as of any file. Where all rows of a block are plain their columns are read at once. A file can
be read so where the rows of a run, or of a pose, stand together and every reading says all of its own.
"""

import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from testbench.arm.decimal import is_decimal, is_integer
from testbench.arm.folder import Arm
from testbench.data.columns import Columns, find_columns, read_columns
from testbench.data.dataset import Dataset, arrays, with_arrays
from testbench.data.header import cells_in
from testbench.data.lines import MAX_BYTES, Line, letters
from testbench.data.mapping import Names
from testbench.data.names import Slot, What
from testbench.data.spool import Held
from testbench.data.table import ID_CELL, NUMBER_CELL, WORD_CELL, read_numbers, release, table_of
from testbench.errors import InputError, open_file

LEAST, MOST = 16_000_000, 20_000_000_000
"""Sizes of files that are read so [byte]: smaller ones are held whole, as the rows of any other file."""
BLOCK = 4_000_000  #: What is read at a time [byte].
HEAD = 1_000_000  #: Bytes by which the columns are understood.
LONGEST = 4_000_000  #: Bytes of a run or pose, with blank lines below it.
BY_MARKER = ("before", "after", "position", "precision")  #: Arrays with a reading a marker.
BLANK = b" ;,|\t\r\n"
FORM = "expected integers for run and pose, both readings in every row, the rows of a run together, UTF-8"

Read = TypeVar("Read")


class Whole(Exception):
    """This file has to be read as a whole."""


@dataclass
class Source(Generic[Read]):
    """A file; block by block each is read under what the first one says of its columns."""

    path: Path
    arm: Arm
    names: Names
    #: Indices of the columns that rows share which belong together; none where the whole is needed.
    key: Callable[[Columns], list[int]]
    ids: tuple[What, ...]  #: Quantities whose cells are integers here.
    compute: Callable[[Columns], Read]  #: What the columns of a block, or of a file, say.

    def blocks(self) -> Iterator[Read]:
        """What every block says.

        Raises:
            InputError: Names line and column, and what was expected.
            Whole: When the file cannot be read so.
        """
        with open_file(self.path, MOST) as file:
            head = file.read(HEAD)
            letters(self.path, head, self.names.map.file.encoding or "latin-1")
            self._understand(head[: head.rfind(b"\n") + 1])
            file.seek(len(self.above))
            content, number, more = b"", self.start, True
            while more:
                found = file.read(BLOCK)
                content, more = content + found, bool(found)
                end = self._whole_keys(content) if more else len(content)
                block, content = content[:end], content[end:]
                if b"\0" in content:
                    self._read(content, number)  # says where
                if len(content) > BLOCK + LONGEST:
                    raise Whole
                if block.strip(BLANK):
                    yield self._read(block, number)
                number += block.count(b"\n")

    def _understand(self, content: bytes) -> None:
        """The header and the columns, by the first block."""
        own = self.names.map.file
        whole = own.footer or own.merged or own.average or self.names.map.log
        if whole or self.names.cells or self.names.ignored or not content:
            raise Whole
        text, self.encoding = letters(self.path, content, own.encoding)
        if self.encoding not in ("utf-8", "cp1252") or _broken(content):
            raise Whole
        table = table_of(self.path, (text, self.encoding), self.names.knows, own)
        if not table.rows:
            raise Whole
        self.columns = columns = find_columns(table, self.names, self.arm)
        self.shared = self.key(columns)
        if columns.table.names != table.names or not self.shared:
            raise Whole
        self.integers = [c.index for c in columns.every(*self.ids)]
        if not all(is_integer(text) for k in self.integers for text in columns.table.texts(k)):
            raise Whole
        self.markers = self._markers(columns)
        self.start = int(table.lines[0]) - 1
        settled: dict[str, object] = {"delimiter": table.delimiter, "decimal": columns.mark}
        if own.header == 1 and not own.names:
            settled["skip"] = table.header - 1
        self.layout = own.model_copy(update=settled)
        self.above = b"".join(content.splitlines(keepends=True)[: self.start])
        self.kinds = {c.index: NUMBER_CELL if c.unit else WORD_CELL for c in columns.found.values()}
        self.kinds |= dict.fromkeys(self.integers, ID_CELL)
        self.plain = not (self.names.lost or self.names.loads)

    def _whole_keys(self, content: bytes) -> int:
        """Where the last run or pose begins of which more may follow; the end where all lines are blank."""
        end = len(content.rstrip(BLANK))
        if not end:
            return content.rfind(b"\n") + 1
        last, end = list[str](), content.rfind(b"\n", 0, end) + 1  # the last line may not be whole
        while end:
            begin = content.rfind(b"\n", 0, end - 1) + 1
            line = content[begin:end].decode(self.encoding, "replace").rstrip("\r\n")
            cells = cells_in(Line(0, line), self.columns.table.delimiter)
            own = [cells[k] for k in self.shared if k < len(cells)]
            if len(own) == len(self.shared) and all(is_decimal(cell.replace(",", ".")) for cell in own):
                if last and own != last:  # no comment, no header again
                    return end
                last = own
            end = begin
        return 0

    def _read(self, block: bytes, number: int) -> Read:
        """What a block behind so many lines says."""
        if _broken(block):
            raise Whole
        table = replace(self.columns.table, decimal=self.columns.mark)
        plain = block.replace(b"\r\n", b"\n") if b"\r" in block else block
        if self.plain and (fast := read_numbers(table, plain, number, self.kinds)) is not None:
            try:
                return self.compute(replace(self.columns, table=fast))
            except InputError:  # said by the cells as they stand there
                pass
        padded = self.above + b"\n" * (number - self.start) + block
        try:
            text = letters(self.path, padded, self.encoding)
        except InputError:
            if self.encoding == "utf-8" and self.names.map.file.encoding is None and b"\0" not in block:
                raise Whole from None
            raise
        found = table_of(self.path, text, self.names.knows, self.layout)
        slow = find_columns(found, self.names, self.arm)
        for k in self.integers:
            slow.table.integers(k)
        try:
            return self.compute(slow)
        except InputError:
            if self._markers(slow) - self.markers:  # sorted by marker
                raise Whole from None
            raise

    def _markers(self, columns: Columns) -> set[str]:
        """The markers that have rows."""
        column, known = columns.get(Slot("marker")), self.arm.markers
        texts = [] if column is None else columns.table.texts(column.index)
        return {self.names.word(text, known) for text in dict.fromkeys(texts)} - {""}


def read_source(source: Source[Read], gather: Callable[[Iterator[Read]], Read]) -> Read:
    """What a file says: gathered from the blocks of a large one, else read as a whole.

    Args:
        source: The file.
        gather: Makes one of what the blocks say; may raise `Whole`.

    Raises:
        InputError: Names line and column, and what was expected.
    """
    try:
        status = source.path.stat()
        large = stat.S_ISREG(status.st_mode) and LEAST <= status.st_size <= MOST
    except OSError:
        large = False
    if large:
        try:
            found = gather(source.blocks())
            release()
            return found
        except Whole as err:
            if status.st_size > MAX_BYTES:
                raise InputError(source.path, "", f"more than {MAX_BYTES} bytes: {FORM}") from err
        except InputError:  # what is wrong in a block may be sound in the whole, as rows sorted by marker
            if status.st_size > MAX_BYTES:
                raise
    return source.compute(read_columns(source.path, source.names, source.arm))


def alike(path: Path, first: Held, block: Held) -> Held:
    """A block with the markers in the order of the first one.

    Raises:
        InputError: Where the two scatter differently.
        Whole: Where one has what the other lacks: targets, orientations, torques, temperature, time.
    """
    if block.sigma != first.sigma or block.sigma_rotation != first.sigma_rotation:
        place = f"run {(block.run if isinstance(block, Dataset) else block.row)[0]}"
        raise InputError(path, place, "expected one value of sigma in the whole file")
    have = [arrays(own).keys() - {"precision"} for own in (first, block)]
    if set(block.markers) != set(first.markers) or have[0] != have[1]:
        raise Whole
    order: list[int] = [block.markers.index(name) for name in first.markers]
    if order == [*range(len(order))]:
        return block
    ordered = {name: own[:, order] for name, own in arrays(block).items() if name in BY_MARKER}
    return replace(with_arrays(block, ordered), markers=first.markers)


def _broken(content: bytes) -> bool:
    """Whether lines end otherwise than by a line feed, or quotes are open at the end."""
    return content.count(b"\r") != content.count(b"\r\n") or content.count(b'"') % 2 == 1
