"""testbench check ARM: what is in an arm's folder, what to confirm, what may be wrong with it."""

from dataclasses import dataclass
from math import ceil

from testbench.arm.folder import find_arm
from testbench.campaign.arm_check import check
from testbench.campaign.campaign_flags import ArmName
from testbench.cli.arguments import ShownFolder
from testbench.commands.check import COMMAND, confirm_lines, contents, report, write
from testbench.output.place import claim_folder
from testbench.shell.options import Force, takes
from testbench.views.terminal import looked_at, plain_console, print_words


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    arm: ArmName
    out: ShownFolder = None
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Read an arm with MuJoCo and Pinocchio, compare, say what to confirm."""
    given = [find_arm(asked.arm)]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        checked = check(asked.arm)
        console = plain_console()
        said, (first, *rest) = report(checked), contents(checked)
        console.print(first, soft_wrap=True)
        apart = max(1, ceil(1e9 * checked.apart))
        lines = [
            "",
            "To confirm, by contribution to the sag:",
            *(confirm_lines(checked) or ["  nothing"]),
            "",
            "Read:",
            *rest,
            f"MuJoCo and Pinocchio place links, tool, load and markers alike, within {apart} nm",
        ]
        if asked.out is not None:
            write(checked, said, find_arm(asked.arm), asked.out)
            lines += [f"picture    {asked.out / 'arm.png'}", *looked_at(asked.out, arm=asked.arm)]
        print_words(console, said, lines=lines)
