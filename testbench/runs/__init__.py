"""Runs: the folder that a run leaves, its manifest, its stops and progress, its trials on cores or a cluster."""
