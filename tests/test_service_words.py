"""Tests that every sentence of service, workers and readers has a code and a translation in web/words/service.*.json."""

from __future__ import annotations

import ast
import json
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from rayfarm.commands.info import NOTES
from tests.helpers import ROOT

SPEAKERS = ("protocol", "service", "worker", "renderer", "blender/rayfarm_addon/scene")
CALL = re.compile(r"(?<!class )(?<![\w.`])Sentence\((?!\))")
PLACES = re.compile(r"\{\w+\}")
CODE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")


class Said(NamedTuple):
    """A `Sentence` found in the source code, with its code, its parameters, and its place (file:line)."""

    code: str
    template: str
    params: frozenset[str]
    prose: tuple[str, ...]  # English text in its parameters
    at: str


@cache
def _sentences() -> tuple[Said, ...]:
    return tuple(each for name in SPEAKERS for path in sorted((ROOT / name).rglob("*.py")) for each in _of(path))


def _of(path: Path) -> Iterator[Said]:
    for line, node in _calls(path, CALL):
        values = [arg.value if isinstance(arg, ast.Constant) else None for arg in node.args]
        assert len(values) == 2 and all(isinstance(each, str) for each in values), f"{line}: code and template"
        prose = tuple(text for keyword in node.keywords if (text := _prose(keyword.value)))
        params = frozenset(f"{{{keyword.arg}}}" for keyword in node.keywords)
        yield Said(str(values[0]), str(values[1]), params, prose, line)


def _calls(path: Path, start: re.Pattern[str]) -> Iterator[tuple[str, ast.Call]]:
    """Yields (place, call) for each call in the file whose start matches a pattern. The place is file:line."""
    at, source = str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
    for found in start.finditer(source):
        yield f"{at}:{source.count(chr(10), 0, found.start()) + 1}", _call(source, found.start())


def _call(source: str, start: int) -> ast.Call:
    """Returns the parsed call that starts at an offset of the source; parsing whole files takes ten times as long."""
    end = start
    while True:
        end = source.index(")", end) + 1
        try:
            node = ast.parse(source[start:end], mode="eval").body
        except SyntaxError:  # this parenthesis is inside the call
            continue
        assert isinstance(node, ast.Call)
        return node


def _catalogue(language: str) -> dict[str, str]:
    """Returns the texts of a language by code.

    Fails if a code occurs twice, since the later text would silently replace the earlier.
    """
    text = (ROOT / "web" / "words" / f"service.{language}.json").read_text(encoding="utf-8")
    pairs: list[tuple[str, str]] = json.loads(text, object_pairs_hook=list)
    assert not [code for code, count in Counter(code for code, _ in pairs).items() if count > 1]
    return dict(pairs)


def test_each_code_has_one_template() -> None:
    """All sentences with the same code have the same English template.

    A full stop at the end is ignored, since `Sentence.removesuffix` keeps the code.
    """
    templates = defaultdict(set)
    for each in _sentences():
        templates[each.code].add(each.template.removesuffix("."))
    assert not {code: found for code, found in templates.items() if len(found) > 1}


def test_each_template_has_one_code() -> None:
    """All sentences with the same English template have the same code, even if their parameters have different names."""
    codes = defaultdict(set)
    for each in _sentences():
        text = PLACES.sub("{}", each.template).removesuffix(".")
        if re.search(r"[A-Za-z]", PLACES.sub("", each.template)):
            codes[text].add(each.code)
    assert not {text: found for text, found in codes.items() if len(found) > 1}


def test_codes_are_in_kebab_case() -> None:
    assert not [each.code for each in _sentences() if not CODE.fullmatch(each.code)]


def test_sentence_parameters_match_the_template() -> None:
    wrong = [each.at for each in _sentences() if not each.params <= {*PLACES.findall(each.template), "{type}"}]
    assert not wrong, "parameters that the template does not use"


def test_every_sentence_is_translated() -> None:
    known = _catalogue("de")
    left = {each.code: each.at for each in _sentences() if each.code not in known}
    assert not left, "not in service.de.json and service.zh.json"


def test_codes_used_by_the_page_exist() -> None:
    source = (ROOT / "web/js/base/codes.js").read_text(encoding="utf-8") + "".join(
        re.findall(r"const CLOSED = .*", (ROOT / "web/js/base/lasting-socket.js").read_text(encoding="utf-8"))
    )
    used = set(re.findall(r'"([a-z0-9]+(?:-[a-z0-9]+)+)"', source))
    assert used and not used - {each.code for each in _sentences()}
    missing = {each.code for each in _sentences() if re.search(r"not among the (scene's )?files", each.template)}
    assert not missing - used, "add these to MISSING_FILE, so that the page offers to add the file"


