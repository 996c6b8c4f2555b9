"""Configurations: what may be set, how the command line becomes configurations, what they may name."""
