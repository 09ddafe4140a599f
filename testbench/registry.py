"""Tables of extensions by name: built-in ones, those of installed packages, and those that a script adds."""

import re
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from testbench.errors import BenchError

T = TypeVar("T")
PART_NAME = re.compile(r"[a-z]\w{0,39}", re.ASCII)  #: Form of a name: it must fit labels, flags and columns.


class UnknownPart(BenchError, KeyError):
    """Signal a name that a table lacks; the message lists the names that it has."""

    def __str__(self) -> str:
        """Return the message, without the quotes of a KeyError."""
        return str(self.args[0])


class Registry(MutableMapping[str, T]):
    """Map names to parts such as joint laws: built-in ones, then those of installed packages and of scripts.

    A package names its parts as entry points of `group`. They are imported when the table is first used, in
    every process: commands, studies and their workers know them without a flag.

    Args:
        kind: Word for a part in messages, such as "joint law".
        group: Group of the entry points.
        built_in: Built-in parts by name.
        check: Function of a name and its part, which raises BenchError for a wrong part.
    """

    def __init__(
        self, kind: str, group: str, built_in: Mapping[str, T], check: Callable[[str, T], None]
    ) -> None:
        self.kind = kind
        self.group = group
        self.built_in = dict(built_in)
        self._check = check
        self._parts: dict[str, T] = {}
        self._entries: dict[str, metadata.EntryPoint] | None = None

    @property
    def added(self) -> Mapping[str, T]:
        """Return the parts that are not built in."""
        if self._entries is None:
            self._entries = {}  # a module that is loaded may look into the table
            entries = {entry.name: entry for entry in metadata.entry_points(group=self.group)}
            try:
                self._parts.update({name: self._loaded(entries[name]) for name in sorted(entries)})
            except BenchError:
                self._entries = None
                raise
            self._entries = entries
        return self._parts

    def _loaded(self, entry: metadata.EntryPoint) -> T:
        try:
            part: T = entry.load()
        except Exception as err:  # any error of a package that is not ours
            raise BenchError(f"entry point {entry.name} = {entry.value!r} of {self.group}: {err}") from err
        self._refuse(entry.name, part)
        return part

    def origins(self) -> dict[str, Path | None]:
        """Find the source files of the parts that are not built in; None for a part that a script added."""
        entries = self._entries or {}
        files = {name: find_spec(entry.module) for name, entry in entries.items()}
        origins = {name: spec.origin for name, spec in files.items() if spec is not None}
        return {name: Path(file) if (file := origins.get(name)) else None for name in self.added}

    def __getitem__(self, name: str) -> T:
        if name in self.built_in:
            return self.built_in[name]
        if name not in self.added:
            raise UnknownPart(f"no {self.kind} {name!r}; {self.kind}s are {', '.join(self)}")
        return self.added[name]

    def __setitem__(self, name: str, part: T) -> None:
        self._refuse(name, part)
        self._parts[name] = part

    def _refuse(self, name: str, part: T) -> None:
        """Refuse a name or a part that cannot work."""
        if not PART_NAME.fullmatch(name):
            raise BenchError(
                f"{self.kind} {name!r}: expected a name of a-z, 0-9 and _, at most 40 characters"
            )
        if name in self.built_in:
            raise BenchError(f"{self.kind} {name!r}: the name is taken; choose another")
        self._check(name, part)

    def __delitem__(self, name: str) -> None:
        del self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter([*self.built_in, *self.added])

    def __len__(self) -> int:
        return len(self.built_in) + len(self.added)