def test_page_and_command_line_call_the_same_messages_notes() -> None:
    source = (ROOT / "web/js/base/codes.js").read_text(encoding="utf-8")
    [guessed] = re.findall(r"const GUESSED = \[(.*?)\]", source, re.DOTALL)
    others = re.findall(r'const (?:SEVERAL_SCENES|WITHOUT_LIGHT) = "(.*?)"', source)
    assert len(others) == 2 and {*re.findall(r'"(.*?)"', guessed), *others} == NOTES


def test_catalogues_have_no_unknown_code() -> None:
    assert not _catalogue("de").keys() - {each.code for each in _sentences()}


@pytest.mark.parametrize("language", ["de", "zh"])
def test_translations_have_the_same_parameters(language: str) -> None:
    templates = {each.code: each.template for each in _sentences()}
    catalogue = _catalogue(language)
    assert not [code for code, text in catalogue.items() if {*PLACES.findall(text)} != {*PLACES.findall(templates[code])}]


def test_both_catalogues_have_the_same_sentences_in_order() -> None:
    german, chinese = _catalogue("de"), _catalogue("zh")
    assert list(german) == list(chinese) == sorted(german)


READERS = ("renderer/scene", "renderer/confine")
PROSE = re.compile(r"[A-Za-z]{2,},? [A-Za-z{]")
FAULT = re.compile(r"(?<=\braise )(SceneError|DamagedError|MachineError|SettingsError|RayfarmError|ValueError)\(")


def _trees(folders: tuple[str, ...]) -> Iterator[tuple[str, ast.Module]]:
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))


def _prose(node: ast.expr) -> str | None:
    """Returns the English text that an expression itself contains, with {} for values; None if it contains none.

    Text within a `Sentence` does not count.
    """
    if isinstance(node, ast.IfExp):
        return _prose(node.body) or _prose(node.orelse)
    if isinstance(node, ast.BoolOp):
        return next((found for each in node.values if (found := _prose(each))), None)
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    text = "".join(str(each.value) if isinstance(each, ast.Constant) and isinstance(each.value, str) else "{}" for each in parts)
    return text if PROSE.search(text) else None


def test_readers_raise_sentences_with_codes() -> None:
    plain = [
        f"{at}: {text}"
        for folder in READERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for at, node in _calls(path, FAULT)
        if node.args and (text := _prose(node.args[0]))
    ]
    assert not plain


def test_parameters_are_not_prose() -> None:
    """No parameter of a sentence is English text, which would stay untranslated; a phrase must be a `Sentence` of its own."""
    assert not [f"{each.at}: {text}" for each in _sentences() for text in each.prose]


SINKS = {"append", "warn", "add_warning", "fail_frame", "give_verdict", "failure_event", "with_full_stop", "joined_sentences"}
LISTS = {"warnings", "notes", "_warnings", "_notes", "missing"}
# Faults that programs and logs read: what the command line prints is in English, like these.
PLAIN_FAULTS = {
    "IndexError",
    *("StartupError", "SystemExit", "AssertionError", "KeyError", "TypeError", "NotImplementedError", "RuntimeError"),
    *("ValueError", "Unusable", "ParamError", "BadParameter", "UsageError", "CompileError", "LinkedError"),
}
# Modules whose texts stay on a machine: what a worker prints as it starts, log lines, names of threads' errors.
TERMINAL = {
    *("worker/__main__.py", "worker/site/reducer.py", "worker/site/socket_deadline.py", "worker/process/redis_lock.py"),
    *("service/access/oidc.py", "service/http/forward.py", "service/intake/unpack.py", "renderer/scene/readers/trimesh_files.py"),
}
NUMBERED = re.compile(r"(camera|light|material|mesh) \{\}")  # names of unnamed things
DEEPEST = 4


