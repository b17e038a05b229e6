"""Generates the served index.html so that the browser loads the needed files in few requests.

A browser opens six connections to an HTTP/1.1 service, and each request takes a round trip: 0.4 s on a slow line. Therefore
adjacent style sheets are joined to one file, and so are classic scripts; all static imports of the first module, direct and
indirect, are preloaded. One table lists the further imports of modules that are imported on demand, another one the modules of
each view's address, so that `web/js/shell/ahead.js` can request all modules of a view at once.
"""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Iterable, Mapping

__all__ = ["index_of", "joined_files"]

# The element ids that web/js/shell/ahead.js looks for.
TABLE = "view-modules"
ADDRESSES = "view-addresses"

_GROUPS = {
    "css/joined.css": re.compile(r'<link rel="stylesheet" href="css/[^"]+" />(?:\s*<link rel="stylesheet" href="css/[^"]+" />)*'),
    "js/joined.js": re.compile(r'<script src="js/[^"]+"></script>(?:\s*<script src="js/[^"]+"></script>)*'),
}
_LINKED = re.compile(r'(?:href|src)="([^"]+)"')
_REFERENCE = re.compile(r'\b(href|src)="((?:js|css)/[^"]+|icon\.svg)"')
_MODULE = re.compile(r'<script type="module" src="([^"]+)"')
_IMPORT = re.compile(r'^(?:import|export|\})[^"\n]*"(\.{1,2}/[^"]+)"', re.MULTILINE)
_VIEW = re.compile(r'^\s*"([\w/]*)": async \(\) => \(await import\("(\.{1,2}/[^"]+)"\)\)', re.MULTILINE)  # in views/showing.js
_DYNAMIC_IMPORT = re.compile(r'\bawait import\("(\.{1,2}/[^"]+)"\)')


def joined_files(html: str, sources: Mapping[str, str]) -> dict[str, str]:
    """Returns the content of the joined style sheets and scripts, by name.

    sources: text of all files of the page, by name.
    """
    found = {}
    for name, group in _GROUPS.items():
        if (match := group.search(html)) is not None:
            found[name] = "\n".join(sources.get(part, "") for part in _LINKED.findall(match[0]))
    return found


def index_of(html: str, sources: Mapping[str, str], base: str) -> str:
    """Returns the served index.html, with links to the files of one version.

    html: the file index.html. sources: text of all files of the page, by name. base: prefix of the links, such as v/HASH/.
    """
    first = _MODULE.findall(html)
    at_once = _static_imports(first, sources)
    on_demand = {
        posixpath.basename(name).removesuffix(".js"): [
            base + each for each in _static_imports([name], sources) if each not in at_once
        ]
        for module in at_once
        for name in _imported_modules(module, _DYNAMIC_IMPORT, sources)
    }
    views = {
        address: posixpath.basename(name).removesuffix(".js")
        for module in at_once
        for address, name in _VIEW.findall(sources.get(module, ""))
    }
    for element, table in ((TABLE, on_demand), (ADDRESSES, views)):
        text = json.dumps(table, separators=(",", ":")).replace("<", "\\u003c")
        html = html.replace("<script", f'<script type="application/json" id="{element}">{text}</script>\n    <script', 1)
    # After the classic scripts, which request further data and would otherwise arrive last.
    links = "".join(f'<link rel="modulepreload" href="{name}" />\n    ' for name in at_once)
    html = html.replace('<script type="module"', f'{links}<script type="module"', 1)
    for name, group in _GROUPS.items():
        tag = f'<link rel="stylesheet" href="{name}" />' if name.endswith(".css") else f'<script src="{name}"></script>'
        html = group.sub(tag, html, count=1)
    return _REFERENCE.sub(rf'\1="{base}\2"', html)


def _static_imports(modules: Iterable[str], sources: Mapping[str, str]) -> list[str]:
    """Returns the given modules, and all modules that they import statically, directly or indirectly, in import order."""
    found = dict.fromkeys(modules)
    for name in (waiting := list(found)):
        for other in _imported_modules(name, _IMPORT, sources):
            if other not in found:
                found[other] = None
                waiting.append(other)
    return list(found)


def _imported_modules(module: str, statement: re.Pattern[str], sources: Mapping[str, str]) -> list[str]:
    """Returns the modules that one module imports by statements of a given form.

    statement: pattern of the import statement. sources: text of all files by name; modules that are not in it are left out.
    """
    folder = posixpath.dirname(module)
    names = [posixpath.normpath(posixpath.join(folder, relative)) for relative in statement.findall(sources.get(module, ""))]
    return [name for name in names if name in sources]
