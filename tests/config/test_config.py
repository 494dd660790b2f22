"""The configuration: what is wrong is said with the file, the key, the value and what is allowed."""

import re
import tomllib
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from pydantic import BaseModel, ConfigDict, Field

from bscd.calibration import GridTarget
from bscd.config import config_schema, load_config, load_target, parse_config
from bscd.config.load import parse_target
from bscd.errors import InputError
from drivers.registry import DriverEntry

ROOT = Path(__file__).resolve().parents[2]
TWIN = re.sub(r"(# the paper measured.*|repeatability_.*)\n", "", (ROOT / "config/twin.toml").read_text())


@pytest.mark.parametrize("name", ["twin.toml", "rig.example.toml"])
def test_the_shipped_files_are_valid(name):
    config = load_config(ROOT / "config" / name)
    assert config.target.grid() == GridTarget()
    assert config.twin is not None


def test_the_example_explains_every_key():
    lines = (ROOT / "config/rig.example.toml").read_text().splitlines()
    for place, line in enumerate(lines):
        if "=" in line and not line.startswith("#"):
            assert lines[place - 1].startswith("# "), f"no comment above: {line}"


BAD = [
    ("pitch_mm = 2.0", "pitch_cm = 0.2", "target.pitch_cm: unknown key; did you mean pitch_mm?"),
    ("alpha_deg = 161.4", "alpha_deg = 80", "prism.alpha_deg = 80: must be above 90 and below 180"),
    ("alpha_deg = 161.4", "alpha_deg = 180", "prism.alpha_deg = 180: must be above 90 and below 180"),
    ("subset_px = 21", "subset_px = 20", "dic: subset_px must be odd"),
    ("search_px = 41", "search_px = 21", "dic: search_px must be above subset_px = 21"),
    ("positions = 17", "positions = 16", "scan: positions must be odd"),
    ("pitch_mm = 2.0", 'pitch_mm = "two"', "target.pitch_mm = 'two': must be a number, above 0"),
    ("pitch_mm = 2.0", "pitch_mm = nan", "target.pitch_mm = nan: must be"),
    ("raised_mm = 70.0", "raised_mm = 2.0", "prism: lowered_mm = 5 must be below raised_mm = 2"),
    ('quantity = "rotation"', 'quantity = "spin"', "[devices.rotation] quantity = 'spin': must be one of 'rotation'"),
    (
        'quantity = "rotation"',
        'quantity = "rotation"\nlimits_deg = [10, -10]',
        "[devices.rotation] limits_deg: the limits 10, -10 must be low, then high",
    ),
    (
        'quantity = "rotation"',
        'quantity = "rotation"\nspeed_mm_s = 3',
        "[devices.rotation] speed_mm_s: unknown key; did you mean speed_deg_s?",
    ),
    (
        'driver = "camera.simulated"',
        'driver = "camera.simulatd"',
        "[devices.primary] driver = 'camera.simulatd': no such camera driver; did you mean camera.simulated?",
    ),
    ("level = 0.7", "levle = 0.7", "[twin] light.levle: unknown key; did you mean level?"),
    ("pitch_mm = 2.0", 'pitch_mm = "2.0"', "target.pitch_mm = '2.0': must be a number, above 0"),
    ("positions = 17", "positions = true", "scan.positions = true: must be a whole number, at least 5 and at most 201"),
    ("positions = 17", "positions = 9.5", "scan.positions = 9.5: must be a whole number, at least 5 and at most 201"),
    ("settle_s = 0.2", "settle_s = inf", "scan.settle_s = inf: must be a finite number, at least 0"),
    ('poses = ["face", "corner"]', 'poses = "face"', "scan.poses = 'face': must be a list in [ ]"),
    ('poses = ["face", "corner"]', 'poses = ["face", "face"]', 'scan: poses must be ["face"] or ["face", "corner"]'),
    ('solver = "projection"', 'solver = "best"', "calibration.solver = 'best': must be 'projection' or 'smallest'"),
    ("step_px = 10", "colour = 10", "dic.colour: unknown key; allowed: subset_px, search_px, step_px"),
    ('quantity = "jack"\n', "", "[devices.jacks] quantity: is missing; must be one of 'rotation'"),
    ('driver = "camera.simulated"\n', "", "[devices.primary] driver: is missing; known: camera."),
    (
        'quantity = "translation"',
        'quantity = "translation"\nlimits_deg = [0, 90]',
        "[devices.translation] limits_deg: unknown key; did you mean limits_mm?",
    ),
    (
        'driver = "camera.simulated"',
        'driver = "camera.simulated"\nexposure_s = "0.01"',
        "[devices.primary] exposure_s = '0.01': must be a number, above 0",
    ),
    ("edge_mm = [0.0, -210.0, 0.0]", "edge_mm = [0.0, -210.0]", "[twin] prism.edge_mm: has too few values"),
    ("edge_mm = [0.0, -210.0, 0.0]", "edge_mm = [0, -210, 0, 0]", "[twin] prism.edge_mm: has 4 values; must have 3"),
    (
        'quantity = "translation"',
        'quantity = "rotation"',
        "[devices.translation] quantity = 'rotation': must be 'translation' here",
    ),
    (
        'camera = "auxiliary"',
        'camera = "primary"',
        "[devices.auxiliary] camera = 'primary': must be 'auxiliary' here",
    ),
    (
        "step_mm = 2.0",
        "step_mm = 10.0",
        "[scan] origin_mm, step_mm, positions: ask for -30 to 130 mm; [devices.translation] allows 0 to 100",
    ),
    (
        "corner_rotation_deg = 45.0",
        "corner_rotation_deg = 225.0",
        "[scan] corner_rotation_deg and face_rotation_deg: ask for 0 to 225 deg; [devices.rotation] allows -180 to 180",
    ),
    (
        "raised_mm = 70.0",
        "raised_mm = 85.0",
        "[prism] lowered_mm and raised_mm: ask for 5 to 85 mm; [devices.jacks] allows 0 to 84",
    ),
    ("exposure_s = 0.02", "exposure_s = 2.0", "[scan] exposure_s: ask for 2 s; [devices.primary] allows 1e-05 to 1"),
    ("gain_db = 0.0", "gain_db = 30.0", "[scan] gain_db: ask for 30 db; [devices.auxiliary] allows 0 to 24"),
    ("[rig]", "[rigg]", "rigg: unknown key; did you mean rig?"),
    ("[devices.rotation]", "[devices.rotations]", "devices.rotation: is missing"),
]


