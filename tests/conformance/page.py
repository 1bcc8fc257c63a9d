"""Writes docs/api-m4.md from the catalogue and the tests: `python -m tests.conformance.page`."""

import ast
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from tests.conformance.catalogue import (
    ASKED_ONLY,
    LEFT_OUT,
    NEVER_ANSWERED,
    Field,
    Place,
    catalogue,
    request_places,
    response_places,
    there,
)
from tests.conformance.meaning import held_by

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "api-m4.md"
FORM = {"request": "tests/conformance/test_request_fields.py"} | {
    "response": "tests/conformance/test_response_fields.py"
}
HEAD = """# M4: every call, every field, and its test

Written from the specification's catalogue and the tests by `make docs`; do not edit.

**Form** is the same for all. What a client sends: a value of another type is refused by the name of
its field, what is required is demanded, the rest may be absent or null, and no text makes a failure
(`{request}`, once for each field below).
What it is answered: no other key, the right type, and every field appears when it has a value
(`{response}`).
**Meaning** names, below `tests/`, the test that looks at the field itself, then those of what
follows from it.
""".format(**FORM)


def page() -> str:
    """Write the page."""
    parts = [HEAD, "## Calls\n"]
    asked, answered = list(request_places()), list(response_places())
    for call in catalogue().calls:
        parts.append(f"### {call.title}\n\n`{call.method} {call.path}` ({call.id})\n")
        if call.response_type is not None and not call.response:
            parts.append(f"Answers `{call.response_type}`.\n")
        elif not call.response:
            parts.append("Answers without a body.\n")
        own = [place for place in asked if place.call is call]
        if own:
            parts.append(_table(("request field", "type", "needed", "default"), _asked(own)))
        direct = [p for p in answered if p.call is call and call.response and len(p.path) == 1]
        if direct:
            parts.append(_table(("answer field", "type"), _answered(direct)))
        parts.append(f"Whole: {meaning(call.id)}.\n")
    parts.append("## Types that are answered\n")
    for name, fields in catalogue().types.items():
        if name in ASKED_ONLY:
            continue
        parts.append(f"### {name}\n")
        if name in NEVER_ANSWERED:
            parts.append("Listed by the source; no call of it answers this type.\n")
        else:
            parts.append(_table(("field", "type"), _typed(name, fields)))
    return "\n".join(parts)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    whole = (*head, "meaning")
    lines = ["| " + " | ".join(row) + " |" for row in (whole, ("---",) * len(whole), *rows)]
    return "\n".join(lines) + "\n"


def _asked(places: list[Place]) -> Iterable[tuple[str, ...]]:
    for place in places:
        field = place.field
        default = "" if field.default is None else f"`{field.default!r}`"
        needed = "yes" if field.required else ""
        yield (f"`{_path(place)}`", f"`{field.type}`", needed, default, meaning(place.name))


def _answered(places: list[Place]) -> Iterable[tuple[str, ...]]:
    for place in places:
        yield (f"`{_path(place)}`", f"`{place.field.type}`", meaning(place.name))


def _typed(type_: str, fields: tuple[Field, ...]) -> Iterable[tuple[str, ...]]:
    for field in fields:
        name = f"{type_}.{field.name}"
        test = "left out, as the source allows (C18)" if name in LEFT_OUT else meaning(name)
        yield (f"`{field.name}`", f"`{field.type}`", test)


def _path(place: Place) -> str:
    return place.name.removeprefix(place.call.id).removeprefix(".")


def meaning(name: str) -> str:
    """Write them into a cell of a table."""
    return "<br>".join(f"`{test.removeprefix('tests/')}`" for test in held_by(name))


@cache
def functions_in(path: str) -> frozenset[str]:
    """Find the test functions of a file."""
    tree = ast.parse((ROOT / path).read_text())
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return frozenset(item.name for item in ast.walk(tree) if isinstance(item, kinds))


def names() -> list[str]:
    """Name every call, every field that is asked for and every field that is answered."""
    found = [call.id for call in catalogue().calls]
    found += [place.name for place in request_places()]
    found += [p.name for p in response_places() if p.call.response and len(p.path) == 1]
    for type_, fields in catalogue().types.items():
        if type_ not in ASKED_ONLY | NEVER_ANSWERED:
            found += [f"{type_}.{f.name}" for f in fields if f"{type_}.{f.name}" not in LEFT_OUT]
    return found


def unheld() -> list[str]:
    """Give the names whose meaning no test is named for."""
    return [name for name in names() if not held_by(name)]


if __name__ == "__main__":
    if there():
        PAGE.write_text(page())
    else:
        print(f"{PAGE.name} is left as it is: the specification's catalogue is not there.")
