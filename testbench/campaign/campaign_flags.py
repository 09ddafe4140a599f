"""Flags of a simulated campaign, for every study and command that makes one."""

from dataclasses import dataclass
from typing import Annotated

import typer

from testbench.arm.folder import find_arm, load_arm
from testbench.campaign.campaign import Scenario, Truth, of_arm
from testbench.campaign.true_arms import FAMILY, TrueArmName

TrueArmFlag = Annotated[
    TrueArmName, typer.Option(help="The true arm; in the family the next one each seed. The model stays.")
]


@dataclass(frozen=True)
class CampaignOptions:
    """What a campaign under gravity is made from; a study adds its own."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"
    payload_kg: Annotated[
        float | None, typer.Option(min=0.001, max=10_000, help="Hung mass; what the arm states if not given.")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, help="Noise of a reading along an axis.")
    ] = 50.0
    truth: Annotated[Truth, typer.Option(help="Kind of truth.")] = "nonlinear"
    true_arm: TrueArmFlag = FAMILY
    noise: Annotated[bool, typer.Option(help="Noisy readings.")] = True
    magnification: Annotated[
        float, typer.Option(min=1, max=10_000, help="Of the deflections drawn in the recording.")
    ] = 50.0

    def scenario(self, workspace_poses: int) -> Scenario:
        """The campaign that is asked for; InputError names an arm that there is not."""
        own = Scenario(
            arm=find_arm(self.arm).resolve().name,
            payload=self.payload_kg,
            sigma=self.sigma_um / 1e6,
            truth=self.truth,
            noise=self.noise,
            workspace_poses=workspace_poses,
        )
        return of_arm(load_arm(self.arm), own)
