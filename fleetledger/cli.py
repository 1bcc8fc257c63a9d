"""The command line: what there is to do, in words."""

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from fleetledger.cli_access import access_app
from fleetledger.config import Auth, Faults, Format, Settings
from fleetledger.telling import told

# `serving` and `offline` are imported where they are used: between them they know every package,
# Rerun's and DuckDB's too, and a child process or `--help` should not pay for that.

app = typer.Typer(
    name="fleetledger",
    help=(
        "Dispatches fleets of mobile robots and never forgets.\n\n"
        "Start with `fleetledger demo`: a server, a scheduler and twenty simulated robots in a "
        "generated warehouse, with a map at http://127.0.0.1:5800/."
    ),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
scene_app = typer.Typer(
    help="Bring maps of other systems in, and check them.", no_args_is_help=True
)
app.add_typer(scene_app, name="scene")
role_app = typer.Typer(hidden=True, help="Single roles, for processes of their own.")
app.add_typer(role_app, name="role")
app.add_typer(access_app, name="access")

Data = Annotated[
    Path, typer.Option(help="Folder of ledger, telemetry and caches; made if missing.")
]
Port = Annotated[int | None, typer.Option(help="Port of the HTTP API; 0 picks a free one.")]
Speed = Annotated[float | None, typer.Option(help="How many times faster than the wall.")]
Seed = Annotated[int | None, typer.Option(help="Seed of everything random: same seed, same run.")]
Folder = Annotated[Path, typer.Argument(help="Data folder of a server.", exists=True)]


@app.command()
def demo(
    robots: Annotated[int, typer.Option(min=1, max=500, help="Simulated robots.")] = 20,
    orders_per_minute: Annotated[
        float | None, typer.Option(min=0, help="Orders sent; default: two a robot every 3 min.")
    ] = None,
    speed: Annotated[float, typer.Option(min=0.1, max=100, help="Times real time.")] = 1.0,
    port: Annotated[int, typer.Option(help="Port of the HTTP API; 0 picks a free one.")] = 5800,
    data: Annotated[Path, typer.Option(help="Where the demo keeps its history.")] = Path(
        "data/demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of warehouse, robots and orders.")] = 1,
) -> None:
    """Watch it work: a generated warehouse, simulated robots, and orders that keep coming.

    No keys are asked for, since it listens on this machine only. Ctrl-C stops everything.
    """
    rate = orders_per_minute if orders_per_minute is not None else robots * 2 / 3
    with told():
        from fleetledger import serving

        code = serving.demo(
            robots=robots, orders_per_minute=rate, speed=speed, port=port, data=data, seed=seed
        )
    _leave(code)


@app.command()
def serve(
    data: Data,
    host: Annotated[str | None, typer.Option(help="Address to listen on.")] = None,
    port: Port = None,
    auth: Annotated[
        Auth | None, typer.Option(help="keys (default), or none: on a loopback host only.")
    ] = None,
    scene: Annotated[
        list[Path] | None, typer.Option(help="Scene file to serve; may be given again.")
    ] = None,
    simulate: Annotated[
        bool | None, typer.Option("--simulate", help="Drive the simulated robots of the scenes.")
    ] = None,
    faults: Annotated[
        Faults | None,
        typer.Option(help="With --simulate: what goes wrong with robots and their links."),
    ] = None,
    speed: Speed = None,
    seed: Seed = None,
    rdscore_port: Annotated[
        int | None,
        typer.Option(help="Serve RDSCore's robotsStatus: HTTP here, WebSocket one port higher."),
    ] = None,
    feed_port: Annotated[
        int | None,
        typer.Option(help="Port of 127.0.0.1 for followers over zenoh; default: any free one."),
    ] = None,
    tls_cert: Annotated[
        Path | None, typer.Option(help="Serve HTTPS: PEM file of the certificate chain.")
    ] = None,
    tls_key: Annotated[Path | None, typer.Option(help="PEM file of the certificate's key.")] = None,
    log_json: Annotated[bool | None, typer.Option("--log-json", help="Logs as JSON.")] = None,
    more_scenes: Annotated[
        list[Path] | None, typer.Argument(hidden=True, help="So that --scene takes several.")
    ] = None,
) -> None:
    """Serve the APIs, run the scheduler, and write every event to the ledger.

    Prints `ready http://HOST:PORT` on standard output once it answers (`https://` with TLS); logs
    go to standard error.
    Every option can stand in DATA/config.toml or in a FLEETLEDGER_… variable as well.
    """
    with told():
        settings = Settings.load(
            data,
            host=host,
            port=port,
            auth=auth,
            scene=(*(scene or ()), *(more_scenes or ())) or None,
            simulate=simulate,
            faults=faults,
            speed=speed,
            seed=seed,
            rdscore_port=rdscore_port,
            feed_port=feed_port,
            tls_cert=tls_cert,
            tls_key=tls_key,
            log_json=log_json,
        )
        from fleetledger import serving

        code = serving.serve(settings)
    _leave(code)


