"""testbench view DIR: the newest recording of a run in the viewer."""

from testbench.cli.arguments import RunFolder
from testbench.views.recording import viewer


def command(folder: RunFolder) -> None:
    """Open it."""
    viewer.view(folder)
