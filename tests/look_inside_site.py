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
LINKS = {"canonical", "author", "license", "next", "prev", "search", "index", "help"}
"""Relations of ``<link>`` that a browser does not load."""
NOT_LOADED = {("a", "href"), ("area", "href"), ("meta", "content"), ("blockquote", "cite")}
"""Attributes whose address a browser does not load by itself."""
FILES = {
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
"""Attributes that name files of the site."""
LISTS = {"srcset", "imagesrcset"}
CSS = re.compile(r"(?:@import\s+[\"']?|url\(\s*[\"']?)((?:https?:)?//[^\"')\s]+)", re.IGNORECASE)
COMMENT = re.compile(r"/\*.*?\*/|(?<![:\\\"'`\w])//[^\n]{0,300}$", re.DOTALL | re.MULTILINE)
SCRIPT = re.compile(r"[\"'`]((?:(?:https?|wss?|ftp):)?//[\w-]+\.[\w.-]+[^\"'`\s]*)", re.IGNORECASE)
NAMES = ("http://www.w3.org/",)
"""Beginnings of addresses that are names, such as those of SVG and MathML."""


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
        if tag == "a" and "href" in values:
            self._file(values["href"])
        if tag == "link" and set(values.get("rel", "").split()) & LINKS:
            return
        for name, value in values.items():
            if name == "style":
                self.outside += CSS.findall(value)
            elif name.startswith("on"):
                self.outside += loaded_by_script(value)
            elif name == "srcdoc":
                self.outside += Page(value).outside
            elif (tag, name) not in NOT_LOADED and not name.startswith("xmlns"):
                self._loaded(value, name in LISTS, name in FILES.get(tag, ()))
        if tag == "meta" and values.get("http-equiv", "").lower() == "refresh":
            self.outside += re.findall(r"(?:https?:)?//\S+", values.get("content", ""))

    def handle_endtag(self, tag: str) -> None:
        """Leave a script or a style."""
        self.inside = ""

    def handle_data(self, data: str) -> None:
        """Search scripts and styles in the page."""
        if self.inside == "style":
            self.outside += CSS.findall(data)
        elif self.inside == "script":
            self.outside += loaded_by_script(data)

    def _loaded(self, value: str, is_list: bool, is_file: bool) -> None:
        parts = value.split(",") if is_list else [value]
        for address in (part.strip().split(" ")[0] for part in parts if part.strip()):
            if OUTSIDE.match(address):
                self.outside.append(address)
            elif is_file:
                self._file(address)

    def _file(self, address: str) -> None:
        parts = urlsplit(address)
        if not parts.scheme and not parts.netloc and parts.path:
            self.local.add(unquote(parts.path))


def loaded_by_script(text: str) -> list[str]:
    """Outside addresses in the strings of a script: it may load them when it runs."""
    found = SCRIPT.findall(COMMENT.sub(" ", text))
    return [address for address in found if not address.startswith(NAMES)]


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
