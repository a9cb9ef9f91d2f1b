"""Newton's method and eigenvalue tools on a `Problem` that knows its own unknowns; outcomes and progress of analyses."""
