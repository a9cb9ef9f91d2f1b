"""Supports and locations on ranks have the results and the messages of one machine, on all ranks."""

import json
from pathlib import Path

import pytest


def results(request, on_ranks, tmp_path_factory, program):
    """Return the results of one machine and of each rank, by case."""
    out = tmp_path_factory.mktemp("held") / "out.json"
    on_ranks(request.param, Path(__file__).with_name(program), out)
    return json.loads(out.read_text())


@pytest.fixture(scope="module", params=[pytest.param(2, marks=pytest.mark.slow), 3])
def messages(request, on_ranks, tmp_path_factory):
    return results(request, on_ranks, tmp_path_factory, "held_on_ranks.py")


@pytest.fixture(scope="module", params=[pytest.param(2, marks=pytest.mark.slow), 3])
def places(request, on_ranks, tmp_path_factory):
    return results(request, on_ranks, tmp_path_factory, "places_on_ranks.py")


def different(found):
    return {case: of for case, of in found.items() if any(one != of[0] for one in of)}


@pytest.mark.slow
def test_motions_without_strain_are_named_as_on_one_machine(messages):
    texts = [of[0] for of in messages.values()]
    assert min(sum(word in text for text in texts) for word in ("rigid mode", "mechanism", "the line through", "more joints")) > 2
    assert sum(not text for text in texts) > 40 and sum(bool(text) for text in texts) > 80
    assert not different(messages)


@pytest.mark.slow
def test_locations_are_those_of_the_whole_body(places):
    assert sum(bool(of[0][1]) for of in places.values()) > 40 and sum(bool(of[0][0]) for of in places.values()) > 30
    assert not different(places)
