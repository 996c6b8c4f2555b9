"""Runs many trials, or named tasks, in other processes, and writes results that outlive an
interruption.

Nothing here knows what a trial is: `runner.run_study` gets `TrialFunctions`. `pool.py` has the
promises.
"""
