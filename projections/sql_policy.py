"""What a statement of an analyst may be: one question over the views, in DuckDB's own grammar.

The parse tree that DuckDB itself gives is looked through: names of tables, and of functions that
give tables, must be on the lists below, so a door of a later DuckDB is shut before
it is known.
The database behind has no other files, no network and fixed settings in any case.
"""

import re
from typing import Any

import duckdb
import msgspec

from ledger.errors import Refused
from projections.sql_views import NAMES

STATEMENT_CHARACTERS_MAX = 20_000
KINDS = ("SELECT", "EXPLAIN")
TABLE_FUNCTIONS = frozenset({"range", "generate_series", "unnest", "json_each", "json_tree"})
# of those that give values: they tell of the server, remember something, or only waste time
NOT_FOR_CLIENTS = frozenset(
    {
        "current_setting",
        "getvariable",
        "getenv",
        "write_log",
        "nextval",
        "currval",
        "setseed",
        "pg_sleep",
        "sleep_ms",
        "json_serialize_plan",
        "json_deserialize_sql",
        "json_execute_serialized_sql",
        "parse_duckdb_log_message",
        "pg_conf_load_time",
        "pg_postmaster_start_time",
        "inet_server_addr",
        "inet_client_addr",
        "which_secret",
        "query",
        "query_table",
        "create_sort_key",
    }
)
SHOWN = frozenset({"DESCRIBE", "SUMMARY"})
_EXPLAIN = re.compile(r"\s*EXPLAIN(?:\s+ANALYZE)?\s+", re.IGNORECASE)
_TREE = "SELECT json_serialize_sql(?::VARCHAR)"


class NotAllowed(Refused):
    """The statement is more than a question over the views."""

    def __init__(self, words: str, *args: object) -> None:
        """Take the sentence."""
        super().__init__("errSqlNotAllowed", words, *args)


def invalid(words: str) -> Refused:
    """Give the refusal of what DuckDB does not understand, in its own words."""
    return Refused("errSqlInvalid", words)


def checked(cursor: duckdb.DuckDBPyConnection, text: str) -> duckdb.Statement:
    """Parse a statement, without running it; raises Refused where it must not run."""
    if len(text) > STATEMENT_CHARACTERS_MAX:
        words = f"The statement may have {STATEMENT_CHARACTERS_MAX} characters, not {len(text)}."
        raise NotAllowed(words, STATEMENT_CHARACTERS_MAX)
    if "\0" in text or not _encodes(text):
        raise invalid(
            "The statement holds characters that are none: NUL, or half a surrogate pair."
        )
    try:
        parsed = cursor.extract_statements(text)
    except duckdb.Error as trouble:
        raise invalid(str(trouble)) from None
    kinds = [statement.type.name for statement in parsed]
    if len(parsed) != 1 or kinds[0] not in KINDS:
        said = ", ".join(kinds) or "none"
        raise NotAllowed(f"Give one SELECT statement, not: {said}.", said)
    question = text
    if kinds[0] == "EXPLAIN":
        found = _EXPLAIN.match(text)
        if found is None:
            raise NotAllowed("Write EXPLAIN, or EXPLAIN ANALYZE, and then the SELECT.")
        question = text[found.end() :]
    _look_through(_tree(cursor, question))
    return parsed[0]


def _encodes(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _tree(cursor: duckdb.DuckDBPyConnection, question: str) -> Any:
    try:
        ((text,),) = cursor.execute(_TREE, [question]).fetchall()
        tree = msgspec.json.decode(text)
    except duckdb.Error as trouble:
        raise invalid(str(trouble)) from None
    except RecursionError:
        raise NotAllowed("The statement is nested too deeply.") from None
    if tree["error"]:
        words = str(tree["error_message"])
        if tree["error_type"] == "not implemented":
            raise NotAllowed(f"Give one SELECT statement over the views. {words}")
        raise invalid(words)
    return tree["statements"]


def _look_through(tree: Any) -> None:
    """Refuse every table and function that is not ours to give; CTEs are known by scope."""
    todo: list[tuple[Any, frozenset[str]]] = [(tree, frozenset())]
    while todo:
        node, known = todo.pop()
        if isinstance(node, list):
            todo.extend((part, known) for part in node)
        if not isinstance(node, dict):
            continue
        if isinstance(name := node.get("cte_name"), str):  # recursive: it may name itself
            known |= {name.lower()}
        if isinstance(ctes := node.get("cte_map"), dict):
            for entry in ctes["map"]:
                todo.append((entry["value"], known))
                known |= {entry["key"].lower()}
        _check(node, known)
        todo.extend((part, known) for key, part in node.items() if key != "cte_map")


def _check(node: dict[str, Any], known: frozenset[str]) -> None:
    kind = node.get("type")
    if kind == "BASE_TABLE":
        path = [str(part).lower() for part in node["qualified_name"]["path"]]
        ours = path[-1] in NAMES and path[:-1] in ([], ["main"])
        if not ours and not (len(path) == 1 and path[0] in known):
            name = ".".join(path)
            views = ", ".join(sorted(NAMES))
            raise NotAllowed(f"There is no view '{name}'; there are {views}.", name)
    elif kind == "SHOW_REF":
        if node["query"] is None or node["show_type"] not in SHOWN:
            raise NotAllowed("Of these, DESCRIBE and SUMMARIZE of a view or a SELECT are allowed.")
    elif kind == "TABLE_FUNCTION":
        name = str(node["function"].get("function_name", "")).lower()
        if name not in TABLE_FUNCTIONS:
            listed = ", ".join(sorted(TABLE_FUNCTIONS))
            words = f"The function '{name}' is not allowed where a table is wanted; {listed} are."
            raise NotAllowed(words, name)
    elif str(node.get("function_name", "")).lower() in NOT_FOR_CLIENTS:
        raise NotAllowed(f"The function '{node['function_name']}' is not allowed here.")
