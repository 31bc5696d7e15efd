"""Fail when a page of the built site loads a thing from elsewhere, or links to a missing file.

A page may link to other sites (``<a href>``); scripts, styles, pictures, fonts and frames must be
in the built folder, so that the site can be read without a network.
"""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

OUTSIDE = re.compile(r"\s*(?:https?:|wss?:|ftp:)?//", re.IGNORECASE)
LOADED = {
    "audio": ("src",),
    "embed": ("src",),
    "iframe": ("src",),
    "image": ("href", "xlink:href"),
    "img": ("src", "srcset"),
    "input": ("src",),
    "link": ("href",),
    "object": ("data",),
    "script": ("src",),
    "source": ("src", "srcset"),
    "track": ("src",),
    "use": ("href", "xlink:href"),
    "video": ("src", "poster"),
}
LINKS = {"canonical", "author", "license", "next", "prev", "search", "index", "help"}
"""Relations of ``<link>`` that a browser does not load."""
CSS = re.compile(r"(?:@import\s+[\"']?|url\(\s*[\"']?)((?:https?:)?//[^\"')\s]+)", re.IGNORECASE)
SCRIPT = re.compile(
    r"(?:fetch|import|importScripts|Worker|WebSocket|EventSource|sendBeacon)\s*\(\s*"
    r"[\"'`]((?:https?:|wss?:)?//[^\"'`]+)"
    r"|(?:\.src\s*=|\bfrom|\bimport)\s*[\"'`]((?:https?:)?//[^\"'`]+)"
)


class Page(HTMLParser):
    """The outside addresses that one page loads, and the local files that it names."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.outside: list[str] = []
        self.local: set[str] = set()
        self.inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Sort the addresses of one tag."""
        values = {name: value or "" for name, value in attrs}
        self.inside = tag
        self.outside += CSS.findall(values.get("style", ""))
        if tag == "a" and "href" in values:
            self._file(values["href"])
        if tag == "link" and set(values.get("rel", "").split()) & LINKS:
            return
        for name in LOADED.get(tag, ()):
            value = values.get(name, "")
            parts = value.split(",") if name == "srcset" else [value]
            for address in (part.strip().split(" ")[0] for part in parts if part.strip()):
                if OUTSIDE.match(address):
                    self.outside.append(address)
                else:
                    self._file(address)

    def handle_endtag(self, tag: str) -> None:
        """Leave a script or a style."""
        self.inside = ""

    def handle_data(self, data: str) -> None:
        """Search scripts and styles in the page."""
        if self.inside == "style":
            self.outside += CSS.findall(data)
        elif self.inside == "script":
            self.outside += loaded_by_script(data)

    def _file(self, address: str) -> None:
        parts = urlsplit(address)
        if not parts.scheme and not parts.netloc and parts.path:
            self.local.add(unquote(parts.path))


def loaded_by_script(text: str) -> list[str]:
    """Outside addresses that a script loads when it runs."""
    return [first or second for first, second in SCRIPT.findall(text)]


def faults_of(folder: Path) -> list[str]:
    """A line for each outside address that is loaded, and for each link to a missing file."""
    faults = []
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if name == "_static/webpack-macros.html":  # a template of the theme, no page
            continue
        if path.suffix == ".html":
            page = Page(path.read_text(encoding="utf-8"))
            faults += [f"{name}: loads {address}" for address in page.outside]
            faults += [
                f"{name}: links to {target}, which is missing"
                for target in sorted(page.local)
                if not (path.parent / target).exists()
            ]
        elif path.suffix == ".css":
            text = path.read_text(encoding="utf-8")
            faults += [f"{name}: loads {address}" for address in CSS.findall(text)]
        elif path.suffix in (".js", ".mjs"):
            text = path.read_text(encoding="utf-8")
            faults += [f"{name}: loads {address}" for address in loaded_by_script(text)]
    return faults


def main(folder: str) -> int:
    """Check all pages in `folder`."""
    faults = faults_of(Path(folder))
    for fault in faults:
        print(fault, file=sys.stderr)
    pages = len(list(Path(folder).rglob("*.html")))
    if not pages:
        print(f"{folder}: no pages", file=sys.stderr)
        return 1
    print(f"{folder}: {pages} pages, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
