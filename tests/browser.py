"""A page in a real browser, off the network: how wide it is, whether its pictures are drawn, what
it complains of.
"""

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

# frames, because a headless window has a least width; the page in them stays as it is
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


class Seen(NamedTuple):
    """A page in a window `width` px wide.

    room        the same less a scroll bar
    content     width of what the page holds: more than `room` if the page scrolls sideways
    pictures    natural widths, 0 for those that are not drawn
    boxes       by how much the content of each scrolling box is wider than the box
    """

    width: int
    room: int
    content: int
    pictures: list[int]
    boxes: list[int]


def look(page: str, widths: Sequence[int], folder: Path) -> tuple[list[Seen], list[str]]:
    """The page at every width, and the lines of the console; `folder` takes the browser's files."""
    frame = '<iframe width="{}" height="800" style="border: 0" srcdoc="{}"></iframe>'
    frames = "".join(frame.format(width, html.escape(page)) for width in widths)
    wrapper = folder / "wrapper.html"
    wrapper.write_text(WRAPPER.format(frames=frames), encoding="utf-8")
    dump, log = _browse(wrapper, folder / "profile")
    views = json.loads(html.unescape(re.findall(r'<pre id="seen">(.*?)</pre>', dump)[-1]))
    return [Seen(**view) for view in views], [
        line for line in log.splitlines() if ":CONSOLE" in line
    ]


def _browse(file: Path, profile: Path) -> tuple[str, str]:
    """The document after loading, and the browser's log."""
    assert BROWSER is not None
    command = [BROWSER, *OPTIONS, f"--user-data-dir={profile}", "--dump-dom", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=True)
    return done.stdout, done.stderr
