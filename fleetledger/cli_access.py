"""The command line of access: who may call, changed in the folder of a server that may run."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from fleetledger.telling import told
from ledger.events import Role

access_app = typer.Typer(
    help="Who may call: users and key pairs. A running server follows within seconds.",
    no_args_is_help=True,
)
user_app = typer.Typer(help="People, who sign in by name and password.", no_args_is_help=True)
key_app = typer.Typer(help="Machine clients, with app id and key.", no_args_is_help=True)
access_app.add_typer(user_app, name="user")
access_app.add_typer(key_app, name="key")

Folder = Annotated[
    Path, typer.Argument(help="Data folder of a server.", exists=True, file_okay=False)
]
Name = Annotated[str, typer.Argument(help="Name of the user.")]
AppId = Annotated[str, typer.Argument(help="App id of the client.")]
RoleOption = Annotated[Role, typer.Option(help="What the caller may do (docs/access.md).")]


@user_app.command("list")
def user_list(data: Folder) -> None:
    """List the users with their roles."""
    with told():
        from fleetledger.access import offline

        offline.list_users(data)


@user_app.command("add")
def user_add(data: Folder, name: Name, role: RoleOption = Role.VIEWER) -> None:
    """Let a person sign in. Asks for the password, or reads it as a line of standard input."""
    with told():
        from fleetledger.access import offline

        offline.add_user(data, name, role, _password())


@user_app.command("change")
def user_change(
    data: Folder,
    name: Name,
    role: Annotated[Role | None, typer.Option(help="Another role.")] = None,
    password: Annotated[bool, typer.Option("--password", help="Another password.")] = False,
    disabled: Annotated[
        bool | None, typer.Option("--disable/--enable", help="Whether to let the person in.")
    ] = None,
) -> None:
    """Change a user's role or password, or lock the user out for now."""
    with told():
        from fleetledger.access import offline

        new = _password() if password else None
        offline.change_user(data, name, role=role, password=new, disabled=disabled)


@user_app.command("remove")
def user_remove(data: Folder, name: Name) -> None:
    """Let a person sign in no more; the sessions end."""
    with told():
        from fleetledger.access import offline

        offline.remove_user(data, name)


@key_app.command("list")
def key_list(data: Folder) -> None:
    """List the app ids with their roles."""
    with told():
        from fleetledger.access import offline

        offline.list_keys(data)


@key_app.command("add")
def key_add(data: Folder, app_id: AppId, role: RoleOption = Role.OPERATOR) -> None:
    """Make a key pair; prints the key, this once."""
    with told():
        from fleetledger.access import offline

        offline.add_key(data, app_id, role)


@key_app.command("rotate")
def key_rotate(
    data: Folder,
    app_id: AppId,
    grace_minutes: Annotated[
        int, typer.Option(min=0, max=30 * 24 * 60, help="For which the old key stays good.")
    ] = 24 * 60,
) -> None:
    """Give a client another key; prints it, this once."""
    with told():
        from fleetledger.access import offline

        offline.rotate_key(data, app_id, grace_minutes)


@key_app.command("remove")
def key_remove(data: Folder, app_id: AppId) -> None:
    """Take a key pair back, at once."""
    with told():
        from fleetledger.access import offline

        offline.remove_key(data, app_id)


def _password() -> str:
    """Ask twice on a terminal, without showing it; programs write a line to standard input."""
    if sys.stdin.isatty():
        return str(typer.prompt("Password", hide_input=True, confirmation_prompt=True, err=True))
    return sys.stdin.readline().rstrip("\r\n")
