"""Linear relations between Green-Lagrange strain and second Piola-Kirchhoff stress."""

from collections.abc import Callable

from .anisotropic import Anisotropic, Orthotropic, TransverselyIsotropic, frames_along
from .isotropic import Isotropic
from .material import FramedMaterial, Hypothesis, Material

#: Materials that scenes know, by their `model`.
MATERIALS: dict[str, Callable[..., Material]] = {
    "isotropic": Isotropic,
    "lame": Isotropic.from_lame,
    "orthotropic": Orthotropic,
    "transversely-isotropic": TransverselyIsotropic,
    "anisotropic": Anisotropic,
}

__all__ = [
    "MATERIALS",
    "Anisotropic",
    "FramedMaterial",
    "Hypothesis",
    "Isotropic",
    "Material",
    "Orthotropic",
    "TransverselyIsotropic",
    "frames_along",
]
