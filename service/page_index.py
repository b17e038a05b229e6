"""index.html as it is served: what a browser needs first, in as few requests as possible.

A browser has six connections to a service that speaks HTTP/1.1, and each request takes a round trip: 0.4 s on a slow line. So
style sheets that follow each other become one file, and so do classic scripts; modules that the first module imports, directly
or not, are named at once; and of those that are imported on demand a table says what each of them needs beyond these, so that
`web/js/shell/ahead.js` can ask for all of it together.
"""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Iterable, Mapping

__all__ = ["index_of", "joined"]

TABLE = "view-modules"  # the id by which web/js/shell/ahead.js finds it

_GROUPS = {
    "css/joined.css": re.compile(r'<link rel="stylesheet" href="css/[^"]+" />(?:\s*<link rel="stylesheet" href="css/[^"]+" />)*'),
    "js/joined.js": re.compile(r'<script src="js/[^"]+"></script>(?:\s*<script src="js/[^"]+"></script>)*'),
}
_LINKED = re.compile(r'(?:href|src)="([^"]+)"')
_NAMED = re.compile(r'\b(href|src)="((?:js|css)/[^"]+|icon\.svg)"')
_MODULE = re.compile(r'<script type="module" src="([^"]+)"')
_IMPORT = re.compile(r'^(?:import|export|\})[^"\n]*"(\.{1,2}/[^"]+)"', re.MULTILINE)
_ON_DEMAND = re.compile(r'\bawait import\("(\.{1,2}/[^"]+)"\)')


def joined(html: str, sources: Mapping[str, str]) -> dict[str, str]:
    """The files that stand for several, by name. sources: text by name, of all files of the page."""
    found = {}
    for name, group in _GROUPS.items():
        if (match := group.search(html)) is not None:
            found[name] = "\n".join(sources.get(part, "") for part in _LINKED.findall(match[0]))
    return found


def index_of(html: str, sources: Mapping[str, str], base: str) -> str:
    """index.html, naming the files of one version. base: what their addresses begin with, as v/HASH/."""
    first = _MODULE.findall(html)
    at_once = _imported(first, sources)
    on_demand = {
        posixpath.basename(name).removesuffix(".js"): [base + each for each in _imported([name], sources) if each not in at_once]
        for module in at_once
        for name in _named_in(module, _ON_DEMAND, sources)
    }
    table = json.dumps(on_demand, separators=(",", ":")).replace("<", "\\u003c")
    html = html.replace("<script", f'<script type="application/json" id="{TABLE}">{table}</script>\n    <script', 1)
    # Behind the classic scripts: those ask for the rest, and would be the last to come.
    links = "".join(f'<link rel="modulepreload" href="{name}" />\n    ' for name in at_once)
    html = html.replace('<script type="module"', f'{links}<script type="module"', 1)
    for name, group in _GROUPS.items():
        tag = f'<link rel="stylesheet" href="{name}" />' if name.endswith(".css") else f'<script src="{name}"></script>'
        html = group.sub(tag, html, count=1)
    return _NAMED.sub(rf'\1="{base}\2"', html)


def _imported(modules: Iterable[str], sources: Mapping[str, str]) -> list[str]:
    """Modules and all that they import statically, directly or not, those that are needed first at the beginning."""
    found = dict.fromkeys(modules)
    for name in (waiting := list(found)):
        for other in _named_in(name, _IMPORT, sources):
            if other not in found:
                found[other] = None
                waiting.append(other)
    return list(found)


def _named_in(module: str, statement: re.Pattern[str], sources: Mapping[str, str]) -> list[str]:
    """The modules that are there of those that a module's statements name."""
    folder = posixpath.dirname(module)
    names = [posixpath.normpath(posixpath.join(folder, relative)) for relative in statement.findall(sources.get(module, ""))]
    return [name for name in names if name in sources]
