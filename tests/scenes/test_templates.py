"""Texts generated from the schema are correct: examples that solve, the page of all keys, and the JSON Schema."""

import json

import pytest
from pydantic_core import PydanticUndefined

from skfem_stvk.scenes import templates
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes.scene import Scene


@pytest.mark.parametrize("kind", templates.EXAMPLES)
def test_an_example_solves_without_a_change_and_meets_its_expectations(kind, tmp_path, capsys):
    assert main(["init", "--type", kind]) == 0
    path = tmp_path / "scene.toml"
    path.write_text(capsys.readouterr().out)
    scene = Scene.read(path)
    assert scene.implausible() == [] and scene.solve(quiet=True).exit_code == 0


@pytest.mark.parametrize("kind", templates.EXAMPLES)
def test_each_key_of_an_example_is_explained_and_optional_keys_are_comments(kind):
    text = templates.example(kind)
    keys = [line for line in text.splitlines() if "=" in line and not line.startswith("#")]
    explained = [line for line in keys if "  # " in line or " # " in line]
    assert len(keys) - len(explained) <= 4  # the title, names of places and of results
    assert "# thickness = ..." in text and "[m]" in text and "# checkpoint = true" in text


@pytest.mark.parametrize("kind", templates.EXAMPLES)
def test_optional_keys_of_an_example_are_legal(kind):
    """An example remains legal if the comment signs before keys with a default are removed."""
    lines = templates.example(kind).splitlines()
    taken = [line[2:] if line.startswith("# ") and " = " in line and "..." not in line.split("#")[1] else line for line in lines]
    assert len([1 for one, other in zip(lines, taken, strict=True) if one != other]) >= 2
    Scene._checked(templates_source("\n".join(taken)))


def templates_source(text):
    from skfem_stvk.scenes.source import SceneSource

    return SceneSource.parse(text)


def test_every_key_has_a_sentence_and_every_table_a_name():
    for model in templates.tables():
        assert templates.title_of(model)
        for row in templates.rows_of(model):
            assert row.sentence.endswith(".") and len(row.sentence) > 5, (model, row)
            assert row.default is PydanticUndefined or row.type


def test_editors_get_a_schema_with_the_same_sentences(capsys):
    assert main(["init", "--schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    young = schema["$defs"]["IsotropicModel"]["properties"]["young"]
    assert young["description"] == "Young's modulus." and young["dimension"] == "stress" and young["exclusiveMinimum"] == 0
    assert schema["additionalProperties"] is False


def test_each_term_of_the_library_can_be_named_by_a_scene():
    from skfem_stvk import terms

    made = {name for name in terms.__all__ if hasattr(getattr(terms, name), "bind") and name[0].isupper()}
    made -= {"Term", "Load", "BoundTerm", "BoundLoad"}
    words = {templates.title_of(model).replace("-", "") for model in templates.tables()}
    assert {name.lower() for name in made} <= words
