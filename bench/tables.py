"""Rows of figures as a table for people; rows need not have the same columns."""

from collections.abc import Iterable, Mapping

from rich.console import Console
from rich.table import Table

WIDTH = 200


def show(title: str, rows: Iterable[Mapping[str, float | str]]) -> None:
    """Print them."""
    rows = list(rows)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = Table(title=title)
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        values = (row.get(column, "") for column in columns)
        table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in values))
    Console(width=WIDTH).print(table)
