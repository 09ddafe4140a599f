"""Ways to spoil a file."""

import os
import re
from collections.abc import Callable
from pathlib import Path

Spoil = Callable[[Path], object]


def holds(data: str | bytes) -> Spoil:
    return lambda file: file.write_bytes(data if isinstance(data, bytes) else data.encode())


def instead(make: Spoil) -> Spoil:
    """Something else at its place."""
    return lambda file: (file.unlink(missing_ok=True), make(file))


def link(to: str) -> Spoil:
    return instead(lambda file: file.symlink_to(to))


def sparse(size: int) -> Spoil:
    """So long without taking room on the disk."""
    return lambda file: (file.touch(), os.truncate(file, size))


def swap(pattern: str, new: str) -> Spoil:
    """Other words at the first place of a pattern."""

    def spoil(file: Path) -> None:
        text = file.read_text()
        changed = re.sub(pattern, lambda _: new, text, count=1)
        assert changed != text, pattern
        file.write_text(changed)

    return spoil
