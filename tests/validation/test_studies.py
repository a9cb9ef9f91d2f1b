from validation import aspect


def test_a_part_meshed_by_gmsh_agrees_to_1e_13_in_every_state(gmsh, capsys):
    from validation import part

    assert part.main() == 0
    out = capsys.readouterr().out
    assert "PASSED" in out and "in 8 states" in out
    assert int(out.split(" tetrahedra")[0].split()[-1]) >= 20_000


def test_flat_elements_cost_the_edge_form_digits():
    rows = {(round(ratio, -1), strain): (ours, theirs) for ratio, strain, ours, theirs in aspect.measure()}
    (plump, *_, flat) = sorted({ratio for ratio, _ in rows})
    assert rows[plump, 1e-6][0] < 1e-13 < rows[plump, 1e-6][1]  # small strains on plump elements: ours is better
    assert rows[flat, 1e-1][0] > 1e-10 > rows[flat, 1e-1][1]  # large strains on flat elements: scikit-fem's is
