"""The command `casid`: one application, one function per command, each in a file of its own.

Nothing slow is imported here before Ctrl-C is listened to.
"""

from __future__ import annotations

from casid.cli.start import begin, leave, outcome

COMMANDS = {
    "diagnose": "casid.cli.diagnose:diagnose",
    "check": "casid.cli.check:check",
    "estimate": "casid.cli.estimate:estimate",
    "simulate": "casid.cli.simulate:simulate",
    "identifiability": "casid.cli.identifiability:identifiability",
    "design": "casid.cli.design:design",
    "convert": "casid.cli.convert:convert",
    "new-aircraft": "casid.cli.new_aircraft:new_aircraft",
    "demo": "casid.cli.diagnose:demo",
}


def main() -> None:
    """Entry point of the wheel."""
    begin()
    from importlib.metadata import version

    from cyclopts import App

    from casid.cli.run import call

    app = App(name="casid", help="Identify aircraft from flight data.", version=version("casid"))
    for name, where in COMMANDS.items():
        app.command(where, name=name)
    leave(outcome(lambda: call(app)))


def run_as_script(command: str) -> None:
    """One command as a script of its own."""
    begin()
    from pkgutil import resolve_name

    from casid.cli.run import call, script

    leave(outcome(lambda: call(script(resolve_name(COMMANDS[command])))))
