"""The rules of the house that no linter knows."""

import importlib
import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted(path for top in ("bscd", "drivers", "tests") for path in (ROOT / top).rglob("*.py"))


@pytest.mark.parametrize("name", ["demo", "test", "bench", "setup"])
def test_scripts_can_be_run(name):
    assert os.access(ROOT / "scripts" / name, os.X_OK)


def test_readme_begins_with_the_picture_and_the_two_commands():
    text = (ROOT / "README.md").read_text()
    picture, demo, test = (text.index(part) for part in ("![", "scripts/demo", "scripts/test"))
    assert picture < demo < test < 2000
    linked = re.search(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert linked
    assert (ROOT / linked[1]).is_file()


def test_ci_calls_only_the_tests():
    lines = (ROOT / ".ci/run").read_text().splitlines()
    commands = [line for line in lines if line and not line.startswith(("#", "set "))]
    assert len(commands) == 1
    assert commands[0].endswith('scripts/test"')


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_modules_are_short_and_finished(path):
    text = path.read_text()
    assert len(text.splitlines()) <= 400
    assert path.stem not in {"utils", "helpers", "common", "manager"}
    if path != Path(__file__):
        assert not re.search(r"\b(TODO|FIXME|XXX)\b|pytest\.mark\.xfail", text)
    if "tests" not in path.relative_to(ROOT).parts:
        assert "NotImplementedError" not in text


def test_nothing_in_a_page_comes_from_another_host():
    elsewhere = re.compile(r"""(src|href)\s*=\s*["']?(https?:)?//|url\(\s*["']?(https?:)?//""")
    for page in [*(ROOT / "bscd").rglob("*.html"), *(ROOT / "bscd").rglob("*.css")]:
        assert not elsewhere.search(page.read_text()), page


@pytest.mark.parametrize("stub", sorted((ROOT / "bscd").rglob("__init__.pyi")), ids=lambda p: p.parent.name)
def test_what_a_package_offers_is_not_named_like_a_module_of_it(stub):
    """Importing the module would put it in the place of what is loaded when asked for."""
    package = importlib.import_module(str(stub.parent.relative_to(ROOT)).replace("/", "."))
    assert package.__all__
    assert not set(package.__all__) & {path.stem for path in stub.parent.iterdir()}
    for name in package.__all__:
        assert getattr(package, name).__class__.__name__ != "module"
