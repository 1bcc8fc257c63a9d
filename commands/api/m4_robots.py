"""Wire models of the M4 calls that set robots up, and what they ask for (spec/m4.md §4)."""

from typing import Annotated, Any

from pydantic import Field

from commands.api.answering import Asked
from commands.api.m4_models import Int, Remark, Text, Wire, json_text
from commands.robot_config import BINS_MAX, RobotConfigPatch
from commands.robot_names import ROBOTS_MAX
from commands.robots import SERIES_MAX, CreateRobotSeries
from ledger.ids import RobotName, SceneId
from ledger.scene import ConnectionType, RobotConfig, RobotVendor

TAGS_MAX = 100
Tags = Annotated[list[Text], Field(max_length=TAGS_MAX)]
_GROUP = "Robot group of the scene, by its id."
_BINS = f"Storage places = loads it carries at once, 1 to {BINS_MAX}."


class RobotParts(Wire):
    """What all set-ups of robots share."""

    remark: Remark | None = Field(None, description="Remark.")
    groupId: Int | None = Field(None, description=_GROUP)
    tags: Tags | None = Field(None, description="Tags.")
    vendor: RobotVendor | None = Field(
        None, description="Brand: Seer (SEER), Hai (Hai Robotics), Hik (Hikvision)."
    )
    selfBinNum: Int | None = Field(None, description=_BINS)
    image: Any = Field(None, description="Picture: any JSON, kept as it is.")
    connectionType: ConnectionType | None = Field(
        None, description="Who connects: the dispatcher, the robot, or both through a gateway."
    )
    robotIp: Text | None = Field(
        None, description="Address; required where connectionType is FleetToRobot."
    )
    robotPortStart: Int | None = Field(
        None, description="First TCP port for requests to it, 1 to 65535."
    )
    ssl: bool | None = Field(None, description="Use TLS (robots of Hai).")
    gwAuthId: Text | None = Field(
        None, description="Gateway user; required where connectionType is GwWs."
    )
    gwAuthSecret: Text | None = Field(
        None,
        description="Gateway secret; required where connectionType is GwWs. Never shown again; "
        "absent or empty, the one that is kept for the robot stays.",
    )
    simulated: bool | None = Field(None, description="Make a simulated robot.")
    plusOne: bool | None = Field(
        None, description="One load more, on the fork (N + 1); for several storage places only."
    )

    def secret(self) -> str | None:
        """Give the gateway secret apart: it goes to the vault, and no further."""
        return self.gwAuthSecret or None

    def _image(self) -> str | None:
        if self.image is None:
            return None
        return json_text({"image": self.image}, "image").removeprefix('{"image":')[:-1]


class RobotSetUp(RobotParts):
    """A set-up as a whole. Absent and null mean the default."""

    groupId: Int | None = Field(0, description=_GROUP)
    tags: Tags | None = Field([], description="Tags.")
    vendor: RobotVendor | None = Field(
        RobotVendor.SEER, description="Brand: Seer (SEER), Hai (Hai Robotics), Hik (Hikvision)."
    )
    selfBinNum: Int | None = Field(1, description=_BINS)
    simulated: bool | None = Field(False, description="Make a simulated robot.")

    def config(self, name: str, *, disabled: bool = False) -> RobotConfig:
        """Translate; empty texts are absent ones, as in the examples of the source."""
        return RobotConfig(
            name=RobotName(name),
            group=self.groupId or 0,
            disabled=disabled,
            simulated=self.simulated is True,
            remark=self.remark or None,
            tags=tuple(self.tags or ()),
            vendor=self.vendor or RobotVendor.SEER,
            bin_count=1 if self.selfBinNum is None else self.selfBinNum,
            image=self._image(),
            connection=self.connectionType,
            host=self.robotIp or None,
            port_first=self.robotPortStart,
            tls=self.ssl,
            gateway_user=self.gwAuthId or None,
            gateway_secret_kept=self.secret() is not None,
            plus_one=self.plusOne,
        )


class SceneRobot(RobotSetUp):
    """A robot of a scene."""

    robotName: Text | None = Field("", description="Name, unique in the scene; must not be empty.")
    disabled: bool | None = Field(False, description="Out of dispatch until enabled.")

    def robot(self) -> RobotConfig:
        """Translate."""
        return self.config(self.robotName or "", disabled=self.disabled is True)


SceneRobots = Annotated[list[SceneRobot], Field(max_length=ROBOTS_MAX)]


class SceneRobotDefaultNull(RobotParts):
    """Changes to a robot's set-up: absent and null leave what the robot has (C11)."""

    disabled: bool | None = Field(None, description="Out of dispatch until enabled.")

    def patch(self) -> RobotConfigPatch:
        """Translate."""
        return RobotConfigPatch(
            group=self.groupId,
            disabled=self.disabled,
            simulated=self.simulated,
            remark=self.remark,
            tags=None if self.tags is None else tuple(self.tags),
            vendor=self.vendor,
            bin_count=self.selfBinNum,
            image=self._image(),
            connection=self.connectionType,
            host=self.robotIp,
            port_first=self.robotPortStart,
            tls=self.ssl,
            gateway_user=self.gwAuthId,
            gateway_secret_kept=self.secret() is not None or None,
            plus_one=self.plusOne,
        )


class CreateRobotBatchReq(RobotSetUp):
    """Several robots alike."""

    robotNamePrefix: Text = Field(description="Names are `<prefix>-01`, `<prefix>-02`, …")
    count: Int = Field(description=f"How many, 1 to {SERIES_MAX}.")
    robotIpStart: Text | None = Field(
        None,
        description="First of consecutive addresses, required where connectionType is "
        "FleetToRobot; `robotIp` is taken too (C14).",
    )

    def command(self, asked: Asked, scene: SceneId) -> CreateRobotSeries:
        """Translate; robotIpStart wins over its synonym robotIp."""
        pattern = self.model_copy(update={"robotIp": self.robotIpStart or self.robotIp})
        return CreateRobotSeries(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=scene,
            prefix=self.robotNamePrefix,
            count=self.count,
            pattern=pattern.config(""),
        )


RobotNames = Annotated[list[Text], Field(max_length=ROBOTS_MAX)]


class RobotNamesReq(Wire):
    """Robots of the scene in the path."""

    robotNames: RobotNames = Field(description="Robot names.")

    def names(self) -> tuple[RobotName, ...]:
        """Translate."""
        return tuple(map(RobotName, self.robotNames))


class UpdateRobotConfigBatchReq(RobotNamesReq):
    """Robots of the scene in the path, and what changes in their set-up."""

    config: SceneRobotDefaultNull = Field(description="What changes; null leaves a value alone.")


class UpdateDisabledReq(RobotNamesReq):
    """Robots to be disabled or enabled."""

    disabled: bool = Field(description="True = out of dispatch, false = back.")


class UpdateOffDutyReq(RobotNamesReq):
    """Robots to be sent off duty or back."""

    sceneId: Text = Field(description="Scene id.")
    offDuty: bool | None = Field(
        False, description="True = takes no orders, false = takes orders (C1)."
    )
