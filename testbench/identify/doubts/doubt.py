"""A doubt: what may be wrong with what was handed in, in a sentence with numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Doubt:
    """What may be wrong."""

    name: str  #: A word for programs, such as "frame".
    sentence: str  #: For people: what is seen, by how much, what to check.
    #: By how many nats the readings are likelier with the mistake than without; None for what is plain.
    evidence: float | None = None
