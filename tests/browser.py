"""Loads a page in a real browser, off the network, to measure it and read its console."""

import html
import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
OPTIONS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--proxy-server=127.0.0.1:9",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--enable-logging=stderr",
]
SECONDS = 120

# Frames, because a headless window has a minimum width; they do not change the page.
WRAPPER = """<!doctype html><meta charset="utf-8">{frames}<pre id="seen"></pre><script>
onload = () => {{
  const seen = [...document.querySelectorAll("iframe")].map(frame => {{
    const page = frame.contentDocument, root = page.documentElement;
    return {{
      width: frame.contentWindow.innerWidth,
      room: root.clientWidth,
      content: root.scrollWidth,
      pictures: [...page.images].map(image => image.naturalWidth),
      boxes: [...page.querySelectorAll(".scroll")].map(box => box.scrollWidth - box.clientWidth),
    }};
  }});
  document.getElementById("seen").textContent = JSON.stringify(seen);
}};
</script>"""


class Window(NamedTuple):
    """Holds the measures of a page in one window, in px."""

    width: int  # of the window
    room: int  # width without a scroll bar
    content: int  # width of the content; more than `room` if the page scrolls sideways
    pictures: list[int]  # natural widths; 0 for pictures that are not drawn
    boxes: list[int]  # by how much the content of each scrolling box is wider than the box


def look(page: str, widths: Sequence[int], folder: Path) -> tuple[list[Window], list[str]]:
    """Measures the page at every width; returns the lines of the console too.

    The browser writes its files into `folder`.
    """
    frame = '<iframe width="{}" height="800" style="border: 0" srcdoc="{}"></iframe>'
    frames = "".join(frame.format(width, html.escape(page)) for width in widths)
    wrapper = folder / "wrapper.html"
    wrapper.write_text(WRAPPER.format(frames=frames), encoding="utf-8")
    dump, log = _browse(wrapper, folder / "profile")
    windows = json.loads(html.unescape(re.findall(r'<pre id="seen">(.*?)</pre>', dump)[-1]))
    return [Window(**window) for window in windows], [
        line for line in log.splitlines() if ":CONSOLE" in line
    ]


def _browse(file: Path, profile: Path) -> tuple[str, str]:
    """Returns the document after loading, and the log of the browser."""
    assert BROWSER is not None
    command = [BROWSER, *OPTIONS, f"--user-data-dir={profile}", "--dump-dom", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=True)
    return done.stdout, done.stderr
