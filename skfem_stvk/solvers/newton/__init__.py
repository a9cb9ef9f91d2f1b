"""Newton's method and eigenvalue tools for a `Problem` that defines its own unknowns; outcomes and progress of analyses."""
