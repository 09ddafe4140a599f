"""Files of any number of runs, read block by block: each as a file of its own under the same header.

What a header means, and what a block of lines says, `read_table` and `runs_of` find, as of any file. Where
all rows of a block are plain their columns are read at once. A file can be read so where every row says its
run and pose and has both readings, and the rows of a run stand together.
"""

import stat
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.decimal import is_integer
from testbench.arm.folder import Arm
from testbench.data.columns import Columns, find_columns
from testbench.data.dataset import Dataset, Ids
from testbench.data.header import cells_in
from testbench.data.lines import MAX_BYTES, Line, letters
from testbench.data.mapping import Names, read_map
from testbench.data.names import Slot, What
from testbench.data.read_pairs import Export, read_export, runs_of
from testbench.data.spool import Campaign, Spool
from testbench.data.table import Kinds, read_numbers, release, table_of
from testbench.errors import Array, InputError, open_file

LEAST, MOST = 16_000_000, 20_000_000_000
"""Sizes of files that are read so [byte]: smaller ones are held whole, as the rows of any other file."""
BLOCK = 4_000_000  #: What is read at a time [byte].
SHOWN = 600  #: Runs that are looked at one by one, evenly out of all.
IDS: tuple[What, ...] = ("run", "pose", "station")  #: Quantities whose cells are integers here.
HEAD = 1_000_000  #: Bytes by which the columns are understood.
LONGEST_RUN = 4_000_000  #: Bytes of a run, with blank lines below it.
BLANK = b" ;,|\t\r\n"
FORM = "expected integers for run and pose, both readings in every row, the rows of a run together, UTF-8"


class _Whole(Exception):
    """This file has to be read as a whole."""


@dataclass(frozen=True)
class Streamed:
    """A file of runs."""

    export: Export  #: Some of them, evenly, or all.
    every: Campaign | None  #: All, where they are too many to be held.


def read_campaign(
    path: Path, arm: Arm, mapping: Path | None = None, sigma: float | None = None, least: int = LEAST
) -> Streamed:
    """Read the runs of an arm as `read_export` does, in blocks where the file is large.

    Args:
        path: The file.
        arm: The arm that was measured.
        mapping: A map of its names.
        sigma: Standard deviation of a reading along an axis [m], where neither file nor map has one.
        least: Size from which it is read in blocks [byte].

    Raises:
        InputError: Names line and column, and what was expected.
    """
    try:
        status = path.stat()
        large = stat.S_ISREG(status.st_mode) and least <= status.st_size <= MOST
    except OSError:
        large = False
    if large:
        try:
            return _streamed(path, _Reader(path, arm, read_map(mapping, arm), sigma))
        except _Whole as err:
            if status.st_size > MAX_BYTES:
                raise InputError(path, "", f"more than {MAX_BYTES} bytes: {FORM}") from err
        except InputError:  # what is wrong in a block may be sound in the whole, as rows sorted by marker
            if status.st_size > MAX_BYTES:
                raise
    return Streamed(read_export(path, arm, mapping, sigma), None)


def _streamed(path: Path, reader: "_Reader") -> Streamed:
    spool, first = Spool(), None
    run, pose, level = list[Ids](), list[Ids](), list[Array]()
    for export in reader.exports():
        first = first or export
        data = _alike(path, first.data, export.data)
        run.append(data.run)
        pose.append(data.pose)
        level.append(np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=2))
        spool.add(data)
    release()
    assert first is not None
    every = Campaign(spool, np.concatenate(run), np.concatenate(pose), np.concatenate(level))
    ordered = np.sort(every.run)
    if (ordered[1:] == ordered[:-1]).any():  # rows of a run do not stand together
        raise _Whole
    return Streamed(replace(first, data=every.pick(some(np.arange(every.runs)))), every)


def some(runs: Ids) -> Ids:
    """So many of the runs that can be looked at one by one, evenly, the first and the last among them."""
    return np.asarray(runs[np.linspace(0, len(runs) - 1, min(SHOWN, len(runs))).round().astype(int)])


def _alike(path: Path, first: Dataset, data: Dataset) -> Dataset:
    """A block with the markers in the order of the first one."""
    if data.sigma != first.sigma or data.sigma_rotation != first.sigma_rotation:
        raise InputError(path, f"run {data.run[0]}", "expected one value of sigma in the whole file")
    if set(data.markers) != set(first.markers):
        raise _Whole
    order = [data.markers.index(name) for name in first.markers]
    if order == [*range(len(order))]:
        return data
    precision = None if data.precision is None else data.precision[:, order]
    before, after = data.before[:, order], data.after[:, order]
    return replace(data, markers=first.markers, before=before, after=after, precision=precision)


