"""Wire models of the access calls. Only the form of names and passwords is checked further on."""

from typing import Annotated

from pydantic import BaseModel, Field, StringConstraints

from commands.api.m4_models import Wire
from ledger.events import Role

GRACE_MINUTES_MAX = 30 * 24 * 60

Name = Annotated[str, StringConstraints(min_length=1, max_length=100)]
Password = Annotated[str, StringConstraints(min_length=1, max_length=256)]
RoleName = Annotated[Role, Field(strict=False, description="viewer, operator or admin.")]


class SignInAsked(Wire):
    """Who wants to sign in."""

    username: Name = Field(description="Name of a user.")
    password: Password = Field(description="The user's password.")


class SignInAnswer(BaseModel):
    """What further calls carry as x-xzz-qyq and x-xzz-qyx, or as cookies."""

    userId: str = Field(description="Id of the user.")
    userToken: str = Field(description="Token; ends 12 h after its last use, and after 7 days.")


class PingAnswer(BaseModel):
    """Who the server takes the caller for."""

    id: str = Field(description="User id or app id.")
    username: str = Field(description="The same.")
    roAdmin: bool = Field(description="Whether the caller may do everything.")
    permissions: list[str] = Field(description="Of view, operate and administer.")


class UserAnswer(BaseModel):
    """A person who may sign in."""

    username: str = Field(description="Name, which is the id as well.")
    role: Role = Field(description="What the person may do.")
    disabled: bool = Field(description="Whether signing in is off for now.")


class AddUserAsked(Wire):
    """A new person."""

    username: Name = Field(description="1 to 100 of A-Z a-z 0-9 _ . @ -, not one of keys' ids.")
    role: RoleName
    password: Password = Field(description="10 to 256 characters.")


class UpdateUserAsked(Wire):
    """What is null stays as it is."""

    username: Name = Field(description="Name of a user.")
    role: RoleName | None = Field(None, description="Another role.")
    password: Password | None = Field(None, description="10 to 256 characters; ends all sessions.")
    disabled: bool | None = Field(None, description="True ends all sessions.")


class NamedUser(Wire):
    """A person."""

    username: Name = Field(description="Name of a user.")


class ChangePasswordAsked(Wire):
    """One's own password."""

    password: Password = Field(description="The password of now.")
    newPassword: Password = Field(description="10 to 256 characters.")


class KeyAnswer(BaseModel):
    """A machine client."""

    appId: str = Field(description="App id.")
    role: Role = Field(description="What the client may do.")
    oldKeyValidUntil: int | None = Field(
        description="Epoch milliseconds until which the key before the last one is good; or null."
    )


class AddKeyAsked(Wire):
    """A new machine client."""

    appId: Name = Field(description="1 to 100 of A-Z a-z 0-9 _ . @ -, not one of users' names.")
    role: RoleName


class RotateKeyAsked(Wire):
    """Another key for a client."""

    appId: Name = Field(description="App id.")
    graceMinutes: Annotated[int, Field(ge=0, le=GRACE_MINUTES_MAX)] = Field(
        24 * 60, description="Minutes for which the key of now stays good."
    )


class NamedKey(Wire):
    """A machine client."""

    appId: Name = Field(description="App id.")


class NewKeyAnswer(BaseModel):
    """A key, which is shown this once."""

    appId: str = Field(description="App id, for the header xyy-app-id.")
    appKey: str = Field(description="Key, for the header xyy-app-key. The server keeps no copy.")
