"""What static solves and motions share: Newton's method and eigenvalue tools on a `Problem` that knows its own unknowns, outcomes and progress."""
