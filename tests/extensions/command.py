"""A toy command that prints the number of elements of a mesh file."""

from skfem_stvk import read_mesh


def arguments(parser):
    parser.add_argument("mesh", help="mesh file")


def run(options):
    """Print the number of elements; return the exit code 0."""
    print(f"{read_mesh(options.mesh).nt} elements")
    return 0
