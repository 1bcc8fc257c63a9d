"""Wire models of the calls about scenes as a whole (spec/protocols.md 1.6)."""

from typing import Annotated

from pydantic import BaseModel, Field

from commands.api.m4_models import Int, Text, Wire
from commands.scene_life import NAME_CHARS_MAX, SCENES_MAX


class CreateSceneReq(Wire):
    """A scene to be made."""

    name: Text = Field(description=f"Unique among the scenes, 1 to {NAME_CHARS_MAX} characters.")


class SceneIdAnswer(BaseModel):
    """The scene that was made, or that the file is."""

    id: str = Field(description="Scene id; the one it already has if the content is known.")


class RemoveScenesReq(Wire):
    """Scenes to be taken away for good, their robots with them."""

    ids: Annotated[list[Text], Field(max_length=SCENES_MAX)] = Field(description="Scene ids.")


class SceneBasicPatch(Wire):
    """What is absent or null stays as it is."""

    name: Text | None = Field(None, description="Unique among the scenes.")
    displayOrder: Int | None = Field(None, description="Place in lists, ascending.")


class DisableSceneReq(Wire):
    """A scene to be taken out of service or put back."""

    disabled: bool = Field(
        description="True = orders and calls about robots are refused, robots get no new moves."
    )


class PauseDispatchReq(Wire):
    """A scene whose dispatch is to pause or to go on."""

    paused: bool = Field(
        description="True = no order gets a robot; what has one goes on. False = they do again."
    )
