"""Materials of a scene, derived from those of the library; a new one is a row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from ... import materials
from .derived import Derived, derived, one_of


class AnyModel(Derived):
    """A material of the library, whose constants are the keys."""

    def material(self) -> materials.Material:
        """Return the material of the library."""
        constants = {name: value for name, value in self if name != "model"}
        made: materials.Material = self.library(**constants)
        return made


AnyMaterial = derived("AnyMaterial", AnyModel, materials.Material, "Keys of all materials.")
FramedModel = derived("FramedModel", AnyMaterial, materials.FramedMaterial, "Keys of anisotropic materials.")


#: Tables of materials by their `model`.
MODELS = {
    kind: derived(f"{name}Model", base, library, sentence, ("model", kind))
    for kind, name, base, library, sentence in (
        ("isotropic", "Isotropic", AnyMaterial, materials.Isotropic, "The same in all directions."),
        ("lame", "Lame", AnyMaterial, materials.Isotropic.from_lame, "Isotropic, by a Lame pair."),
        ("orthotropic", "Orthotropic", FramedModel, materials.Orthotropic, "Three planes of symmetry."),
        (
            "transversely-isotropic",
            "TransverselyIsotropic",
            FramedModel,
            materials.TransverselyIsotropic,
            "Fibres along the first axis.",
        ),
        ("anisotropic", "Anisotropic", FramedModel, materials.Anisotropic, "The elasticity matrix itself."),
    )
}
IsotropicModel = MODELS["isotropic"]
if TYPE_CHECKING:
    Material: TypeAlias = Any
else:
    Material = one_of(MODELS.values(), "model")
