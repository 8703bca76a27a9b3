"""report.html printed as PDF, by a browser that is installed."""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from photogram.errors import ReportError

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)
OFFLINE = (
    "--headless",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
TIMEOUT_S = 180
OLDEST = 131
"""Chromium's first version that prints what stands at the margins of each page."""


def find_browser() -> str | None:
    """Return the browser named by the environment's CHROME, or the first of BROWSERS that is installed."""
    named = os.environ.get("CHROME")
    if named:
        return shutil.which(named)
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def _looked_for() -> str:
    """Return where a browser was looked for in vain."""
    named = os.environ.get("CHROME")
    if named:
        return f"CHROME names {named}, which cannot be run"
    programs = [name for name in BROWSERS if "/" not in name]
    return f"looked for {', '.join(programs[:-1])} and {programs[-1]}"


def browser_version(browser: str) -> int:
    """Return the main version of a browser, 0 where it does not say: on Windows it would open a window instead."""
    if os.name == "nt":
        return 0
    try:
        output = subprocess.run(
            [browser, "--version"], capture_output=True, encoding="utf-8", errors="replace", timeout=30, check=False
        ).stdout
    except (OSError, subprocess.TimeoutExpired):
        return 0  # printing itself will fail, and say why
    number = re.search(r"\b(\d{2,4})\.\d", output)
    return int(number[1]) if number else 0


def browser_options(profile: Path) -> list[str]:
    """Return the options that keep a browser to itself: nothing on screen, no network, a profile of its own."""
    # the sandbox of Chromium refuses to work for root
    alone = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    return [*OFFLINE, *alone, f"--user-data-dir={profile}"]


def print_pdf(page: Path, target: Path) -> None:
    """Print a page as PDF. Raises ReportError where no browser is installed, or where it fails."""
    browser = find_browser()
    remedy = f"open {page} in a browser and print it there, or set CHROME to a Chromium, Chrome or Edge"
    if browser is None:
        raise ReportError(
            f"report.pdf was not printed, since no browser is installed ({_looked_for()}); the report itself is "
            f"written, {page}: install Chromium, Chrome or Edge, version {OLDEST} or newer, and run photogram report "
            "--pdf, or print the page from any other browser"
        )
    if 0 < (version := browser_version(browser)) < OLDEST:
        raise ReportError(
            f"{browser} is version {version}: headers and page numbers need Chromium {OLDEST} or newer: {remedy}"
        )
    with tempfile.TemporaryDirectory(prefix="photogram-", ignore_cleanup_errors=True) as profile:
        options = [*browser_options(Path(profile)), "--no-pdf-header-footer", f"--print-to-pdf={target.absolute()}"]
        command = [browser, *options, page.absolute().as_uri()]
        try:
            done = subprocess.run(
                command, capture_output=True, encoding="utf-8", errors="replace", timeout=TIMEOUT_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ReportError(f"{browser} could not print the report ({error}): {remedy}") from error
    if done.returncode or not target.is_file():
        reason = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
        raise ReportError(f"{browser} could not print the report ({reason}): {remedy}")