class _Reader:
    """Reads a file block by block, each under what the first one says of its columns."""

    def __init__(self, path: Path, arm: Arm, names: Names, sigma: float | None) -> None:
        self.path, self.arm, self.names, self.sigma = path, arm, names, sigma

    def exports(self) -> Iterator[Export]:
        """The runs of every block.

        Raises:
            InputError: Names line and column, and what was expected.
            _Whole: When the file cannot be read so.
        """
        with open_file(self.path, MOST) as file:
            head = file.read(HEAD)
            letters(self.path, head, self.names.layout.encoding or "latin-1")
            self._understand(head[: head.rfind(b"\n") + 1])
            file.seek(len(self.above))
            content, number, more = b"", self.start, True
            while more:
                found = file.read(BLOCK)
                content, more = content + found, bool(found)
                end = self._whole_runs(content) if more else len(content)
                block, content = content[:end], content[end:]
                if b"\0" in content:
                    self._export(content, number)  # says where
                if len(content) > BLOCK + LONGEST_RUN:
                    raise _Whole
                if block.strip(BLANK):
                    yield self._export(block, number)
                number += block.count(b"\n")

    def _understand(self, content: bytes) -> None:
        """The header and the columns, by the first block."""
        own = self.names.layout
        if own.footer or own.merged or self.names.cells or self.names.ignored or not content:
            raise _Whole
        text, self.encoding = letters(self.path, content, own.encoding)
        if self.encoding not in ("utf-8", "cp1252") or _broken(content):
            raise _Whole
        table = table_of(self.path, (text, self.encoding), self._known, own)
        if not table.rows:
            raise _Whole
        self.columns = columns = find_columns(table, self.names, self.arm)
        ids = [columns.get(Slot(what)) for what in IDS]
        single = all(c.slot.when for c in columns.every("reading"))
        if columns.table.names != table.names or not (ids[0] and ids[1] and single):
            raise _Whole
        self.ids = [c.index for c in ids if c]
        if not all(is_integer(text) for k in self.ids for text in columns.table.texts(k)):
            raise _Whole
        self.markers = self._markers(columns)
        self.start = int(table.lines[0]) - 1
        settled: dict[str, object] = {"delimiter": table.delimiter, "decimal": columns.mark}
        if own.header == 1 and not own.names:
            settled["skip"] = table.header - 1
        self.layout = own.model_copy(update=settled)
        self.above = b"".join(content.splitlines(keepends=True)[: self.start])
        plain = [c for c in columns.found.values() if c.index not in self.ids]
        words = [c.index for c in plain if c.slot.what == "marker"]
        self.kinds = Kinds([c.index for c in plain if c.unit], self.ids, words)
        self.plain = len(self.kinds.numbers) + len(words) == len(plain)
        self.plain &= not (self.names.lost or self.names.loads)

    def _known(self, name: str) -> bool:
        return self.names.find(name) is not None

    def _whole_runs(self, content: bytes) -> int:
        """Where the last run begins of which more may follow; the end of the lines where all are blank."""
        end = len(content.rstrip(BLANK))
        if not end:
            return content.rfind(b"\n") + 1
        last, end = "", content.rfind(b"\n", 0, end) + 1  # the last line may not be whole
        while end:
            begin = content.rfind(b"\n", 0, end - 1) + 1
            line = content[begin:end].decode(self.encoding, "replace").rstrip("\r\n")
            cells = cells_in(Line(0, line), self.columns.table.delimiter)
            own = cells[self.ids[0]] if len(cells) > self.ids[0] else ""
            if is_integer(own):  # no comment, no header again
                if last and own != last:
                    return end
                last = own
            end = begin
        return 0

    def _export(self, block: bytes, number: int) -> Export:
        """The runs of a block behind so many lines."""
        if _broken(block):
            raise _Whole
        table = replace(self.columns.table, decimal=self.columns.mark)
        plain = block.replace(b"\r\n", b"\n") if b"\r" in block else block
        if self.plain and (fast := read_numbers(table, plain, number, self.kinds)) is not None:
            try:
                return runs_of(replace(self.columns, table=fast), self.arm, self.sigma)
            except InputError:  # said by the cells as they stand there
                pass
        padded = self.above + b"\n" * (number - self.start) + block
        try:
            text = letters(self.path, padded, self.encoding)
        except InputError:
            if self.encoding == "utf-8" and self.names.layout.encoding is None and b"\0" not in block:
                raise _Whole from None
            raise
        slow = find_columns(table_of(self.path, text, self._known, self.layout), self.names, self.arm)
        for k in self.ids:
            slow.table.integers(k)
        try:
            return runs_of(slow, self.arm, self.sigma)
        except InputError:
            if self._markers(slow) - self.markers:  # sorted by marker
                raise _Whole from None
            raise

    def _markers(self, columns: Columns) -> set[str]:
        """The markers that have rows."""
        column, known = columns.get(Slot("marker")), self.arm.markers
        texts = [] if column is None else columns.table.texts(column.index)
        return {self.names.word(text, known) for text in dict.fromkeys(texts)} - {""}


def _broken(content: bytes) -> bool:
    """Whether lines end otherwise than by a line feed, or quotes are open at the end."""
    return content.count(b"\r") != content.count(b"\r\n") or content.count(b'"') % 2 == 1
