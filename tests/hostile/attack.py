"""Hostile inputs: one clear line, exit code 2, nothing changed, little time and memory."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fuzz import state

ROOT = Path(__file__).resolve().parents[2]
PEAK = 2 * 10**9  #: Most memory that a refusal may take [byte].
SECONDS = 10  #: Most processor time; the command is ended beyond it [s].


@dataclass(frozen=True)
class Outcome:
    """What became of a command line."""

    args: tuple[str, ...]
    code: int
    out: str
    err: str
    peak: int  #: Memory [byte].
    changed: tuple[str, ...]  #: Paths in the folder that are new, gone or other than before.

    def refused(self, *said: str) -> None:
        """It ended with one clear line that has these words, and changed nothing."""
        assert self.code == 2, self
        self._plain()
        assert self.err.count("\n") == 1, self
        assert self.err.startswith("error: "), self
        assert all(word in self.err for word in said), (said, self.err)
        assert self.changed == (), self

    def done(self, *made: str) -> None:
        """It ended well, said nothing that steers a terminal, and changed these paths alone."""
        assert self.code == 0, self
        self._plain()
        others = [path for path in self.changed if not any(f"{path}/".startswith(f"{own}/") for own in made)]
        assert others == [], self

    def _plain(self) -> None:
        said = self.out + self.err
        assert all(c.isprintable() or c == "\n" for c in said), self
        assert "Traceback" not in said, self
        assert self.peak < PEAK, self


Attack = Callable[..., Outcome]


@contextlib.contextmanager
def warm() -> Iterator[Attack]:
    """A process that has all commands loaded; gives the function that runs one in a folder.

    Its arguments: the folder, then the words of the command line; and the largest file that the disk takes.
    """
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("warm.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **one, "PYTHONPATH": paths},
    )

    def attack(folder: Path, *args: object, largest: int | None = None) -> Outcome:
        words = [str(word) for word in args]
        before = state(folder)
        asked = {"args": words, "folder": str(folder), "seconds": SECONDS, "largest": largest}
        process.stdin.write(json.dumps(asked) + "\n")
        process.stdin.flush()
        found = json.loads(process.stdout.readline())
        after = state(folder)
        changed = {path for path in before.keys() | after.keys() if before.get(path) != after.get(path)}
        return Outcome(args=tuple(words), changed=tuple(sorted(changed)), **found)

    with process:
        assert process.stdout.readline() == "ready\n"
        yield attack
        process.stdin.close()