@pytest.mark.parametrize(("good", "bad", "message"), BAD, ids=[bad for _, bad, _ in BAD])
def test_bad_values_are_named(good, bad, message):
    assert good in TWIN
    with pytest.raises(InputError) as caught:
        parse_config(TWIN.replace(good, bad, 1), "my-rig.toml")
    lines = str(caught.value).splitlines()
    assert any(line.startswith(f"my-rig.toml: {message}") for line in lines), str(caught.value)


def test_all_problems_are_reported_together():
    text = TWIN.replace("subset_px = 21", "subset_px = 20").replace("pitch_mm = 2.0", "pitch_mm = -1", 1)
    with pytest.raises(InputError) as caught:
        parse_config(text)
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize(("good", "bad", "message"), BAD, ids=[bad for _, bad, _ in BAD])
def test_messages_have_no_words_of_the_validator(good, bad, message):
    with pytest.raises(InputError) as caught:
        parse_config(TWIN.replace(good, bad, 1))
    for word in ("input", "instance", "tuple", "dictionary", "integer", "discriminator", "literal", "pydantic"):
        assert word not in str(caught.value).lower()


def test_a_section_that_is_a_value():
    with pytest.raises(InputError, match="target = 3: must be a section"):
        parse_target("target = 3")


def test_simulated_devices_need_a_twin():
    with pytest.raises(InputError, match=r"no \[twin\] section"):
        parse_config(TWIN[: TWIN.index("[twin")])


def test_broken_toml_and_missing_files(tmp_path):
    with pytest.raises(InputError, match="not valid TOML"):
        parse_config("[rig\n")
    with pytest.raises(InputError, match=r"none\.toml: can not be read"):
        load_config(tmp_path / "none.toml")


class _ThirdPartyOptions(BaseModel):
    model_config = ConfigDict(extra="forbid")
    port: str
    speed_deg_s: float = Field(1.0, gt=0)


ENTRY = DriverEntry("axis", _ThirdPartyOptions, lambda options, context: None)


def test_a_third_partys_driver_brings_its_own_options(monkeypatch):
    from importlib.metadata import entry_points

    mine = EntryPoint("axis.acme", "tests.config.test_config:ENTRY", "bscd.drivers")
    known = EntryPoints([*entry_points(group="bscd.drivers"), mine])
    monkeypatch.setattr("drivers.registry.entry_points", lambda group: known)
    text = TWIN.replace('driver = "axis.simulated"\nquantity = "rotation"', 'driver = "axis.acme"\nport = "COM1"')
    assert parse_config(text).devices.rotation.options.port == "COM1"
    with pytest.raises(InputError, match=r"\[devices\.rotation\] speed_deg_s = -1: must be above 0"):
        parse_config(text.replace('port = "COM1"', 'port = "COM1"\nspeed_deg_s = -1'))
    assert "axis.acme" in str(config_schema()["$defs"]["DevicesConfig"]["properties"]["rotation"])


def test_the_schema_describes_the_shipped_files():
    schema = config_schema()
    for name in ("twin.toml", "rig.example.toml"):
        with (ROOT / "config" / name).open("rb") as file:
            Draft202012Validator(schema).validate(tomllib.load(file))


def test_target_beside_a_manifest(tmp_path):
    (tmp_path / "rig.toml").write_text("[target]\ncolumns = 7\nrows = 15\n[sphere]\nradius_mm = 20\n")
    target = load_target(tmp_path / "rig.toml")
    assert (target.target.columns, target.target.rows) == (7, 15)
    assert target.sphere is not None
    assert target.sphere.radius_mm == 20.0
    assert parse_target(TWIN).target.grid() == GridTarget()
    with pytest.raises(InputError, match="did you mean columns"):
        parse_target("[target]\ncolumn = 7\n")


def test_a_table_of_marks(tmp_path):
    rows = "\n".join(f"m{i},{i},{i * i},{-i}" for i in range(8))
    (tmp_path / "marks.csv").write_text("label,x_mm,y_mm,z_mm\n" + rows)
    target = parse_target('[target]\nkind = "points"\ntable = "marks.csv"\nmark_size_mm = 3').target
    points = target.points(tmp_path)
    assert points.labels[3] == "m3"
    assert np.array_equal(points.xyz_mm[3], [3.0, 9.0, -3.0])
    with pytest.raises(InputError, match="needs the cube"):
        target.grid()
    (tmp_path / "marks.csv").write_text("name,x\n1,2\n")
    with pytest.raises(InputError, match="not a table of marks"):
        target.points(tmp_path)
