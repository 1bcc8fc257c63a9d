"""Pages of `docs/` that are written from the code: `make docs`, and a test keeps them fresh."""

import inspect
from pathlib import Path
from typing import get_type_hints

import msgspec

from commands.scene_settings import CHARGING, SETTINGS, Setting
from ledger.events import EVENTS, Event
from ledger.scene_config import ChargingLevels, SceneConfig
from projections.sql_views import views_page

ROOT = Path(__file__).parent.parent
PAGES = ROOT / "docs"

_HEAD = """# Events

Written from `ledger/events/` by `make docs`; do not edit.
Every message of the ledger is one of these, as JSON with its name in `type`.
"""


def events_page() -> str:
    """Describe every event: its sentence, its topic, and its fields."""
    header = [f"`{field.encode_name}`" for field in msgspec.structs.fields(Event)]
    parts = [_HEAD, f"All have {', '.join(header)} as well.\n"]
    folder = None
    for event, aggregate in EVENTS.items():
        if aggregate != folder:
            folder = aggregate
            parts.append(f"## {aggregate.capitalize()}\n")
        parts.append(f"### {event.__name__}\n")
        parts.append(f"{inspect.cleandoc(event.__doc__ or '')}\n")
        parts.append(f"Topic `{aggregate}/{event.__name__}`.\n")
        rows = _fields(event)
        if rows:
            parts.append("\n".join(["| field | type | default |", "|---|---|---|", *rows]) + "\n")
    return "\n".join(parts)


def _fields(event: type[Event]) -> list[str]:
    own = {f.name for f in msgspec.structs.fields(event)} - {
        f.name for f in msgspec.structs.fields(Event)
    }
    hints = get_type_hints(event)
    rows = []
    for field in msgspec.structs.fields(event):
        if field.name not in own:
            continue
        default = "" if field.default is msgspec.NODEFAULT else f"`{field.default!r}`"
        if default and isinstance(field.default, msgspec.Struct):
            default = "its own defaults"
        rows.append(f"| `{field.name}` | {_type_name(hints[field.name])} | {default} |")
    return rows


def _type_name(hint: object) -> str:
    name = hint.__name__ if isinstance(hint, type) and not hasattr(hint, "__args__") else str(hint)
    for prefix in ("ledger.ids.", "ledger.scene_config.", "ledger.scene.", "ledger.state."):
        name = name.replace(prefix, "")
    return f"`{name.replace('ledger.events.orders.', '')}`".replace("|", "or")


_SETTINGS_HEAD = """# Settings of a scene

Written from `commands/scene_settings.py` by `make docs`; do not edit.
`GET /api/fleet/scenes/{id}/config` reads them.
`POST` there, or to `config/patch`, changes those that it names: an event, effective at once.
In scene files they stand in `config` by the name in the second column.
A change that nothing would obey is refused (`errSceneConfigUnsupported`).
So is a setting that is not in this table (`errFieldUnknown`).
"""


def settings_page() -> str:
    """Describe every setting: its default, its unit, and its effect or why it has none."""
    parts = [_SETTINGS_HEAD, *_table(SETTINGS, SceneConfig())]
    parts.append("\n## chargingConfig\n")
    parts.append(
        "`defaultConfig` is for all robot groups, `groupedConfigs` for the groups by id that "
        "differ.\n`chargeOnly` <= `chargeNeed` <= `chargeOk` <= `chargeFull` must hold.\n"
    )
    parts += _table(CHARGING, ChargingLevels())
    return "\n".join(parts) + "\n"


def _table(settings: tuple[Setting, ...], defaults: msgspec.Struct) -> list[str]:
    rows = [
        "| setting | in files | default | unit | values | effect |",
        "|---|---|---|---|---|---|",
    ]
    for setting in settings:
        default = msgspec.json.encode(getattr(defaults, setting.field)).decode()
        bounds = "" if setting.bounds is None else "{:.15g} to {:.15g}".format(*setting.bounds)
        values = "default only" if setting.fixed else bounds
        effect = f"None: {setting.fixed}." if setting.fixed else setting.effect
        cells = (f"`{setting.name}`", f"`{setting.field}`", f"`{default}`", setting.unit, values)
        rows.append(f"| {' | '.join(cells)} | {effect} |")
    return rows


# each page by its name in docs/, and what writes it
WRITTEN = {"events.md": events_page, "settings.md": settings_page, "sql.md": views_page}


def main() -> None:
    """Write all pages."""
    for name, page in WRITTEN.items():
        (PAGES / name).write_text(page())


if __name__ == "__main__":
    main()
