"""Settings of a server: flags over environment over DIR/config.toml over defaults."""

from enum import StrEnum
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from ledger.snapshot import EVENTS_APART

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})


class Auth(StrEnum):
    """Who may call."""

    KEYS = "keys"
    NONE = "none"


class Faults(StrEnum):
    """Named mixes of `sim.faults`, of which a server has the part of robots and their links."""

    NONE = "none"
    LATE = "late"  # a tenth of all moves begins late
    STANDARD = "standard"  # a hard day


class Format(StrEnum):
    """How rows are printed."""

    TABLE = "table"
    JSON = "json"
    CSV = "csv"


class Settings(BaseSettings):
    """All options of `serve`: TOML keys and FLEETLEDGER_ variables, and most are flags too."""

    model_config = SettingsConfigDict(env_prefix="FLEETLEDGER_", extra="forbid")

    data: Path = Field(description="Folder of ledger, telemetry and caches.")
    host: str = "127.0.0.1"
    port: int = Field(5800, ge=0, le=65535)
    auth: Auth = Auth.KEYS
    scene: tuple[Path, ...] = ()
    simulate: bool = False
    faults: Faults = Field(
        Faults.NONE, description="What goes wrong with simulated robots and their links."
    )
    speed: float = Field(1.0, gt=0, le=100)
    seed: int = 1
    rdscore_port: int | None = Field(None, ge=0, le=65534)
    feed_port: int | None = Field(
        None, ge=0, le=65535, description="Port of 127.0.0.1 for followers over zenoh."
    )
    snapshot_events: int = Field(EVENTS_APART, ge=1000, description="Events between two snapshots.")
    answers_max: int = Field(
        10_000, ge=1, le=100_000, description="Answers kept for repeated Idempotency-Keys."
    )
    answers_age_s: int = Field(
        86_400, ge=1, le=31_536_000, description="No answer is kept longer, in scaled time."
    )
    disk_reserve_mb: int = Field(
        64, ge=0, le=1_000_000, description="Free space below which no command is accepted."
    )
    failure_grace_s: float = Field(
        30.0, ge=0, le=3600, description="How long queries go on once the ledger has failed."
    )
    sql_seconds: float = Field(30.0, gt=0, le=600, description="Time of a statement of /api/sql.")
    sql_memory_mb: int = Field(
        1000, ge=200, le=100_000, description="Memory of all statements of /api/sql together."
    )
    tls_cert: Path | None = Field(None, description="PEM file of the certificate chain.")
    tls_key: Path | None = Field(None, description="PEM file of its key.")
    telemetry_keep_days: float = Field(
        7.0, ge=0, description="Age at which telemetry files go; 0 = none is written."
    )
    telemetry_keep_mb: int = Field(
        2048, ge=0, description="Megabytes of telemetry files kept; 0 = none is written."
    )
    log_json: bool = False

    @model_validator(mode="after")
    def open_only_on_loopback(self) -> "Settings":
        """A server without keys must not be reachable from outside."""
        if self.auth is Auth.NONE and self.host not in LOOPBACK:
            raise ValueError(
                f"--auth none is only allowed on a loopback host, not on {self.host}: "
                "use --auth keys, or --host 127.0.0.1"
            )
        return self

    @model_validator(mode="after")
    def tls_needs_both_files(self) -> "Settings":
        """A certificate without its key must not end in plain HTTP."""
        if (self.tls_cert is None) is not (self.tls_key is None):
            raise ValueError("--tls-cert and --tls-key belong together: give both, or none")
        return self

    @property
    def scheme(self) -> str:
        """How URLs of this server begin."""
        return "http" if self.tls_cert is None else "https"

    @property
    def ledger(self) -> Path:
        """Folder of the events."""
        return self.data / "ledger"

    @property
    def snapshots(self) -> Path:
        """Folder of the snapshots, a cache."""
        return self.data / "snapshots"

    @property
    def telemetry(self) -> Path:
        """Folder of robot reports and plans."""
        return self.data / "telemetry"

    @classmethod
    def load(cls, data: Path, **flags: Any) -> "Settings":
        """Read the settings for a data folder; flags that are None were not given."""
        given = {name: value for name, value in flags.items() if value is not None}
        file = data / "config.toml"

        class FromFolder(cls):  # type: ignore[valid-type, misc]
            @classmethod
            def settings_customise_sources(
                cls,
                settings_cls: type[BaseSettings],
                init_settings: PydanticBaseSettingsSource,
                env_settings: PydanticBaseSettingsSource,
                dotenv_settings: PydanticBaseSettingsSource,
                file_secret_settings: PydanticBaseSettingsSource,
            ) -> tuple[PydanticBaseSettingsSource, ...]:
                return init_settings, env_settings, TomlConfigSettingsSource(settings_cls, file)

        settings: Settings = FromFolder(data=data, **given)
        return settings
