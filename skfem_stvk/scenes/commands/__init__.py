"""The command `skfem-stvk`."""
