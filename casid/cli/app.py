"""The command `casid`: one application, one function per command, each in a file of its own.

Nothing slow is imported here before Ctrl-C is listened to.
"""

from __future__ import annotations

import sys

from casid.cli.start import begin, leave

COMMANDS = {
    "diagnose": "casid.cli.diagnose:diagnose",
    "why": "casid.cli.why:why",
    "compare": "casid.cli.compare:compare",
    "check": "casid.cli.check:check",
    "compatibility": "casid.cli.compatibility:compatibility",
    "estimate": "casid.cli.estimate:estimate",
    "simulate": "casid.cli.simulate:simulate",
    "response": "casid.cli.response:response",
    "match": "casid.cli.match:match",
    "identifiability": "casid.cli.identifiability:identifiability",
    "design": "casid.cli.design:design",
    "modes": "casid.cli.modes:modes",
    "isolate": "casid.cli.isolate:isolate",
    "segments": "casid.cli.segments:segments",
    "convert": "casid.cli.convert:convert",
    "export": "casid.cli.export:export",
    "new-aircraft": "casid.cli.new_aircraft:new_aircraft",
    "demo": "casid.cli.diagnose:demo",
}


def main() -> None:
    """Entry point of the wheel."""
    begin()
    from importlib.metadata import version

    from cyclopts import App

    from casid.cli.run import status_of

    app = App(name="casid", help="Identify aircraft from flight data.", version=version("casid"))
    listed = sys.argv[1:2] == [] or sys.argv[1] not in COMMANDS
    for name, where in COMMANDS.items():
        app.command(where, name=name, help=_first_line(where) if listed else None)
    app.register_install_completion_command()
    leave(status_of(app))


def _first_line(where: str) -> str:
    """Return the summary of a command, for the list of all, read from its docstring without the imports of its file."""
    import ast
    from importlib.resources import files

    module, function = where.split(":")
    source = files("casid.cli").joinpath(f"{module.rpartition('.')[2]}.py").read_text(encoding="utf-8")
    found = next(n for n in ast.parse(source).body if isinstance(n, ast.FunctionDef) and n.name == function)
    return (ast.get_docstring(found) or "").split("\n\n")[0]
