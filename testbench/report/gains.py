"""Ratios and shares in words: 8.6; a share with its interval by Wilson, 79 % (70 to 86 %)."""

import math

Z95 = 1.959964  #: Of the normal distribution, 97.5 %.


def wilson(share: float, n: int) -> tuple[float, float]:
    """Compute the 95 % interval of a share by the score test (E. B. Wilson, 1927).

    Args:
        share: The share [1].
        n: Number of independent trials.

    Returns:
        Ends of the interval [1].
    """
    z2 = Z95**2
    middle, half = share + z2 / (2 * n), Z95 * math.sqrt(share * (1 - share) / n + z2 / (4 * n**2))
    return max((middle - half) / (1 + z2 / n), 0.0), min((middle + half) / (1 + z2 / n), 1.0)


def share(value: float, trials: str) -> str:
    """Write a share of independent trials with its interval: 79 % (70 to 86 %).

    Args:
        value: The share [1].
        trials: Number of trials, as text.

    Returns:
        The words.
    """
    low, high = wilson(float(value), int(trials))
    form = ".0f" if value in (0, 1) or 0.01 <= value <= 0.99 else ".1f"
    return f"{100 * value:{form}} % ({100 * low:{form}} to {100 * high:{form}} %)"


def ratio(value: float) -> str:
    """Write a ratio in two or three digits: 1.04, 1.7, 8.6, 21, 1,300."""
    if value < 1.1:
        return f"{value:.2f}"
    return f"{value:.1f}" if value < 9.95 else f"{value:,.0f}"
