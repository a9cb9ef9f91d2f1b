"""The checks, one kind a file: each takes a case and yields results."""
