"""The folder of a check: picture and recording, all of it or nothing."""

from pathlib import Path

from testbench import files
from testbench.bench.checked import Checked
from testbench.output.run import whole_folder

COMMAND = "testbench check"  #: As manifest.json names it.


def write(checked: Checked, arm: Path, out: Path) -> None:
    """arm.png, recording.rrd and manifest.json; InputError when they cannot be written."""
    from testbench.views.checked.figure import picture  # importing matplotlib and rerun takes two thirds
    from testbench.views.recording.arm_check import write_arm  # of a second

    with whole_folder(out) as folder:
        picture(checked).savefig(folder / "arm.png")
        write_arm(folder / "recording.rrd", checked)
        files.write_manifest(folder, command=COMMAND, scenario={}, seeds=range(0), arms=[arm])
