"""How far a command is, said at one place: bars on a terminal, silence, run.log."""

import io
import sys
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from unittest import mock

import pytest

from testbench.progress import stepwise, tell
from testbench.runs.follow import followed
from testbench.runs.interrupt import EMPTY_SESSION, SESSION

HIDDEN, SHOWN = "\x1b[?25l", "\x1b[?25h"  #: The cursor, while bars are there and behind them.


class Terminal(io.StringIO):
    def isatty(self):
        return True


@contextmanager
def command(errors, *, quiet=False):
    """A command that writes to a terminal, or not, and what it said on standard output."""
    out = io.StringIO()
    environment = mock.patch.dict("os.environ", {"TERM": "xterm"})
    with environment, redirect_stderr(errors), redirect_stdout(out), followed(EMPTY_SESSION, quiet=quiet):
        yield out


def test_bars_stand_while_steps_are_under_way_and_no_longer():
    terminal = Terminal()
    with command(terminal) as out:
        for _ in stepwise(range(3), "fitting models"):
            list(stepwise("ab", "trying"))
            assert SHOWN not in terminal.getvalue()
        assert SHOWN in terminal.getvalue()  # words that come now meet no bar
        sys.stdout.write("the answer\n")
    said = terminal.getvalue()
    assert said.count(HIDDEN) == said.count(SHOWN) == 1
    assert "fitting models" in said
    assert "-:--:--" in said  # the time left
    assert out.getvalue() == "the answer\n"


def test_ctrl_c_leaves_no_bar():
    terminal = Terminal()
    with pytest.raises(KeyboardInterrupt), command(terminal):  # noqa: PT012
        for _ in stepwise(range(3), "fitting models"):
            raise KeyboardInterrupt
    assert terminal.getvalue().count(HIDDEN) == terminal.getvalue().count(SHOWN) == 1


def test_quiet_says_nothing_and_no_terminal_has_no_bars():
    terminal, pipe = Terminal(), io.StringIO()
    for errors, quiet in ((terminal, True), (pipe, False)):
        with command(errors, quiet=quiet) as out:
            list(stepwise(range(3), "fitting models"))
            sys.stdout.write("the answer\n")
        assert (errors.getvalue(), out.getvalue()) == ("", "" if quiet else "the answer\n")


def test_the_log_has_every_kind_of_steps_once_it_ended_even_early(monkeypatch):
    now = iter([0.5 * k for k in range(100)])
    monkeypatch.setattr("testbench.runs.follow.time.monotonic", lambda: next(now))
    monkeypatch.setattr(sys, "argv", ["/usr/bin/testbench", "plan", "a\x1b[2Jb"])
    with command(io.StringIO()):
        for k in stepwise(range(5), "refining"):
            if k == 2:
                break
        tell("never ends", 1, 2)
        first, *rest = SESSION.get().log().splitlines()
    assert first.endswith(" UTC  testbench plan a\N{REPLACEMENT CHARACTER}[2Jb")
    assert [line.split(" s  ")[1] for line in rest] == ["refining: 1.50 s", "writing files"]
    assert EMPTY_SESSION.log() == ""
    assert SESSION.get() is EMPTY_SESSION
