"""A process that has all commands loaded and runs each command line in a fork of itself, within limits.

Reads a line of JSON a command line: {"args": ..., "folder": ..., "seconds": ...}; answers with one.
"""

import importlib
import json
import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path

import typer

from testbench.cli.predict import COMMANDS, program
from testbench.runs import command
from testbench.studies import find_study
from testbench.studies import run as studies

sys.path.append(str(Path(__file__).parents[1] / "scenarios"))
import trial_study

MEMORY = 3 * 2**30  #: Addresses that a command may take besides those that are loaded [byte].
PATIENCE = 60.0  #: Longest wait for a command that uses no processor, as one that waits for a pipe [s].


def load() -> None:
    """Import all commands, and what they import when they run."""
    for name in COMMANDS:
        importlib.import_module(f"testbench.cli.{name}")
    for name in ("testbench.workflows.cell", "testbench.report.recording.stream", "testbench.report.figure"):
        importlib.import_module(name)


def app_of(args: list[str]) -> tuple[typer.Typer, list[str]]:
    """A command, a study ("study", its name) or nothing but trials ("trials"), and the words for it."""
    if args[0] == "trials":
        return trial_study.app, args[1:]
    if args[0] == "study":
        return studies.app(find_study(args[1])), args[2:]
    return program(args), args


def held() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def run(args: list[str], folder: str, seconds: int, largest: int | None) -> dict[str, object]:
    """What a command line said and took."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if not child:
            _command(args, folder, (seconds, largest), (out.fileno(), err.fileno()))
        end = time.monotonic() + PATIENCE
        while True:
            pid, status, used = os.wait4(child, os.WNOHANG)
            if pid:
                break
            if time.monotonic() > end:
                os.killpg(child, signal.SIGKILL)
            time.sleep(0.002)
        texts = [_text(stream) for stream in (out, err)]
    return {
        "code": os.waitstatus_to_exitcode(status),
        "out": texts[0],
        "err": texts[1],
        "peak": used.ru_maxrss * 1024,
    }


def _text(stream: object) -> str:
    stream.seek(0)
    return stream.read().decode(errors="backslashreplace")


def _command(args: list[str], folder: str, limits: tuple[int, int | None], streams: tuple[int, int]) -> None:
    """In the fork; never returns."""
    os.setpgid(0, 0)
    os.chdir(folder)
    for own, stream in enumerate(streams, 1):
        os.dup2(stream, own)
    seconds, largest = limits
    if largest is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    resource.setrlimit(resource.RLIMIT_AS, (held() + MEMORY,) * 2)
    code = 70
    try:
        app, words = app_of(args)
        sys.argv = ["testbench", *words]
        code = command.run(app)
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def answer(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    load()
    answer("ready")
    for line in sys.stdin:
        answer(json.dumps(run(**json.loads(line))))
