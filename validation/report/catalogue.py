"""Catalogue of the report: the parts of all groups with their kinds, references and sources."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Kind(Enum):
    """Kinds of claims, after ASME V&V 10."""

    CODE = "code verification"
    SOLUTION = "solution verification"
    PUBLISHED = "validation against published values"


class Part(NamedTuple):
    """Part of a group.

    Attributes
    ----------
    kind, reference, reference_kind, source
        Kind of the claims, their reference, its kind and its source.
    words
        Claim of a study that prints no claim itself.
    speed
        Whether the part measures time, or memory over many steps, and runs only with `--speed`.
    numbers
        Name of the function in `numbers` that computes the claims; empty for a study.
    takes_quick
        Whether the study has a quick version.
    whole_only
        Whether quick reports leave the part out.
    """

    kind: Kind
    reference: str
    reference_kind: str
    source: str
    words: str = ""
    speed: bool = False
    numbers: str = ""
    takes_quick: bool = True
    whole_only: bool = False


CODE, SOLUTION, PUBLISHED = Kind.CODE, Kind.SOLUTION, Kind.PUBLISHED
ANALYTIC, OTHER_CODE, ITSELF, VALUE = "analytic", "another code", "itself, on other meshes or steps", "published value"

PARTS: dict[str, dict[str, Part]] = {
    "referee": {
        "embedded": Part(CODE, "scikit-fem's assembly", OTHER_CODE, "skfem_stvk/reference", numbers="agreement"),
        "self-test": Part(CODE, "planted faults", "mutation", "docs/measurements/planted-faults.md", numbers="planted_faults"),
        "laws": Part(CODE, "ten textbook laws, and planted mistakes", "mutation", "docs/how-to/judge-a-law.md", numbers="laws"),
        "judged": Part(
            CODE, "correct and wrong solvers and integrators", "mutation", "docs/how-to/judge-a-solver.md", numbers="judged"
        ),
        "vectors": Part(CODE, "W, F and K in 50 digits", ANALYTIC, "docs/how-to/test-vectors.md", numbers="vectors"),
        "C": Part(CODE, "a program in C", OTHER_CODE, "docs/vectors.c", numbers="round_trip"),
        "MuJoCo": Part(CODE, "MuJoCo's flex", OTHER_CODE, "docs/measurements/peers.md", numbers="mujoco"),
        "FElupe": Part(CODE, "FElupe", OTHER_CODE, "docs/measurements/peers.md", numbers="felupe"),
        "NGSolve": Part(CODE, "NGSolve", OTHER_CODE, "docs/measurements/peers.md", numbers="ngsolve"),
        "coefficients": Part(PUBLISHED, "regular tetrahedron", VALUE, "Delingette 2008; literature", numbers="coefficients"),
    },
    "orders": {
        "mesh": Part(SOLUTION, "2 and 1", ITSELF, "Richardson, Roache 1994", numbers="orders_in_space"),
        "time": Part(SOLUTION, "declared orders", ITSELF, "Richardson, Roache 1994", numbers="orders_in_time"),
        "flag": Part(PUBLISHED, "CSM1 and CSM2", VALUE, "Turek and Hron 2006, FeatFlow's web page", numbers="flag"),
    },
    "part": {
        "all": Part(
            CODE,
            "scikit-fem's assembly",
            OTHER_CODE,
            "validation/part.py",
            "F and K of a part meshed by Gmsh agree to 1e-13",
            takes_quick=False,
            whole_only=True,
        )
    },
    "operations": {
        "all": Part(
            PUBLISHED,
            "15 - 27 %, 27 - 38 %, 70 % fewer",
            VALUE,
            "Kikuuwe et al. 2009; the overview",
            "numbers of operations on whole meshes equal the sums over their entities",
            takes_quick=True,
        )
    },
    "statics": {
        "homogeneous": Part(CODE, "closed forms", ANALYTIC, "literature: homogeneous states"),
        "turek-hron": Part(PUBLISHED, "CSM1 and CSM2", VALUE, "Turek and Hron 2006, FeatFlow's page"),
        "manufactured": Part(SOLUTION, "orders 2 and 1", ITSELF, "manufactured solution"),
        "elastica": Part(PUBLISHED, "the elastica", VALUE, "Euler's equation, tables in the literature"),
    },
    "stability": {
        "snap-through": Part(PUBLISHED, "one bar with Green's strain", ANALYTIC, "closed form"),
        "column": Part(PUBLISHED, "Euler's load", ANALYTIC, "Euler 1744"),
        "post-buckling": Part(PUBLISHED, "the elastica after buckling", ANALYTIC, "Euler's equation"),
        "law": Part(CODE, "limit points of the law", ANALYTIC, "literature: closed forms"),
    },
    "dynamics": {
        "independent": Part(CODE, "scikit-fem and SciPy's DOP853", OTHER_CODE, "validation/dynamics/independent.py"),
        "csm3": Part(PUBLISHED, "CSM3", VALUE, "Turek and Hron 2006, FeatFlow's page"),
        "flight": Part(CODE, "energy and momenta", ANALYTIC, "conservation laws"),
        "vibrations": Part(SOLUTION, "numerical dispersion", ANALYTIC, "linear theory of each integrator"),
        "work-precision": Part(SOLUTION, "velocity Verlet, extrapolated", ITSELF, "validation/dynamics", speed=True),
    },
    "elements": {
        "orders": Part(SOLUTION, "orders of each element", ITSELF, "manufactured solution"),
        "turek-hron": Part(PUBLISHED, "CSM1", VALUE, "Turek and Hron 2006, FeatFlow's page"),
        "work-precision": Part(SOLUTION, "finer meshes", ITSELF, "validation/elements", speed=True),
        "costs": Part(CODE, "linear tetrahedra", ITSELF, "validation/elements/costs.py", speed=True),
    },
    "models": {
        "bent": Part(CODE, "StVK on fine meshes; neo-Hookean by scikit-fem", OTHER_CODE, "validation/models"),
        "twisted": Part(CODE, "StVK on fine meshes; neo-Hookean by scikit-fem", OTHER_CODE, "validation/models"),
        "released": Part(CODE, "conserved energy and angular momentum", ANALYTIC, "conservation laws"),
        "thrown": Part(CODE, "conserved energy and angular momentum", ANALYTIC, "conservation laws"),
        "costs": Part(CODE, "StVK", ITSELF, "validation/models/costs.py", speed=True),
    },
    "reduced": {
        "statics": Part(SOLUTION, "the full body", ITSELF, "validation/reduced"),
        "motion": Part(SOLUTION, "the full body", ITSELF, "validation/reduced"),
        "energy": Part(CODE, "conserved energy", ANALYTIC, "conservation laws"),
        "cable": Part(PUBLISHED, "the catenary", ANALYTIC, "closed form and the chain's own equations"),
        "net": Part(CODE, "the net's own equations", ANALYTIC, "validation/reduced/cables.py"),
        "sphere": Part(PUBLISHED, "p = 2 h S/(s r)", ANALYTIC, "closed form"),
        "disc": Part(PUBLISHED, "Hencky's series", VALUE, "Hencky 1915; Fichter 1997"),
        "wrinkles": Part(PUBLISHED, "tension fields", ANALYTIC, "Pipkin 1986"),
    },
    "contact": {
        "patch": Part(CODE, "a homogeneous state", ANALYTIC, "closed form"),
        "hertz": Part(PUBLISHED, "Hertz's force and contact radius", ANALYTIC, "Hertz 1881, Tatara 1991"),
        "capstan": Part(PUBLISHED, "exp(mu angle)", ANALYTIC, "Euler 1769, Eytelwein 1808"),
        "slope": Part(CODE, "Coulomb's law", ANALYTIC, "closed form"),
        "bar": Part(CODE, "the wave equation", ANALYTIC, "closed form"),
        "bounce": Part(CODE, "energy", ANALYTIC, "conservation laws"),
        "pair": Part(CODE, "a homogeneous state", ANALYTIC, "closed form"),
        "balls": Part(PUBLISHED, "Hertz's force and contact radius", ANALYTIC, "Hertz 1881, Tatara 1991"),
        "ironing": Part(SOLUTION, "the mean force", ITSELF, "validation/contact/between.py"),
        "collision": Part(CODE, "energy and momenta", ANALYTIC, "conservation laws"),
    },
    "hard": {
        name: Part(CODE, "tiny steps of Newton or Verlet by scikit-fem, closed forms", OTHER_CODE, "validation/hard")
        for name in ("deformed", "crushed", "elements", "starts", "unstable", "slender", "slack", "scales", "motion")
    },
    "hostile": {
        name: Part(
            CODE,
            "a correct result, or a readable error",
            "mutation",
            "docs/measurements/robustness.md",
            f"hostile inputs of the family {name} give a correct result or a readable error",
        )
        for name in ("meshes", "stores", "names", "commands", "candidates", "arguments")
    },
    "fuzz": {
        "all": Part(
            CODE,
            "a correct result, or a readable error",
            "mutation",
            "docs/measurements/robustness.md",
            "random bodies, programs, solves, motions and files give a correct result or a readable error",
            takes_quick=False,
            whole_only=True,
        )
    },
    "distributed": {
        "all": Part(
            CODE, "one machine", ITSELF, "docs/measurements/distributed.md", "a body on ranks has the same answers", whole_only=True
        )
    },
    "bench": {
        "all": Part(
            CODE,
            "other codes",
            OTHER_CODE,
            "docs/measurements/benchmark.md",
            "the benchmark measures everything in its plan",
            speed=True,
        )
    },
    "solvers": {"all": Part(CODE, "direct solves", ITSELF, "validation/solvers.py", "linear solvers", speed=True)},
}
