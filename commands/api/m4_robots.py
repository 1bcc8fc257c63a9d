"""Wire models of the M4 calls that set robots up, and what they ask for (spec/m4.md §4)."""

from typing import Annotated, Any

from pydantic import Field

from commands.api.answering import Asked
from commands.api.m4_models import Int, Remark, Text, Wire, json_text
from commands.robots import BINS_MAX, ROBOTS_MAX, CreateRobotSeries
from ledger.ids import RobotName, SceneId
from ledger.scene import ConnectionType, RobotConfig, RobotVendor

TAGS_MAX = 100


class RobotSetUp(Wire):
    """What SceneRobot and CreateRobotBatchReq share. Absent and null mean the default."""

    remark: Remark | None = Field(None, description="Remark.")
    groupId: Int | None = Field(0, description="Robot group of the scene.")
    tags: Annotated[list[Text], Field(max_length=TAGS_MAX)] | None = Field(
        None, description="Tags."
    )
    vendor: RobotVendor | None = Field(RobotVendor.SEER, description="Brand.")
    selfBinNum: Int | None = Field(1, description=f"Loads it carries at once, 1 to {BINS_MAX}.")
    image: Any = Field(None, description="Picture: any JSON, kept as it is.")
    connectionType: ConnectionType | None = Field(
        None, description="Who connects: the dispatcher, the robot, or both through a gateway."
    )
    robotIp: Text | None = Field(
        None, description="Address; required where connectionType is FleetToRobot."
    )
    robotPortStart: Int | None = Field(None, description="First TCP port for requests to it.")
    ssl: bool | None = Field(None, description="Use TLS (robots of Hai).")
    gwAuthId: Text | None = Field(
        None, description="Gateway user; required where connectionType is GwWs."
    )
    gwAuthSecret: Text | None = Field(
        None, description="Gateway secret; required where connectionType is GwWs."
    )
    simulated: bool | None = Field(False, description="Make a simulated robot.")
    plusOne: bool | None = Field(None, description="One load more, on the fork (N + 1).")

    def config(self, name: str, *, disabled: bool = False) -> RobotConfig:
        """Translate; empty texts are absent ones, as in the examples of the source."""
        image = None if self.image is None else json_text({"image": self.image}, "image")
        return RobotConfig(
            name=RobotName(name),
            group=self.groupId or 0,
            disabled=disabled,
            simulated=self.simulated is True,
            remark=self.remark or None,
            tags=tuple(self.tags or ()),
            vendor=self.vendor or RobotVendor.SEER,
            bin_count=1 if self.selfBinNum is None else self.selfBinNum,
            image=None if image is None else image.removeprefix('{"image":')[:-1],
            connection=self.connectionType,
            host=self.robotIp or None,
            port_first=self.robotPortStart,
            tls=self.ssl,
            gateway_user=self.gwAuthId or None,
            gateway_secret=self.gwAuthSecret or None,
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


class CreateRobotBatchReq(RobotSetUp):
    """Several robots alike."""

    robotNamePrefix: Text = Field(description="Names are `<prefix>-01`, `<prefix>-02`, …")
    count: Int = Field(description="How many.")
    robotIpStart: Text | None = Field(
        None, description="First of consecutive addresses; `robotIp` is taken too (C14)."
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


class UpdateDisabledReq(RobotNamesReq):
    """Robots to be disabled or enabled."""

    disabled: bool = Field(description="True = out of dispatch, false = back.")


class UpdateOffDutyReq(RobotNamesReq):
    """Robots to be sent off duty or back."""

    sceneId: Text = Field(description="Scene id.")
    offDuty: bool | None = Field(
        False, description="True = takes no orders, false = takes orders (C1)."
    )
