"""Meshes that Gmsh writes for several tests."""

import pytest


@pytest.fixture(scope="module")
def two_boxes(gmsh, tmp_path_factory):
    """Return a function that writes two touching boxes with Gmsh to a file `name`, with options, and returns its path.

    Groups of volumes overlap, and a group of surfaces has no name.
    """
    folder = tmp_path_factory.mktemp("gmsh")

    def save(name, **options):
        gmsh.initialize(interruptible=False)
        model, occ = gmsh.model, gmsh.model.occ
        occ.fragment([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(1, 0, 0, 1, 1, 1))])
        occ.synchronize()
        for group, volumes in {"steel": [1], "rubber": [2], "all": [1, 2]}.items():
            model.addPhysicalGroup(3, volumes, name=group)
        model.addPhysicalGroup(2, [1, 2], tag=40)
        for option, value in {"General.Terminal": 0, "Mesh.SaveGroupsOfElements": -1111, **options}.items():
            gmsh.option.setNumber(option.replace("_", "."), value)
        model.mesh.generate(3)
        gmsh.write(str(folder / name))
        gmsh.finalize()
        return folder / name

    return save
