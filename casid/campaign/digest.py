"""What results were computed with: a fingerprint of source files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
# what an estimation is computed with
ENGINE = tuple(f"casid/{room}/**/*" for room in ("estimation", "native", "filtering", "analysis", "model", "records"))


def source_digest(*patterns: str) -> str:
    """Fingerprint of the files below the folder of the packages that match the globs, e.g. "casid/model/**/*.py"."""
    digest = hashlib.sha256()
    for path in _files(patterns):
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _files(patterns: Iterable[str]) -> list[Path]:
    return sorted(
        path
        for path in {path for pattern in patterns for path in ROOT.glob(pattern)}
        if path.is_file() and "__pycache__" not in path.parts
    )
