"""Runs: the folder of a run, its manifest, its stops and progress, its trials on cores or a cluster."""
