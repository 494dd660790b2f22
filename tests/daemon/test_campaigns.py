"""Recipes from files: what is shipped can be read, and what is wrong is told with its place."""

from pathlib import Path

import pytest

from bscd.daemon.campaigns import load_recipe
from bscd.daemon.recipes import Campaign
from bscd.errors import InputError
from tests.daemon.small import small_daemon

SHIPPED = Path(__file__).resolve().parents[2] / "config/campaigns"

YAML = """
recipe: campaign
steps:
  - name: home
    do: {recipe: home}
"""


def test_the_papers_experiment_is_possible_on_the_twin(tmp_path):
    campaign = load_recipe(SHIPPED / "genovese2013.toml")
    assert isinstance(campaign, Campaign)
    kinds = [step.do.recipe for step in campaign.steps]
    assert kinds[0] == "home"
    assert {"align", "reference-scan", "bsc-scan", "calibrate", "inflation", "sphere-check", "measure"} <= set(kinds)
    with small_daemon(tmp_path) as daemon:
        looked = daemon.validate(campaign)
    assert looked.problems == ()
    assert looked.frames > 17 * 2 * 3


def test_toml_yaml_and_json_are_the_same(tmp_path):
    (tmp_path / "a.yaml").write_text(YAML)
    (tmp_path / "a.toml").write_text('recipe = "campaign"\n[[steps]]\nname = "home"\ndo = { recipe = "home" }\n')
    (tmp_path / "a.json").write_text('{"recipe": "campaign", "steps": [{"name": "home", "do": {"recipe": "home"}}]}')
    read = [load_recipe(tmp_path / f"a.{ending}") for ending in ("yaml", "toml", "json")]
    assert read[0] == read[1] == read[2]
    changed = load_recipe(tmp_path / "a.toml", {"title": "other"})
    assert changed.title == "other"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("recipe = ", "is no TOML"),
        ('title = "x"', "recipe = None is not known; known are home"),
        ('recipe = "fly"', "recipe = 'fly' is not known"),
        ('recipe = "campaign"\nsteps = []', "steps"),
        ('recipe = "campaign"\n[[steps]]\nname = "a"\ndo = { recipe = "move", axis = "jacks" }', "step a, position"),
        ('recipe = "campaign"\n[[steps]]\nname = "a"\ndo = { recipe = "home", x = 1 }', "step a, x"),
        (
            'recipe = "campaign"\n[[steps]]\nname = "a"\ndo = { recipe = "home" }\n'
            '[[steps]]\nname = "a"\ndo = { recipe = "home" }',
            "steps have the same name: a",
        ),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, text, told):
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        load_recipe(path)
    assert told in str(refused.value)
    assert str(path) in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_a_yaml_file_runs_nothing(tmp_path):
    path = tmp_path / "evil.yaml"
    path.write_text("recipe: !!python/object/apply:os.system ['touch /tmp/bscd-evil']")
    with pytest.raises(InputError, match="is no YAML"):
        load_recipe(path)
    assert not Path("/tmp/bscd-evil").exists()
