"""The folder of a check: picture and recording, all of it or nothing."""

from pathlib import Path

from testbench import files
from testbench.bench.checked import Checked
from testbench.views.checked.figure import picture


def write(checked: Checked, out: Path) -> None:
    """arm.png and recording.rrd; InputError when they cannot be written."""
    from testbench.views.recording.arm_check import write_arm  # importing rerun takes a third of a second

    with files.whole_folder(out) as folder:
        picture(checked).savefig(folder / "arm.png", dpi=100)
        write_arm(folder / "recording.rrd", checked)
