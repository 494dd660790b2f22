import math

import pytest
from pydantic import ValidationError

from bscd.procedures import ScanRecipe


def places(recipe: ScanRecipe) -> list[tuple[str, int, float, float]]:
    return [(step.pose, step.position, step.y_mm, step.rotation_deg) for step in recipe.steps()]


CASES = [
    (
        "corner at POS.0, then the face",
        {"positions": 3},
        [("corner", 0, 0.0, 45.0), ("face", -1, -2.0, 0.0), ("face", 0, 0.0, 0.0), ("face", 1, 2.0, 0.0)],
    ),
    (
        "the corner through all positions too",
        {"positions": 3, "step_mm": 1.5, "poses": ("face", "corner")},
        [
            *(("corner", k, 1.5 * k, 45.0) for k in (-1, 0, 1)),
            *(("face", k, 1.5 * k, 0.0) for k in (-1, 0, 1)),
        ],
    ),
    (
        "validation: only the poses given, off the positions, turned, numbered beyond POS.+1",
        {"positions": 3, "y_offsets_mm": (1.0, -1.0), "rotation_offset_deg": 2.0},
        [("face", 2, -1.0, 2.0), ("face", 3, 1.0, 2.0)],
    ),
    (
        "other readings of the poses",
        {"positions": 1, "face_rotation_deg": 10.0, "corner_rotation_deg": 55.0},
        [("corner", 0, 0.0, 55.0), ("face", 0, 0.0, 10.0)],
    ),
]


@pytest.mark.parametrize(("changes", "expected"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_steps(changes: dict, expected: list) -> None:
    assert places(ScanRecipe(kind="bsc", **changes)) == expected


def test_the_papers_scan() -> None:
    recipe = ScanRecipe(kind="reference", frames_per_position=1)
    face = [step for step in recipe.steps() if step.pose == "face"]
    assert [step.position for step in face] == list(range(-8, 9))
    assert (face[0].y_mm, face[-1].y_mm) == (-16.0, 16.0)
    assert {step.phase for step in recipe.steps()} == {"reference-corner", "reference-face"}
    assert recipe.frame_count == 2 * 18
    assert ScanRecipe(kind="bsc", frames_per_position=3).frame_count == 18 * 3


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"positions": 4}, "must be odd"),
        ({"poses": ("face", "face")}, "twice"),
        ({"poses": ()}, "poses"),
        ({"corner_rotation_deg": 0.0}, "equal"),
        ({"rotation_offset_deg": 3.0}, "y_offsets_mm"),
        ({"y_offsets_mm": (1.0, 1.0)}, "twice"),
        ({"exposure_s": 0.0}, "exposure_s"),
        ({"step_mm": math.nan}, "step_mm"),
        ({"stepmm": 2.0}, "stepmm"),
    ],
)
def test_impossible_recipes_are_refused(changes: dict, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        ScanRecipe(kind="bsc", **changes)


def test_between_lies_half_way_and_goes_through_its_text() -> None:
    recipe = ScanRecipe(kind="reference", positions=5, step_mm=4.0).between(2.5)
    assert recipe.kind == "bsc"
    assert [step.y_mm for step in recipe.steps()] == [-6.0, -2.0, 2.0, 6.0]
    assert {step.rotation_deg for step in recipe.steps()} == {2.5}
    assert ScanRecipe.model_validate_json(recipe.model_dump_json()) == recipe
