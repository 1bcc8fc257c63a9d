"""The cookbook's commands, run anew: the same answers but for names, numbers and times."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.fleetledger.cookbook import MAP, PAGE, Shell, blocks, commands
from tests.golden import same_form

_OF_A_RUN = re.compile(r"TO\d{8}-\d{6}[A-Z]?|[0-9A-F]{24}")


def form(text: str) -> Any:
    """Give JSON as it is, other texts without their numbers."""
    plain = _OF_A_RUN.sub("ID", text)
    try:
        return json.loads(plain)
    except ValueError:
        return re.sub(r"\d[\d.,:]*", "N", plain)


def test_every_command_of_the_cookbook_does_what_the_page_shows(tmp_path: Path) -> None:
    if not MAP.is_file():
        pytest.skip("no map beside the repository (../shared/data/smap)")
    shell = Shell(tmp_path)
    try:
        for _, _, block in blocks(PAGE.read_text()):
            for command, told in commands(block):
                expected, actual = form(told), form(shell.run(command))
                if isinstance(expected, dict | list):
                    same_form(expected, actual, command)
                else:
                    assert actual == expected, command
    finally:
        shell.close()
