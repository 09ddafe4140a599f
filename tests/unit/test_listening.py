"""Where a process listens: told however its descriptors come and go."""

import os
import socket
import sys
from pathlib import Path

import pytest
from listening import listening


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_descriptor_that_closes_while_it_is_looked_at_is_none_that_listens(monkeypatch):
    listed = Path.iterdir

    def iterdir(folder):
        """All that is there, of which one is closed before the first is looked at."""
        own = os.open(os.devnull, os.O_RDONLY)
        found = list(listed(folder))
        os.close(own)
        assert folder / str(own) in found
        return iter(found)

    monkeypatch.setattr(Path, "iterdir", iterdir)
    with socket.create_server(("127.0.0.1", 0)) as server:
        assert f"0100007F:{server.getsockname()[1]:04X}" in listening(os.getpid())
