"""Section 5.2: the illustrative 6R arm."""
