"""One factorial campaign: studies choose the factors, this room fits, judges and compares."""
