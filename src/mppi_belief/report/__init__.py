"""From results to tables and pictures; reads results only and never runs a trial."""
