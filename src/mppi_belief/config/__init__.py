"""Configurations: what may be set and named, and how a command line becomes configurations."""
