"""Structural rules of the house. Each message says what to do instead."""

import ast
import importlib
import re
from pathlib import Path

import pytest

from fleetledger.documents import PAGES, WRITTEN
from ledger.events import EVENTS

ROOT = Path(__file__).parent.parent
PACKAGES = ("fleetledger", "ledger", "commands", "projections", "scheduler", "sim", "replay")
FILE_LINES_MAX = 400
FUNCTION_LINES_MAX = 70
SOURCES = sorted(p for name in (*PACKAGES, "tests", "bench") for p in (ROOT / name).rglob("*.py"))


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", SOURCES, ids=_name)
def test_files_and_functions_fit_on_a_few_screens(path: Path) -> None:
    text = path.read_text()
    lines = text.count("\n")
    assert lines <= FILE_LINES_MAX, f"{_name(path)} has {lines} lines: split it by noun"
    for item in ast.walk(ast.parse(text)):
        if isinstance(item, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (item.end_lineno or item.lineno) - item.lineno + 1
            assert length <= FUNCTION_LINES_MAX, (
                f"{_name(path)}: {item.name} has {length} lines: give its parts names"
            )


@pytest.mark.parametrize("event", EVENTS, ids=lambda event: event.__name__)
def test_every_event_says_what_happened_and_is_evolved(event: type) -> None:
    assert event.__doc__, f"{event.__name__}: say in one sentence what happened, and on whose word"
    evolve = "".join(p.read_text() for p in (ROOT / "ledger").glob("evolve*.py"))
    if EVENTS[event] != "access":  # these change no state
        found = re.search(rf"\b{event.__name__}\b", evolve)
        assert found, f"evolve() has no arm for {event.__name__}"
    assert not event.__name__.endswith(("Updated", "Event", "StatusChanged")), (
        f"{event.__name__}: an event says why, not which row changed"
    )


@pytest.mark.parametrize("name", WRITTEN)
def test_pages_written_from_the_code_are_fresh(name: str) -> None:
    assert WRITTEN[name]() == (PAGES / name).read_text(), "run `make docs`"


def test_every_file_named_in_the_architecture_exists() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text()
    named = set(re.findall(r"`([a-z_]+(?:/[a-z_]+)*(?:/|\.py|\.md))`", text))
    assert len(named) > 20, "ARCHITECTURE.md should name the files of the code map"
    missing = sorted(name for name in named if not (ROOT / name).exists())
    assert not missing, f"ARCHITECTURE.md names what does not exist: {missing}"


@pytest.mark.parametrize("package", PACKAGES)
def test_our_packages_are_ours(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__file__ is not None
    assert Path(module.__file__).is_relative_to(ROOT), f"{package} is shadowed by another one"


def test_test_folders_are_packages() -> None:
    missing = [
        _name(folder)
        for folder in (ROOT / "tests").rglob("*")
        if folder.is_dir()
        and any(folder.glob("*.py"))
        and not (folder / "__init__.py").exists()
        and "__pycache__" not in folder.parts
    ]
    assert not missing, f"without __init__.py these shadow our packages: {missing}"


def test_nothing_names_a_machine_or_an_index() -> None:
    forbidden = re.compile(r"(?:extra-)?index-url|(?:^|[^\w.])/(?:work|root|home)/\w", re.MULTILINE)
    files = [*SOURCES, *ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("requirements/*")]
    here = Path(__file__)
    found = [_name(p) for p in files if p != here and forbidden.search(p.read_text())]
    assert not found, f"paths of one machine, or package indexes, in {found}"
