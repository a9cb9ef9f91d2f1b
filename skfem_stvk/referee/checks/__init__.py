"""Checks of a verification, one kind per file. Each takes a case and yields tasks."""
