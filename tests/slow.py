"""Tests and parameters that take too long for .ci/run; `python -m pytest -n auto -m slow` runs them."""

import pytest


def slow(*values, **options):
    """Return one parameter, or one row of parameters, marked as slow."""
    return pytest.param(*values, marks=pytest.mark.slow, **options)


def slow_but(quick, values):
    """Return the parameters `values`, all marked as slow except those in `quick`."""
    assert not set(quick) - set(values)
    return [value if value in quick else slow(value) for value in values]


#: Tests with many parameters, by file: `.ci/run` runs every fourth parameter, and `-m slow` the others.
THINNED = {
    "ranks/test_process.py": ("test_a_rank_that_fails_ends_the_job",),
    "solvers/dynamics/test_critical_step.py": ("test_instability_is_observed_within_two_percent",),
    "solvers/dynamics/test_elements_in_motion.py": ("test_a_free_body_falls_without_strain",),
    "solvers/dynamics/test_equations.py": ("test_steps_are_those_of_the_equation",),
    "solvers/dynamics/test_forces_without_energy.py": ("test_missing_energies_are_nan_and_the_rest_balances",),
    "solvers/dynamics/test_integrators.py": (
        "test_an_integrator_conserves_what_it_declares_and_nothing_else",
        "test_converged_steps_do_not_depend_on_the_tangent",
        "test_errors_of_motion_and_energy_fall_with_the_declared_order",
    ),
    "solvers/dynamics/test_interruptions.py": (
        "test_ctrl_c_during_step_size_control_leaves_a_whole_step",
        "test_ctrl_c_within_a_step_leaves_a_whole_step",
    ),
    "solvers/dynamics/test_kill_and_resume.py": (
        "test_a_run_resumes_bit_for_bit_from_any_checkpoint",
        "test_each_integrator_resumes_bit_for_bit_with_each_solver",
    ),
    "solvers/dynamics/test_modes.py": (
        "test_a_free_body_has_its_rigid_modes",
        "test_every_solver_finds_the_lowest_pairs",
    ),
    "solvers/dynamics/test_simulation.py": (
        "test_a_restored_state_leads_to_the_same_steps",
        "test_steps_are_those_of_simulate_to_the_last_bit",
    ),
    "solvers/dynamics/test_step_solvers.py": ("test_follower_loads_are_accurate_with_every_tangent",),
    "solvers/dynamics/test_tearing.py": (
        "test_a_body_without_its_removed_elements_moves_like_one_built_without_them",
        "test_a_torn_run_resumes_bit_for_bit",
    ),
    "edges/test_clamp.py": ("test_the_clamped_tangent_is_semi_definite_and_exact_in_tension",),
    "kernels/test_cg.py": ("test_compiled_and_readable_loops_agree",),
    "kernels/test_readable.py": ("test_all_laws_on_all_elements_are_those_of_the_continuum",),
    "kernels/test_twins.py": (
        "test_compiled_and_readable_kernels_agree",
        "test_compiled_and_readable_kernels_agree_on_elements_with_several_points",
    ),
    "linear/test_solvers.py": ("test_the_residual_is_below_rtol_and_reported_correctly",),
    "referee/test_library.py": ("test_every_fault_is_an_error_that_names_the_function",),
    "referee/test_candidates.py": (
        "test_K_may_be_dense_sparse_or_an_operator",
        "test_a_broken_candidate_is_never_a_pass_nor_an_exception",
        "test_candidates_on_every_kind_of_simplex",
    ),
    "referee/test_elements_judged.py": (
        "test_a_fault_in_the_tables_is_caught_on_other_elements_too",
        "test_all_elements_pass",
    ),
    "referee/test_hypotheses.py": (
        "test_a_planted_fault_is_named_by_its_class_or_by_none",
        "test_wrong_initial_stresses_are_named_for_all_elements",
        "test_wrong_units_of_length_are_named_for_all_elements",
    ),
    "referee/test_integrators_judged.py": (
        "test_own_integrators_pass_with_what_they_declare",
        "test_planted_faults_are_caught",
        "test_planted_faults_are_named",
    ),
    "referee/test_laws.py": (
        "test_laws_of_textbooks_pass",
        "test_mistakes_in_st_venant_kirchhoff_are_caught_and_named",
        "test_stress_measures_are_distinguished",
    ),
    "referee/test_limits.py": (
        "test_any_poisson_passes",
        "test_unit_and_location_do_not_matter",
    ),
    "referee/test_slivers.py": ("test_an_error_of_1e_8_in_lambda_is_found_next_to_a_sliver",),
    "referee/test_solvers_judged.py": ("test_planted_faults_are_caught_and_named",),
    "referee/test_verify.py": (
        "test_a_stale_cache_of_a_nearby_state_fails_and_is_named",
        "test_every_body_passes",
    ),
    "results/test_animation.py": (
        "test_a_series_on_disk_gives_the_film_of_its_states",
        "test_every_kind_of_body_moves_in_a_film",
    ),
    "solvers/statics/test_checkpoint.py": ("test_after_each_state_a_restored_continuation_has_the_same_state",),
    "system/test_cost_of_terms.py": ("test_without_a_term_its_kernels_do_not_run_and_its_arrays_do_not_exist",),
    "system/test_divided.py": (
        "test_a_damped_motion_on_parts_is_that_of_the_whole_body",
        "test_conjugate_gradients_on_parts_find_the_solution_of_the_whole_body",
        "test_parts_have_the_results_of_the_whole_body",
    ),
    "system/test_divided_decisions.py": ("test_newton_cuts_steps_in_all_parts_at_the_same_place",),
    "system/test_divided_results.py": ("test_supports_that_move_in_one_part_move_the_whole_body",),
    "system/test_float32.py": ("test_every_body_is_right_to_single_precision",),
    "system/test_mechanisms.py": ("test_mechanisms_are_counted_at_any_size_location_and_order",),
    "system/test_removal.py": (
        "test_all_functions_of_displacements_are_those_of_the_remaining_body",
        "test_the_original_body_is_unchanged",
    ),
    "system/test_threads.py": ("test_python_threads_that_share_an_object_get_what_one_thread_gets",),
    "terms/test_conformance.py": (
        "test_fill_adds_to_earlier_values_on_a_larger_pattern",
        "test_force_and_tangent_are_derivatives",
        "test_products_diagonals_and_edge_blocks_are_those_of_the_tangent",
        "test_single_precision_has_errors_of_single_precision",
        "test_the_clamped_tangent_is_positive_semi_definite",
        "test_the_round_off_of_the_force_is_neither_below_its_error_nor_far_above",
    ),
    "terms/test_linear_elastic.py": ("test_the_stiffness_is_that_of_the_body_at_rest_in_all_states",),
    "terms/test_neo_hookean.py": (
        "test_compiled_and_readable_kernels_agree",
        "test_the_mean_force_is_the_readable_one_and_its_work_is_the_energy_difference",
    ),
    "terms/test_principal_stretches.py": ("test_compiled_and_readable_kernels_agree",),
    "terms/test_recoveries.py": ("test_motions_recover_from_exact_mirrors_lines_and_points",),
    "terms/test_toys.py": (
        "test_a_motion_is_near_that_of_small_steps",
        "test_a_static_solve_finds_the_equilibrium",
    ),
    "terms/test_volume_penalty_on_elements.py": ("test_energy_force_and_tangent_are_scikit_fems",),
    "validation/test_dynamics.py": ("test_the_studies_hold",),
    "validation/test_fuzz.py": ("test_random_cases_are_right_or_refused_with_a_clear_error",),
    "validation/test_hard.py": ("test_the_default_is_right_or_says_why_not",),
    "validation/test_hard_motion.py": (
        "test_elements_invert_at_the_times_in_the_table",
        "test_no_integrator_is_wrong_without_a_warning_and_the_plain_one_is",
    ),
    "validation/test_stability.py": ("test_the_claim_holds",),
    "referee/test_vectors.py": (
        "test_one_entry_of_a_file_that_is_not_a_number_is_named",
        "test_single_precision_is_named_in_results",
    ),
}


def mark_thinned(items):
    """Mark all but every fourth parameter of the tests in `THINNED` as slow."""
    counts = {}
    for item in items:
        name = getattr(item, "originalname", None)
        if name in THINNED.get("/".join(item.path.parts[-2:]), ()):
            counts[name, item.path] = number = counts.get((name, item.path), -1) + 1
            if number % 4:
                item.add_marker(pytest.mark.slow)