class _Flow:
    """Data flow of one module: finds the English texts that may be the value of an expression."""

    def __init__(self, tree: ast.Module) -> None:
        self._functions: dict[str, list[ast.expr]] = defaultdict(list)
        self._values: dict[str, list[ast.expr]] = defaultdict(list)  # of variables and attributes, by name
        self._local: dict[ast.AST, dict[str, list[ast.expr]]] = defaultdict(lambda: defaultdict(list))
        self.spoken: list[tuple[ast.expr, ast.AST | None]] = []  # each text given to users, and its enclosing function
        whole = {tree, *(each for each in tree.body if isinstance(each, ast.ClassDef))}
        # One pass, since the modules have half a million nodes: (node, owner of its variables, enclosing functions).
        left: list[tuple[ast.AST, ast.AST, tuple[ast.FunctionDef | ast.AsyncFunctionDef, ...]]] = [(tree, tree, ())]
        while left:
            node, owner, functions = left.pop()
            match node:
                case ast.Name() | ast.Constant():
                    continue
                case ast.FunctionDef() | ast.AsyncFunctionDef():
                    owner, functions = node, (*functions, node)
                case ast.ClassDef() | ast.Lambda():
                    owner = node
                case ast.Return(value=ast.expr() as value):
                    for function in functions:
                        self._functions[function.name].append(value)
                case ast.Assign(targets=targets, value=value):
                    self._assign(targets, value, self._values if owner in whole else self._local[owner])
                case ast.AnnAssign(target=target, value=ast.expr() as value) | ast.NamedExpr(target=target, value=value):
                    self._assign([target], value, self._values if owner in whole else self._local[owner])
                case ast.AugAssign(target=target, value=value):
                    self._assign([target], value, self._values if owner in whole else self._local[owner])
            self.spoken += ((each, functions[-1] if functions else None) for each in _spoken(node))
            left += [(each, owner, functions) for each in ast.iter_child_nodes(node)]

    @staticmethod
    def _assign(targets: list[ast.expr], value: ast.expr, values: dict[str, list[ast.expr]]) -> None:
        for target in targets:
            if isinstance(target, ast.Name):
                values[target.id].append(value)

    def prose_of(self, node: ast.expr, function: ast.AST | None, depth: int = 0) -> str | None:
        """Returns an English text outside of `Sentence` that may be the expression's value; None if there is none.

        Variables, attributes and function calls are followed to at most DEEPEST assignments. function: the one that contains the
        expression, or None.
        """
        if (found := _prose(node)) is not None:
            return found
        if depth > DEEPEST:
            return None
        return next((text for each in self._sources(node, function) if (text := self.prose_of(each, None, depth + 1))), None)

    def _sources(self, node: ast.expr, function: ast.AST | None) -> list[ast.expr]:
        match node:
            case ast.Name(id=name):
                local = self._local.get(function, {}) if function is not None else {}
                return local.get(name) or self._values.get(name, [])
            case ast.Attribute(value=ast.Name(id=owner), attr=name) if owner[:1].isupper() or owner in ("self", "cls"):
                return self._values.get(name, [])
            case ast.JoinedStr(values=values):
                return [each.value for each in values if isinstance(each, ast.FormattedValue)]
            case ast.BinOp(left=left, right=right, op=ast.Add()):
                return [left, right]
            case ast.IfExp(body=body, orelse=orelse):
                return [body, orelse]
            case ast.BoolOp(values=values) | ast.Tuple(elts=values) | ast.List(elts=values):
                return list(values)
            case ast.Subscript(value=value):
                return [value]
            case ast.Dict(values=values):
                return list(values)
            case ast.Call(func=ast.Attribute(value=value, attr="get" | "join" | "removesuffix" | "rstrip")):
                return [value, *node.args]
            case ast.Call(func=ast.Name(id="Sentence")):
                return [each.value for each in node.keywords]
            case ast.Call(func=ast.Name(id="str"), args=args):
                return list(args)
            case ast.Call(func=ast.Name(id=name)) | ast.Call(func=ast.Attribute(value=ast.Name(id="self"), attr=name)):
                return self._functions.get(name, [])
        return []


def _spoken(node: ast.AST) -> list[ast.expr]:
    """Returns each text that a statement or call gives to an error, warning, note or state."""
    if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
        return node.exc.args if _name(node.exc.func) not in PLAIN_FAULTS else []
    if isinstance(node, ast.Call):
        name = _name(node.func)
        if name == "Sentence" or (name in SINKS and (name != "append" or _name(getattr(node.func, "value", None)) in LISTS)):
            return [*(node.args if name != "Sentence" else []), *(each.value for each in node.keywords)]
    return [node.value] if isinstance(node, ast.AugAssign) and _name(node.target) in LISTS else []


def _name(node: ast.AST | None) -> str:
    """Returns the name of a variable, or the last name of an attribute."""
    return str(getattr(node, "id", getattr(node, "attr", "")))


def test_no_prose_reaches_users_through_variables() -> None:
    """No English text reaches users without a code, even if a variable, function or attribute holds it.

    This covers the texts of errors, warnings, notes and sentences' parameters.
    """
    plain = []
    for at, tree in _trees(("service", "worker", "protocol", "renderer/scene", "renderer/blender", "renderer/confine")):
        if at in TERMINAL:
            continue
        flow = _Flow(tree)
        plain += [
            f"{at}:{node.lineno}: {text}"
            for node, function in flow.spoken
            if (text := flow.prose_of(node, function)) is not None and not NUMBERED.fullmatch(text)
        ]
    assert not plain
