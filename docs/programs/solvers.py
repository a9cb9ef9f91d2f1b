"""A user's static solver, judged by its results: a correct solver, one with half the load, and one with linear strain.

The referee poses problems with known solutions and uses only the displacements that the solver returns. The third solver is linear
elasticity in scikit-fem. It is correct for small displacements, and the referee names it as linear.
"""

import numpy as np
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity

from skfem_stvk import BodyForce, StVK, System, solve_static, verify_solver


def right(mesh, material, body_force, boundary, factor=1.0):
    load = BodyForce(lambda x, t: factor * t * body_force(x))
    prescribed = {tuple(boundary.nodes): lambda x, t: t * boundary.values.T}
    return solve_static(System(mesh, [StVK(material), load], prescribed=prescribed), steps=2, quiet=True).u


def half_of_the_load(*problem):
    return right(*problem, factor=0.5)


def linear_elasticity_of_scikit_fem(mesh, material, body_force, boundary):
    basis = skfem.Basis(mesh, skfem.ElementVector(mesh.elem()), intorder=6)
    load = skfem.LinearForm(lambda v, w: sum(v[i] * body_force(w.x.reshape(2, -1))[i].reshape(w.x[0].shape) for i in range(2)))
    u = np.zeros(basis.N)
    u[boundary.dofs] = boundary.values.ravel()
    K = linear_elasticity(*lame_parameters(material.young, material.poisson)).assemble(basis)  # plane strain
    return skfem.solve(*skfem.condense(K, load.assemble(basis), x=u, D=boundary.dofs))


SOLVERS = (right, half_of_the_load, linear_elasticity_of_scikit_fem)
reports = {solve.__name__: verify_solver(solve, young=1e5, poisson=0.3, dimension=2, quiet=True) for solve in SOLVERS}
named = {name: report.named.names if report.named else [] for name, report in reports.items()}
failed = {name: sorted({result.check for result in report.failures()}) for name, report in reports.items()}


def picture():
    import matplotlib.pyplot as plt

    checks = list(dict.fromkeys(result.check for result in reports["right"].results if result.limit))
    figure, axes = plt.subplots(figsize=(9, 3.8), layout="constrained")
    for number, (name, report) in enumerate(reports.items()):
        of = [[r.measured / r.limit for r in report.results if r.check == check and r.measured is not None] for check in checks]
        x = [max(1e-9, *values) if values else np.nan for values in of]
        y = [len(checks) - row - 0.2 * (number - 1) for row in range(len(checks))]
        label = f"{name.replace('_', ' ')}: {', '.join(named[name]) or 'passed'}"
        axes.plot(x, y, "osD"[number], color=("#0072B2", "#E69F00", "#000000")[number], label=label)
    axes.axvline(1, color="0.4", ls="--")
    axes.set(xscale="log", xlabel="largest error over its limit", title="Three solvers, and what the referee says of them")
    axes.set_yticks(range(len(checks), 0, -1), checks)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


if __name__ == "__main__":
    for name, report in reports.items():
        print(f"{name}: {', '.join(failed[name]) or 'passed'}; named: {', '.join(named[name]) or 'nothing'}")
        for result in report.results:
            if result.check == "order":
                print(f"    {result.quantity}: {result.scale}")
