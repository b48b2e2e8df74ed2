"""`casid diagnose --model FILE.py:NAME`: the `Model` of any dynamic system, from a Python file of the user's."""

from __future__ import annotations

import runpy
from pathlib import Path
from traceback import extract_tb

from casid.errors import CasidError, InputError, unknown
from casid.model.system import Model


def model_of(where: str) -> Model:
    """The model that a Python file has under a name, or makes there without arguments: "tanks.py:model".

    The file is executed. Raises InputError if the file, the name in it, or the model does not exist.
    """
    file, colon, name = where.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputError(f"--model {where}: expected a file and a name in it, like tanks.py:model")
    if not Path(file).is_file():
        raise InputError(f"--model {where}: there is no file {file}")
    try:
        found = runpy.run_path(file, run_name="casid_model")
    except SyntaxError as error:
        raise InputError(f"--model {where}: line {error.lineno} is no Python: {error.msg}") from None
    except CasidError:
        raise
    except Exception as error:  # whatever the user's own lines may raise
        lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == file]
        at = f"line {lines[-1]}: " if lines else ""
        said = " ".join(str(error).split())
        raise InputError(f"--model {where}: {at}{type(error).__name__}: {said}") from None
    if name not in found:
        raise unknown("name", name, [n for n, value in found.items() if isinstance(value, Model)], f"--model {where}")
    one = found[name]
    made = one() if callable(one) and not isinstance(one, Model) else one
    if not isinstance(made, Model):
        raise InputError(f"--model {where}: '{name}' is {type(made).__name__}; expected a casid Model, of define_model")
    return made
