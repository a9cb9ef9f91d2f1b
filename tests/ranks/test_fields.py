"""W, F and K v of a body on ranks are those on one machine, for all kinds of elements, divisions and terms."""

import json
from pathlib import Path

import pytest

pytestmark = (
    pytest.mark.slow
)  # minutes: all kinds of elements and terms; `tests/system/test_divided.py` has them on parts in threads


@pytest.fixture(scope="module", params=[2, 3])
def differences(request, on_ranks, tmp_path_factory):
    out = tmp_path_factory.mktemp("fields") / "out.json"
    divisions = ["random"] if request.param == 2 else []  # 3 ranks: all of them
    on_ranks(request.param, Path(__file__).with_name("fields_on_ranks.py"), out, *divisions)
    return json.loads(out.read_text())


def test_fields_and_numbers_are_those_of_the_whole_body(differences):
    assert len(differences) > 150
    assert not {(case, name): value for case, of in differences.items() for name, value in of.items() if not value <= 1e-13}
