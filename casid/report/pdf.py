"""A page printed to PDF by a browser that is installed."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from casid.errors import InputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer")
_SECONDS = 120.0


def browser() -> str | None:
    """Find a browser that prints without a window; None: there is none."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def print_to_pdf(page: Path, pdf: Path) -> None:
    """Print a page of this computer, as its style sheet for print has it; InputError when no browser is installed, or
    it fails."""
    found = browser()
    if found is None:
        raise InputError(
            f"no browser prints {page.name} to PDF; install Chromium, Chrome or Edge, or print the page by hand"
        )
    with tempfile.TemporaryDirectory(prefix="casid-browser-") as profile:
        own = [f"--user-data-dir={profile}", f"--print-to-pdf={pdf.resolve()}"]
        command = [found, *_OPTIONS, *own, page.resolve().as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_SECONDS, check=False)
        except subprocess.TimeoutExpired:
            raise InputError(
                f"{found} took more than {_SECONDS:g} s to print {page.name}; print the page by hand"
            ) from None
    if not pdf.is_file():
        raise InputError(f"{found} did not print {page.name}: {' '.join(done.stderr.split())[-200:]}")
