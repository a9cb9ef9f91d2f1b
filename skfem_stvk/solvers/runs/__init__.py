"""Runs: the data that a path and a motion leave, where these are written, how they are shown, and how a later run continues.

A state is a dataclass, `Step` of a path and `RunState` of a motion, with a row of the `Ledger`. `archive` writes the dataclass as
an .npz file, in a folder with one writer. `outputs` writes a series of states, and `ledger` a table. `run_result` has the last
state with its fields, forces, files and pictures. A later run reads the dataclass: `archive` checks types, problem and lengths.
Then `path_checkpoint` and `motion_checkpoint` check that the body, the equation and the earlier states allow the state.
"""
