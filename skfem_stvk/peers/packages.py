"""The packages of the peers: which version is here, and how to get one."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module, metadata
from typing import Any

from ..errors import StvkError


@dataclass(frozen=True)
class Package:
    """How a package is imported, called where it is installed from, and installed.

    `least` is the first major version that computes this model, `why` the reason.
    """

    module: str
    distribution: str
    install: str
    least: int = 0
    why: str = ""

    def version(self) -> str | None:
        """The installed version; None if it is missing or too old."""
        try:
            version = metadata.version(self.distribution)
        except metadata.PackageNotFoundError:
            return None
        return version if self.fits(version) else None

    def fits(self, version: str) -> bool:
        return int(version.split(".")[0]) >= self.least


PACKAGES = {
    package.module: package
    for package in (
        Package("mujoco", "mujoco", 'pip install "mujoco>=4"', least=4, why="Releases before 4.0 take lambda twice."),
        Package("felupe", "felupe", "pip install felupe"),
        Package("ngsolve", "ngsolve", "pip install ngsolve"),
        Package("dolfinx", "fenics-dolfinx", "conda install -c conda-forge fenics-dolfinx"),
    )
}


def require(module: str) -> Any:
    """The imported package.

    Raises
    ------
    StvkError
        if it is missing, cannot be imported or is too old, with the line that installs it.
    """
    package = PACKAGES[module]
    try:
        imported = import_module(module)
    except ImportError as error:
        raise StvkError(f"The package {module} cannot be imported ({error}). It is optional: {package.install}") from error
    version = str(getattr(imported, "__version__", ""))
    if package.least and not package.fits(version):
        raise StvkError(f"{module} {version} came; expected {package.least}.0 or later. {package.why} Get it: {package.install}")
    return imported
