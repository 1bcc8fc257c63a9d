"""Scenes are configured: what is accepted, and what is refused.

A setting that could only be stored and never obeyed is refused, so that nobody believes it was
heard (`commands.scene_settings` says which, and why).
"""

from typing import Any

from commands.command import Command, Decision, known_scene
from commands.rejected import Reason, Rejected
from commands.scene_settings import (
    CHARGING,
    FIXED,
    SELECTION_CHARS_MAX,
    SETTINGS,
    SORT_FIELDS_MAX,
    Setting,
    in_force,
    only_value,
)
from ledger.events import SceneConfigured
from ledger.ids import SceneId
from ledger.scene import Group
from ledger.scene_config import DISPATCH_SORT_FIELDS, ChargingLevels, SceneConfig
from ledger.state import Fleet


class ConfigureScene(Command, frozen=True, kw_only=True):
    """Change the settings of a scene."""

    scene: SceneId
    config: SceneConfig  # all of them


def configure(fleet: Fleet, command: ConfigureScene) -> Decision:
    """A scene may be set up while it is out of service."""
    scene = known_scene(fleet, command.scene)
    check_settings(command.config, scene.groups)
    if command.config == in_force(scene.config):
        return Decision()
    return Decision(events=(SceneConfigured(scene=scene.id, config=command.config),))


def check_settings(config: SceneConfig, groups: tuple[Group, ...]) -> None:
    """Refuse what is not supported, out of bounds, or at odds with itself or with the scene."""
    for setting in SETTINGS:
        _check(setting, getattr(config, setting.field), setting.name)
    _check_sort(config.dispatch_sort)
    if len(config.selection) > SELECTION_CHARS_MAX:
        raise _invalid("selectConfig", f"may have {SELECTION_CHARS_MAX} characters")
    _check_levels(config)
    known = {group.id for group in groups}
    for group in config.charging.by_group:
        if group not in known:
            message = f"Field 'chargingConfig.groupedConfigs': there is no robot group {group}."
            raise Rejected(Reason.GROUP_UNKNOWN, message, group)


def _check(setting: Setting, value: Any, field: str) -> None:
    if setting.fixed and value != FIXED[setting.field]:
        message = (
            f"Field '{field}' ({setting.field} in scene files) is not supported: "
            f"it can only be {only_value(setting)}, for {setting.fixed}."
        )
        raise Rejected(Reason.SCENE_CONFIG_UNSUPPORTED, message, field, FIXED[setting.field])
    if setting.bounds is not None:
        least, most = setting.bounds
        if not least <= value <= most:
            raise _invalid(field, f"must be from {least:.15g} to {most:.15g}")


def _check_sort(names: tuple[str, ...]) -> None:
    if len(names) > SORT_FIELDS_MAX:
        raise _invalid("dispatchSort", f"may have {SORT_FIELDS_MAX} entries")
    for name in names:
        if name.removeprefix("-") not in DISPATCH_SORT_FIELDS:
            known = ", ".join(DISPATCH_SORT_FIELDS)
            what = f"cannot sort by '{name[:100]}'; it can by {known}, '-' in front = descending"
            raise _invalid("dispatchSort", what)


def _check_levels(config: SceneConfig) -> None:
    charging = config.charging
    named = {"chargingConfig.defaultConfig": charging.default}
    named |= {f"chargingConfig.groupedConfigs.{g}": c for g, c in charging.by_group.items()}
    for field, levels in named.items():
        for setting in CHARGING:
            _check(setting, getattr(levels, setting.field), f"{field}.{setting.name}")
        if not _ordered(levels):
            order = "0 <= chargeOnly <= chargeNeed <= chargeOk <= chargeFull <= 1 must hold"
            raise Rejected(Reason.SCENE_CONFIG_INVALID, f"Field '{field}': {order}.", field)


def _ordered(levels: ChargingLevels) -> bool:
    only, need = levels.charge_only, levels.charge_need
    return 0 <= only <= need <= levels.charge_ok <= levels.charge_full <= 1


def _invalid(field: str, what: str) -> Rejected:
    return Rejected(Reason.SCENE_CONFIG_INVALID, f"Field '{field}' {what}.", field)
