"""Running many trials: what to run, who runs it, and results that outlive an interruption.

Nothing here knows what a trial is: `runner.run_study` is handed a `Task`.
"""
