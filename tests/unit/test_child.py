"""Programs that end with the one that started them."""

import os
import subprocess
import sys

import pytest

from testbench.child import child

PARENT = """
import os, signal, sys
from testbench.child import child
with child(["sh", "-c", "sleep 900 & echo begun; exec sleep 900"], os.environ):
    sys.stdin.readline()
    os.kill(os.getpid(), signal.{})
"""


@pytest.mark.parametrize("way", ["SIGKILL", "SIGTERM", "SIGSEGV"])
def test_a_child_and_what_it_started_end_with_a_parent_that_is_killed(way):
    """All of them hold the pipe: it ends when the last one has ended."""
    parent = [sys.executable, "-c", PARENT.format(way)]
    with subprocess.Popen(parent, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"begun\n"
        out, _ = process.communicate(b"\n", timeout=60)
    assert out == b""
    assert process.returncode < 0


def test_a_child_ends_with_its_block_and_its_code_is_known():
    with child(["sh", "-c", "exit 7"], os.environ) as process:
        assert process.wait() == 7
    with child(["sleep", "900"], os.environ) as process:
        pass
    assert process.returncode == -9
