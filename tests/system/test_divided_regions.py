"""Laws and terms on a region of which a part of a divided body has no element."""

import re

import numpy as np
import pytest
from bodies import EVERY_MESH, state
from divided import Division, caught, combined, separate_threads

from skfem_stvk import (
    BodyForce,
    Corotated,
    InvertibleStVK,
    LinearElastic,
    NeoHookean,
    SpringNetwork,
    StVK,
    System,
    VolumePenalty,
    critical_step,
)
from skfem_stvk.results import Fields, names
from skfem_stvk.results.monitors import Monitors
from skfem_stvk.system.bound import compressed_in_part
from skfem_stvk.system.signature import Fingerprint

__all__ = ["separate_threads"]  # a fixture
pytestmark = pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")

FULL = {"young": 3.0, "poisson": 0.2, "density": 1.0}
TERMS = {
    "StVK": lambda ids, d: StVK(**FULL, region=ids),
    "NeoHookean": lambda ids, d: NeoHookean(**FULL, region=ids),
    "LinearElastic": lambda ids, d: LinearElastic(**FULL, region=ids),
    "Corotated": lambda ids, d: Corotated(**FULL, region=ids),
    "InvertibleStVK": lambda ids, d: InvertibleStVK(**FULL, region=ids),
    "InvertibleStVK, stress": lambda ids, d: InvertibleStVK(**FULL, extend="stress", region=ids),
    "SpringNetwork": lambda ids, d: SpringNetwork(**FULL, region=ids),
    "BodyForce": lambda ids, d: BodyForce(np.arange(1.0, d + 1), region=ids),
    **{
        f"VolumePenalty, {kind}": lambda ids, d, kind=kind: VolumePenalty(kind=kind, region=ids)
        for kind in ("barrier", "quadratic")
    },
    "VolumePenalty, compression": lambda ids, d: VolumePenalty(0.5, kind="compression", region=ids),
}


def results(system, u, v):
    """Return vectors and values at nodes, values of elements, and numbers and texts of the whole body, by name."""
    operator = system.linear_operator(u)
    at_nodes = {"F": system.internal_force(u), "loads": system.external_force(u, 0.7), "K v": operator @ v}
    at_nodes |= {"blocks": operator.diagonal_blocks(), "mass": np.repeat(system.mass().vertex, system.mesh.d)}
    numbers = {"J": system.smallest_volume_ratio(u), "critical step": critical_step(system, u).step}
    numbers |= {
        "inverted": system.inside_out(8 * u),
        "compressed": system.mesh.ids_of_all(compressed_in_part(system, u, 0.9)),
        "limit": system.step_limit(0 * u, u),
    }
    if not system.without_energy:
        numbers |= {"W": system.energy(u), "energies": list(system.energies(u, 0.7).values())}
    numbers |= {
        f"signature {i}": one for i, one in enumerate(Fingerprint("motion", system, {}, (0.5, 1.0), {}).signature.numbers.values())
    }
    texts = {"findings": [(one.name, one.elements.tolist(), one.text) for one in Monitors(system).at(u)]}
    fields, of_elements = Fields.of(system).at(u), {}
    for name in names():
        texts[name] = without_ids(error := caught(lambda name=name: fields[name]))
        if error is None:
            of_elements[name], by_node = (np.ma.filled(values, -1.0) for values in (fields[name], fields.at_nodes(name)))
            at_nodes[name] = np.repeat(by_node.reshape(system.mesh.nv, -1), system.mesh.d, axis=0)
    return at_nodes, of_elements, {name: np.ravel(value) for name, value in numbers.items()}, texts


def without_ids(error):
    """Return the text of an error without the ids of elements that one part alone has."""
    return error and re.sub(r"^\d+ elements? \([^)]*\) in ", "", error[1])


@pytest.mark.few(8)
@pytest.mark.parametrize(
    ("name", "term"),
    [
        (name, term)
        for name, mesh in EVERY_MESH.items()
        for term in TERMS
        if mesh.k == mesh.d > 1 and (mesh.element.is_linear_simplex or term != "SpringNetwork")
    ],
)
def test_all_results_are_those_of_the_whole_body(name, term, separate_threads):
    body = Division(name, "strips")
    region, d = body.parts[2], body.mesh.d
    u, v = 0.3 * state(body.mesh).ravel(), np.random.default_rng(4).standard_normal(body.mesh.p.size)

    def make(mesh, young):
        rest = None if "Volume" in term or "Body" in term else np.setdiff1d(np.arange(body.mesh.nt), region)
        return System(mesh, [StVK(young=2.0, poisson=0.3, density=2.0, region=rest), TERMS[term](region, d)])

    found, (at_nodes, of_elements, numbers, texts) = body.run(lambda system, dofs: results(system, u[dofs], v[dofs]), make)
    for key, field in at_nodes.items():
        whole = field.reshape(u.size, -1)
        of_parts = combined([(dofs, own[0][key]) for dofs, own in found], whole.shape)
        np.testing.assert_allclose(of_parts, whole, rtol=0, atol=1e-12 * max(abs(whole).max(), 1.0), err_msg=key)
    for elements, (_, (_, own_elements, own_numbers, own_texts)) in zip(body.parts, found, strict=True):
        assert own_texts == texts and own_elements.keys() == of_elements.keys()
        for key, values in of_elements.items():
            whole = values[elements]
            np.testing.assert_allclose(own_elements[key], whole, rtol=0, atol=1e-12 * max(abs(values).max(), 1.0), err_msg=key)
        for key, value in numbers.items():
            np.testing.assert_allclose(own_numbers[key], value, rtol=1e-9, err_msg=key)