@scene_app.command("import")
def scene_import(
    file: Annotated[
        Path, typer.Argument(help="Map: .smap (SEER) or .map (MovingAI).", exists=True)
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Scene file to write.")],
    name: Annotated[str | None, typer.Option(help="Name of the scene; default: the map's.")] = None,
    robots: Annotated[int, typer.Option(min=0, max=5000, help="Simulated robots to add.")] = 0,
    robot_group: Annotated[
        Path | None, typer.Option(help="JSON file with the group: footprint and kinematics.")
    ] = None,
) -> None:
    """Translate a map into a scene file for `serve --scene`. Names survive unchanged."""
    with told():
        from fleetledger import offline

        offline.import_scene(file, output, name=name, robots=robots, robot_group=robot_group)


@scene_app.command("check")
def scene_check(
    file: Annotated[Path, typer.Argument(help="Scene file.", exists=True)],
) -> None:
    """Say in words what a planner would trip over; exit 1 if the scene is unusable."""
    with told():
        from fleetledger import offline

        raise typer.Exit(0 if offline.check_scene(file) else 1)


@scene_app.command("generate")
def scene_generate(
    output: Annotated[Path, typer.Option("--output", "-o", help="Scene file to write.")],
    robots: Annotated[int, typer.Option(min=1, max=1000, help="Robots it must hold.")] = 20,
    seed: Annotated[int, typer.Option(help="Same seed, same warehouse.")] = 1,
) -> None:
    """Write a generated warehouse with room for so many simulated robots."""
    with told():
        from fleetledger import offline

        offline.generate_scene(output, robots=robots, seed=seed)


@app.command()
def verify(data: Folder) -> None:
    """Check every segment, checksum, position and snapshot; exit 1 on damage."""
    with told():
        from fleetledger import offline

        raise typer.Exit(0 if offline.verify(data) else 1)


@app.command()
def replay(
    data: Folder,
    at: Annotated[str, typer.Option(help="Moment: ISO 8601, or epoch milliseconds.")],
    scene: Annotated[str | None, typer.Option(help="Id of one scene; default: all.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="The whole state as canonical JSON.")
    ] = False,
    rerun: Annotated[
        bool, typer.Option("--rerun", help="Open it in the Rerun viewer, on this machine only.")
    ] = False,
) -> None:
    """Show the state at any past moment: orders as they were, robots where they stood."""
    with told():
        from fleetledger import offline

        offline.replay(data, at=at, scene=scene, as_json=as_json, rerun=rerun)


@app.command()
def export(
    data: Folder,
    rrd: Annotated[Path | None, typer.Option(help="Rerun recording to write.")] = None,
    parquet: Annotated[
        Path | None, typer.Option(help="Folder for Parquet files of orders, steps and events.")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="Id of one scene; default: the first, in Parquet all.")
    ] = None,
    since: Annotated[str | None, typer.Option("--from", help="First moment.")] = None,
    until: Annotated[str | None, typer.Option("--to", help="Last moment.")] = None,
) -> None:
    """Write a stretch of history: a Rerun recording, or Parquet files by day (UTC, days whole).

    In Parquet orders and their steps stand in the day in which they ended.
    A rerun replaces whole days. The server may run meanwhile.
    """
    with told():
        from fleetledger import offline

        offline.export(data, rrd=rrd, parquet=parquet, scene=scene, since=since, until=until)


@app.command()
def sql(
    data: Folder,
    statement: Annotated[str, typer.Argument(help="One SELECT over the views of docs/sql.md.")],
    form: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.TABLE,
) -> None:
    """Ask the history in SQL: the views of docs/sql.md; read-only, beside a server or without."""
    with told():
        from fleetledger import offline

        offline.sql(data, statement, form)


Listen = Annotated[str, typer.Option(help="Endpoint of the bus to open.")]
Connect = Annotated[list[str], typer.Option(help="Endpoints of the bus to join.")]
ClockText = Annotated[str, typer.Option(help="The core's clock.")]


@role_app.command("scheduler")
def role_scheduler(listen: Listen, connect: Connect, clock: ClockText, data: Data) -> None:
    """Plan and dispatch; ends when standard input closes."""
    with told():
        from fleetledger import children

        children.run_scheduler(listen, connect, clock, data)


@role_app.command("sim")
def role_sim(
    connect: Connect,
    clock: ClockText,
    data: Data,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")],
    faults: Annotated[Faults, typer.Option(help="What goes wrong with them.")] = Faults.NONE,
) -> None:
    """Be the simulated robots; ends when standard input closes."""
    with told():
        from fleetledger import children

        children.run_sim(connect, clock, data, seed, faults)


@role_app.command("analyst")
def role_analyst(
    data: Data,
    seconds_max: Annotated[float, typer.Option(help="Time of a statement.")],
    memory_mb: Annotated[int, typer.Option(help="Memory of all statements together.")],
) -> None:
    """Answer SQL; ends when standard input closes."""
    with told():
        from fleetledger import analyst_role

        analyst_role.run_analyst(data, seconds_max, memory_mb)


@role_app.command("sealer")
def role_sealer(data: Data) -> None:
    """Seal what can be sealed and end; earlier when standard input closes."""
    with told():
        from fleetledger import sealer_role

        raise typer.Exit(sealer_role.run_sealer(data))


def _leave(code: int) -> NoReturn:
    """End at once: all is closed, and to take the interpreter apart has DuckDB report leaks."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # a file on a full disk
            stream.flush()
    os._exit(code)


def main() -> None:
    """Entry point of the program `fleetledger`."""
    try:
        app(prog_name="fleetledger", args=sys.argv[1:])
    except SystemExit as end:  # the last words of a refusal are the hint
        _leave(end.code if isinstance(end.code, int) else 0)
