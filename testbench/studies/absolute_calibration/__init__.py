"""Absolute readings of simulated arms: which errors hide behind which, how many poses, what a mix gains."""
