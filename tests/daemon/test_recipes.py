"""What can be asked of the daemon, and what is refused before anything is done."""

import pytest
from pydantic import TypeAdapter, ValidationError

from bscd.daemon.recipes import RECIPES, AnyRecipe, BscScan, Campaign, ReferenceScan
from bscd.procedures import ScanRecipe

CONFIGURED = {"positions": 17, "step_mm": 2.0, "poses": ("face", "corner"), "settle_s": 0.2}
ANY = TypeAdapter(AnyRecipe)


def test_every_recipe_is_told_apart_by_its_name():
    assert list(RECIPES) == [
        "home",
        "move",
        "align",
        "reference-scan",
        "bsc-scan",
        "calibrate",
        "sphere-check",
        "inflation",
        "measure",
        "campaign",
    ]
    assert type(ANY.validate_python({"recipe": "bsc-scan", "between": True})) is BscScan


def test_a_scan_is_what_is_configured_but_for_what_is_given():
    assert ReferenceScan().scan(CONFIGURED) == ScanRecipe(kind="reference", **CONFIGURED)
    assert BscScan(positions=5, poses=("face",)).scan(CONFIGURED) == ScanRecipe(
        kind="bsc", positions=5, step_mm=2.0, poses=("face",), settle_s=0.2
    )


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"recipe": "dance"}, "does not match any of the expected tags"),
        ({"recipe": "home", "speed": 3}, "Extra inputs are not permitted"),
        ({"recipe": "move", "axis": "rotation", "position": "nan"}, "finite number"),
        ({"recipe": "measure", "calibration": "../keys", "run": "a"}, "should match pattern"),
        ({"recipe": "measure", "calibration": "a/b", "run": "a"}, "should match pattern"),
        ({"recipe": "campaign", "steps": []}, "at least 1 item"),
    ],
)
def test_what_can_not_be_is_refused(given, told):
    with pytest.raises(ValidationError, match=told):
        ANY.validate_python(given)


def test_the_steps_of_a_campaign_have_names_of_their_own():
    steps = [{"name": "a", "do": {"recipe": "home"}}, {"name": "a", "do": {"recipe": "home"}}]
    with pytest.raises(ValidationError, match="steps have the same name: a; give each its own"):
        Campaign.model_validate({"recipe": "campaign", "steps": steps})


def test_recipes_travel_as_json_and_can_not_be_changed():
    recipe = ANY.validate_python({"recipe": "inflation", "calibration": "cal", "inflation": {"top_kpa": 8.0}})
    assert ANY.validate_json(recipe.model_dump_json()) == recipe
    with pytest.raises(ValidationError, match="frozen"):
        recipe.calibration = "other"
