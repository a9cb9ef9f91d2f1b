"""MPI of mpi4py, or the error that says how to install it."""

try:
    from mpi4py import MPI
except (ImportError, RuntimeError) as error:  # RuntimeError if there is no MPI library
    raise ImportError(
        f"Bodies on ranks need mpi4py and a library of MPI: {str(error).splitlines()[0]}. Install both: "
        'pip install "skfem-stvk[mpi-wheel]". On a cluster load its module of MPI, and: pip install "skfem-stvk[mpi]".'
    ) from error

__all__ = ["MPI"]
