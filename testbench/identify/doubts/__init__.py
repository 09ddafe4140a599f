"""What may be wrong with what was handed in: doubts, with numbers, the likeliest first."""

from testbench.identify.doubts.deflected import scale
from testbench.identify.doubts.doubt import Doubt
from testbench.identify.doubts.find import HandedIn, doubts, open_places

__all__ = ["Doubt", "HandedIn", "doubts", "open_places", "scale"]
