"""The command `casid`: one application, one function per command, each in a file of its own."""

from __future__ import annotations

import sys
from importlib.metadata import version

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
    """Entry point of the wheel. What is slow to load is loaded inside, so that Ctrl-C is heard from the start."""
    try:
        from cyclopts import App

        from casid.cli.run import run_app

        app = App(
            name="casid",
            help="Identify aircraft from flight data.",
            version=version("casid"),
            suppress_keyboard_interrupt=False,
        )
        for name, where in COMMANDS.items():
            app.command(where, name=name)
        run_app(app)
    except KeyboardInterrupt:
        print("interrupted; nothing had begun", file=sys.stderr)
        sys.exit(130)
