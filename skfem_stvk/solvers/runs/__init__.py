"""Runs: what a path and a motion leave, where it is written, how it is shown, and how a later run resumes it."""
